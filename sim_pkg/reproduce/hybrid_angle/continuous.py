# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Continuous time: Figure 4, the Lyapunov function, Figure 5 (rows F4, LY, F5).

Plant (1) and observer (3) with their jumps.

Runge-Kutta of order four at a fixed step. Jumps are tested after each step, in the order plant J1,
observer J1, observer J2, until none applies (the paper leaves the order open).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import wrap
from estimator_pkg.engine.calls import run
from estimator_pkg.observers.angle.hybrid.injections import NAMES as FOUR
from sim_pkg.joints import profiles
from sim_pkg.reproduce import splitmix
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.hybrid_angle.observer import (
    TURN,
    first_jump,
    flow,
    in_first_jump_set,
    in_second_jump_set,
    injection,
    lyapunov,
    observer_gains,
)

Array = NDArray[np.floating[Any]]
Column = NDArray[np.float64]

STEP = 1e-4  # integration step [s]
DURATION = 8.0  # duration of Figures 4 and 5 [s]
STEPS = round(DURATION / STEP)
NOISE_HOLD = 10  # steps for which a noise value is constant: 1 ms
NOISE_BOUND = math.radians(15.0)  # largest noise [rad]
MARGIN = math.radians(5.0)  # delta_pi
K1, K2 = 6.0, 5.0  # the paper's k_v and k_p
SEEDS = (1, 2, 3)  # random seeds of the noise of Figure 5
TURNS_AT = 2.0  # the speed leaves 10 rad/s [s] ...
SETTLES_AT = 2.05  # ... and has reached -20 rad/s [s]
NO_RESET = 1e-12  # a delta_pi so small that J2 never applies [rad]


class Trace(NamedTuple):
    """A simulation; arrays of shape (STEPS,), row i at the start of step i, after all jumps.

    Attributes
    ----------
    time : s.
    true_velocity, velocity : of the plant and of the observer [rad/s].
    output_error : y minus the estimated position, wrapped [rad].
    position_error : true minus estimated position, wrapped [rad].
    lyapunov : V of the errors [rad^2].
    flow_change : change of V in step i while flowing [rad^2].
    reset_change : change of V at the observer's J2 jumps after step i; nan without a jump.
    wrap_change : change of V at the J1 jumps after step i; nan without a jump.
    resets : number of J2 jumps after step i.
    """

    time: Array
    true_velocity: Array
    velocity: Array
    output_error: Array
    position_error: Array
    lyapunov: Array
    flow_change: Array
    reset_change: Array
    wrap_change: Array
    resets: Array

    @property
    def velocity_error(self) -> Array:
        """True minus estimated velocity [rad/s]."""
        return self.true_velocity - self.velocity


def simulate(
    kind: int,
    l1: float,
    l2: float,
    limit: float,
    margin: float,
    step: float,
    count: int,
    speed: Column,
    noise: Column,
    velocity: Column,
    output_error: Column,
    position_error: Column,
    value: Column,
    flow_change: Column,
    reset_change: Column,
    wrap_change: Column,
    resets: Column,
) -> None:
    """Fill the arrays from `velocity` on; all of shape (count,).

    limit : of saturation. speed : true velocity at half steps, shape (2 count + 1,).
    noise : measurement noise in each step, shape (count,) [rad].
    """
    half = 0.5 * step
    true, position, speed_hat = 0.0, 0.0, 0.0
    before = lyapunov(kind, true - position, speed[0] - speed_hat, l2, limit)
    for i in range(count):
        w = noise[i]
        v0, v1, v2 = speed[2 * i], speed[2 * i + 1], speed[2 * i + 2]
        velocity[i] = speed_hat
        output_error[i] = wrap(true + w - position, TURN)
        position_error[i] = wrap(true - position, TURN)
        value[i] = before

        p1, a1 = flow(kind, position, speed_hat, true + w, l1, l2, limit)
        p2, a2 = flow(
            kind, position + half * p1, speed_hat + half * a1, true + half * v0 + w, l1, l2, limit
        )
        p3, a3 = flow(
            kind, position + half * p2, speed_hat + half * a2, true + half * v1 + w, l1, l2, limit
        )
        p4, a4 = flow(
            kind, position + step * p3, speed_hat + step * a3, true + step * v1 + w, l1, l2, limit
        )
        true += step / 6.0 * (v0 + 4.0 * v1 + v2)
        position += step / 6.0 * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
        speed_hat += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

        after = lyapunov(kind, true - position, v2 - speed_hat, l2, limit)
        flow_change[i] = after - before
        before = after
        jumping = True
        while jumping:
            jumping = False
            if in_first_jump_set(true + w, margin):
                true = first_jump(true)
                jumping = True
            if in_first_jump_set(position, margin):
                position = first_jump(position)
                jumping = True
            if jumping:
                after = lyapunov(kind, true - position, v2 - speed_hat, l2, limit)
                wrap_change[i] = after - before
                before = after
            if in_second_jump_set(true + w - position, margin):
                position = true + w
                jumping = True
                resets[i] += 1.0
                after = lyapunov(kind, true - position, v2 - speed_hat, l2, limit)
                reset_change[i] = after - before
                before = after


@lru_cache
def figure_4(injection: str, *, k1: float = K1, k2: float = K2, margin: float = MARGIN) -> Trace:
    """Simulate Figure 4: no noise, epsilon 0.7 s, M = 1 rad.

    Parameters
    ----------
    margin : delta_pi [rad]; if it is smaller than any step, J2 never applies.
    """
    return _run(injection, (*observer_gains(k1, k2, 0.7), 1.0), margin, np.zeros(STEPS))


@lru_cache
def figure_5(injection: str, seed: int) -> Trace:
    """Simulate Figure 5: +-15 degrees of uniform noise, epsilon 0.1 s, M = 0.03 rad.

    Parameters
    ----------
    seed : seed of the splitmix64 stream. The paper states neither distribution nor bandwidth.
    """
    held = splitmix.uniforms(seed, STEPS // NOISE_HOLD, NOISE_BOUND)
    return _run(
        injection, (*observer_gains(K1, K2, 0.1), 0.03), MARGIN, np.repeat(held, NOISE_HOLD)
    )


def _run(injection: str, gains: tuple[float, float, float], margin: float, noise: Array) -> Trace:
    half_steps = np.asarray(0.5 * STEP * np.arange(2 * STEPS + 1), np.float64)
    speed = profiles.figure_4()(half_steps)[1]
    out = [np.zeros(STEPS) for _ in range(5)]
    out += [np.full(STEPS, np.nan), np.full(STEPS, np.nan), np.zeros(STEPS)]
    run(simulate, FOUR.index(injection), *gains, margin, STEP, STEPS, speed, noise, *out)
    return Trace(half_steps[:-1:2], speed[:-1:2], *out)


def rms(values: Array) -> float:
    """Return the root mean square of `values`, of any shape, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


def window(trace: Trace, start: float, end: float) -> slice:
    """Return the rows with start <= time < end [s]."""
    return slice(round(start / STEP), round(end / STEP))


def figure_4_values() -> Values:
    """Rows F4, of Figure 4.

    The last ones exchange k1 and k2, to tell which of k_v and k_p is k1: the text of the paper then
    no longer fits.
    """
    traces = {name: figure_4(name) for name in FOUR}
    saw = traces['saw']
    early, late = window(saw, 0.0, TURNS_AT), window(saw, TURNS_AT, 8.0)
    for name, trace in traces.items():
        error = trace.velocity_error
        yield f'F4 RMS e2 [0,2) {name}', rms(error[early])
        yield f'F4 RMS e2 [2,8) {name}', rms(error[late])
        astray = trace.time[np.abs(error) > 1.0]  # never empty: the error starts at 10 rad/s
        yield f'F4 settling {name}', astray[-1] + STEP - TURNS_AT
        yield f'F4 J2 resets {name}', trace.resets.sum()
        yield (
            f'F4 max |xh2 - xh2 saw| [0,2) {name}',
            np.abs(trace.velocity - saw.velocity)[early].max(),
        )
    for name in ('sin', 'sat'):
        free = figure_4(name, margin=NO_RESET)
        yield (
            f'F4 max |e2| [7,8) without J2 {name}',
            np.abs(free.velocity_error[window(free, 7.0, 8.0)]).max(),
        )
    yield 'F4 gain of tan over saw', gain_of_tan(traces['tan'], saw)
    exchanged = {name: figure_4(name, k1=K2, k2=K1) for name in ('tan', 'saw')}
    yield (
        'F4 gains exchanged: max |e1| [0,2) saw',
        np.abs(exchanged['saw'].position_error[early]).max(),
    )
    yield 'F4 gains exchanged: gain of tan over saw', gain_of_tan(**exchanged)
    yield 'F4 gains exchanged: J2 resets saw', exchanged['saw'].resets.sum()


def gain_of_tan(tan: Trace, saw: Trace) -> float:
    """Return by how much tan's RMS velocity error from 2 s on is below saw's [%]."""
    late = window(saw, TURNS_AT, 8.0)
    return 100.0 * (1.0 - rms(tan.velocity_error[late]) / rms(saw.velocity_error[late]))


def lyapunov_values() -> Values:
    """Rows LY: Figure 4 without the 50 ms in which d moves the plant."""
    l1 = observer_gains(K1, K2, 0.7)[0]
    for name in FOUR:
        trace = figure_4(name)
        free = (trace.time < TURNS_AT - STEP) | (trace.time > SETTLES_AT)
        if name in ('sin', 'sat'):
            yield f'LY dV at J2 {name}', np.nanmin(trace.reset_change)
        yield f'LY max |dV| at J1 {name}', np.nanmax(np.abs(trace.wrap_change))
        yield f'LY max flow increase of V {name}', trace.flow_change[free].max()
        kind, errors = FOUR.index(name), trace.position_error.tolist()
        power = l1 * np.square([injection(kind, error, 1.0) for error in errors])
        # the cubic through four samples gives the integral over the step between the middle two
        whole = free & np.isnan(trace.reset_change)
        smooth = whole[:-2] & whole[1:-1] & whole[2:]
        spent = STEP / 24.0 * (13.0 * (power[1:-2] + power[2:-1]) - power[:-3] - power[3:])
        rest = trace.flow_change[1:-2] + spent
        yield f'LY max |dV + l1 phi^2 dt| {name}', np.abs(rest[smooth[:-1]]).max()


def figure_5_values() -> Values:
    """Rows F5, of Figure 5."""
    for name in FOUR:
        traces = [figure_5(name, seed) for seed in SEEDS]
        for start in (2, 6):
            errors = [rms(trace.velocity_error[window(trace, start, 8.0)]) for trace in traces]
            yield f'F5 RMS e2 [{start},8) {name}', float(np.mean(errors))
        yield f'F5 J2 resets {name}', float(np.mean([trace.resets.sum() for trace in traces]))
