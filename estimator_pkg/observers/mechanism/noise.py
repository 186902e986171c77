# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Variances of an observer of a mechanism at one configuration: measurement noise, model error.

White noise gives a white innovation. An error of the model gives a slow one, m: then 0 = e' =
-L m + V x, so that the velocities are wrong by V x = L m. Its size follows from the innovation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimator_pkg.models.mechanics import Array, Mechanics
from estimator_pkg.observers.maths.linear import exponential
from estimator_pkg.observers.maths.steady_noise import steady_covariance

GRID = 0.03  # relative spacing of the cached variances in position, dt and innovation
CACHE_SIZE = 4096  # largest number of cached variances


def discrete(A: Array, n: int, dt: float, *, euler: bool, linear_hold: bool) -> tuple[Array, Array]:
    """Return (Phi, W) of the error over one sample: z+ = Phi z + W (y_k - y_{k-1}).

    Their shapes are (m, m) and (m, n), in the units of z = (e, x, d) and of the measurement.

    Parameters
    ----------
    A : of z' = A z, shape (m, m) [1/s], with e' containing -rate of the measurement.
    n : number of positions. dt : sample time [s].
    """
    size = len(A)
    arrival = np.zeros((size, n))
    arrival[:n] = -np.eye(n)
    if euler:
        return np.eye(size) + dt * A, arrival
    block = np.zeros((size + n, size + n))
    block[:size, :size], block[:size, size:] = dt * A, arrival
    whole = exponential(block, block)
    return whole[:size, :size], whole[:size, size:] if linear_hold else arrival


class NoiseGains(NamedTuple):
    """Variances of an observer in steady state; infinite where it is unstable."""

    position: Array  # per noise variance, shape (n, n): row i for position i, column j for noise j
    velocity: Array
    innovation: Array
    own_position: Array  # without noise, from the chattering of a sliding mode, shape (n,)
    own_velocity: Array
    own_innovation: Array


def noise_gains(A: Array, shown: Array, dt: float, euler: bool, linear_hold: bool) -> NoiseGains:
    """Return the variances of an observer with a linear error system.

    The innovation is e, estimate minus measurement.

    Parameters
    ----------
    A : of (e, x, d)' = A (e, x, d), shape (m, m) [1/s].
    shown : V of velocities = V x, shape (n, n).
    dt : sample time [s].
    euler : the step is forward Euler.
    linear_hold : the measurement is interpolated linearly between samples.
    """
    n = len(shown)
    step, arrival = discrete(A, n, dt, euler=euler, linear_hold=linear_hold)
    size = len(A)
    nothing = np.zeros(n)
    # the error of the estimate is e + n_k, which is bounded if Phi is stable; a common drift of
    # estimate and measurement, as at rest, does not matter
    if max(abs(np.linalg.eigvals(step))) >= 1.0:
        without = np.full((n, n), np.inf)
        return NoiseGains(without, without, without, nothing, nothing, nothing)
    # the noise of the previous sample is a state: z+ = Phi z + W (n_k - n_{k-1})
    transition = np.zeros((size + n, size + n))
    transition[:size, :size], transition[:size, size:] = step, -arrival
    entering = np.vstack([arrival, np.eye(n)])
    inward = np.hstack([np.eye(n), np.zeros((n, size - n)), np.eye(n)])
    velocity = np.hstack(
        [np.zeros((n, n)), shown, np.zeros((n, size - n - shown.shape[1])), np.zeros((n, n))]
    )
    offset = np.hstack([np.eye(n), np.zeros((n, size))])
    outputs = inward, velocity, offset
    of_position, of_velocity, of_innovation = per_noise(transition, entering, outputs)
    return NoiseGains(of_position, of_velocity, of_innovation, nothing, nothing, nothing)


def per_noise(transition: Array, entering: Array, outputs: Sequence[Array]) -> list[Array]:
    """Return the variances of outputs per variance of the noise of each measurement.

    The states z+ = transition z + entering n have white noises n, as many as positions; an output
    is rows z. Row i, column j of a result, shape (n, n), is for row i and noise j.
    """
    states = [steady_covariance(transition, np.outer(each, each)) for each in entering.T]
    return [np.stack([variances(rows, each) for each in states], axis=1) for rows in outputs]


def variances(rows: Array, covariance: Array) -> Array:
    """Return the variances of rows z, shape (n,), where z has this covariance."""
    found: Array = np.einsum('ij,jk,ik->i', rows, covariance, rows)
    return found


class StandardDeviations:
    """Standard deviations of an observer's estimates.

    The variances per noise depend on configuration and dt, and on the size of the innovation if the
    observer is not linear. They are computed on a grid of these and cached. The slow part of the
    innovation adds the error of the model, as far as white noise does not explain it.

    Parameters
    ----------
    noise, quantum : standard deviation of the noise and quantum of each position [rad or m].
    noise_gains, linear, by_size : of the observer.
    measured : the noise is not a parameter, but estimated from the innovation.
    """

    def __init__(
        self,
        mechanics: Mechanics,
        noise: tuple[float, ...],
        quantum: tuple[float, ...],
        noise_gains: Callable[[Array, Array, float], NoiseGains],
        linear: Callable[[Array, Array], tuple[Array, Array]],
        *,
        by_size: bool,
        measured: bool,
    ) -> None:
        self._mechanics, self._noise_gains, self._linear = mechanics, noise_gains, linear
        self._by_size, self._measured = by_size, measured
        self._floor = np.array(quantum) ** 2 / 12.0
        self._variance = np.array(noise) ** 2 + self._floor
        self._spacing = GRID * np.array(mechanics.reach)
        self._gains = lru_cache(CACHE_SIZE)(self._found)

    def _found(
        self, place: tuple[float, ...], sizes: tuple[float, ...], period: int
    ) -> tuple[NoiseGains, Array, Array] | None:
        """Return (variances, inverse of the innovation's, L^2 by entry); None: not finite."""
        n = self._mechanics.degrees
        at, dt = self._spacing * np.array(place), math.exp(GRID * period)
        power = np.exp(2.0 * GRID * np.array(sizes))
        if not self._mechanics.admits(at):
            return None
        try:
            with np.errstate(all='ignore'):  # checked for finite values below
                found = self._noise_gains(at, power, dt)
                A, _ = self._linear(at, power)
        except np.linalg.LinAlgError:  # overflow in an intermediate result
            return None
        if not all(np.all(np.isfinite(each)) for each in found):
            return None
        # rounding may make a variance near zero negative
        found = NoiseGains(*(np.maximum(each, 0.0) for each in found))
        back: Array = np.array(np.linalg.pinv(found.innovation), float)
        return found, back, np.square(A[:n, :n])

    def __call__(
        self,
        at: Array,
        squares: Array,
        drift_squares: Array,
        of_white: float,
        late: Array,
        dt: float,
    ) -> tuple[list[float], list[float]]:
        """Return the standard deviations of all positions and of all velocities.

        Parameters
        ----------
        squares, drift_squares : mean squares of the innovation and of its slow part, of which white
            noise has the part `of_white`.
        late : errors of the velocities that are not in the innovation.
        """
        power = np.maximum(squares, 1e-300)
        sizes = np.round(0.5 * np.log(power) / GRID) if self._by_size else np.zeros(len(at))
        kept = self._gains(
            tuple(np.round(at / self._spacing).tolist()),
            tuple(sizes.tolist()),
            round(math.log(dt) / GRID),
        )
        if kept is None:
            return ([math.inf] * len(at),) * 2
        found, back, L_squared = kept
        slow = np.maximum(drift_squares - of_white * squares, 0.0)
        used = self._variance
        if self._measured:
            used = np.maximum(back @ (power - found.own_innovation), self._floor)
        position = found.position @ used + found.own_position + slow
        velocity = found.velocity @ used + found.own_velocity + L_squared @ slow + late**2
        return np.sqrt(position).tolist(), np.sqrt(velocity).tolist()
