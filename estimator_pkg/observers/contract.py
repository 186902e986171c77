# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The contract of an observer: a declaration of gains, and a module with records and functions.

An observer's equations are written once, as functions of the subset of Python that the engine
translates (docs/engine.md). They update records in place, and run as plain Python or as C.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from estimator_pkg.estimate import (  # noqa: F401  (for modules of observers)
    COASTING,
    INITIALISING,
    LOST,
    MISCONFIGURED,
    NOT_OBSERVABLE,
    STATUS_NAMES,
    TRACKING,
    VALID,
    Deviation,
    Estimate,
)

# What a module of an observer must have. `observer` is the module itself, for what it shares with
# others (`angle.shared`). Records, and functions of the subset of Python that becomes C:
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
# A module of an observer of mechanisms has `plan` in place of all these: (gains, circle) ->
# `mechanism.observer.MechanismObserver`.
CONSTANTS = {
    'SINGLE_ANGLE': 'a sample is one angle alone, so that the driver can compare it with others',
    'EDGES': 'it takes a changed count as the time at which an edge was crossed',
    'TURNS': 'it goes on without a circle where the sensor counts turns (`sensor.turns`): its '
    'state fits both, and it needs no circle to tell an outlier',
    'DRIVEN': 'a known input acts between two samples: none may be dropped or taken later',
}


def no_limit(design: Any, dt: float) -> str | None:
    """Return None: the gains work at every sample time."""
    return None


def no_reason(state: Any, design: Any) -> str:
    """Return no text: the status says it all."""
    return ''


@dataclass(frozen=True)
class Observer:
    """An observer: the object named by an entry point of ``velocity_estimator.observers``.

    Attributes
    ----------
    name : the name that users write.
    summary : one line for ``velocity_estimator list``.
    gains : the frozen dataclass that declares the parameters (see `estimator_pkg.parameters`).
    reference : the paper and its equations.
    kind : 'angle' observers take one angle per sample; `joint_observer` can run them.
    gives_acceleration : (gains) -> bool. True if `estimate` sets the acceleration.
    """

    name: str
    summary: str
    gains: type
    reference: str
    kind: str = 'angle'
    gives_acceleration: Callable[[Any], bool] = field(default=lambda gains: False)

    @property
    def module(self) -> ModuleType:
        """The module that declares the gains, which has the functions."""
        return sys.modules[self.gains.__module__]

    def module_of(self, gains: Any) -> Any:
        """Return the module, or a copy of it with what these gains name, such as a model."""
        return self.module
