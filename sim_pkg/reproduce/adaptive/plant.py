# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The servo (34) of the adaptive paper, its inputs, and the observer in continuous time."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lsim

Array = NDArray[np.floating[Any]]

STEP = 1e-3  # of the rows in continuous time [s]


class Example(NamedTuple):
    """An example of the paper: J q'' + b q' + k q = Kv u, and its observer.

    observer_poles, model_poles : of A_c - K C and A_c [1/s].
    gamma : diagonal of Gamma.
    hold : time for which each value of the random input is constant [s].
    """

    b: float
    J: float
    k: float
    Kv: float
    observer_poles: tuple[float, float]
    model_poles: tuple[float, float]
    gamma: tuple[float, ...]
    hold: float


# K of 4.1 and Gamma of 4.1 are not printed; Gamma of 4.2 is printed for two parameters, not four
VELOCITY = Example(
    5.0, 10.0, 5.0, 100.0, (-4.0, -5.0), (-1.0, -2.0), (10.0, 10.0, 1000.0, 1000.0), 1.0
)
IDENTIFICATION = Example(0.1, 10.0, 3.0, 2.0, (-10.0, -12.0), (-1.5, -2.5), (1000.0,) * 4, 5.0)


def lcg(seed: int, count: int) -> Array:
    """Return uniform numbers of unit variance, shape (count,), the same on every machine."""
    values = np.empty(count)
    for i in range(count):
        seed = (1664525 * seed + 1013904223) % 2**32
        values[i] = math.sqrt(3.0) * (2.0 * seed / 2**32 - 1.0)
    return values


def held(values: Array, hold: float, duration: float) -> Array:
    """Return each of `values` for `hold` [s], sampled every STEP; shape (duration / STEP,)."""
    index = np.floor(np.arange(round(duration / STEP)) * STEP / hold + 1e-9).astype(np.int64)
    return values[index]


def random_input(example: Example, duration: float, seed: int = 12345) -> Array:
    """Return the random input of the paper; shape (duration / STEP,)."""
    return held(lcg(seed, math.ceil(duration / example.hold) + 1), example.hold, duration)


def square(duration: float) -> Array:
    """Return +1 and -1, for 5 s each; shape (duration / STEP,)."""
    return held(
        np.where(np.arange(math.ceil(duration / 5.0) + 1) % 2 == 0, 1.0, -1.0), 5.0, duration
    )


def response(example: Example, inputs: Array) -> Array:
    """Return the angle [rad] for a piecewise constant input, shape (n + 1,).

    Parameters
    ----------
    inputs : shape (n,), u of `Example`, each constant for one STEP.
    """
    matrix = [[0.0, 1.0], [-example.k / example.J, -example.b / example.J]]
    return simulate(matrix, [[0.0], [example.Kv / example.J]], inputs)


def simulate(matrix: list[list[float]], gain: list[list[float]], inputs: Array) -> Array:
    """Return the first state of a linear system from rest, shape (n + 1,).

    Parameters
    ----------
    inputs : shape (n,), each held for one STEP.
    """
    held = np.append(inputs, 0.0)
    system = matrix, gain, [[1.0, 0.0]], [[0.0]]
    return lsim(system, held, STEP * np.arange(len(held)), interp=False)[1]


class Continuous(NamedTuple):
    """A run in continuous time; row i at i times STEP.

    time [s], velocity, estimate by (38) [rad/s], theta of shape (n, 4).
    """

    time: Array
    velocity: Array
    estimate: Array
    theta: Array

    @property
    def error(self) -> Array:
        """Estimated minus true velocity [rad/s]."""
        return self.estimate - self.velocity

    def at(self, time: float) -> int:
        """Return the row at this time [s]."""
        return round(time / STEP)


def continuous(example: Example, inputs: Array, freeze: float = math.inf) -> Continuous:
    """Return plant (36) and observer (11) to (13), literally, from zero: n + 1 rows.

    The state is q, w; x (2); theta (4); Upsilon, shape (2, 4), row by row.

    Parameters
    ----------
    inputs : shape (n,), u of `Example`, each constant for one STEP.
    freeze : when the parameter law stops [s].
    """
    a11, a21 = _column(example.model_poles)
    o11, o21 = _column(example.observer_poles)
    stiffness, damping, gain = (value / example.J for value in (example.k, example.b, example.Kv))
    gamma = np.array(example.gamma)

    def flow(t: float, s: Array, u: float, adapting: bool) -> Array:
        y, w, x1, x2 = s[:4].tolist()
        e, first, second = y - x1, s[8:12], s[12:]
        rate = gamma * first * (e * adapting)
        l1, l2, b1, b2 = s[4:8].tolist()
        out = np.empty(16)
        out[0] = w
        out[1] = -stiffness * y - damping * w + gain * u
        out[2] = a11 * x1 + x2 + y * l1 + u * b1 + (a11 - o11) * e + first @ rate
        out[3] = a21 * x1 + y * l2 + u * b2 + (a21 - o21) * e + second @ rate
        out[4:8] = rate
        out[8:12] = o11 * first + second
        out[12:] = o21 * first
        out[8] += y
        out[13] += y
        out[10] += u
        out[15] += u
        return out

    edges = np.flatnonzero(np.diff(inputs)) + 1
    edges = np.unique([0, *edges, min(len(inputs), round(min(freeze, 1e9) / STEP)), len(inputs)])
    time = np.arange(len(inputs) + 1) * STEP
    state, parts = np.zeros(16), []
    for begin, end in pairwise(edges):
        at = time[begin : end + 1]
        arguments = float(inputs[begin]), bool(at[0] < freeze - 1e-9)
        found = solve_ivp(
            flow, (at[0], at[-1]), state, 'DOP853', at, args=arguments, rtol=1e-9, atol=1e-11
        )
        state = found.y[:, -1]
        parts.append(found.y[:, :-1])
    rows = np.column_stack((*parts, state)).T
    theta = rows[:, 4:8]
    return Continuous(time, rows[:, 1], rows[:, 3] + (a11 + theta[:, 0]) * rows[:, 2], theta)


def _column(poles: tuple[float, float]) -> tuple[float, float]:
    """Return the first column of the companion matrix with these eigenvalues."""
    return poles[0] + poles[1], -poles[0] * poles[1]
