# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records that all observers of mechanisms share.

Vectors have one number per position. Those of records have a declared maximum, `JOINTS`; `enlarge`
makes room for a user's own model with more positions, which runs as plain Python.
"""

from __future__ import annotations

from typing import Annotated, Any

from estimator_pkg.models.mechanics import JOINTS, Matrix, Values, Vector
from estimator_pkg.record import Vector as Field
from estimator_pkg.record import record
from estimator_pkg.sensor.convention import Convention


@record
class Design:
    """What the gains and the model imply whatever the sample time is."""

    values: Values  # the model's numbers
    L: Matrix  # [1/s]
    K: Matrix  # [1/s^2], of hgo and ehgo
    Gamma: Matrix  # of geso
    P0: Matrix
    E: Matrix  # of the disturbance; 0: none
    one: Matrix  # the identity
    first: Vector  # gains of the injections of smo
    second: Vector
    m1: float
    m2: float
    uniform: bool  # the uniform injections
    paper: bool  # forward Euler
    at_measurement: bool  # where the model is evaluated
    linear_hold: bool  # the measurement between samples is linear
    simple: bool  # Gamma and P0 are diagonal, and P0 is 1
    damped: bool  # the model has damping
    dry: bool  # the model's forces depend on the velocities
    resisted: bool  # D of `friction.resist` is not zero
    disturbed: bool  # disturbances are estimated
    periods: Vector  # wrap period of each position [rad]; 0: none
    unwrap: Annotated[list[bool], JOINTS]  # turns of the position are counted
    outside: Vector  # innovations [rad or m] beyond which the lock is in doubt
    settle: float  # time of valid samples until the estimate is valid [s]
    lost_after: float  # time without a valid sample after which the observer starts again [s]
    longest: float  # sample time from which on the gains cannot work [s]
    lag: float  # delay at low frequency of motion that the model does not predict [s]


@record
class Coefficients:
    """What follows from the sample time."""

    dt: float  # [s]
    inverse_dt: float  # [1/s]
    drift: float  # weight of the newest sample in the slow part of the innovation
    memory: float  # over which the power of the slow part is averaged [s]


@record
class Core:
    """The observer's own state."""

    e: Vector  # estimate minus measurement [rad or m]
    x: Vector  # momenta (geso) or velocities
    d: Vector  # disturbances (geso, hgo, ehgo) or the innovation (smo)
    v: Vector  # published velocities [rad/s or m/s]


@record
class Work:
    """What a step computes on its way; nothing in it lasts."""

    after: Core  # the state after the step
    moved: Vector  # the change of the measurement since the last sample, wrapped
    at: Vector  # where the model is evaluated
    nothing: Vector  # zeros
    rate: Vector
    f: Vector
    force: Vector
    free: Vector  # the forces at rest
    ahead: Vector
    late: Vector  # the forces at the velocities `ahead`
    coriolis: Vector
    mass: Matrix
    damping: Matrix
    calm: Matrix
    psi: Matrix
    b: Matrix
    w: Matrix
    lower: Matrix  # factors of the mass matrix
    upper: Matrix
    y: Vector
    x: Vector  # terms of the series of `flow`, and the next ones; their sums
    z: Vector
    next_x: Vector
    next_y: Vector
    next_z: Vector
    sum_x: Vector
    sum_y: Vector
    sum_z: Vector


@record
class State:
    """An observer of a mechanism, after a sample."""

    core: Core
    before: Vector  # the last measurement [rad or m]
    conventions: Annotated[list[Convention], JOINTS]
    squares: Vector  # mean squares of the innovation
    drift: Vector  # its slow part
    drift_squares: Vector  # mean squares of the slow part
    status: int
    valid_time: float  # since the last sample that was not valid [s]
    invalid_time: float  # of samples that are not valid [s]
    invalid_reason: int  # see `core`
    work: Work


def enlarge(kept: Any, count: int) -> Any:
    """Return a record (changed in place) whose vectors have room for `count` positions."""
    for name, kind in type(kept).fields.items():
        value = getattr(kept, name)
        if not isinstance(kind, Field):
            if hasattr(type(value), 'fields'):
                enlarge(value, count)
        elif kind.size == JOINTS:
            made = enlarge_vector(kind, count)
            value[:] = made
    return kept


def enlarge_vector(kind: Field, count: int) -> list[Any]:
    """Return a vector of zeros with room for `count`."""
    return [
        enlarge_vector(kind.kind, count) if isinstance(kind.kind, Field) else kind.kind()
        for _ in range(max(count, kind.size))
    ]
