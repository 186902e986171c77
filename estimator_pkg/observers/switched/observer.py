# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Hybrid observer: velocities of a system whose dynamics switch at known events.

Step-by-step super-twisting (22) estimates the outputs' derivatives and the last derivative of each
chain without knowing Z. From them the discrete state Z follows in one of three ways (`discrete`):

    inversion   (25), (28), (29): at each event, from the last N + 1 intervals; for exact outputs
    regression  within an interval, from filtered signals and least squares: for noisy encoders
    copy        Z+ = A_d Z + beta_d only

`jump` is called at each event. Each stage is discretised implicitly, in closed form, or by forward
Euler (`form: explicit`), which chatters. The functions run in Python with numpy, because users
write the model.

Files: `gains` the parameters, `system` everything that follows from them, `stages` the continuous
part, `velocity` the published velocity, `events` and `regression` the discrete part.

Barbot, Djemai, Manamanni: State observer and observability conditions for a class of hybrid
continuous-discrete dynamic system (2007); corrections in docs/papers/hybrid_discrete.md.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.observers.adaptive.filter import rows, series
from estimator_pkg.observers.circle import Circle, is_angle, wrap
from estimator_pkg.observers.contract import COASTING, INITIALISING, TRACKING, Observer
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.observers.maths.scatter import begin_scatter, follow_scatter, resume_scatter
from estimator_pkg.observers.switched.events import discrete, jump
from estimator_pkg.observers.switched.gains import Gains
from estimator_pkg.observers.switched.regression import (
    FORGOTTEN,
    empty_columns,
    learn,
    resting,
    vague,
)
from estimator_pkg.observers.switched.stages import climb, gates_open
from estimator_pkg.observers.switched.state import State, SwitchedFunctions, is_sound
from estimator_pkg.observers.switched.system import make_system
from estimator_pkg.observers.switched.velocity import motions, observe, poles, standard_deviations

LOCKED = 0.3  # longest settling time of the stages after a start [s]
OUTSIDE = 0.125  # a reading beyond this part of a turn is no motion: the encoder was stuck or reset
FADED = 20.0  # time constants of the extended observers until the start has no influence


def build(gains: Gains, circle: Circle) -> SwitchedFunctions:
    """Return the functions of the observer of this model; `circle` applies to every output.

    Raises
    ------
    UsageError : the model is invalid, or its rank condition is never met with these `steps`.
    """
    system = make_system(gains, circle)
    model, period, outputs = system.model, system.period, system.outputs
    indices, m = model.indices, model.size
    floor = gains.quantum * gains.quantum / 12.0
    extended = tuple(poles(k, gains.bandwidth_hz) for k in indices)
    faded = FADED / min(each.pole for each in extended)

    def design() -> tuple:
        return ()

    def prepare(design: tuple, dt: float) -> tuple:
        filters = []
        for column in system.columns:
            f, g0, g1 = series(column, gains.filter_rate, dt)
            filters.append((list(zip(*rows(f, column))), g0, g1))
        return dt, tuple(filters), tuple(each.at(dt) for each in extended)

    def init(measurement: tuple, design: tuple) -> State:
        y = tuple(map(float, measurement))
        zero = tuple((0.0,) * k for k in indices)
        nothing, u = (0.0,) * m, (0.0,) * system.inputs
        first = system.signals(
            y, u, tuple(x for i in outputs for x in (y[i], *(0.0,) * (indices[i] - 1)))
        )
        return State(
            zh=tuple((y[i], *(0.0,) * (indices[i] - 1)) for i in outputs),
            zt=zero,
            errors=zero,
            y=y,
            u=u,
            z=nothing,
            predicted=nothing,
            y_at=y,
            history=(),
            dt=0.0,
            observed=tuple((y[i], *(0.0,) * indices[i]) for i in outputs),
            used=nothing,
            powers=(0.0,) * len(indices),
            noises=((1.0, 1.0, 1.0),) * len(indices),
            age=0.0,
            total=0.0,
            forgetting=FORGOTTEN / gains.filter_rate,
            fitted=False,
            filters=tuple(
                (
                    resting(system, i, y[i]),
                    (0.0,) * indices[i],
                    empty_columns(system, i),
                    (0.0,) * indices[i],
                )
                for i in outputs
            ),
            last_columns=first,
            origin=first,
            p=vague(system),
            power=0.0,
            conventions=tuple(map(begin, y)),
            scatters=tuple(map(begin_scatter, y)),
        )

    def step(
        state: Any, coefficients: tuple, design: tuple, measurement: tuple, known_input: tuple
    ) -> State:
        h, filters_of, corrections = coefficients
        read = tuple(map(float, measurement))
        jumps = tuple(wrap(read[i] - state.conventions[i][0], period) for i in outputs)
        if period > 0.0 and state.total > faded:
            speeds = (each[1] if len(each) > 2 else 0.0 for each in state.observed)
            if any(abs(a - v * h) > OUTSIDE * period for a, v in zip(jumps, speeds)):
                # the readings before may have been wrong, and the Z that was learnt from them
                return restart(state, coefficients, design, measurement)
        climbed = [climb(system, i, state, jumps[i], h) for i in outputs]
        y = tuple(state.y[i] + jumps[i] for i in outputs)
        u = tuple(map(float, known_input))
        if system.is_filtered:
            z, _, converged = discrete(system, state)
            state = observe(system, state, y, u, z if converged else state.used, corrections)
        state = state._replace(
            zh=tuple(c[0] for c in climbed),
            zt=tuple(c[1] for c in climbed),
            errors=tuple(c[2] for c in climbed),
            u=u,
            dt=h,
            age=state.age + h,
            total=state.total + h,
            forgetting=max(0.0, state.forgetting - h),
            conventions=tuple(follow(state.conventions[i], read[i], period) for i in outputs),
            scatters=tuple(follow_scatter(state.scatters[i], read[i], h, period) for i in outputs),
        )
        if system.is_regression:
            state = learn(system, state, y, jumps, filters_of, h)
        else:
            state = state._replace(y=y)
        if not is_sound(state):
            return init(measurement, design)  # the state has diverged: start again
        return state

    def states(state: Any) -> tuple[float, ...]:
        return model.state(system.chains(state)[0], discrete(system, state)[0])

    def published_outputs(state: Any, measurement: tuple) -> list[tuple[float, float, float]]:
        z, _, converged = discrete(system, state)
        return [
            (present(convention, position, period, float(circle.unwrap)), velocity, second)
            for convention, (position, velocity, second) in zip(
                state.conventions, motions(system, state, z, converged)
            )
        ]

    def status(state: Any) -> int:
        if system.is_filtered:
            locked = state.total > faded
        else:
            locked = state.total > min(gains.settle, LOCKED) and gates_open(system, state)
        if not locked:
            return INITIALISING
        return TRACKING if state.age > 0.0 else COASTING

    def output(
        state: Any, coefficients: tuple, design: tuple, measurement: tuple, known_input: tuple
    ) -> tuple:
        position, velocity, acceleration = published_outputs(state, measurement)[0]
        return position, velocity, acceleration, status(state)

    def deviations(state: Any) -> list[tuple[float, float]]:
        found = []
        for i in outputs:
            if gains.noise is not None:
                sigma = math.sqrt(gains.noise * gains.noise + floor)
            else:
                sigma = math.sqrt(max(state.scatters[i][0], floor))
            found.append(standard_deviations(system, state, i, sigma))
        return found

    def stddev(state: Any, coefficients: tuple, design: tuple) -> tuple[float, float]:
        return deviations(state)[0]

    def resume(state: Any, coefficients: tuple, design: tuple, measurement: tuple) -> State:
        """Continue after a gap: positions from the measurement; keep speeds and Z."""
        fresh = init(measurement, design)
        y = tuple(
            state.y[i] + wrap(float(measurement[i]) - state.conventions[i][0], period)
            for i in outputs
        )
        shown = discrete(system, state)[0]
        return fresh._replace(
            zh=tuple((y[i], *state.zh[i][1:]) for i in outputs),
            zt=state.zt,
            y=y,
            u=state.u,
            observed=tuple((y[i], *state.observed[i][1:]) for i in outputs),
            used=state.used,
            noises=state.noises,
            dt=state.dt,
            z=shown,
            predicted=shown,
            y_at=y,
            p=state.p,
            filters=tuple((resting(system, i, y[i]), *fresh.filters[i][1:]) for i in outputs),
            conventions=tuple(
                follow(state.conventions[i], float(measurement[i]), period) for i in outputs
            ),
            scatters=tuple(
                resume_scatter(state.scatters[i], float(measurement[i])) for i in outputs
            ),
        )

    def restart(state: Any, coefficients: tuple, design: tuple, measurement: tuple) -> State:
        return init(measurement, design)._replace(
            conventions=tuple(
                follow(state.conventions[i], float(measurement[i]), period) for i in outputs
            )
        )

    def finite(measurement: tuple) -> bool:
        return len(measurement) == len(indices) and all(is_angle(x) for x in measurement)

    return SwitchedFunctions(
        design,
        prepare,
        init,
        step,
        output,
        stddev,
        resume,
        lambda dt: None,
        lambda dt: 0.0,
        finite,
        (0.0,) * len(indices),
        (0.0,) * system.inputs,
        lambda state, event: jump(system, state, event),
        states=states,
        outputs=published_outputs,
        discrete=lambda state: discrete(system, state),
        chains=system.chains,
        deviations=deviations,
        model=system.model,
        restart=restart,
    )


OBSERVER = Observer(
    name='switched',
    summary='hybrid observer of systems that switch at known events',
    gains=Gains,
    build=build,
    reference='Barbot, Djemai, Manamanni (2007): State observer and observability conditions for a '
    'class of hybrid continuous-discrete dynamic system',
    kind='switched',
    gives_acceleration=lambda gains: True,
)
