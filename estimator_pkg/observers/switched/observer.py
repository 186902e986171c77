# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Hybrid observer: velocities of a system whose dynamics switch at known events.

Step-by-step super-twisting (22) estimates the outputs' derivatives and the last derivative of each
chain without knowing Z. From them the discrete state Z follows in one of two ways (`discrete`):

    inversion   (25), (28), (29): at each event, from the last N + 1 intervals; for exact outputs
    regression  within an interval, from filtered signals and least squares: for noisy encoders

`jump` is called at each event. Each stage is discretised implicitly, in closed form. The functions
run in Python with numpy, because users write the model; they find it as `observer.model`.

Files: `state` the records, `stages` the continuous part, `velocity` the published velocity,
`discrete` the discrete part.

Barbot, Djemai, Manamanni: State observer and observability conditions for a class of hybrid
continuous-discrete dynamic system (2007); corrections in docs/papers/hybrid_discrete.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from estimator_pkg.circle import Circle, is_angle, wrap
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import COASTING, INITIALISING, TRACKING
from estimator_pkg.models.switched import OUR_MODELS, SwitchedModel, check, load
from estimator_pkg.observers.angle.shared import variance_floor
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.least_squares import kept
from estimator_pkg.observers.switched import discrete as discrete_part
from estimator_pkg.observers.switched import state as records
from estimator_pkg.observers.switched.discrete import (
    FILTER_RATE,
    FORGOTTEN,
    UNKNOWN_VARIANCE,
    begin_signals,
    learn,
    regression_filter,
    resting,
    signals,
)
from estimator_pkg.observers.switched.stages import climb, gates_open, stage
from estimator_pkg.observers.switched.state import (
    Coefficients,
    Design,
    OutputDeviations,
    OutputEstimates,
    State,
    is_sound,
)
from estimator_pkg.observers.switched.velocity import (
    correction,
    motions,
    observe,
    pole,
    standard_deviations,
)
from estimator_pkg.parameters import parameter, structural
from estimator_pkg.sensor.convention import Convention, begin_convention, follow_convention, present
from estimator_pkg.sensor.scatter import Scatter, begin_scatter, follow_scatter, resume_scatter

LOCKED = 0.3  # longest settling time of the stages after a start [s]
LARGEST_JUMP = 0.125  # of a turn: a larger one is no motion, the encoder was stuck or reset
MISFIT = 9.0  # largest power of the regression's residual relative to that of noise
FADED = 20.0  # time constants of the extended observers until the start has no influence

OutputReadings = Sequence[float]  # one number per output [rad or m]


@dataclass(frozen=True)
class Gains:
    """Parameters of `switched`."""

    model: str = structural(
        'gripper',
        choices=(*OUR_MODELS, 'package.module:name'),
        description='the system: a built-in model, or your own SwitchedModel',
    )
    discrete: str = structural(
        'regression',
        choices=('regression', 'inversion'),
        description='how Z is estimated: regression for noisy encoders; inversion as in the paper, '
        'for exact outputs only',
        equation='(28), (29)',
    )
    velocity: str = structural(
        'filtered',
        choices=('filtered', 'cascade'),
        description='source of the published velocity. filtered: an extended observer that uses '
        'the model with the estimated Z, for noisy encoders; cascade: the super-twisting stages, '
        'as in the paper',
        equation='(22)',
    )
    bandwidth_hz: float = parameter(
        48.0,
        unit='Hz',
        range=(0.001, 1e6),
        search=(1.0, 500.0),
        description='-3 dB frequency from true to estimated velocity for motion that the model '
        'does not predict; velocity filtered only',
    )
    gate: float = parameter(
        1e-3,
        unit='unit of the output',
        range=(1e-12, 1e6),
        description='a stage runs while the errors of all stages before it are below this',
        equation='epsilon in (23)',
    )
    steps: int = structural(
        1,
        range=(1, 20),
        description='number of past intervals that the inversion uses',
        equation='N in (28)',
    )
    singular_value: float = parameter(
        0.05,
        range=(0.0, 1e9),
        description='the inversion is used if the smallest singular value of its matrix is above '
        'this',
    )
    settle: float = parameter(
        0.3,
        unit='s',
        range=(0.0, 1e6),
        description='settling time after an event, during which Z is predicted and not converged; '
        'between two events closer than this Z stays predicted',
        equation='tau_c in (26)',
    )
    reset: str = structural(
        'all',
        choices=('all', 'states'),
        description='what (13) resets at an event. states: the states of both chains; all: the '
        'last derivative of each chain too',
    )
    memory: float = parameter(
        0.0,
        unit='s',
        range=(0.0, 1e9),
        description='time constant with which the regression forgets within an interval; 0: it '
        'forgets nothing',
    )
    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        description='smallest step of the measurement; 0: not known',
    )
    noise: float | None = parameter(
        None,
        unit='rad',
        range=(1e-12, 10.0),
        description='standard deviation of the measurement noise; automatic: estimated',
    )


def begin_motion(observer: Any, state: State, design: Design, measurement: OutputReadings) -> None:
    """Set everything that depends on motion and Z, both unknown."""
    model, y = observer.model, tuple(map(float, measurement))
    indices, m, u = model.indices, model.size, (0.0,) * len(model.probe(0.0))
    state.zh = [[x, *(0.0,) * (k - 1)] for x, k in zip(y, indices)]
    state.zt = [[0.0] * k for k in indices]
    state.errors = [[0.0] * k for k in indices]
    state.y, state.y_at, state.u = list(y), list(y), list(u)
    state.z, state.predicted, state.used = (np.zeros(m) for _ in range(3))
    state.observed = [np.array([x, *(0.0,) * k]) for x, k in zip(y, indices)]
    state.powers = [0.0] * len(indices)
    state.noises = [[1.0, 1.0, 1.0] for _ in indices]
    state.dt = state.age = state.total = state.power = 0.0
    state.forgetting = FORGOTTEN
    state.history, state.fitted = [], False
    state.signals = [begin_signals(k, m, x) for k, x in zip(indices, y)]
    zeta = tuple(x for zh in state.zh for x in zh)
    state.last_columns = state.origin = signals(model, y, u, zeta)
    state.p = np.diag(design.vague)
    state.scatters = [Scatter() for _ in y]
    for scatter, reading in zip(state.scatters, y):
        begin_scatter(scatter, reading)


def is_torn(state: State, jumps: list[float], h: float, period: float) -> bool:
    """Return True if an output changed by more than its speed explains."""
    speeds = (float(each[1]) if len(each) > 2 else 0.0 for each in state.observed)
    return any(abs(a - v * h) > LARGEST_JUMP * period for a, v in zip(jumps, speeds))


def noise_variance(design: Design, scatter: Scatter) -> float:
    """Return the variance of the measurement noise of an output."""
    return design.noise or max(scatter.variance, design.floor)


@lru_cache(maxsize=16)  # because a check takes half a second
def checked(name: str, steps: int) -> type[Switched]:
    """Return the observer with the model of this name, checked."""
    found = load(name)
    check(found, steps)
    return type('Switched', (Switched,), {'model': found})


class Switched(Observer):
    """The observer of a switched system; `bound` adds its model, as `model`."""

    name = 'switched'
    summary = 'hybrid observer of systems that switch at known events'
    reference = (
        'Barbot, Djemai, Manamanni (2007): State observer and observability conditions for a '
        'class of hybrid continuous-discrete dynamic system'
    )
    kind = 'switched'
    gains = Gains
    Design: TypeAlias = records.Design
    Coefficients: TypeAlias = records.Coefficients
    State: TypeAlias = records.State
    model: SwitchedModel
    discrete = staticmethod(discrete_part.discrete)
    jump = staticmethod(discrete_part.jump)

    @staticmethod
    def design(gains: Gains, circle: Circle) -> Design:
        """Return what follows from gains and model; `circle` applies to every output.

        Raises
        ------
        UsageError : the model is invalid, its rank condition is never met with these `steps`, or
            the memory is too short.
        """
        model, made = Switched.bound(gains).model, Design()
        if 0.0 < gains.memory < 1.0 / FILTER_RATE:
            raise UsageError(
                f"parameter 'memory' = {gains.memory:g} s is shorter than the filter's time "
                f'constant: set 0, or at least {1.0 / FILTER_RATE:.3g} s'
            )
        made.orders = [
            np.array(own, int)
            for own in model.orders or [(0,) * (model.size + 1)] * len(model.indices)
        ]
        if any(
            order > 1 or order >= k for own, k in zip(made.orders, model.indices) for order in own
        ):
            raise UsageError(
                f"model '{gains.model}': 'orders' = {model.orders} has an entry that is too large: "
                'each must be 0, or 1 where the chain is longer than 1'
            )
        made.filtered, made.regression = (
            gains.velocity == 'filtered',
            gains.discrete == 'regression',
        )
        made.resets_ends = gains.reset == 'all'
        made.stages = [[stage(bound) for bound in own] for own in model.bounds]
        made.bounds = [own[0] for own in model.bounds]
        made.poles = [pole(k, gains.bandwidth_hz) for k in model.indices]
        made.faded = FADED / min(made.poles)
        made.gate, made.steps, made.singular_value = gains.gate, gains.steps, gains.singular_value
        made.settle, made.locked = gains.settle, min(gains.settle, LOCKED)
        made.memory, made.vague = gains.memory, np.full(model.size, UNKNOWN_VARIANCE)
        made.period, made.unwrap = float(circle.period), bool(circle.unwrap)
        made.floor = variance_floor(gains.quantum)
        made.noise = gains.noise * gains.noise + made.floor if gains.noise is not None else 0.0
        return made

    @staticmethod
    def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]."""
        coefficients.dt, coefficients.keep = dt, kept(dt, design.memory)
        lengths = [len(each) for each in design.stages]
        coefficients.filters = [regression_filter(k, dt) for k in lengths]
        coefficients.corrections = [
            correction(k, pole, dt) for k, pole in zip(lengths, design.poles)
        ]

    @staticmethod
    def is_reading(measurement: OutputReadings) -> bool:
        """Return False if an output is no angle."""
        return all(map(is_angle, measurement))

    @staticmethod
    def start(observer: Any, state: State, design: Design, measurement: OutputReadings) -> None:
        """Set every field, after the first sample."""
        begin_motion(observer, state, design, measurement)
        state.conventions = [Convention() for _ in measurement]
        for convention, reading in zip(state.conventions, measurement):
            begin_convention(convention, float(reading))

    @staticmethod
    def step(
        observer: Any,
        state: State,
        coefficients: Coefficients,
        design: Design,
        measurement: OutputReadings,
        known_input: Sequence[float],
    ) -> None:
        """Take one sample: the stages, the extended observers, then least squares."""
        model, h, period = observer.model, coefficients.dt, design.period
        read, u = tuple(map(float, measurement)), tuple(map(float, known_input))
        jumps = [wrap(x - known.last, period) for x, known in zip(read, state.conventions)]
        if period > 0.0 and state.total > design.faded and is_torn(state, jumps, h, period):
            # the readings before may have been wrong, and the Z that was learnt from them
            observer.restart(observer, state, coefficients, design, measurement)
            return
        for i, change in enumerate(jumps):
            climb(state, design, i, change, h)
        y = tuple(before + change for before, change in zip(state.y, jumps))
        if design.filtered:
            z, _, converged = discrete_part.discrete(state, design)
            observe(model, state, coefficients, y, u, np.array(z) if converged else state.used)
        state.u[:] = u
        state.dt = h
        state.age += h
        state.total += h
        state.forgetting = max(0.0, state.forgetting - h)
        for reading, convention, scatter in zip(read, state.conventions, state.scatters):
            follow_convention(convention, reading, period)
            follow_scatter(scatter, reading, h, period)
        if design.regression:
            learn(model, state, coefficients, design, y, jumps, u)
        else:
            state.y[:] = y
        if not is_sound(state):
            observer.start(
                observer, state, design, measurement
            )  # the state has diverged: start again

    @staticmethod
    def estimate(
        observer: Any,
        out: OutputEstimates,
        state: State,
        coefficients: Coefficients,
        design: Design,
        measurement: OutputReadings,
        known_input: Sequence[float],
    ) -> None:
        """Set the estimate of all outputs at the last measurement."""
        z, _, converged = discrete_part.discrete(state, design)
        found = motions(observer.model, state, design, z, converged)
        out.position = [
            present(convention, position, design.period, design.unwrap)
            for convention, (position, _, _) in zip(state.conventions, found)
        ]
        out.velocity = [velocity for _, velocity, _ in found]
        out.acceleration = [acceleration for _, _, acceleration in found]
        if design.filtered:
            locked = state.total > design.faded
        else:
            locked = state.total > design.locked and gates_open(state, design)
        out.status = INITIALISING if not locked else TRACKING if state.age > 0.0 else COASTING

    @staticmethod
    def deviation(
        observer: Any,
        out: OutputDeviations,
        state: State,
        coefficients: Coefficients,
        design: Design,
        scale: float,
    ) -> None:
        """Set the standard deviations of all outputs."""
        found = []
        for i, scatter in enumerate(state.scatters):
            sigma = math.sqrt(noise_variance(design, scatter))
            found.append(standard_deviations(state, design, i, sigma))
        out.position = [position for position, _ in found]
        out.velocity = [scale * velocity for _, velocity in found]

    @staticmethod
    def resume(
        observer: Any,
        state: State,
        coefficients: Coefficients,
        design: Design,
        measurement: OutputReadings,
    ) -> None:
        """Continue after a gap: positions from the measurement; keep speeds and Z."""
        old, shown = State(), discrete_part.discrete(state, design)[0]
        old.take(state)
        begin_motion(observer, state, design, measurement)
        for i, reading in enumerate(map(float, measurement)):
            y = old.y[i] + wrap(reading - state.conventions[i].last, design.period)
            state.y[i] = state.y_at[i] = state.zh[i][0] = state.observed[i][0] = y
            state.zh[i][1:], state.observed[i][1:] = old.zh[i][1:], old.observed[i][1:]
            state.signals[i].rows[0] = resting(len(old.zh[i]), y)
            follow_convention(state.conventions[i], reading, design.period)
            state.scatters[i].take(old.scatters[i])
            resume_scatter(state.scatters[i], reading)
        state.zt, state.u, state.used, state.noises = old.zt, old.u, old.used, old.noises
        state.dt, state.p = old.dt, old.p
        state.z = state.predicted = np.array(shown)

    @staticmethod
    def restart(
        observer: Any,
        state: State,
        coefficients: Coefficients,
        design: Design,
        measurement: OutputReadings,
    ) -> None:
        """Start again; the turns that were counted stay."""
        begin_motion(observer, state, design, measurement)
        for convention, reading in zip(state.conventions, measurement):
            follow_convention(convention, float(reading), design.period)

    @staticmethod
    def why(state: State, design: Design) -> str:
        """Return that the model does not fit if noise does not explain the residual.

        The interval of the velocity covers that, but Z is not the plant's.
        """
        if not (design.regression and discrete_part.discrete(state, design)[2]):
            return ''
        noise = max(noise_variance(design, scatter) for scatter in state.scatters)
        if state.power <= MISFIT * noise:
            return ''
        return (
            'the model does not fit: its residual is '
            f'{math.sqrt(state.power / noise):.2g} times what noise explains'
        )

    @staticmethod
    def group_delay(design: Design, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]: none."""
        return 0.0

    @staticmethod
    def gives_acceleration(gains: Gains) -> bool:
        """Return True: it has one for each output."""
        return True

    @classmethod
    def bound(cls, gains: Gains) -> type[Switched]:
        """Return the observer with the model of these gains, as `model`.

        Raises
        ------
        UsageError : the model is invalid.
        """
        return checked(gains.model, gains.steps)
