"""What an observer is: a declaration of gains and a record of pure functions.

An observer's equations are written once, as functions in the subset of Python that Numba
compiles: floats, ints, tuples, `math`, no exceptions, no containers that grow. The live node calls
them as ordinary Python; replay, tuning and benchmarks may compile the same functions.

State, coefficients and design are tuples (tuples of tuples are allowed) whose fields keep one type
each: a float stays a float, so write 0.0 and never 0 for one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from estimator_pkg.observers.circle import Circle

# What an observer says of its own estimate. Plain ints: compiled code returns them.
INITIALISING = 0  # not settled since the start or the last loss of lock; not published
TRACKING = 1  # the estimate can be trusted
COASTING = 2  # published, but carried by prediction (gap, outlier, loss of lock)
LOST = 3  # no input (set by the node, never by an observer)
NOT_OBSERVABLE = 4  # the signals do not determine the state
MISCONFIGURED = 5  # the gains are unstable at the measured sample rate
VALID = (TRACKING, COASTING)  # an estimate of such a status is published, no other
STATUS_NAMES = ('initialising', 'tracking', 'coasting', 'lost', 'not observable', 'misconfigured')


def is_finite(measurement: float) -> bool:
    """False for NaN and infinities."""
    return measurement - measurement == 0.0


@dataclass(frozen=True)
class Functions:
    """The pure functions of an observer whose structure is settled.

    Attributes
    ----------
    design : () -> design. What the gains imply whatever dt is (poles, variances): a tuple. Made
        anew when a gain changes; ordinary Python, called once.
    prepare : (design, dt) -> coefficients. What depends on dt [s] and design alone.
    init : (measurement, design) -> state. From the first sample.
    step : (state, coefficients, design, measurement, input) -> state. One sample further.
    output : (state, coefficients, design, measurement, input) ->
        (position, velocity, acceleration or nan, status).
    stddev : (state, coefficients, design) -> (position, velocity): one standard deviation of each.
    resume : (state, coefficients, design, measurement) -> state. After a gap: position from the
        measurement, speed kept where that is safe.
    restart : (state, coefficients, design, measurement) -> state. A new start, after an outage or
        a jump of the clock: nothing of the motion before, but what is known beside it (the turns
        counted, parameters that were identified). None: as `init`.
    limits : (dt) -> None, or why these gains cannot work at this dt [s], with the limit in words.
    group_delay : (dt) -> delay of the velocity at low frequency [s].
    finite : (measurement) -> bool. False: the guard drops and counts the sample.
    blank : a measurement of the right type, for a state that no sample has reached yet.
    no_input : an input of the right type, where none is given.
    jump : (state, event) -> state, for observers of switching systems.
    why : (state, design) -> what a person should know beside the status, or ''. Ordinary Python.
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
    finite: Callable[[Any], bool] = is_finite
    blank: Any = 0.0
    no_input: Any = 0.0
    jump: Callable[[tuple, tuple], tuple] | None = None
    why: Callable[[tuple, tuple], str] | None = None
    restart: Callable[[tuple, tuple, tuple, Any], tuple] | None = None

    @property
    def new_start(self) -> Callable[[tuple, tuple, tuple, Any], tuple]:
        """`restart`, or `init` in its place."""
        init = self.init

        def afresh(state: tuple, coefficients: tuple, design: tuple, measurement: Any) -> tuple:
            return init(measurement, design)

        return self.restart or afresh


@dataclass(frozen=True)
class Observer:
    """What an entry point of the group ``velocity_estimator.observers`` names.

    Attributes
    ----------
    name : as users write it.
    summary : one line for ``velocity_estimator list``.
    gains : the frozen dataclass that declares the parameters (see `estimator_pkg.parameters`).
    build : (gains, circle) -> Functions. Structure (order, form, injection) is settled here.
    reference : the paper and its equations.
    kind : 'angle' observers take one angle per sample and can serve in `joint_observer`.
    gives_acceleration : (gains) -> bool.
    """

    name: str
    summary: str
    gains: type
    build: Callable[[Any, Circle], Functions]
    reference: str
    kind: str = 'angle'
    gives_acceleration: Callable[[Any], bool] = field(default=lambda gains: False)
