# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The shared part of all observers of mechanisms: guard of the domain, status, convention.

A measurement is the vector of all positions. The input is the vector of forces and torques that
acted from the previous sample to this one. An observer adds two functions, and imports those here:

    advance(model, state, coefficients, design, measurement, known_input)
        Set `work.after`, the core state after one sample: `before` is the previous measurement,
        `work.moved` the wrapped change since then. Return False where the model is not valid.
    propagate(model, core, work, design, at)
        Set the velocities v at the positions `at` after samples without input or measurement.

and SLIDING: the innovation is d of its core state, not e. `plan` of its module is ordinary Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import COASTING, INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.models.mechanics import Mechanics, Vector
from estimator_pkg.observers.mechanism.algebra import is_beyond, is_finite
from estimator_pkg.observers.mechanism.gains import longest_euler, longest_exact, slowest_pole
from estimator_pkg.observers.mechanism.noise import NoiseGains, StandardDeviations
from estimator_pkg.observers.mechanism.parameters import (
    AT_MEASUREMENT,
    EXACT_FORM,
    LINEAR,
    PAPER_FORM,
    MechanicalGains,
    circles_of,
    per_joint,
)
from estimator_pkg.observers.mechanism.state import Coefficients, Core, Design, State, Work, enlarge
from estimator_pkg.record import record
from estimator_pkg.sensor.convention import begin_convention, follow_convention, present

Array = NDArray[np.float64]

OUTSIDE_PART = 0.125  # an innovation beyond this part of a turn is not noise: the lock is in doubt
DOUBT_LIMIT = 0.5  # s in doubt after which the observer starts again
COAST = 0.2  # s without input or outside the domain after which the state is not observable
POWER_MEMORY = 400.0  # samples over which the innovation's power is averaged
DRIFT_MEMORY = 20.0  # slowest time constants over which the power of its slow part is averaged
START_SETTLING = 4.0  # time constants of the slowest pole until a start has settled

NO_REASON = 0
OUT_OF_DOMAIN = 1
NO_INPUT = 2
FAR_OFF = 3  # the innovation is too large
NOT_FINITE = 4  # the model returned values that are not finite

SINGLE_ANGLE = EDGES = TURNS = False
DRIVEN = True


@record
class MechanismEstimate:
    """The newest estimate of a mechanism."""

    position: Vector  # [rad or m], in the convention of the measurement
    velocity: Vector  # [rad/s or m/s]
    status: int


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set what follows from dt [s]."""
    corner = START_SETTLING * dt / design.settle  # of the slow part: the slowest pole
    coefficients.dt = dt
    coefficients.inverse_dt = 1.0 / dt
    coefficients.drift = corner / (1.0 + corner)
    coefficients.memory = max(POWER_MEMORY * dt, DRIFT_MEMORY * design.settle / START_SETTLING)


def is_reading(measurement: Vector) -> bool:
    """Return True: `driver.mechanism_channel` examines the measurement."""
    return True


def start(observer: Any, state: State, design: Design, measurement: Vector) -> None:
    """Set every field, after the first sample."""
    begin_core(observer.model, state, INITIALISING, NO_REASON)
    for i in range(observer.model.JOINTS):
        state.before[i] = measurement[i]
        begin_convention(state.conventions[i], measurement[i])
        state.squares[i] = state.drift[i] = state.drift_squares[i] = 0.0


def begin_core(model: Any, state: State, status: int, reason: int) -> None:
    """Begin at rest at the measurement."""
    core = state.core
    for i in range(model.JOINTS):
        core.e[i] = core.x[i] = core.d[i] = core.v[i] = 0.0
    state.status, state.invalid_reason = status, reason
    state.valid_time = state.invalid_time = 0.0


def step(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: Vector,
    known_input: Vector,
) -> None:
    """Take one sample."""
    n, work, core = observer.model.JOINTS, state.work, state.core
    for i in range(n):
        work.moved[i] = wrap(measurement[i] - state.before[i], design.periods[i])
        follow_convention(state.conventions[i], measurement[i], design.periods[i])
    reason = NO_REASON
    if not is_finite(observer.model.INPUTS, known_input):
        reason = NO_INPUT
    elif not observer.advance(
        observer.model, state, coefficients, design, measurement, known_input
    ):
        reason = OUT_OF_DOMAIN
    elif not (is_finite(n, work.after.e) and is_finite(n, work.after.v)):
        begin_core(observer.model, state, INITIALISING, NOT_FINITE)
        reason = NOT_FINITE
    else:
        core.take(work.after)
        if is_beyond(n, core.e, design.outside):
            reason = FAR_OFF
    if reason == NO_REASON:
        settle(observer, state, coefficients, design)
    elif reason != NOT_FINITE:
        update_fault_status(observer, state, coefficients, design, measurement, reason)
    for i in range(n):
        state.before[i] = measurement[i]


def settle(observer: Any, state: State, coefficients: Coefficients, design: Design) -> None:
    """Follow the status and the power of the innovation after a valid sample."""
    dt = coefficients.dt
    state.valid_time += dt
    if state.valid_time >= design.settle:
        state.status = TRACKING
        state.invalid_time = 0.0
    state.invalid_reason = NO_REASON
    weight = dt / state.valid_time if state.valid_time < POWER_MEMORY * dt else 1.0 / POWER_MEMORY
    since = max(state.valid_time - design.settle, 0.0) + dt
    slowly = dt / min(since, coefficients.memory)
    for i in range(observer.model.JOINTS):
        innovation = state.core.e[i]
        if observer.SLIDING:
            innovation = state.core.d[i]
        state.squares[i] += weight * (innovation * innovation - state.squares[i])
        drift = state.drift[i] + coefficients.drift * (innovation - state.drift[i])
        state.drift[i] = drift
        if state.status == TRACKING:  # the transient of the start is not an error of the model
            state.drift_squares[i] += slowly * (drift * drift - state.drift_squares[i])


def update_fault_status(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: Vector,
    reason: int,
) -> None:
    """Follow the status after a sample that is not valid."""
    state.invalid_time += coefficients.dt
    state.invalid_reason = reason
    if reason == FAR_OFF:
        state.valid_time = 0.0
        if state.invalid_time > design.lost_after:
            begin_core(observer.model, state, INITIALISING, FAR_OFF)
        elif state.status == TRACKING or state.status == COASTING:
            state.status = COASTING
        else:
            state.status = INITIALISING
        return
    # no update: keep the velocity, take the position from the measurement
    coast(observer, state, design, measurement)
    if state.invalid_time > COAST:
        state.valid_time = 0.0
        state.status = NOT_OBSERVABLE
    elif state.status == TRACKING:
        state.status = COASTING


def coast(observer: Any, state: State, design: Design, measurement: Vector) -> None:
    """Take the position from the measurement, and keep the motion."""
    for i in range(observer.model.JOINTS):
        state.core.e[i] = 0.0
    observer.propagate(observer.model, state.core, state.work, design, measurement)


def keep_velocities(model: Any, core: Core, work: Work, design: Design, at: Vector) -> None:
    """Keep the velocities: `propagate` of an observer whose state they are."""


def estimate(
    observer: Any,
    out: MechanismEstimate,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: Vector,
    known_input: Vector,
) -> None:
    """Set the estimate at the last measurement."""
    core = state.core
    for i in range(observer.model.JOINTS):
        out.position[i] = present(
            state.conventions[i], measurement[i] + core.e[i], design.periods[i], design.unwrap[i]
        )
        out.velocity[i] = core.v[i]
    out.status = state.status


def resume(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: Vector
) -> None:
    """Go on after a gap: position from the measurement, motion kept."""
    coast(observer, state, design, measurement)
    go_on(observer.model, state, design, measurement)
    if state.status == TRACKING:
        state.status = COASTING
    state.invalid_reason = NO_REASON
    state.valid_time = state.invalid_time = 0.0


def restart(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: Vector
) -> None:
    """Start again after an outage; the turns that were counted stay."""
    begin_core(observer.model, state, INITIALISING, NO_REASON)
    go_on(observer.model, state, design, measurement)


def go_on(model: Any, state: State, design: Design, measurement: Vector) -> None:
    """Follow the convention of a measurement without a step."""
    for i in range(model.JOINTS):
        state.before[i] = measurement[i]
        follow_convention(state.conventions[i], measurement[i], design.periods[i])


def place(model: Any, state: State, design: Design) -> None:
    """Set the positions `work.at` at which a step evaluates the model."""
    work = state.work
    for i in range(model.JOINTS):
        if not design.at_measurement:
            work.at[i] = state.before[i] + state.core.e[i]
        elif design.linear_hold:
            work.at[i] = state.before[i] + 0.5 * work.moved[i]
        else:
            work.at[i] = state.before[i]


def limits(design: Design, dt: float) -> str | None:
    """Return None, or why these gains cannot work at this dt [s], with the limit."""
    if dt < design.longest:
        return None
    if design.paper:
        return (
            f'forward Euler (form: paper) is unstable at a sample time of {dt:.4g} s: these '
            f'gains need less than {design.longest:.4g} s; use form: exact or lower gains'
        )
    return (
        f'the gains are far too fast for a sample time of {dt:.4g} s: these need less than '
        f'{design.longest:.4g} s; lower bandwidth_hz'
    )


def group_delay(design: Design, dt: float) -> float:
    """Return the delay of the velocity at low frequency [s]."""
    return design.lag + (0.0 if design.linear_hold else 0.5 * dt)


@cache
def bound(module: ModuleType, model: Any) -> ModuleType:
    """Return the observer's module with `model` in it, named as the engine names it."""
    name = f'{module.__dict__["advance"].__module__} model={getattr(model, "__name__", "")}'
    made = ModuleType(name)
    vars(made).update({**vars(module), 'model': model, '__name__': name})
    return made


@dataclass(frozen=True)
class Plan:
    """What the gains of an observer imply.

    Attributes
    ----------
    module : the observer's module with its model, see `bound`.
    linear : (at, mean squares of the innovation) -> (A, V): the error system about a configuration,
        (e, x, d)' = A (e, x, d), and velocities = V x. For standard deviations, status and limits.
    describe : (dt) -> properties of the gains by name: poles, limits, noise.
    noise : (at, mean squares of the innovation, dt) -> `NoiseGains`, for an observer that is not
        linear; None: they follow from `linear`.
    """

    mechanics: Mechanics
    module: ModuleType
    design: Design
    deviations: StandardDeviations
    linear: Callable[[Array, Array], tuple[Array, Array]]
    describe: Callable[[float], dict[str, Any]]

    def limits(self, dt: float) -> str | None:
        """Return None, or why these gains cannot work at this dt [s]."""
        return limits(self.design, dt)

    def state(self) -> State:
        """Return a state with room for all positions."""
        return enlarge(State(), self.mechanics.degrees)

    def why(self, state: State) -> str:
        """Return why the estimate is not published, in words, or ''."""
        model, complaint = self.mechanics.name, self.mechanics.complaint()
        if state.invalid_reason == OUT_OF_DOMAIN:
            return f"outside the domain of model '{model}': the last velocity is kept" + (
                f' ({complaint})' if complaint else ''
            )
        if state.invalid_reason == NO_INPUT:
            needed = ', '.join(self.mechanics.joints[index] for index in self.mechanics.actuated)
            return f"no effort for {needed}, which model '{model}' needs"
        if state.invalid_reason == FAR_OFF:
            return 'the positions are far from those that the model predicts with these inputs'
        if state.invalid_reason == NOT_FINITE:
            return f"model '{model}' is not finite at these positions" + (
                f': {complaint}' if complaint else ''
            )
        if state.status == INITIALISING:
            return (
                f'settling: {state.valid_time:.2g} s of {self.design.settle:.3g} s, four times the '
                'slowest time constant'
            )
        return ''


def made_plan(
    module: ModuleType,
    gains: MechanicalGains,
    mechanics: Mechanics,
    circle: Any,
    *,
    fields: dict[str, Any],
    systems: list[Array] | None = None,
    slowest: float = 0.0,
    lag: float = 0.0,
    linear: Callable[[Array, Array], tuple[Array, Array]],
    describe: Callable[[float], dict[str, Any]],
    noise: Callable[[Array, Array, float], NoiseGains] | None = None,
) -> Plan:
    """Return the plan of an observer.

    Parameters
    ----------
    fields : of `Design`, that the observer sets; matrices have the shape (n, n).
    systems : error systems x' = A x [1/s], the first at the operating point.
    slowest : slowest pole at the operating point [1/s], if there are none.
    lag : as in `Design`. linear, describe, noise : as in `Plan`.
    """
    n = mechanics.degrees
    made: Design = enlarge(Design(), n)
    for index, value in enumerate(mechanics.values):
        made.values[index] = float(value)
    made.paper = gains.form == PAPER_FORM
    made.at_measurement = gains.schedule == AT_MEASUREMENT
    made.linear_hold = gains.hold == LINEAR and gains.form == EXACT_FORM
    made.damped, made.dry = mechanics.damped, mechanics.speed_matters
    made.resisted = mechanics.damped or (mechanics.speed_matters and not made.paper)
    for index, each in enumerate(circles_of(mechanics, circle)):
        made.periods[index], made.unwrap[index] = float(each.period), bool(each.unwrap)
        made.outside[index] = OUTSIDE_PART * each.period if each.period > 0.0 else math.inf
        made.one[index][index] = 1.0
    made.longest, made.lag = math.inf, float(lag)
    if systems is not None:
        slowest = slowest_pole(systems[0])
        made.longest = longest_euler(systems) if made.paper else longest_exact(systems, n)
    made.settle = float(START_SETTLING / slowest) if slowest > 0.0 else math.inf
    made.lost_after = max(DOUBT_LIMIT, min(made.settle, 10.0 * DOUBT_LIMIT))
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            for index, row in enumerate(value.tolist()):
                if isinstance(row, list):
                    getattr(made, name)[index][:n] = row
                else:
                    getattr(made, name)[index] = row
        else:
            setattr(made, name, value)
    deviations = StandardDeviations(
        mechanics,
        per_joint('noise', gains.noise, n),
        per_joint('quantum', gains.quantum, n),
        linear,
        noise,
        measured=gains.noise is None,
        euler=made.paper,
        linear_hold=made.linear_hold,
    )
    return Plan(mechanics, bound(module, mechanics.model), made, deviations, linear, describe)
