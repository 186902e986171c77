# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""GESO: the globally exponentially stable observer of partially linearisable mechanisms.

    qh' = calM(s) ph + L (y - qh)
    ph' = -Psi(s)^T [dV/dq - G u] - Psi^T D calM ph + Gamma calM(s)^T (y - qh),   vh = calM(s) ph

Aranovskiy, Ortega, Romero, Sokolov, 'A globally exponentially stable speed observer for a class of
mechanical systems' (International Journal of Control, 2019), equation (11). The error is linear at
any speed: locally q~'' + L q~' + K q~ = 0 with K = calM Gamma calM^T. So K, not Gamma, is the gain
of the innovation.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.models import check
from estimator_pkg.models.mechanics import Mechanics, Vector
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.tracking import natural_frequency
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from estimator_pkg.observers.mechanism.algebra import (
    apply,
    is_finite,
    multiply,
    multiply_turned,
    turn,
    turned_multiply,
)
from estimator_pkg.observers.mechanism.core import (  # noqa: F401  (its functions too)
    DRIVEN,
    EDGES,
    SINGLE_ANGLE,
    TURNS,
    MechanismEstimate,
    Plan,
    estimate,
    group_delay,
    is_reading,
    limits,
    made_plan,
    place,
    prepare,
    restart,
    resume,
    start,
    step,
)
from estimator_pkg.observers.mechanism.flow import flow
from estimator_pkg.observers.mechanism.friction import resist
from estimator_pkg.observers.mechanism.gains import GesoGains
from estimator_pkg.observers.mechanism.parameters import (
    LoopGains,
    MechanicalGains,
    gain_matrix,
    model_of,
    operating_point,
)
from estimator_pkg.observers.mechanism.state import Coefficients, Core, Design, State, Work
from estimator_pkg.parameters import parameter

Array = NDArray[np.float64]
TURN = 2.0 * np.pi
SLIDING = False


@dataclass(frozen=True)
class Gains(MechanicalGains, LoopGains):
    """Parameters of `geso`."""

    Gamma: tuple[float, ...] | None = parameter(
        None,
        kind=list,
        range=(-1e12, 1e12),
        advanced=True,
        description='gain of the momenta: one number, one per position, or a symmetric positive '
        'definite matrix row by row; the gain of the innovation is '
        'calM Gamma calM^T; automatic: from K, or from bandwidth_hz and damping',
        equation="ph' = ... + Gamma calM^T (y - qh)",
    )
    K: tuple[float, ...] | None = parameter(
        None,
        unit='1/s^2',
        kind=list,
        range=(-1e12, 1e12),
        advanced=True,
        description='gain of the innovation at the operating point, instead of Gamma; automatic: '
        'from Gamma, or from bandwidth_hz and damping',
        equation='Gamma = calM^-1 K calM^-T',
    )


def tune(gains: Gains, mechanics: Mechanics, point: Array) -> GesoGains:
    """Return the gain matrices, shape (n, n), that these parameters request at `point`, (n,).

    Raises
    ------
    UsageError : a gain is not positive definite, not Hurwitz, of wrong size, or set twice.
    """
    n = mechanics.degrees
    calm = mechanics.factors(point)[0]
    slow = TURN * gains.disturbance_hz
    if gains.Gamma is not None and gains.K is not None:
        raise UsageError("'Gamma' and 'K' are both set: set only one of them, not both")
    if gains.L is None and (gains.Gamma is not None or gains.K is not None):
        raise UsageError("'Gamma' or 'K' is set, but not 'L': set 'L' too")
    if gains.L is not None:
        L = gain_matrix('L', gains.L, n)
        if gains.Gamma is None and gains.K is None:
            raise UsageError("'L' is set, but neither 'Gamma' nor 'K': set one of them too")
        innovation = None
    else:
        omega = natural_frequency(gains.bandwidth_hz, gains.damping)
        middle = 2.0 * gains.damping * omega
        # (s^2 + middle s + omega^2)(s + slow)
        L = np.eye(n) * (middle + slow)
        innovation = np.eye(n) * (omega * omega + middle * slow)
    mechanical_gains.require_hurwitz(L)
    if gains.K is not None:
        innovation = mechanical_gains.require_positive('K', gain_matrix('K', gains.K, n))
    if innovation is not None:
        back = np.linalg.inv(calm)
        Gamma = back @ innovation @ back.T
    else:
        Gamma = mechanical_gains.require_positive(
            'Gamma', gain_matrix('Gamma', gains.Gamma or (), n)
        )
    P0 = mechanical_gains.lyapunov_weight(L)
    foreseen = calm @ Gamma @ calm.T
    if gains.L is None:
        product = np.eye(n) * omega * omega * slow
    else:
        product = foreseen * slow
    E = mechanics.inertia(point) @ product
    return GesoGains(L, Gamma, P0, E)


def advance(
    model: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: Vector,
    known_input: Vector,
) -> bool:
    """Set `work.after`, the state after one sample; return False where the model is not valid."""
    n, values, core, work = model.JOINTS, design.values, state.core, state.work
    after, at, moved = work.after, work.at, work.moved
    place(model, state, design)
    if not model.admits(values, at):
        return False
    after.take(core)
    model.factors(work.calm, work.psi, values, at)
    set_gain(model, work, design)
    if design.paper:
        move_by_euler(model, state, coefficients.dt, design, known_input)
    else:
        if design.dry:
            model.inertia(work.mass, values, at)
        resist(model, design, work, at, core.v, known_input, coefficients.dt)
        turn(work.f, n, work.psi, work.force)
        set_damping(model, work, design)
        for i in range(n):
            work.rate[i] = coefficients.inverse_dt * moved[i] if design.linear_hold else 0.0
        if not flow(model, after, work.calm, work.psi, work.b, work, design, coefficients.dt):
            return False
        if not design.linear_hold:
            for i in range(n):
                after.e[i] -= moved[i]
    for i in range(n):
        at[i] = measurement[i] if design.at_measurement else measurement[i] + after.e[i]
    if not model.admits(values, at):
        return False
    model.factors(work.calm, work.psi, values, at)
    apply(after.v, n, work.calm, after.x)
    return True


def set_gain(model: Any, work: Work, design: Design) -> None:
    """Set b = Gamma calM^T P0."""
    n, calm, Gamma = model.JOINTS, work.calm, design.Gamma
    if design.simple:
        for i in range(n):
            for j in range(n):
                work.b[i][j] = Gamma[i][i] * calm[j][i]
    else:
        multiply_turned(work.w, n, Gamma, calm)
        multiply(work.b, n, work.w, design.P0)


def set_damping(model: Any, work: Work, design: Design) -> None:
    """Set w = Psi^T D calM."""
    n = model.JOINTS
    if design.resisted:
        multiply(work.mass, n, work.damping, work.calm)
        turned_multiply(work.w, n, work.psi, work.mass)
    else:
        for i in range(n):
            for j in range(n):
                work.w[i][j] = 0.0


def move_by_euler(model: Any, state: State, dt: float, design: Design, known_input: Vector) -> None:
    """Advance by forward Euler of (11)."""
    n, core, work = model.JOINTS, state.core, state.work
    after = work.after
    model.force(work.force, design.values, work.at, core.v, known_input)
    if design.damped:
        model.damping(work.damping, design.values, work.at)
    turn(work.f, n, work.psi, work.force)
    set_damping(model, work, design)
    for i in range(n):
        of_p, of_L = work.calm[i][0] * core.x[0], design.L[i][0] * core.e[0]
        of_b, of_w = work.b[i][0] * core.e[0], work.w[i][0] * core.x[0]
        for k in range(1, n):
            of_p += work.calm[i][k] * core.x[k]
            of_L += design.L[i][k] * core.e[k]
            of_b += work.b[i][k] * core.e[k]
            of_w += work.w[i][k] * core.x[k]
        after.e[i] = core.e[i] + dt * (of_p - of_L) - work.moved[i]
        work.f[i] = work.f[i] - of_b - of_w
    if design.disturbed:
        turn(work.free, n, work.psi, core.d)
        apply(work.late, n, design.E, core.e)
        for i in range(n):
            work.f[i] += work.free[i]
            after.d[i] = core.d[i] - dt * work.late[i]
    for i in range(n):
        after.x[i] = core.x[i] + dt * work.f[i]


def propagate(model: Any, core: Core, work: Work, design: Design, at: Vector) -> None:
    """Keep the momenta: without forces they are constant at all positions."""
    if not model.admits(design.values, at):
        return
    model.factors(work.calm, work.psi, design.values, at)
    apply(work.f, model.JOINTS, work.calm, core.x)
    if is_finite(model.JOINTS, work.f):
        for i in range(model.JOINTS):
            core.v[i] = work.f[i]


def plan(gains: Gains, circle: Any) -> Plan:
    """Return what these gains imply.

    Raises
    ------
    UserError, UsageError : the model or the gains cannot work.
    """
    mechanics = model_of(gains)
    if not mechanics.linearisable:
        raise UserError(
            f"model '{mechanics.name}' is not partially linearisable (it has no Psi, and the "
            "Cholesky factor of M^-1 is not one): use the observer 'hgo', which does not need it"
        )
    point = operating_point(gains, mechanics)
    tuned = tune(gains, mechanics, point)
    n = mechanics.degrees
    disturbed = gains.disturbance_hz > 0.0

    def linear(at: Array, power: Array) -> tuple[Array, Array]:
        matrix = mechanical_gains.error_matrix(mechanics, tuned, at, disturbed)
        return matrix, mechanics.factors(at)[0]

    def describe(dt: float) -> dict[str, Any]:
        return mechanical_gains.describe(mechanics, tuned, point, dt, disturbed=disturbed)

    configurations = [point, *(q for q, _ in check.random_states(mechanics))]
    matrices = [
        mechanical_gains.error_matrix(mechanics, tuned, q, disturbed) for q in configurations
    ]
    calm_there = mechanics.factors(point)[0]
    K = calm_there @ tuned.Gamma @ calm_there.T @ tuned.P0
    simple = np.all(tuned.Gamma == np.diag(np.diag(tuned.Gamma))) and np.all(np.eye(n) == tuned.P0)
    return made_plan(
        sys.modules[__name__],
        gains,
        mechanics,
        circle,
        fields={**tuned._asdict(), 'simple': bool(simple), 'disturbed': disturbed},
        systems=matrices,
        lag=0.0 if disturbed else float(np.max(np.diag(tuned.L) / np.diag(K))),
        linear=linear,
        describe=describe,
    )


OBSERVER = Observer(
    name='geso',
    summary='globally exponentially stable observer of a mechanism with known model and input',
    gains=Gains,
    kind='mechanical',
    reference='Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), equation (11)',
)
