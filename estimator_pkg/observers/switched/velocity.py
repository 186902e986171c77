# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The published position and velocity: from extended observers, or from the cascade.

A stage of super-twisting bounds the change of the velocity by L. If the encoder's quantum is q, the
stage responds to each quantum with a jump of L dt. Its error is then about sqrt(L q) and it lags by
samples, even if Z is exact. For noisy encoders an extended observer therefore estimates the chain
of each output again, with the estimated Z and a disturbance w as one more state:

    x_j' = x_{j+1},  x_k' = Gamma(x, u) + Lambda(x, u) Z + w,  w' = 0,  corrected by y - x_1

All its poles are equal. While Z is unknown, at the start or after an event, w contains all of the
acceleration, or its change, and the velocity is that of a high-gain observer. When Z changes, w
changes by the opposite amount, so that the acceleration does not jump.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.maths.steady_noise import steady_variances
from estimator_pkg.observers.maths.vectors import dot
from estimator_pkg.observers.switched.state import State
from estimator_pkg.observers.switched.system import System

SMALLEST, LARGEST, POINTS = 1e-4, 20.0, 65  # grid of pole times dt for the table of variances
FORGET = 0.02  # weight of the newest sample in the innovation's mean square

Correction = tuple[tuple[float, ...], tuple[float, ...], tuple[float, float, float]]


@dataclass(frozen=True)
class Poles:
    """An observer of n integrators with n equal poles, for any dt.

    Attributes
    ----------
    pole : magnitude of the poles [1/s].
    weights : shape (n, n): row j belongs to (1 - exp(-pole dt))^(j + 1) in the gains at dt = 1.
    noise : log of (position, velocity, innovation) variances at dt = 1 and unit noise, (POINTS, 3).
    """

    pole: float
    weights: tuple[tuple[float, ...], ...]
    noise: NDArray[np.float64]

    def at(self, dt: float) -> Correction:
        """Return gains, Taylor's factors dt^i/i!, and the variances at unit noise; dt in s.

        The variances are those of position, velocity and innovation.
        """
        decayed = 1.0 - math.exp(-self.pole * dt)
        n = len(self.weights)
        gains = tuple(
            sum(decayed ** (j + 1) * self.weights[j][i] for j in range(n)) / dt**i for i in range(n)
        )
        place = np.log(self.pole * dt)
        position, velocity, innovation = (
            math.exp(np.interp(place, _places(), self.noise[:, c])) for c in range(3)
        )
        return (
            gains,
            tuple(dt**i / math.factorial(i) for i in range(n)),
            (position, velocity / (dt * dt), innovation),
        )


def poles(length: int, bandwidth_hz: float) -> Poles:
    """Return the observer of a chain of this length and its disturbance.

    `bandwidth_hz` is the -3 dB frequency from true to estimated velocity. The gains at dt = 1 are
    those of Ackermann's formula. A - 1 is nilpotent, so they are polynomials in 1 - exp(-pole dt)
    and keep their digits at high sample rates.
    """
    n = length + 1
    weights, noise = _unit(n)
    return Poles(2.0 * math.pi * bandwidth_hz / _unit_bandwidth(n), weights, noise)


def _places() -> NDArray[np.float64]:
    return np.linspace(math.log(SMALLEST), math.log(LARGEST), POINTS, dtype=np.float64)


@lru_cache
def _unit(n: int) -> tuple[tuple[tuple[float, ...], ...], NDArray[np.float64]]:
    """Return (weights, noise) of `Poles` at dt = 1."""
    a = np.array(
        [[1.0 / math.factorial(j - i) if j >= i else 0.0 for j in range(n)] for i in range(n)]
    )
    seen = np.vstack([np.linalg.matrix_power(a, i)[0] for i in range(n)])
    last = np.linalg.solve(seen, np.eye(n)[:, -1])
    weights = [
        math.comb(n, j) * np.linalg.solve(a, np.linalg.matrix_power(a - np.eye(n), n - j) @ last)
        for j in range(1, n + 1)
    ]
    noise = []
    for place in np.exp(_places()):
        gain = sum((1.0 - math.exp(-place)) ** (j + 1) * weights[j] for j in range(n))
        noise.append(steady_variances(a, np.asarray(gain)))
    return tuple(tuple(row.tolist()) for row in weights), np.log(noise)


@lru_cache
def _unit_bandwidth(n: int) -> float:
    """Return the -3 dB frequency [rad/s] from true to estimated velocity, n poles at -1."""

    def gain(w: float) -> float:
        s = 1j * w
        return abs(sum(math.comb(n, i) * s ** (n - i) for i in range(2, n + 1)) / (s + 1.0) ** n)

    low, high = 0.0, 1.0
    while gain(high) > math.sqrt(0.5):
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gain(middle) > math.sqrt(0.5) else (low, middle)
    return low


def observe(
    system: System, state: State, y: tuple, u: tuple, z: tuple, corrections: tuple[Correction, ...]
) -> State:
    """Return the state after one more sample in the extended observers.

    `y` and `u` are those of the new sample. `z` should have converged: otherwise its noise enters
    the velocity.
    """
    zeta = _chains(state)
    rows = zip(system.model.gamma(zeta, u), system.model.lam(zeta, u))
    observed, powers = [], []
    for i, (gamma, row) in enumerate(rows):
        gains, factors, noise = corrections[i]
        lam = tuple(map(float, row))
        rest = _unexplained(system, state, i, lam, z)
        x = (*state.observed[i][:-1], float(gamma) + dot(lam, z) + rest)
        n = len(x)
        ahead = [sum(factors[j - first] * x[j] for j in range(first, n)) for first in range(n)]
        ahead[-1] = rest
        error = y[i] - ahead[0]
        observed.append(tuple(a + k * error for a, k in zip(ahead, gains)))
        power = state.powers[i]
        powers.append(power + FORGET * (error * error / noise[2] - power))
    return state._replace(
        observed=tuple(observed),
        powers=tuple(powers),
        used=z,
        noises=tuple(each[2] for each in corrections),
    )


def _chains(state: State) -> tuple[float, ...]:
    """Return zeta of the extended observers."""
    return tuple(x for each in state.observed for x in each[:-1])


def _unexplained(system: System, state: State, i: int, lam: tuple, z: tuple) -> float:
    """Return the disturbance w of output i after the Z in use changes to z."""
    change = tuple(old - new for old, new in zip(state.used, z))
    return float(state.observed[i][-1] + dot(lam, change))


def moved_observers(
    system: System, state: State, old: tuple, new: tuple
) -> tuple[tuple[float, ...], ...]:
    """Return the extended observers after Z has jumped from `old`, its latest value, to `new`."""
    model, zeta = system.model, _chains(state)
    after, rows = moved_chain(system, zeta, old, new), model.lam(zeta, state.u)
    return tuple(
        (*after[first : first + k], _unexplained(system, state, i, tuple(map(float, row)), old))
        for i, (first, k, row) in enumerate(zip(model.firsts, model.indices, rows))
    )


def moved_chain(system: System, zeta: tuple, old: tuple, new: tuple) -> tuple[float, ...]:
    """Return zeta after Z has jumped from `old` to `new`, by (13): x is continuous."""
    model = system.model
    return model.zeta(model.state(zeta, old), new)


def motions(
    system: System, state: State, z: tuple, converged: bool
) -> list[tuple[float, float, float]]:
    """Return (position, velocity, acceleration or nan) of each output at the newest sample.

    Once Z has converged, the acceleration is that of the model without w, which is less noisy.
    """
    if not system.is_filtered:
        return _of_cascade(system, state, z, converged)
    endings = system.ending(_chains(state), state.u, state.used)
    found = []
    for k, x, ending in zip(system.model.indices, state.observed, endings):
        whole = ending + x[-1]
        if k == 1:
            found.append((x[0], whole, math.nan))
        else:
            found.append((x[0], x[1], x[2] if k > 2 else ending if converged else whole))
    return found


def _of_cascade(
    system: System, state: State, z: tuple, converged: bool
) -> list[tuple[float, float, float]]:
    """Return the motions from the auxiliary states.

    In sliding mode an implicit stage gives the mean derivative over the last interval. Half an
    interval of acceleration moves it to the newest sample.
    """
    endings = system.ending(system.chains(state)[0], state.u, z)
    found = []
    for i, k in enumerate(system.model.indices):
        own = state.zt[i]
        if k == 1:
            found.append((state.zh[i][0], own[0], math.nan))
            continue
        acceleration = endings[i] if k == 2 and converged else own[1]
        carried = 0.5 * state.dt * acceleration if system.is_implicit else 0.0
        found.append((state.zh[i][0], own[0] + carried, acceleration))
    return found


def standard_deviations(system: System, state: State, i: int, sigma: float) -> tuple[float, float]:
    """Return standard deviations of position and velocity of output i, for noise sigma [rad or m].

    The mean squared innovation of the extended observer replaces the noise variance if it is
    larger. The cascade bounds the acceleration by L, so its velocity error is sqrt(L sigma).
    """
    if system.is_filtered:
        position, velocity, _ = state.noises[i]
        seen = max(sigma * sigma, state.powers[i])
        return math.sqrt(position * seen), math.sqrt(velocity * seen)
    bound = system.gains.bound_scale * system.model.bounds[i][0]
    return sigma, math.sqrt(bound * sigma)
