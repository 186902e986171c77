# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One sample of the sensorless observer; its start, and how it goes on after a gap.

The robust form extends the paper: it waits while the rotor is not observable, and finds it again
from the direction and the rotation of the back-EMF.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.circle import wrap
from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.observers.pmsm.equations import align, emf, phase_signs, reflect, rotor_angle
from estimator_pkg.observers.pmsm.identifier import credible, shift, solve
from estimator_pkg.observers.pmsm.scheme import advance, turned_emf
from estimator_pkg.observers.pmsm.state import Coefficients, Design, State
from estimator_pkg.observers.pmsm.watch import (
    BLIND,
    FRAME_RESET,
    SEARCHING,
    begin_watch,
    least_emf,
    look,
)

SPEED_CLIP = 2e4  # rad/s, electrical: a back-EMF that turns faster is noise
LARGEST_STATE = 1e15  # V and 1/Wb: larger states have diverged
# Length of every second clock period, relative to the others, of the robust form: so at no speed
# the rotor is at the same angle at every tick.
SECOND_PERIOD = 0.8
TURN = 2.0 * math.pi


def start(observer: Any, state: Any, design: Design, measurement: DriveSample) -> None:
    """Set the state after the first sample."""
    blank = State()
    state.take(blank)
    core = state.core
    core.i1 = core.i_alpha = design.scale * measurement.i_alpha
    core.i2 = core.i_beta = design.scale * measurement.i_beta
    core.z1, core.x = 1.0, design.xi_start
    state.ticks.span = 1.0
    begin_watch(state.watch, design.noise_guess)
    state.rotation.time = design.dead


def restart(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: DriveSample,
) -> None:
    """Start again after an outage or a jump of the clock."""
    start(observer, state, design, measurement)


def resume(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: DriveSample,
) -> None:
    """Go on after a gap: keep flux and speed, search the rotor again."""
    core, watch, ticks = state.core, state.watch, state.ticks
    core.i_alpha = design.scale * measurement.i_alpha
    core.i_beta = design.scale * measurement.i_beta
    core.i1 = core.z1 * core.i_alpha + core.z2 * core.i_beta
    core.i2 = core.z1 * core.i_beta - core.z2 * core.i_alpha
    core.y_alpha = core.y_beta = 0.0
    ticks.area_alpha = ticks.area_beta = ticks.rho = 0.0
    ticks.span, ticks.count = 1.0, 0
    watch.calm, watch.reasons = 0.0, watch.reasons | SEARCHING
    state.out.slope = 0.0
    state.rotation.time, state.rotation.angle = design.dead, 0.0


def coast(state: State, gap: float) -> None:
    """Go on with the speed as it was over a gap [s]."""
    state.out.travel += state.out.speed * gap


def step(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: DriveSample,
    known_input: float,
) -> None:
    """Take one sample."""
    core, watch, ticks, out = state.core, state.watch, state.ticks, state.out
    if not design.robust and not (
        abs(core.x) < LARGEST_STATE and abs(complex(core.h1, core.h2)) < LARGEST_STATE
    ):
        start(observer, state, design, measurement)  # the printed equations do not bound xi_hat
        return
    acting, dt, last = state.acting, coefficients.dt, watch.reasons
    act(state, design, measurement)
    searching = design.robust and last & SEARCHING != 0
    if searching:  # xi is frozen, the frame turns at the speed of the back-EMF
        turning = watch.rate if -SPEED_CLIP < watch.rate < SPEED_CLIP else 0.0
        _, frame = advance(core, coefficients.scheme, acting, 0.0, 0.0, 0.0, turning)
    else:  # the flow (16)
        core.x, frame = advance(
            core, coefficients.scheme, acting, core.x, design.k_eta, design.gamma, 0.0
        )
        out.travel += frame * dt
    y_alpha, y_beta = emf(core)
    area_alpha, area_beta, turned = turned_emf(core.y_alpha, core.y_beta, y_alpha, y_beta, dt)
    core.y_alpha, core.y_beta = y_alpha, y_beta
    ticks.area_alpha += area_alpha
    ticks.area_beta += area_beta
    ticks.rho += coefficients.pace  # Lambda dt
    # i_tilde, and its power per component
    error1 = core.z1 * acting.i_alpha + core.z2 * acting.i_beta - core.i1
    error2 = core.z1 * acting.i_beta - core.z2 * acting.i_alpha - core.i2
    square = 0.5 * (error1 * error1 + error2 * error2)
    event = 0
    if ticks.rho + 0.5 * coefficients.pace >= ticks.span:  # the end of the clock period
        event = tick(state, coefficients, design, searching)
    if searching:
        event, turned = search(state, coefficients, design, turned)
    size = abs(complex(core.h1, core.h2))
    speed = size * core.x  # omega_hat
    if not searching:
        follow_speed(state, coefficients, frame, speed)
    look(watch, coefficients, design, core, acting, event, size, speed, turned / dt, square)
    core.i_alpha, core.i_beta = acting.i_alpha, acting.i_beta


def act(state: State, design: Design, measurement: DriveSample) -> None:
    """Set the current of a sample, and the voltage that acted before it."""
    core, acting, scale = state.core, state.acting, design.scale
    acting.i_alpha, acting.i_beta = scale * measurement.i_alpha, scale * measurement.i_beta
    acting.u_alpha, acting.u_beta = scale * measurement.u_alpha, scale * measurement.u_beta
    if not design.corrects:
        return
    kept, part = design.kept, design.part
    for k in range(kept):
        state.u_alpha[k], state.u_beta[k] = state.u_alpha[k + 1], state.u_beta[k + 1]
    state.u_alpha[kept], state.u_beta[kept] = acting.u_alpha, acting.u_beta
    u_alpha, u_beta = state.u_alpha[kept - design.late], state.u_beta[kept - design.late]
    if part > 0.0:
        u_alpha = (1.0 - part) * u_alpha + part * state.u_alpha[0]
        u_beta = (1.0 - part) * u_beta + part * state.u_beta[0]
    if design.dead_time > 0.0:
        of_alpha, of_beta = phase_signs(core.i_alpha + acting.i_alpha, core.i_beta + acting.i_beta)
        u_alpha -= design.dead_time * of_alpha
        u_beta -= design.dead_time * of_beta
    acting.u_alpha, acting.u_beta = u_alpha, u_beta


def tick(state: State, coefficients: Coefficients, design: Design, searching: bool) -> int:
    """Run the jump of (16) at a clock tick; return FRAME_RESET if frame or flux changed, else 0."""
    core, watch, ticks, out, event = state.core, state.watch, state.ticks, state.out, 0
    scale = 1.0 / abs(complex(core.z1, core.z2))
    core.z1, core.z2 = core.z1 * scale, core.z2 * scale
    if searching:
        ticks.count = 0
        if design.identifies:
            register(state, design, core.y_alpha, core.y_beta)
    else:
        x = core.x
        if design.identifies:
            event = identify(state, coefficients, design)
        if design.resets and reflect(core):
            event = FRAME_RESET
        if design.robust and core.x != x:  # the averages belong to the old frame: reset them
            watch.mean_h1, watch.mean_h2, watch.slip = 0.0, -watch.level, 0.0
        out.travel += wrap(rotor_angle(core) - out.travel, TURN)
    ticks.area_alpha = ticks.area_beta = ticks.rho = 0.0
    if design.robust:
        ticks.span = SECOND_PERIOD if ticks.span == 1.0 else 1.0
    return event


def register(state: State, design: Design, y_alpha: float, y_beta: float) -> None:
    """Take a tick into the registers."""
    core, ticks = state.core, state.ticks
    size = abs(complex(core.h1, core.h2))
    shift(state.registers, design.periods, y_alpha, y_beta, size, ticks.area_alpha, ticks.area_beta)


def identify(state: State, coefficients: Coefficients, design: Design) -> int:
    """Replace xi_hat by that of the identifier (26) if they differ; return FRAME_RESET then."""
    core, ticks, periods = state.core, state.ticks, design.periods
    y_alpha, y_beta = emf(core)
    register(state, design, y_alpha, y_beta)
    ticks.count += 1
    if ticks.count <= periods + 1:
        return 0
    found, travelled, rest, scale = solve(state.registers, periods)
    if not abs(core.x - found) > design.threshold:
        return 0
    if design.robust:
        least = least_emf(
            state.watch.power, state.acting.i_alpha, state.acting.i_beta, coefficients, design
        )
        if not credible(state.registers, design, found, travelled, rest, scale, least):
            return 0
    core.x = found
    if design.robust:  # flux and direction are credible
        align(core, core.h1, core.h2)
    return FRAME_RESET


def search(
    state: State, coefficients: Coefficients, design: Design, turned: float
) -> tuple[int, float]:
    """Observe the rotation of y until it is time to lock on; return (event, `turned`).

    Parameters
    ----------
    turned : the angle by which y turned [rad]; before the back-EMF has settled it is replaced by
        that of the speed before a gap, which is 0 after a standstill.
    """
    out, rotation = state.out, state.rotation
    out.slope = 0.0
    if state.watch.reasons & BLIND != 0:
        out.speed = 0.0
        rotation.time, rotation.angle = design.dead, 0.0
        return SEARCHING, turned
    settled = rotation.time >= 0.0
    if not settled:
        turned = out.speed * coefficients.dt
    out.travel += turned
    rotation.angle = rotation.angle + turned if settled else 0.0
    rotation.time += coefficients.dt
    if rotation.time < coefficients.window:
        return SEARCHING, turned
    lock_on(state, design)
    rotation.time, rotation.angle = design.dead, 0.0
    return FRAME_RESET, turned


def lock_on(state: State, design: Design) -> None:
    """Align the frame with the averaged back-EMF, with the sign of xi that its rotation shows."""
    core, watch, out = state.core, state.watch, state.out
    size = abs(complex(watch.mean_h1, watch.mean_h2))
    watch.slip = 0.0
    if core.x != 0.0 and size > 0.0:
        align(core, watch.mean_h1, watch.mean_h2)
        most = abs(core.x)
        if most > design.xi_high:  # xi has diverged: take its initial value
            most = design.xi_start if design.xi_start > 0.0 else design.xi_high
        core.x = most if state.rotation.angle > 0.0 else -most
        watch.mean_h1, watch.mean_h2 = 0.0, -size
    out.speed = abs(complex(core.h1, core.h2)) * core.x
    out.travel += wrap(rotor_angle(core) - out.travel, TURN)


def follow_speed(state: State, coefficients: Coefficients, frame: float, speed: float) -> None:
    """Set the speed output from that of the frame, or from omega_hat without a low-pass [rad/s].

    Its integral is the angle, so that the current noise in it is above the low-pass.
    """
    out = state.out
    if coefficients.f21 == 0.0:
        out.speed = speed
        return
    lag, slope = out.speed - frame, out.slope
    out.speed = frame + coefficients.f11 * lag + coefficients.f12 * slope
    out.slope = coefficients.f21 * lag + coefficients.f22 * slope
