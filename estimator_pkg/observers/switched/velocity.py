# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Published velocity, and position: from extended observers, or from the cascade.

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
from bisect import bisect_right
from functools import lru_cache

import numpy as np

from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.observers.maths.steady_noise import steady_variances
from estimator_pkg.observers.switched.stages import chains, ending, moved_chain
from estimator_pkg.observers.switched.state import Array, Coefficients, Correction, Design, State

GRID_FROM, GRID_TO, GRID_POINTS = 1e-4, 20.0, 65  # grid of pole times dt for the table of variances
LOG_GRID = np.linspace(math.log(GRID_FROM), math.log(GRID_TO), GRID_POINTS).tolist()
INNOVATION_WEIGHT = 0.02  # weight of the newest sample in the innovation's mean square


def pole(length: int, bandwidth_hz: float) -> float:
    """Return the n equal poles [1/s] of a chain of this length and its disturbance.

    `bandwidth_hz` is the -3 dB frequency from true to estimated velocity.
    """
    return 2.0 * math.pi * bandwidth_hz / _unit_bandwidth(length + 1)


def correction(length: int, pole: float, dt: float) -> Correction:
    """Return the observer of a chain of this length and its disturbance at dt [s].

    The gains at dt = 1 are those of Ackermann's formula. A - 1 is nilpotent, so they are
    polynomials in 1 - exp(-pole dt) and keep their digits at high sample rates.
    """
    n, made = length + 1, Correction()
    weights, noise = _unit(n)
    scales = dt ** np.arange(n)
    made.gains = (1.0 - math.exp(-pole * dt)) ** np.arange(1, n + 1) @ weights / scales
    made.step = _integrators(n) * scales / scales[:, None]
    place = min(max(float(np.log(pole * dt)), LOG_GRID[0]), LOG_GRID[-1])
    j = min(bisect_right(LOG_GRID, place), GRID_POINTS - 1) - 1
    beyond, cell = place - LOG_GRID[j], LOG_GRID[j + 1] - LOG_GRID[j]
    position, velocity, innovation = (
        math.exp((column[j + 1] - column[j]) / cell * beyond + column[j]) for column in noise
    )
    made.noise = [position, velocity / (dt * dt), innovation]
    return made


@lru_cache
def _integrators(n: int) -> Array:
    """Return the transition of n integrators over dt = 1, shape (n, n)."""
    return np.array(
        [[1.0 / math.factorial(j - i) if j >= i else 0.0 for j in range(n)] for i in range(n)]
    )


@lru_cache
def _unit(n: int) -> tuple[Array, list[list[float]]]:
    """Return what n integrators with n equal poles need at dt = 1.

    weights : shape (n, n): row j belongs to (1 - exp(-pole dt))^(j + 1) in the gains.
    noise : log of the (position, velocity, innovation) variances at unit noise, (3, GRID_POINTS).
    """
    a = _integrators(n)
    seen = np.vstack([np.linalg.matrix_power(a, i)[0] for i in range(n)])
    last = np.linalg.solve(seen, np.eye(n)[:, -1])
    weights = np.array(
        [
            math.comb(n, j)
            * np.linalg.solve(a, np.linalg.matrix_power(a - np.eye(n), n - j) @ last)
            for j in range(1, n + 1)
        ]
    )
    decayed = 1.0 - np.exp(-np.exp(LOG_GRID))
    noise = [steady_variances(a, each ** np.arange(1, n + 1) @ weights) for each in decayed]
    return weights, np.log(noise).T.tolist()


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
    model: SwitchedModel,
    state: State,
    coefficients: Coefficients,
    y: tuple[float, ...],
    u: tuple[float, ...],
    z: Array,
) -> None:
    """Take one more sample in the extended observers.

    `y` and `u` are those of the new sample. `z`, shape (m,), should have converged: otherwise its
    noise enters the velocity.
    """
    zeta = observed_chains(state)
    change = state.used - z
    rows = zip(model.gamma(zeta, u), model.lam(zeta, u), coefficients.corrections)
    for i, (gamma, row, made) in enumerate(rows):
        lam, x = np.array(row, float), state.observed[i].copy()
        rest = x[-1] + lam @ change
        x[-1] = float(gamma) + lam @ z + rest
        ahead = made.step @ x
        ahead[-1] = rest
        error = float(y[i] - ahead[0])
        state.observed[i] = ahead + made.gains * error
        state.powers[i] += INNOVATION_WEIGHT * (error * error / made.noise[2] - state.powers[i])
        state.noises[i] = made.noise
    state.used = z


def observed_chains(state: State) -> tuple[float, ...]:
    """Return zeta of the extended observers."""
    return tuple(x for each in state.observed for x in each[:-1].tolist())


def move_observers(
    model: SwitchedModel, state: State, old: tuple[float, ...], new: tuple[float, ...]
) -> None:
    """Set the extended observers after Z has jumped from `old`, its latest value, to `new`.

    The disturbance w takes the difference between `old` and the Z in use.
    """
    zeta, change = observed_chains(state), state.used - old
    after, rows = moved_chain(model, zeta, old, new), model.lam(zeta, tuple(state.u))
    for i, (first, k, row) in enumerate(zip(model.firsts, model.indices, rows)):
        w = state.observed[i][-1] + np.array(row, float) @ change
        state.observed[i] = np.array([*after[first : first + k], w])
    state.used = np.array(new)


def motions(
    model: SwitchedModel, state: State, design: Design, z: tuple[float, ...], converged: bool
) -> list[tuple[float, float, float]]:
    """Return (position, velocity, acceleration or nan) of each output at the newest sample.

    Once Z has converged, the acceleration is that of the model without w, which is less noisy.
    """
    if not design.filtered:
        return of_cascade(model, state, design, z, converged)
    endings = ending(model, observed_chains(state), tuple(state.u), tuple(state.used.tolist()))
    found = []
    for k, x, end in zip(model.indices, map(np.ndarray.tolist, state.observed), endings):
        whole = end + x[-1]
        if k == 1:
            found.append((x[0], whole, math.nan))
        else:
            found.append((x[0], x[1], x[2] if k > 2 else end if converged else whole))
    return found


def of_cascade(
    model: SwitchedModel, state: State, design: Design, z: tuple[float, ...], converged: bool
) -> list[tuple[float, float, float]]:
    """Return the motions from the auxiliary states.

    In sliding mode a stage gives the mean derivative over the last interval. Half an
    interval of acceleration moves it to the newest sample.
    """
    endings = ending(model, chains(state)[0], tuple(state.u), z)
    found = []
    for i, k in enumerate(model.indices):
        own = state.zt[i]
        if k == 1:
            found.append((state.zh[i][0], own[0], math.nan))
            continue
        acceleration = endings[i] if k == 2 and converged else own[1]
        found.append((state.zh[i][0], own[0] + 0.5 * state.dt * acceleration, acceleration))
    return found


def standard_deviations(state: State, design: Design, i: int, sigma: float) -> tuple[float, float]:
    """Return standard deviations of position and velocity of output i, for noise sigma [rad or m].

    The mean squared innovation of the extended observer replaces the noise variance if it is
    larger. The cascade bounds the acceleration by L, so its velocity error is sqrt(L sigma).
    """
    if design.filtered:
        position, velocity, _ = state.noises[i]
        seen = max(sigma * sigma, state.powers[i])
        return math.sqrt(position * seen), math.sqrt(velocity * seen)
    return sigma, math.sqrt(design.bounds[i] * sigma)
