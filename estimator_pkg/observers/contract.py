# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The contract of an observer: a class of static functions, which inherits what it does not define.

An observer's equations are written once, as functions of the subset of Python that the engine
translates (docs/engine.md). They update records in place, and run as plain Python or as C. No
observer has an instance: `observer` is the class itself, for what a base asks of it.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.circle import Circle, is_angle


class Observer:
    """An observer: the class named by an entry point of ``velocity_estimator.observers``.

    It has the records `Design` (what follows from the gains whatever the sample time is),
    `Coefficients` (what follows from the sample time) and `State`. `design`, `limits`,
    `group_delay`, `why`, `runs_plain`, `gives_acceleration` and `bound` are ordinary Python; the
    other functions are of the subset. An observer of mechanisms has `plan` in place of all these:
    (gains, circle) -> `mechanism.observer.MechanismObserver`.

    Attributes
    ----------
    name : the name that users write.
    summary : one line for ``velocity_estimator list``.
    gains : the frozen dataclass that declares the parameters (see `estimator_pkg.parameters`).
    reference : the paper and its equations.
    kind : 'angle' observers take one angle per sample; `joint_observer` can run them.
    SINGLE_ANGLE : a sample is one angle alone, so that the driver can compare it with others.
    EDGES : it takes a changed count as the time at which an edge was crossed.
    TURNS : it goes on without a circle where the sensor counts turns (`sensor.turns`): its state
        fits both, and it needs no circle to tell an outlier.
    """

    name: str
    summary: str
    gains: type
    reference: str
    kind = 'angle'
    plan: Any  # of an observer of mechanisms
    SINGLE_ANGLE = False
    EDGES = False
    TURNS = False

    @staticmethod
    def design(gains: Any, circle: Circle) -> Any:
        """Return the `Design`: what follows from the gains whatever the sample time is."""
        raise NotImplementedError

    @staticmethod
    def prepare(coefficients: Any, design: Any, dt: float) -> None:
        """Set what follows from dt [s] and the design."""
        raise NotImplementedError

    @staticmethod
    def start(observer: Any, state: Any, design: Any, measurement: Any) -> None:
        """Set every field of the state, after the first sample."""
        raise NotImplementedError

    @staticmethod
    def step(
        observer: Any,
        state: Any,
        coefficients: Any,
        design: Any,
        measurement: Any,
        known_input: Any,
    ) -> None:
        """Take one sample."""
        raise NotImplementedError

    @staticmethod
    def estimate(
        observer: Any,
        out: Any,
        state: Any,
        coefficients: Any,
        design: Any,
        measurement: Any,
        known_input: Any,
    ) -> None:
        """Set the `Estimate`."""
        raise NotImplementedError

    @staticmethod
    def deviation(
        observer: Any, out: Any, state: Any, coefficients: Any, design: Any, scale: float
    ) -> None:
        """Set the `Deviation`: one standard deviation of position and velocity.

        That of the velocity is scaled before it is limited to a speed that the readings allow.
        """
        raise NotImplementedError

    @staticmethod
    def resume(observer: Any, state: Any, coefficients: Any, design: Any, measurement: Any) -> None:
        """Go on after a gap: position from the measurement, speed kept where that is safe."""
        observer.start(observer, state, design, measurement)

    @staticmethod
    def restart(
        observer: Any, state: Any, coefficients: Any, design: Any, measurement: Any
    ) -> None:
        """Start again after an outage or a jump of the clock: what is no motion stays."""
        observer.start(observer, state, design, measurement)

    @staticmethod
    def is_reading(measurement: Any) -> bool:
        """Return False for what no sensor gives: the guard drops and counts the sample."""
        return is_angle(measurement)

    @staticmethod
    def limits(design: Any, dt: float) -> str | None:
        """Return None, or why these gains cannot work at this dt [s], with the limit."""
        return None

    @staticmethod
    def group_delay(design: Any, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]; nan: not known."""
        return math.nan

    @staticmethod
    def why(state: Any, design: Any) -> str:
        """Return the reason for the status, as text for users; '': the status says it all."""
        return ''

    @staticmethod
    def runs_plain(gains: Any) -> bool:
        """Return True if a function of the user is called, so that the engine is not used."""
        return False

    @staticmethod
    def gives_acceleration(gains: Any) -> bool:
        """Return True if `estimate` sets the acceleration."""
        return False

    @classmethod
    def bound(cls, gains: Any) -> Any:
        """Return the class, or one with what these gains name, such as a model."""
        return cls
