# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The contract of an observer: a declaration of gains and a record of pure functions.

An observer's equations are written once, as functions in the subset of Python that Numba
compiles: floats, ints, tuples, `math`, no exceptions, no containers that grow. The live node calls
them as ordinary Python; replay, tuning and benchmarks may compile the same functions.

State, coefficients and design are tuples, which may be nested. Each field keeps its type: write
0.0, not 0, for a float.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from estimator_pkg.observers.circle import is_angle
from estimator_pkg.record import record

# The status of an estimate. Plain ints: compiled code returns them.
INITIALISING = 0  # not settled since the start or the last loss of lock; not published
TRACKING = 1  # the estimate can be trusted
COASTING = 2  # published, but predicted only (gap, outlier, loss of lock)
LOST = 3  # no input (set by the node, never by an observer)
NOT_OBSERVABLE = 4  # the signals do not determine the state
MISCONFIGURED = 5  # the gains are unstable at the measured sample rate
VALID = (TRACKING, COASTING)  # only estimates with one of these statuses are published
STATUS_NAMES = ('initialising', 'tracking', 'coasting', 'lost', 'not observable', 'misconfigured')


@record
class Estimate:
    """The newest estimate of a single angle."""

    position: float  # [rad or m], in the convention of the measurement
    velocity: float  # [rad/s or m/s]
    acceleration: float  # [rad/s^2 or m/s^2]; nan: the observer gives none
    status: int


@record
class Deviation:
    """One standard deviation of each."""

    position: float  # [rad or m]
    velocity: float  # [rad/s or m/s]


# What a module of an observer must have; docs/observers/contract.md. `observer` is the module
# itself, for what it shares with others (`angle.shared`). Records, and functions of the subset of
# Python that becomes C (see `estimator_pkg.engine`):
RECORDS = ('Design', 'Coefficients', 'State')
FUNCTIONS = {
    'prepare': '(coefficients, design, dt): set what follows from dt [s] and the design',
    'start': '(observer, state, design, measurement): set every field, after the first sample',
    'step': '(observer, state, coefficients, design, measurement, known_input): take one sample',
    'estimate': '(observer, out, state, coefficients, design, measurement, known_input): see '
    '`Estimate`',
    'deviation': '(observer, out, state, coefficients, design, scale): see `Deviation`; that of '
    'the velocity is scaled before it is limited to a speed that the readings allow',
    'resume': '(observer, state, coefficients, design, measurement): go on after a gap: position '
    'from the measurement, speed kept where that is safe',
    'restart': '(observer, state, coefficients, design, measurement): start again after an outage '
    'or a jump of the clock; what does not depend on the motion stays',
    'is_reading': '(measurement) -> False: the guard drops and counts the sample',
    'lateness': '(state) -> by how much the last stamp is taken to be wrong [s]; 0: it is believed',
}
# Ordinary Python:
METHODS = {
    'design': '(gains, circle) -> Design: what follows from the gains whatever the sample time is',
    'limits': '(design, dt) -> None, or why these gains cannot work at this dt [s], with the limit',
    'group_delay': '(design, dt) -> delay of the velocity at low frequency [s]; nan: not known',
    'runs_plain': '(gains) -> True: a function of the user is called, so that the engine is not '
    'used (may be left out)',
    'why': '(state, design) -> the reason for the status, as text for users, or an empty text',
}
CONSTANTS = {
    'SINGLE_ANGLE': 'a sample is one angle alone, so that the driver can compare it with others',
    'EDGES': 'it takes a changed count as the time at which an edge was crossed',
    'TURNS': 'it goes on without a circle where the sensor counts turns (`sensor.turns`): its '
    'state fits both, and it needs no circle to tell an outlier',
    'DRIVEN': 'a known input acts between two samples: none may be dropped or taken later',
}


def never_late(state: Any) -> float:
    """Return 0 [s]: every stamp is believed."""
    return 0.0


def no_limit(design: Any, dt: float) -> str | None:
    """Return None: the gains work at every sample time."""
    return None


def no_reason(state: Any, design: Any) -> str:
    """Return no text: the status says it all."""
    return ''


@dataclass(frozen=True)
class Functions:
    """The pure functions of an observer of fixed structure.

    Attributes
    ----------
    design : () -> design. Returns the tuple of everything that follows from the gains and does not
        depend on dt (poles, variances). Called again when a gain changes; ordinary Python.
    prepare : (design, dt) -> coefficients. Returns everything that follows from dt [s] and design.
    init : (measurement, design) -> state. Returns the state after the first sample.
    step : (state, coefficients, design, measurement, input) -> state. Advances by one sample. The
        input of an observer of single angles is 0, or see `driver.sensor_map`.
    output : (state, coefficients, design, measurement, input) ->
        (position, velocity, acceleration or nan, status).
    stddev : (state, coefficients, design) -> (position, velocity): one standard deviation of each.
    resume : (state, coefficients, design, measurement) -> state. Continues after a gap: position
        from the measurement, speed kept where that is safe.
    restart : (state, coefficients, design, measurement) -> state. Starts again after an outage or
        a jump of the clock. It forgets the motion, but keeps what does not depend on it (the
        turns counted, the identified parameters). None: `init` is called.
    scaled : (state, coefficients, design, scale) -> as `stddev`, where that of the velocity is
        scaled before it is limited to a speed that the readings allow. None: it has no such limit.
    late : (state) -> by how much the last stamp is taken to be wrong [s]; 0: it is believed.
    edges : it takes a changed count as the time at which an edge was crossed.
    limits : (dt) -> None, or text that names why these gains cannot work at this dt [s], with the
        limit.
    group_delay : (dt) -> delay of the velocity at low frequency [s].
    finite : (measurement) -> bool. False: the guard drops and counts the sample.
    blank : a measurement of the right type, for a state before the first sample.
    no_input : an input of the right type, used where the observer gets no input.
    driven : a known input acts between two samples, so no sample may be dropped or taken later.
    turns : it goes on without a circle where the sensor counts turns, see `driver.turns`: its state
        fits both, and it needs no circle to tell an outlier.
    jump : (state, event) -> state, for observers of switched systems.
    why : (state, design) -> the reason for the status, as text for users, or ''. Ordinary Python.
    """

    design: Callable[[], tuple]
    prepare: Callable[[Any, float], tuple]
    init: Callable[[Any, Any], tuple]
    step: Callable[[tuple, tuple, tuple, Any, Any], tuple]
    output: Callable[[tuple, tuple, tuple, Any, Any], tuple[float, float, float, int]]
    stddev: Callable[[tuple, tuple, tuple], tuple[float, float]]
    resume: Callable[[tuple, tuple, tuple, Any], tuple]
    limits: Callable[[float], str | None]
    group_delay: Callable[[float], float]
    finite: Callable[[Any], bool] = is_angle
    blank: Any = 0.0
    no_input: Any = 0.0
    jump: Callable[[tuple, tuple], tuple] | None = None
    why: Callable[[tuple, tuple], str] | None = None
    restart: Callable[[tuple, tuple, tuple, Any], tuple] | None = None
    scaled: Callable[[tuple, tuple, tuple, float], tuple[float, float]] | None = None
    late: Callable[[tuple], float] = never_late
    edges: bool = False
    driven: bool = False
    turns: bool = False

    @property
    def of_angles(self) -> bool:
        """True if a sample is one angle alone, so that the driver can compare it with others."""
        return isinstance(self.blank, float) and not self.driven

    @property
    def new_start(self) -> Callable[[tuple, tuple, tuple, Any], tuple]:
        """Return `restart`, or `init` with the same arguments if there is no `restart`."""
        init = self.init

        def afresh(state: tuple, coefficients: tuple, design: tuple, measurement: Any) -> tuple:
            return init(measurement, design)

        return self.restart or afresh

    @property
    def scaled_stddev(self) -> Callable[[tuple, tuple, tuple, float], tuple[float, float]]:
        """Return `scaled`, or `stddev` times the scale if there is no `scaled`."""
        stddev = self.stddev

        def times(
            state: tuple, coefficients: tuple, design: tuple, scale: float
        ) -> tuple[float, float]:
            position, velocity = stddev(state, coefficients, design)
            return position, scale * velocity

        return self.scaled or times


@dataclass(frozen=True)
class Observer:
    """An observer: the object named by an entry point of ``velocity_estimator.observers``.

    Attributes
    ----------
    name : the name that users write.
    summary : one line for ``velocity_estimator list``.
    gains : the frozen dataclass that declares the parameters (see `estimator_pkg.parameters`).
    build : (gains, circle) -> Functions. It fixes the structure (order, form, injection).
    reference : the paper and its equations.
    kind : 'angle' observers take one angle per sample; `joint_observer` can run them.
    gives_acceleration : (gains) -> bool. True if `output` returns an acceleration.
    """

    name: str
    summary: str
    gains: type
    reference: str
    kind: str = 'angle'
    build: Any = None
    gives_acceleration: Callable[[Any], bool] = field(default=lambda gains: False)

    @property
    def module(self) -> ModuleType:
        """The module that declares the gains, which has the functions."""
        return sys.modules[self.gains.__module__]

    def module_of(self, gains: Any) -> Any:
        """Return the module, or what stands for it with these gains."""
        return self.module
