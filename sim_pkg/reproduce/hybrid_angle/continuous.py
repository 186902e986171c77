# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Continuous time: Figure 4, the Lyapunov function, Figure 5 (rows F4, LY, F5).

Plant (1) and observer (3) with their jumps, by scipy's Runge-Kutta; its events find the jumps.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from estimator_pkg.circle import wrap
from estimator_pkg.observers.angle.hybrid.injections import INJECTIONS as FOUR
from sim_pkg.reproduce.contract import Values, rms
from sim_pkg.reproduce.hybrid_angle.observer import TURN, first_jump, flow, injection, lyapunov

Array = NDArray[np.floating[Any]]

STEP = 1e-3  # of the rows [s]
DURATION = 8.0  # duration of Figures 4 and 5 [s]
COUNT = round(DURATION / STEP)
NOISE_BOUND = math.radians(15.0)  # largest noise [rad]
MARGIN = math.radians(5.0)  # delta_pi
K1, K2 = 6.0, 5.0  # the paper's k_v and k_p
SEED = 1  # of the noise of Figure 5
TURNS_AT, SETTLES_AT = 2.0, 2.05  # the speed goes from 10 to -20 rad/s [s]


class Trace(NamedTuple):
    """A simulation; arrays of shape (n,), row i at i STEP, before a jump that occurs there.

    Attributes
    ----------
    time : s.
    true_velocity, velocity : of the plant and of the observer [rad/s].
    output_error : y minus the estimated position, wrapped [rad].
    position_error : true minus estimated position, wrapped [rad].
    lyapunov : V of the errors [rad^2].
    reset_times : of the observer's J2 jumps [s].
    reset_change, wrap_change : change of V at the J2 jumps and at the J1 jumps.
    growth : largest increase of V between rows without a jump, while d = 0.
    rest : largest departure from Lemma 1, V + l1 phi^2 t, between two jumps, while d = 0.
    """

    time: Array
    true_velocity: Array
    velocity: Array
    output_error: Array
    position_error: Array
    lyapunov: Array
    reset_times: list[float]
    reset_change: list[float]
    wrap_change: list[float]
    growth: float
    rest: float

    @property
    def velocity_error(self) -> Array:
        """True minus estimated velocity [rad/s]."""
        return self.true_velocity - self.velocity


def speed(t: Any) -> Any:
    """Return the true velocity at t [rad/s]."""
    return np.interp(t, (TURNS_AT, SETTLES_AT), (10.0, -20.0))


def simulate(kind: int, epsilon: float, limit: float, noise: Array | None) -> Trace:
    """Simulate plant and observer from rest at zero; the state has the integral of l1 phi^2 too.

    Parameters
    ----------
    epsilon : s. limit : M, of saturation [rad].
    noise : measurement noise every millisecond, interpolated, shape (n,) [rad]; None: none.
    """
    l1, l2 = K1 / epsilon, K2 / epsilon**2
    values = [] if noise is None else noise.tolist()

    def measured(t: float, x: Array) -> float:
        if noise is None:
            return float(x[0])
        place = min(int(t / STEP), len(values) - 2)
        part = t / STEP - place
        return float(x[0]) + values[place] + part * (values[place + 1] - values[place])

    def slope(t: float, x: Array) -> tuple[float, ...]:
        y, (_, position, velocity, _) = measured(t, x), x.tolist()
        spent = l1 * injection(kind, y - position, limit) ** 2
        return float(speed(t)), *flow(kind, position, velocity, y, l1, l2, limit), spent

    def value(t: float, x: Array) -> float:
        true, position, velocity, _ = x.tolist()
        return lyapunov(kind, true - position, float(speed(t)) - velocity, l2, limit)

    def plant_turns(t: float, x: Array) -> float:
        return abs(measured(t, x)) - math.pi - MARGIN

    def observer_turns(_: float, x: Array) -> float:
        return abs(float(x[1])) - math.pi - MARGIN

    def resets_at(t: float, x: Array) -> float:
        return abs(abs(measured(t, x) - float(x[1])) - math.pi) - MARGIN

    events: list[Any] = [plant_turns, observer_turns, resets_at]
    for event in events:
        event.terminal = True
        event.direction = -1.0 if event is resets_at else 1.0
    exact = noise is None
    accuracy = {'rtol': 1e-9, 'atol': 1e-10} if exact else {'rtol': 1e-4, 'atol': 1e-6}
    x, rows, reset_times = np.zeros(4), [], []
    reset_change: list[float] = []
    wrap_change: list[float] = []
    growth = rest = 0.0
    every = STEP * np.arange(COUNT + 1)
    for begin, end in pairwise((0.0, TURNS_AT, SETTLES_AT, DURATION)):
        t = begin
        while t < end:
            at = every[(every >= t) & (every < end)]
            found = solve_ivp(
                slope, (t, end), x, t_eval=np.append(at, end), events=events,
                max_step=2.0 * STEP if exact else STEP,  # no step over J2
                method='DOP853' if exact else 'RK45', **accuracy,
            )  # fmt: skip
            jumps = [place for place, times in enumerate(found.t_events) if len(times)]
            last, after = (
                (found.t_events[jumps[0]][0], found.y_events[jumps[0]][0])
                if jumps
                else (end, found.y[:, -1])
            )
            inner = np.reshape(found.y, (4, -1))[:, : len(at)]
            rows += inner.T.tolist()
            path = np.column_stack((x, inner, after)).T
            stamps = np.array([t, *at[: len(inner.T)], last])
            if begin != TURNS_AT:
                v = np.array([value(s, row) for s, row in zip(stamps, path)])
                growth = max(growth, float(np.diff(v).max()))
                rest = max(rest, float(np.ptp(v + path[:, 3])))
            t, x, before = float(last), after.copy(), value(float(last), after)
            for place in jumps:
                if place == 2:
                    x[1] = measured(t, x)
                    reset_times.append(t)
                else:
                    x[place] = first_jump(float(x[place]))
                change = value(t, x) - before
                (reset_change if place == 2 else wrap_change).append(change)
                before = value(t, x)
    table, time = np.array(rows), every[: len(rows)]
    y = [measured(t, row) for t, row in zip(time, table)]
    true = speed(time)
    return Trace(
        time,
        true,
        table[:, 2],
        np.array([wrap(each, TURN) for each in y - table[:, 1]]),
        np.array([wrap(each, TURN) for each in table[:, 0] - table[:, 1]]),
        np.array([value(t, row) for t, row in zip(time, table)]),
        reset_times,
        reset_change,
        wrap_change,
        growth,
        rest,
    )


@lru_cache
def figure_4(name: str) -> Trace:
    """Simulate Figure 4: no noise, epsilon 0.7 s, M = 1 rad."""
    return simulate(FOUR.index(name), 0.7, 1.0, None)


@lru_cache
def figure_5(name: str) -> Trace:
    """Simulate Figure 5: +-15 degrees of uniform noise, epsilon 0.1 s, M = 0.03 rad.

    The paper states neither distribution nor bandwidth of the noise.
    """
    noise = np.random.default_rng(SEED).uniform(-NOISE_BOUND, NOISE_BOUND, COUNT + 1)
    return simulate(FOUR.index(name), 0.1, 0.03, noise)


def window(start: float, end: float) -> slice:
    """Return the rows with start <= time < end [s]."""
    return slice(round(start / STEP), round(end / STEP))


def figure_4_values() -> Values:
    """Rows F4, of Figure 4."""
    saw = figure_4('saw')
    early, late = window(0.0, TURNS_AT), window(TURNS_AT, DURATION)
    for name in FOUR:
        trace = figure_4(name)
        yield f'F4 RMS e2 [0,2) {name}', rms(trace.velocity_error[early])
        yield f'F4 RMS e2 [2,8) {name}', rms(trace.velocity_error[late])
        yield (
            f'F4 max |xh2 - xh2 saw| [0,2) {name}',
            np.abs(trace.velocity - saw.velocity)[early].max(),
        )
    tan = figure_4('tan')
    yield 'F4 J2 resets tan', len(tan.reset_times)
    yield (
        'F4 gain of tan over saw',
        100.0 * (1.0 - rms(tan.velocity_error[late]) / rms(saw.velocity_error[late])),
    )


def lyapunov_values() -> Values:
    """Rows LY: Figure 4 without the 50 ms in which d moves the plant."""
    for name in FOUR:
        trace = figure_4(name)
        if name in ('sin', 'sat'):
            yield f'LY dV at J2 {name}', min(trace.reset_change)
        yield f'LY max |dV| at J1 {name}', np.abs(trace.wrap_change).max()
        yield f'LY max flow increase of V {name}', trace.growth
        yield f'LY max |dV + l1 phi^2 dt| {name}', trace.rest


def figure_5_values() -> Values:
    """Rows F5, of Figure 5."""
    for name in FOUR:
        yield f'F5 RMS e2 [2,8) {name}', rms(figure_5(name).velocity_error[window(2.0, DURATION)])
