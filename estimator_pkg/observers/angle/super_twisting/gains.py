# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Gains of the matching form of super-twisting, and what noise makes of them.

With s = dt (L/|e|)^(1/(n+1)), dt times the speed of the error dynamics at an innovation e, the
gains are those of a Taylor chain whose eigenvalues are exp(s p_i); p_i are the roots of the
coefficients. For one size of innovation the observer is linear, and its noise gains follow.
"""

from __future__ import annotations

import cmath
import math
from typing import Annotated

import numpy as np

from estimator_pkg.observers.angle.shared import SharedDesign
from estimator_pkg.observers.maths.steady_noise import steady_variances
from estimator_pkg.observers.maths.tracking import noise_of_three, noise_of_two
from estimator_pkg.record import record

# c_1 .. c_{n+1} for a bound of 1; larger ones converge faster and are noisier.
COEFFICIENTS = {1: (1.5, 1.1), 2: (2.0, 2.12, 1.1), 3: (3.0, 4.16, 3.06, 1.1)}

ZERO_INNOVATION = 1e-150  # innovations below this are zero: no power of them overflows
TABLE = 48  # points of the noise table
TABLE_FROM = -3.0  # log10 of the smallest speed of the error dynamics in it
TABLE_STEP = 0.1


@record
class Roots:
    """Roots of p^m + c_1 p^(m-1) + ..., in units of (L/|e|)^(1/(n+1))."""

    single: float  # the real one (order 2)
    real: float  # of a pair
    imaginary: float
    real_2: float  # of the second pair (order 3)
    imaginary_2: float


@record
class Design:
    """What the gains imply whatever the sample time is."""

    shared: SharedDesign
    explicit: bool  # sampled by forward Euler; else with matched eigenvalues
    order: int  # n
    scale: float  # L^(1/(n+1))
    c1: float  # of the differentiator; those beyond n + 1 are 0
    c2: float
    c3: float
    c4: float
    roots: Roots
    table: Annotated[list[list[float]], TABLE, 3]  # logarithms of noise gains (order 3)
    longest_dt: float  # [s] beyond which it chatters over more than an eighth of a turn


def matched(order: int, s: float, roots: Roots) -> tuple[float, float, float, float]:
    """Return the gains of position, velocity dt, acceleration dt^2 and jerk dt^3.

    Parameters
    ----------
    s : dt times the speed (L/|e|)^(1/(n+1)) of the error dynamics.
    """
    total, product = pair(s, roots.real, roots.imaginary)
    if order == 1:
        return total - product, product, 0.0, 0.0
    if order == 2:
        d = -math.expm1(roots.single * s)
        e2, e3 = product + total * d, product * d
        return total + d - e2 + e3, e2 - 1.5 * e3, e3, 0.0
    total_2, product_2 = pair(s, roots.real_2, roots.imaginary_2)
    e2, e3 = product + product_2 + total * total_2, total * product_2 + total_2 * product
    e4 = product * product_2
    return (total + total_2 - e2 + e3 - e4, e2 - 1.5 * e3 + 11.0 / 6.0 * e4, e3 - 2.0 * e4, e4)


def pair(s: float, real: float, imaginary: float) -> tuple[float, float]:
    """Return sum and product of 1 - z for the eigenvalues z = exp(s (real +- i imaginary)).

    Made of 1 - |z| and of 2 (|z| - Re z), so that no digits are lost where s is small.
    """
    short = -math.expm1(real * s)
    half = math.sin(0.5 * imaginary * s)
    turned = 4.0 * (1.0 - short) * half * half
    return 2.0 * short + turned, short * short + turned


def noise_gains_at(power: float, dt: float, design: Design) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise.

    Parameters
    ----------
    power : mean square innovation [rad^2].
    """
    if power < ZERO_INNOVATION:
        power = ZERO_INNOVATION
    # dt times the speed of the error dynamics
    s = dt * design.scale / math.pow(power, 0.5 / (design.order + 1.0))
    if design.order == 3:
        return tabled(s, dt, design)
    k0, k1, k2, k3 = matched(design.order, s, design.roots)
    if design.order == 1:
        return noise_of_two(k0, k1, dt)
    return noise_of_three(k0, k1, k2, dt)


def tabled(s: float, dt: float, design: Design) -> tuple[float, float, float]:
    """Return the noise gains of order 3, which have no short closed form, from the table."""
    at = (math.log10(s) - TABLE_FROM) / TABLE_STEP
    if at < 0.0:
        at = 0.0
    elif at > TABLE - 1.001:
        at = TABLE - 1.001
    i = int(at)
    part, rate, row, after = at - i, 1.0 / dt, design.table[i], design.table[i + 1]
    return (
        math.exp(row[0] + part * (after[0] - row[0])),
        math.exp(row[1] + part * (after[1] - row[1])) * (rate * rate),
        math.exp(row[2] + part * (after[2] - row[2])),
    )


def roots_of(order: int) -> Roots:
    """Return the roots of p^m + c_1 p^(m-1) + ..., with the c_i of this order."""
    found = np.roots((1.0, *COEFFICIENTS[order]))
    pairs = [complex(root) for root in sorted(found, key=cmath.phase) if root.imag > 1e-9]
    reals = [float(root.real) for root in found if abs(root.imag) <= 1e-9]
    made = Roots()
    made.single = reals[0] if reals else 0.0
    made.real, made.imaginary = pairs[0].real, pairs[0].imag
    if len(pairs) > 1:
        made.real_2, made.imaginary_2 = pairs[1].real, pairs[1].imag
    return made


def noise_table(roots: Roots) -> tuple[tuple[float, ...], ...]:
    """Return logarithms of the noise gains of order 3 at dt = 1, shape (TABLE, 3).

    One row for each speed of the error dynamics.
    """
    chain = np.array(
        [[1.0 / math.factorial(j - i) if j >= i else 0.0 for j in range(4)] for i in range(4)]
    )
    return tuple(
        tuple(
            math.log(gain)
            for gain in steady_variances(
                chain, np.array(matched(3, 10.0 ** (TABLE_FROM + TABLE_STEP * point), roots))
            )
        )
        for point in range(TABLE)
    )
