# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The shared part of all observers of mechanisms: guard of the domain, status, convention.

A measurement is the tuple of all positions. The input is the tuple of forces and torques that acted
from the previous sample to this one. An observer is a small core (see `MechanicalCore`). `around`
adds the shared part and returns the `Functions` of the contract, in which position, velocity and
acceleration are tuples.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.contract import (
    COASTING,
    INITIALISING,
    NOT_OBSERVABLE,
    TRACKING,
    Functions,
)
from estimator_pkg.observers.mechanism.algebra import mechanical_algebra
from estimator_pkg.observers.mechanism.noise import NoiseGains, make_stddev
from estimator_pkg.observers.mechanism.parameters import (
    EXACT,
    LINEAR,
    PAPER,
    MechanicalGains,
    circles_of,
    per_joint,
)

Array = NDArray[np.float64]

OUTSIDE = 0.125  # an innovation beyond this part of a turn is not noise: the lock is in doubt
LOST_AFTER = 0.5  # s in doubt after which the observer starts again
COAST = 0.2  # s without input or outside the domain after which the state is not observable
MEMORY = 400.0  # samples over which the innovation's power is averaged
DRIFT_MEMORY = 20.0  # slowest time constants over which the power of its slow part is averaged
SETTLED = 4.0  # time constants of the slowest pole until a start has settled


class Design(NamedTuple):
    """Everything that follows from the gains alone."""

    core: tuple  # design of the core
    periods: tuple  # wrap period of each position [rad]; 0: none
    unwrap: tuple  # 1.0 or 0.0 for each position
    outside: tuple  # innovations [rad or m] beyond which the lock is in doubt
    settle: float  # time without trouble until the estimate is valid [s]
    lost_after: float  # time in trouble after which the observer starts again [s]


class Coefficients(NamedTuple):
    """Everything that follows from the design and the sample time."""

    core: tuple
    dt: float  # [s]
    drift: float  # weight of the newest sample in the slow part of the innovation
    memory: float  # over which the power of the slow part is averaged [s]


@dataclass(frozen=True)
class MechanicalCore:
    """The part that differs between observers. All but `design`, `linear` and `limits` compile.

    Its state is (e, x, d, v): e, estimate minus measurement of the positions; x, momenta or
    velocities; d, disturbances, if they are estimated; v, published velocities.

    design : () -> design of the core.
    prepare : (design, dt) -> coefficients of the core.
    begin : () -> core state at rest at the measurement.
    advance : (core, coefficients, design, before, moved, measurement, known_input) -> (core, good).
        Advances by one sample: `before` is the previous measurement, `moved` the wrapped change
        since then. `good` is False where the model is not valid.
    carry : (core, design, at) -> core. Sets the velocities v at the positions `at` after samples
        with missing inputs or measurements.
    linear : (at, mean squares of the innovation) -> (A, V): the error system about a configuration,
        (e, x, d)' = A (e, x, d), and velocities = V x. For standard deviations, status and limits.
    slowest : slowest pole at the operating point [1/s], positive.
    lag : delay at low frequency of motion that the model does not predict [s].
    noise : (at, mean squares of the innovation, dt) -> `NoiseGains`, for a core that is not linear;
        None: they follow from `linear`.
    seen : index of the innovation in the core's state: 0 for e, 2 for d.
    """

    design: Callable[[], tuple]
    prepare: Callable[[tuple, float], tuple]
    begin: Callable[[], tuple]
    advance: Callable[..., tuple]
    carry: Callable[..., tuple]
    linear: Callable[[Array, Array], tuple[Array, Array]]
    limits: Callable[[float], str | None]
    slowest: float
    lag: float
    noise: Callable[[Array, Array, float], NoiseGains] | None = None
    seen: int = 0


@dataclass(frozen=True, kw_only=True)
class MechanicalFunctions(Functions):
    """The functions of an observer of kind 'mechanical'.

    Attributes
    ----------
    mechanics : the model.
    core : the core, for callers that start it in another state than at rest at the measurement.
    describe : (dt) -> properties of the gains by name: poles, limits, noise.
    why : (state, design) -> why the estimate is not published, in words, or ''.
    """

    mechanics: Mechanics
    core: MechanicalCore
    describe: Callable[[float], dict[str, Any]]
    why: Callable[[tuple, tuple], str]


def prepare_dt(design: tuple, dt: float) -> tuple[float, float]:
    """Return (dt [s], 1 / dt [1/s]): the coefficients of a core that needs no others."""
    return (dt, 1.0 / dt)


def around(
    core: MechanicalCore,
    gains: MechanicalGains,
    mechanics: Mechanics,
    circle: Any,
    describe: Callable[[float], dict[str, Any]],
) -> MechanicalFunctions:
    """Return the contract's functions for the observer of a mechanism with this core.

    The state is (state of the core, last measurement, conventions, power, lock). The power is (mean
    squares of the innovation, its slow part, mean squares of the slow part). The lock is (status,
    time since the last trouble [s], time in trouble [s], kind of trouble): 0 none, 1 outside the
    domain, 2 no input, 3 innovation too large, 4 the model returned values that are not finite.
    """
    n = mechanics.degrees
    circles = circles_of(mechanics, circle)
    algebra = mechanical_algebra(n)
    between, begin_all, follow_all = algebra.between, algebra.begin, algebra.follow
    finite, beyond, present_all, squares = (
        algebra.finite,
        algebra.beyond,
        algebra.present,
        algebra.squares,
    )
    towards, minus, zeros_like = algebra.towards, algebra.minus, algebra.zeros_like
    input_finite = mechanical_algebra(max(1, mechanics.inputs)).finite
    needs_input = mechanics.inputs > 0
    prepare_core, advance, carry, begin_core = (core.prepare, core.advance, core.carry, core.begin)
    unknown, seen = (math.nan,) * n, core.seen
    stddev = make_stddev(
        core,
        mechanics,
        per_joint('noise', gains.noise, n),
        per_joint('quantum', gains.quantum, n),
        measured=gains.noise is None,
        euler=gains.form == PAPER,
        linear_hold=gains.form == EXACT and gains.hold == LINEAR,
    )
    linear_hold = gains.form == EXACT and gains.hold == LINEAR
    settling = SETTLED / core.slowest if core.slowest > 0.0 else math.inf

    def design() -> Design:
        periods = tuple(float(each.period) for each in circles)
        outside = tuple(OUTSIDE * period if period > 0.0 else math.inf for period in periods)
        return Design(
            core=core.design(),
            periods=periods,
            unwrap=tuple(float(each.unwrap) for each in circles),
            outside=outside,
            settle=float(settling),
            lost_after=max(LOST_AFTER, min(float(settling), 10.0 * LOST_AFTER)),
        )

    def prepare(design: Any, dt: float) -> Coefficients:
        corner = SETTLED * dt / settling  # of the slow part: the slowest pole
        memory = max(MEMORY * dt, DRIFT_MEMORY * settling / SETTLED)
        return Coefficients(prepare_core(design.core, dt), dt, corner / (1.0 + corner), memory)

    def init(measurement: tuple, design: Any) -> tuple:
        return (
            begin_core(),
            measurement,
            begin_all(measurement),
            (zeros_like(measurement), zeros_like(measurement), zeros_like(measurement)),
            (INITIALISING, 0.0, 0.0, 0),
        )

    def step(
        state: tuple, coefficients: Any, design: Any, measurement: tuple, known_input: tuple
    ) -> tuple:
        inner, before, conventions, power, (status, clear, astray, trouble) = state
        core_coefficients, dt, of_newest, memory = coefficients
        core_design, periods, unwrap, outside, settle, lost_after = design
        moved = between(measurement, before, periods)
        conventions = follow_all(conventions, measurement, periods)
        found = 0
        if needs_input and not input_finite(known_input):
            found = 2
        else:
            after, good = advance(
                inner, core_coefficients, core_design, before, moved, measurement, known_input
            )
            e, x, d, v = after
            if not good:
                found = 1
            elif not finite(e) or not finite(v):
                return (begin_core(), measurement, conventions, power, (INITIALISING, 0.0, 0.0, 4))
            else:
                inner = after
                if beyond(e, outside):
                    found = 3
        if found == 0:
            clear += dt
            if clear >= settle:
                status = TRACKING
                astray = 0.0
            weight = dt / clear if clear < MEMORY * dt else 1.0 / MEMORY
            mean_squares, drift, drift_squares = power
            mean_squares = squares(mean_squares, weight, inner[seen])
            drift = towards(drift, of_newest, minus(inner[seen], drift))
            if status == TRACKING:  # the transient of the start is not an error of the model
                since = max(clear - settle, 0.0) + dt
                drift_squares = squares(drift_squares, dt / min(since, memory), drift)
            power = (mean_squares, drift, drift_squares)
            return (inner, measurement, conventions, power, (status, clear, astray, 0))
        astray += dt
        if found != 3:  # no update: keep the velocity, take the position from the measurement
            e, x, d, v = inner
            inner = carry((zeros_like(measurement), x, d, v), core_design, measurement)
        if found == 3:
            clear = 0.0
            if astray > lost_after:
                return (begin_core(), measurement, conventions, power, (INITIALISING, 0.0, 0.0, 3))
            status = COASTING if status == TRACKING or status == COASTING else INITIALISING
        elif astray > COAST:
            clear = 0.0
            status = NOT_OBSERVABLE
        elif status == TRACKING:
            status = COASTING
        return (inner, measurement, conventions, power, (status, clear, astray, found))

    def output(
        state: tuple, coefficients: Any, design: Any, measurement: tuple, known_input: tuple
    ) -> tuple:
        (e, x, d, v), before, conventions, power, (status, clear, astray, trouble) = state
        position = present_all(
            conventions, towards(measurement, 1.0, e), design.periods, design.unwrap
        )
        return position, v, unknown, status

    def resume(state: tuple, coefficients: Any, design: Any, measurement: tuple) -> tuple:
        (e, x, d, v), before, conventions, power, (status, clear, astray, trouble) = state
        inner = carry((zeros_like(measurement), x, d, v), design.core, measurement)
        if status == TRACKING:
            status = COASTING
        return (
            inner,
            measurement,
            follow_all(conventions, measurement, design.periods),
            power,
            (status, 0.0, 0.0, 0),
        )

    def restart(state: tuple, coefficients: Any, design: Any, measurement: tuple) -> tuple:
        inner, before, conventions, power, lock = state
        return (
            begin_core(),
            measurement,
            follow_all(conventions, measurement, design.periods),
            power,
            (INITIALISING, 0.0, 0.0, 0),
        )

    def why(state: tuple, design: Any) -> str:
        inner, before, conventions, power, (status, clear, astray, trouble) = state
        if trouble == 1:
            complaint = mechanics.complaint()
            return f"outside the domain of model '{mechanics.name}': the last velocity is kept" + (
                f' ({complaint})' if complaint else ''
            )
        if trouble == 2:
            needed = ', '.join(mechanics.joints[index] for index in mechanics.actuated)
            return f"no effort for {needed}, which model '{mechanics.name}' needs"
        if trouble == 3:
            return 'the positions are far from those that the model predicts with these inputs'
        if trouble == 4:
            complaint = mechanics.complaint()
            return f"model '{mechanics.name}' is not finite at these positions" + (
                f': {complaint}' if complaint else ''
            )
        if status == INITIALISING:
            return (
                f'settling: {clear:.2g} s of {design.settle:.3g} s, four times the slowest '
                'time constant'
            )
        return ''

    return MechanicalFunctions(
        design=design,
        prepare=prepare,
        init=init,
        step=step,
        output=output,
        stddev=stddev,
        resume=resume,
        limits=core.limits,
        group_delay=lambda dt: core.lag + (0.0 if linear_hold else 0.5 * dt),
        finite=finite,
        blank=tuple(mechanics.centre),
        no_input=(math.nan,) * max(1, mechanics.inputs),
        mechanics=mechanics,
        core=core,
        describe=describe,
        why=why,
        restart=restart,
    )
