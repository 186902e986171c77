# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The servo (34) of the adaptive paper, its inputs, and the observer in continuous time."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.calls import run
from estimator_pkg.observers.mechanism.noise import exponential
from estimator_pkg.record import record

Array = NDArray[np.floating[Any]]
Column = NDArray[np.float64]

RK4_STEP = 1e-3  # step of the continuous-time reference [s]


class Example(NamedTuple):
    """An example of the paper: J q'' + b q' + k q = Kv u, and its observer.

    observer_poles, model_poles : of A_c - K C and A_c [1/s].
    gamma : diagonal of Gamma.
    hold : time for which each value of the random input is constant [s].
    theta : the true parameters l1, l2, b1, b2.
    """

    b: float
    J: float
    k: float
    Kv: float
    observer_poles: tuple[float, float]
    model_poles: tuple[float, float]
    gamma: tuple[float, ...]
    hold: float
    theta: tuple[float, float, float, float]


# K of 4.1 and Gamma of 4.1 are not printed; Gamma of 4.2 is printed for two parameters, not four
VELOCITY = Example(
    5.0,
    10.0,
    5.0,
    100.0,
    (-4.0, -5.0),
    (-1.0, -2.0),
    (10.0, 10.0, 1000.0, 1000.0),
    1.0,
    (2.5, 1.5, 0.0, 10.0),
)
IDENTIFICATION = Example(
    0.1, 10.0, 3.0, 2.0, (-10.0, -12.0), (-1.5, -2.5), (1000.0,) * 4, 5.0, (3.99, 3.45, 0.0, 0.2)
)


def lcg(seed: int, count: int) -> Array:
    """Return uniform numbers of unit variance, shape (count,), the same on every machine."""
    values = np.empty(count)
    for i in range(count):
        seed = (1664525 * seed + 1013904223) % 2**32
        values[i] = math.sqrt(3.0) * (2.0 * seed / 2**32 - 1.0)
    return values


def held(values: Array, hold: float, dt: float, duration: float) -> Array:
    """Return each of `values` for `hold` [s], sampled every `dt` [s]; shape (duration / dt,)."""
    index = np.floor(np.arange(round(duration / dt)) * dt / hold + 1e-9).astype(np.int64)
    return values[index]


def random_input(example: Example, dt: float, duration: float, seed: int = 12345) -> Array:
    """Return the random input of the paper; shape (duration / dt,)."""
    return held(lcg(seed, math.ceil(duration / example.hold) + 1), example.hold, dt, duration)


def square(dt: float, duration: float) -> Array:
    """Return +1 and -1, for 5 s each; shape (duration / dt,)."""
    return held(
        np.where(np.arange(math.ceil(duration / 5.0) + 1) % 2 == 0, 1.0, -1.0), 5.0, dt, duration
    )


def march(count: int, angle: Column, speed: Column, e: Column, inputs: Column) -> None:
    """Move the servo by the matrix e, shape (3, 3), in each of `count` steps."""
    q, w = angle[0], speed[0]
    for i in range(count):
        u = inputs[i]
        q, w = e[0] * q + e[1] * w + e[2] * u, e[3] * q + e[4] * w + e[5] * u
        angle[i + 1], speed[i + 1] = q, w


def response(example: Example, inputs: Array, dt: float, load: float = 0.0) -> tuple[Array, Array]:
    """Return angle [rad] and velocity [rad/s] for a piecewise constant input (exact).

    Both have shape (n + 1,).

    Parameters
    ----------
    inputs : shape (n,), u of `Example`, each constant for one dt [s].
    load : constant acceleration in addition to that of the input [rad/s^2].
    """
    ratio = example.Kv / example.J
    matrix = np.zeros((3, 3))
    matrix[:2] = [[0.0, 1.0, 0.0], [-example.k / example.J, -example.b / example.J, 1.0]]
    angle, speed = np.empty(len(inputs) + 1), np.empty(len(inputs) + 1)
    angle[0] = speed[0] = 0.0
    run(march, len(inputs), angle, speed, exponential(matrix * dt), ratio * inputs + load)
    return angle, speed


SIZE = 16  # numbers of a state


@record
class Stages:
    """A state and the stages of Runge-Kutta."""

    s: Annotated[list[float], SIZE]
    k1: Annotated[list[float], SIZE]
    k2: Annotated[list[float], SIZE]
    k3: Annotated[list[float], SIZE]
    k4: Annotated[list[float], SIZE]
    t: Annotated[list[float], SIZE]


def flow(
    s: list[float], u: float, p: Column, adapting: float, injecting: float, out: list[float]
) -> None:
    """Plant (36) and observer (11) to (13), literally: Upsilon is 2 x 4.

    s : q, w; x1, x2; theta (4); Upsilon row by row (8).
    p : k/J, b/J, Kv/J; a11, a21 of A_c; K (2); Gamma (4).
    """
    y, w, x1, x2 = s[0], s[1], s[2], s[3]
    theta1, theta2, theta3, theta4 = s[4], s[5], s[6], s[7]
    stiffness, damping, gain, a11, a21, k1, k2 = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    out[0] = w
    out[1] = -stiffness * y - damping * w + gain * u
    e = y - x1
    moved1 = moved2 = 0.0
    for i in range(4):
        rate = p[7 + i] * s[8 + i] * e
        out[4 + i] = adapting * rate
        moved1 += s[8 + i] * rate
        moved2 += s[12 + i] * rate
    out[2] = a11 * x1 + x2 + y * theta1 + u * theta3 + k1 * e + injecting * moved1
    out[3] = a21 * x1 + y * theta2 + u * theta4 + k2 * e + injecting * moved2
    for i in range(4):
        out[8 + i] = (a11 - k1) * s[8 + i] + s[12 + i]
        out[12 + i] = (a21 - k2) * s[8 + i]
    out[8] += y
    out[13] += y
    out[10] += u
    out[15] += u


def integrate(
    stages: Stages,
    count: int,
    inputs: Column,
    p: Column,
    adapting: Column,
    injecting: Column,
    h: float,
    out: Column,
) -> None:
    """Move the state by `count` steps h; row i of `out`, (count + 1, SIZE), is before step i."""
    s, t, k1, k2, k3, k4 = stages.s, stages.t, stages.k1, stages.k2, stages.k3, stages.k4
    for n in range(SIZE):
        out[n] = s[n]
    for i in range(count):
        u, g, j = inputs[i], adapting[i], injecting[i]
        flow(s, u, p, g, j, k1)
        for n in range(SIZE):
            t[n] = s[n] + 0.5 * h * k1[n]
        flow(t, u, p, g, j, k2)
        for n in range(SIZE):
            t[n] = s[n] + 0.5 * h * k2[n]
        flow(t, u, p, g, j, k3)
        for n in range(SIZE):
            t[n] = s[n] + h * k3[n]
        flow(t, u, p, g, j, k4)
        for n in range(SIZE):
            s[n] += h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n])
            out[SIZE * (i + 1) + n] = s[n]


class Continuous(NamedTuple):
    """A run in continuous time; row i at i times RK4_STEP.

    time [s], angle [rad], velocity, estimate by (38) [rad/s], theta of shape (n, 4).
    """

    time: Array
    angle: Array
    velocity: Array
    estimate: Array
    theta: Array

    @property
    def error(self) -> Array:
        """Estimated minus true velocity [rad/s]."""
        return self.estimate - self.velocity

    def at(self, time: float) -> int:
        """Return the row at this time [s]."""
        return round(time / RK4_STEP)


def continuous(
    example: Example,
    inputs: Array,
    *,
    freeze: float = math.inf,
    injection_stays: bool = False,
    gamma: tuple[float, ...] | None = None,
) -> Continuous:
    """Simulate plant and observer together by Runge-Kutta 4, from zero; n + 1 rows.

    Parameters
    ----------
    inputs : shape (n,), u of `Example`, each constant for one RK4_STEP.
    freeze : when the parameter law stops [s].
    injection_stays : keep the last term of (13) after `freeze`.
    """
    model, observer = _column(example.model_poles), _column(example.observer_poles)
    p = np.array(
        [
            example.k / example.J,
            example.b / example.J,
            example.Kv / example.J,
            *model,
            *(m - o for m, o in zip(model, observer)),
            *(gamma or example.gamma),
        ]
    )
    time = np.arange(len(inputs) + 1) * RK4_STEP
    adapting = (time[:-1] < freeze - 1e-9).astype(float)
    injecting = np.ones_like(adapting) if injection_stays else adapting
    out, columns = np.empty((len(inputs) + 1, SIZE)), (inputs, p, adapting, injecting)
    run(integrate, Stages(), len(inputs), *columns, RK4_STEP, out)
    theta = out[:, 4:8].copy()
    return Continuous(
        time, out[:, 0], out[:, 1], out[:, 3] + (model[0] + theta[:, 0]) * out[:, 2], theta
    )


def _column(poles: tuple[float, float]) -> tuple[float, float]:
    """Return the first column of the companion matrix with these eigenvalues."""
    return poles[0] + poles[1], -poles[0] * poles[1]
