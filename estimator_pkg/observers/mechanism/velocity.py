# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The shared part of the observers whose state is the velocity: acceleration, step and gains.

`hgo`, `ehgo` and `smo` need M, C and the forces, but not Psi, so they work for every mechanism.
Their error contains C(q, vh) vh - C(q, v) v, which grows with the speed. GESO's error does not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.models import check
from estimator_pkg.models.mechanics import Mechanics, Values, Vector
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from estimator_pkg.observers.mechanism.algebra import apply, divide, solve
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
from estimator_pkg.observers.mechanism.core import keep_velocities as propagate  # noqa: F401
from estimator_pkg.observers.mechanism.flow import flow
from estimator_pkg.observers.mechanism.friction import resist
from estimator_pkg.observers.mechanism.parameters import model_of, operating_point
from estimator_pkg.observers.mechanism.state import Coefficients, Core, Design, State, Work  # noqa: F401

Array = NDArray[np.float64]
SLIDING = False


def accelerate(
    model: Any, work: Work, values: Values, damped: bool, q: Vector, v: Vector, u: Vector
) -> None:
    """Set `work.f` = M^-1 [force - C v - D v]."""
    n, f = model.JOINTS, work.f
    model.force(work.force, values, q, v, u)
    model.coriolis(work.coriolis, values, q, v)
    for i in range(n):
        f[i] = work.force[i] - work.coriolis[i]
    if damped:
        model.damping(work.damping, values, q)
        apply(work.free, n, work.damping, v)
        for i in range(n):
            f[i] -= work.free[i]
    model.inertia(work.mass, values, q)
    solve(f, work.lower, work.upper, n, work.mass)


def drift(model: Any, work: Work, design: Design, v: Vector, u: Vector, h: float) -> None:
    """Set a = `work.f` and W = `work.w` of v' = a - W v.

    a = M^-1 [force - C v] and W = M^-1 D. An explicit step of D v would be unstable if friction
    stops a joint within a sample of h [s].
    """
    n, f = model.JOINTS, work.f
    model.inertia(work.mass, design.values, work.at)
    resist(model, design, work, work.at, v, u, h)
    model.coriolis(work.coriolis, design.values, work.at, v)
    for i in range(n):
        f[i] = work.force[i] - work.coriolis[i]
    solve(f, work.lower, work.upper, n, work.mass)
    if design.resisted:
        divide(work.w, work.free, work.lower, work.upper, n, work.mass, work.damping)


def brake(model: Any, work: Work, design: Design, v: Vector, u: Vector, h: float) -> None:
    """Set `work.f`, the mean acceleration over h [s].

    (M + h D) a = force - C v - D v: implicit in the damping, explicit in the other forces.
    """
    n, f, mass = model.JOINTS, work.f, work.mass
    model.inertia(mass, design.values, work.at)
    resist(model, design, work, work.at, v, u, h)
    model.coriolis(work.coriolis, design.values, work.at, v)
    for i in range(n):
        f[i] = work.force[i] - work.coriolis[i]
    if design.resisted:
        apply(work.free, n, work.damping, v)
        for i in range(n):
            f[i] -= work.free[i]
            for j in range(n):
                mass[i][j] += h * work.damping[i][j]
    solve(f, work.lower, work.upper, n, mass)


def advance(
    model: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: Vector,
    known_input: Vector,
) -> bool:
    """Set `work.after`, the state after one sample; return False where the model is not valid.

    qh' = vh + L e, vh' = model + K e (+ sigma, sigma' = E e)
    """
    n, core, work, dt = model.JOINTS, state.core, state.work, coefficients.dt
    after, moved = work.after, work.moved
    place(model, state, design)
    if not model.admits(design.values, work.at):
        return False
    after.take(core)
    if design.paper:
        accelerate(model, work, design.values, design.damped, work.at, core.x, known_input)
        for i in range(n):
            of_L, of_K = design.L[i][0] * core.e[0], design.K[i][0] * core.e[0]
            for k in range(1, n):
                of_L += design.L[i][k] * core.e[k]
                of_K += design.K[i][k] * core.e[k]
            after.e[i] = core.e[i] + dt * (core.x[i] - of_L) - moved[i]
            work.f[i] -= of_K
        if design.disturbed:
            apply(work.late, n, design.E, core.e)
            for i in range(n):
                work.f[i] += core.d[i]
                after.d[i] = core.d[i] - dt * work.late[i]
        for i in range(n):
            after.x[i] = core.x[i] + dt * work.f[i]
    else:
        drift(model, work, design, core.x, known_input, dt)
        for i in range(n):
            work.rate[i] = coefficients.inverse_dt * moved[i] if design.linear_hold else 0.0
        if not flow(model, after, design.one, design.one, design.K, work, design, dt):
            return False
        if not design.linear_hold:
            for i in range(n):
                after.e[i] -= moved[i]
    for i in range(n):
        after.v[i] = after.x[i]
    return True


def linear_matrix(mechanics: Mechanics, L: Array, K: Array, E: Array | None, at: Array) -> Array:
    """Return A [1/s] of (e, x, d)' = A (e, x, d) at the positions `at`, without Coriolis forces.

    Its shape is (2 n, 2 n) if E is None, else (3 n, 3 n).
    """
    n = mechanics.degrees
    matrix = np.zeros((2 * n, 2 * n) if E is None else (3 * n, 3 * n))
    matrix[:n, :n] = -L
    matrix[:n, n : 2 * n] = np.eye(n)
    matrix[n : 2 * n, :n] = -K
    if mechanics.damped:
        matrix[n : 2 * n, n : 2 * n] = -np.linalg.solve(
            mechanics.inertia(at), mechanics.damping(at)
        )
    if E is not None:
        matrix[n : 2 * n, 2 * n :] = np.eye(n)
        matrix[2 * n :, :n] = -E
    return matrix


def linear_plan(module: Any, gains: Any, circle: Any, complaint: str) -> Plan:
    """Return what the gains of HGO or EHGO imply, whose `module` has `tune`.

    Raises
    ------
    UserError : the model cannot work.
    UsageError : the error does not decay; the text is `complaint` with the slowest pole.
    """
    mechanics = model_of(gains)
    L, K, E = module.tune(gains, mechanics.degrees)
    places = [operating_point(gains, mechanics)]
    if mechanics.damped:
        places += [q for q, _ in check.random_states(mechanics)]
    matrices = [linear_matrix(mechanics, L, K, E, q) for q in places]
    slowest = mechanical_gains.slowest_pole(matrices[0])
    if slowest <= 0.0:
        raise UsageError(f'{complaint} (slowest pole {-slowest:+.3g} 1/s)')
    return made_plan(
        module,
        gains,
        mechanics,
        circle,
        fields={
            'L': L,
            'K': K,
            'E': np.zeros_like(L) if E is None else E,
            'disturbed': E is not None,
        },
        systems=matrices,
        lag=float(np.max(np.diag(L) / np.diag(K))) if E is None else 0.0,
        linear=lambda at, power: (linear_matrix(mechanics, L, K, E, at), np.eye(len(L))),
        describe=lambda dt: mechanical_gains.describe_loop(L, K, matrices, dt),
    )
