# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records of the hybrid observer, and its gains: from bandwidth to symbols, poles and limits.

The continuous designs, in the symbols of Brentari et al. (2018), section III:

    order 2   l = (k1/eps, k2/eps^2)             error polynomial (eps s)^2 + k1 (eps s) + k2
    order 3   l = (k1/eps, k2/eps^2, k3/eps^3)   (eps s)^3 + k1 (eps s)^2 + k2 (eps s) + k3
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.shared import SharedDesign
from estimator_pkg.observers.maths.tracking import bandwidth_ratio
from estimator_pkg.record import record

PAPER = (6.0, 5.0)  # k1, k2 of the paper's simulations and experiments: poles -1, -5
TRIPLE_POLE = (3.0, 3.0, 1.0)  # k1, k2, k3 of the third order: a triple pole at -1

LEAST_DAMPING = 0.01  # of each pole
LEAST_DECAY = 1e-6  # of the slowest pole, in the fastest


@record
class Design:
    """What the gains imply whatever the sample time is."""

    shared: SharedDesign
    order: int
    paper: bool  # Algorithm 1; else the robust form
    injection: int  # which, see `injections`
    saturation: float  # M [rad]
    margin: float  # delta_pi [rad]
    # the poles of the robust form: single, decay +- sqrt(discriminant), see `tracking.matched`
    triple: bool  # all three poles are one
    single: float  # the pole next to the pair [1/s]; order 2: 0
    decay: float  # of the pair [1/s]
    discriminant: float  # of the pair [1/s^2]
    reset_from: float  # errors from here on are reset (J2) instead of injected [rad]
    doubtful: float  # innovations beyond it are [rad], see `robust`
    fastest: float  # speed limit [rad/s]
    # Algorithm 1: L = (k1/eps, k2/eps^2), section III
    l1: float  # [1/s]
    l2: float  # [1/s^2]
    epsilon: float  # [s]
    bandwidth_hz: float
    ratio: float  # largest stable T/epsilon


@record
class Coefficients:
    """What follows from the sample time."""

    dt: float  # [s]
    alpha: float
    beta: float  # over dt [1/s]
    gamma: float  # over dt^2 [1/s^2]
    z: float  # of the single or triple pole
    pace: float  # of the slowest pole of Algorithm 1 [1/s]


@record
class Core:
    """The observer itself."""

    position: float  # [rad]
    velocity: float  # [rad/s]
    acceleration: float  # [rad/s^2]; order 2: nan
    last: float  # last measurement [rad]
    error: float  # that the last correction left [rad]
    # 0 in steady state, the number of samples so far in a start, and less the number of samples
    # held while astray
    phase: float


class Continuous(NamedTuple):
    """A continuous design."""

    k: tuple[float, ...]  # (k1, k2) or (k1, k2, k3)
    epsilon: float  # high-gain scale [s]
    poles: tuple[complex, ...]  # of the error [rad/s], all with positive real part (-s)
    bandwidth_hz: float  # -3 dB frequency from true to estimated velocity [Hz]

    @property
    def slowest(self) -> float:
        """Decay rate of the slowest pole [1/s]."""
        return min(pole.real for pole in self.poles)

    @property
    def triple(self) -> bool:
        """True where all three poles are one."""
        return self.k == TRIPLE_POLE


def continuous_design(
    order: int, bandwidth_hz: float, gains: Sequence[float | None], epsilon: float | None
) -> Continuous:
    """Return the design that these parameters mean; what is None follows.

    Parameters
    ----------
    order : 2 or 3. gains : k1, k2, k3. bandwidth_hz : used where `epsilon` is None.

    Raises
    ------
    UsageError : the error polynomial is not Hurwitz, or only just so, or poles are decades apart,
        or a gain of the other order is set.
    """
    _, _, k3 = gains
    if order == 2 and k3 is not None:
        raise UsageError("parameter 'k3' belongs to order 3, and the order is 2")
    usual = PAPER if order == 2 else TRIPLE_POLE
    k = tuple(float(default if given is None else given) for given, default in zip(gains, usual))
    if order == 3 and k[0] * k[1] <= k[2]:  # Routh and Hurwitz
        raise UsageError(
            f'k1 k2 = {k[0] * k[1]:g} must exceed k3 = {k[2]:g}, '
            'or the third-order observer is unstable'
        )
    roots = [1.0 + 0.0j] * 3 if k == TRIPLE_POLE else [-complex(r) for r in np.roots((1.0, *k))]
    slow = LEAST_DECAY * max(abs(root) for root in roots)
    if not all(root.real >= max(LEAST_DAMPING * abs(root), slow) for root in roots):
        named = ', '.join(f'k{i + 1} = {gain:g}' for i, gain in enumerate(k))
        raise UsageError(
            f'{named} leave the error of the observer hardly damped, or with poles more '
            f'than {1.0 / LEAST_DECAY:g} apart'
        )
    unit = unit_bandwidth(k)
    if epsilon is None:
        epsilon = unit / (2.0 * math.pi * bandwidth_hz)
    return Continuous(
        k, epsilon, tuple(root / epsilon for root in roots), unit / (2.0 * math.pi * epsilon)
    )


def unit_bandwidth(k: tuple[float, ...]) -> float:
    """Return the -3 dB frequency [rad/s] from true to estimated velocity at epsilon = 1 s.

    Order 2: k2/(s^2 + k1 s + k2). Order 3: (k2 s + k3)/(s^3 + k1 s^2 + k2 s + k3).
    """
    if len(k) == 2:
        k1, k2 = k
        natural = math.sqrt(k2)
        return natural * bandwidth_ratio(0.5 * k1 / natural)
    k1, k2, k3 = k
    # |D|^2 - 2 |N|^2 in u = w^2
    power = (1.0, k1 * k1 - 2.0 * k2, -k2 * k2 - 2.0 * k1 * k3, -k3 * k3)
    crossings = [
        root.real
        for root in np.roots(power)
        if abs(root.imag) < 1e-9 * abs(root) and root.real > 0.0
    ]
    return math.sqrt(min(crossings))


def paper_limit(k: tuple[float, ...]) -> float:
    """Return the largest stable T/epsilon of Algorithm 1.

    Its z-polynomial z^2 - (2 - a - b) z + 1 - a, with a = k1 r, b = k2 r^2, r = T/epsilon, leaves
    the unit circle at z = -1: k2 r^2 + 2 k1 r - 4 = 0.
    """
    k1, k2 = k
    return (math.sqrt(k1 * k1 + 4.0 * k2) - k1) / k2
