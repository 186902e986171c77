# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The shared part of the observers whose state is the velocity: acceleration, step and gains.

`hgo`, `ehgo` and `smo` need M, C and the forces, but not Psi, so they work for every mechanism.
Their error contains C(q, vh) vh - C(q, v) v, which grows with the speed. GESO's error does not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.models import check
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.mechanism import gains as mechanical_gains
from estimator_pkg.observers.mechanism.algebra import mechanical_algebra
from estimator_pkg.observers.mechanism.core import (
    MechanicalCore,
    MechanicalFunctions,
    around,
    prepare_dt,
)
from estimator_pkg.observers.mechanism.flow import make_flow
from estimator_pkg.observers.mechanism.friction import is_resisted, make_resistance
from estimator_pkg.observers.mechanism.parameters import (
    LINEAR,
    MEASUREMENT,
    PAPER,
    MechanicalGains,
    tuple_of,
)

Array = NDArray[np.float64]


def make_acceleration(mechanics: Mechanics) -> Callable[..., tuple]:
    """Return acceleration(values, q, v, u) -> M^-1 [force - C v - D v]."""
    algebra = mechanical_algebra(mechanics.degrees)
    solve, minus, apply = algebra.solve, algebra.minus, algebra.apply
    inertia, force, coriolis = mechanics.inertia, mechanics.force, mechanics.coriolis
    damped = mechanics.damping is not None
    damping = mechanics.damping if mechanics.damping is not None else mechanics.inertia

    def acceleration(values: tuple, q: tuple, v: tuple, u: tuple) -> tuple:
        total = minus(force(values, q, v, u), coriolis(values, q, v))
        if damped:
            total = minus(total, apply(damping(values, q), v))
        return solve(inertia(values, q), total)

    return acceleration


def make_drift(mechanics: Mechanics) -> Callable[..., tuple]:
    """Return drift(values, q, v, u, h) -> (a, W) of v' = a - W v.

    a = M^-1 [force - C v] and W = M^-1 D. An explicit step of D v would be unstable if friction
    stops a joint within a sample of h [s]. Without resistance W is meaningless, but has its shape.
    """
    algebra = mechanical_algebra(mechanics.degrees)
    solve, minus, divided = algebra.solve, algebra.minus, algebra.divided
    inertia, coriolis = mechanics.inertia, mechanics.coriolis
    resisted, resistance = is_resisted(mechanics), make_resistance(mechanics)

    def drift(values: tuple, q: tuple, v: tuple, u: tuple, h: float) -> tuple:
        mass = inertia(values, q)
        force, damping = resistance(values, q, v, u, mass, h)
        free = solve(mass, minus(force, coriolis(values, q, v)))
        if resisted:
            return free, divided(mass, damping)
        return free, mass

    return drift


def make_braked(mechanics: Mechanics) -> Callable[..., tuple]:
    """Return braked(values, q, v, u, h) -> mean acceleration over h [s].

    (M + h D) a = force - C v - D v: implicit in the damping, explicit in the other forces.
    """
    algebra = mechanical_algebra(mechanics.degrees)
    solve, minus, apply, blend = algebra.solve, algebra.minus, algebra.apply, algebra.blend
    inertia, coriolis = mechanics.inertia, mechanics.coriolis
    resisted, resistance = is_resisted(mechanics), make_resistance(mechanics)

    def braked(values: tuple, q: tuple, v: tuple, u: tuple, h: float) -> tuple:
        mass = inertia(values, q)
        force, damping = resistance(values, q, v, u, mass, h)
        total = minus(force, coriolis(values, q, v))
        if resisted:
            total, mass = minus(total, apply(damping, v)), blend(mass, h, damping)
        return solve(mass, total)

    return braked


def make_place(n: int, gains: MechanicalGains) -> Callable[..., tuple]:
    """Return place(before, moved, e) -> positions at which a step evaluates the model."""
    towards = mechanical_algebra(n).towards
    at_measurement = gains.schedule == MEASUREMENT
    linear_hold = gains.hold == LINEAR and gains.form != PAPER

    def place(before: tuple, moved: tuple, e: tuple) -> tuple:
        if not at_measurement:
            return towards(before, 1.0, e)
        if linear_hold:
            return towards(before, 0.5, moved)
        return before

    return place


def linear_matrix(mechanics: Mechanics, L: Array, K: Array, E: Array | None, at: Array) -> Array:
    """Return A [1/s] of (e, x, d)' = A (e, x, d) at the positions `at`, without Coriolis forces.

    Its shape is (2 n, 2 n) if E is None, else (3 n, 3 n).
    """
    n = mechanics.degrees
    matrix = np.zeros((2 * n, 2 * n) if E is None else (3 * n, 3 * n))
    matrix[:n, :n] = -L
    matrix[:n, n : 2 * n] = np.eye(n)
    matrix[n : 2 * n, :n] = -K
    if mechanics.damping is not None:
        matrix[n : 2 * n, n : 2 * n] = -np.linalg.solve(
            check.matrix(mechanics.inertia, mechanics, at),
            check.matrix(mechanics.damping, mechanics, at),
        )
    if E is not None:
        matrix[n : 2 * n, 2 * n :] = np.eye(n)
        matrix[2 * n :, :n] = -E
    return matrix


def linear_observer(
    mechanics: Mechanics,
    gains: MechanicalGains,
    circle: Any,
    L: Array,
    K: Array,
    E: Array | None,
    point: Array,
    complaint: str,
) -> MechanicalFunctions:
    """Return the functions of HGO (if E is None) or EHGO with these gains, see `linear_core`.

    Parameters
    ----------
    L, K, E : gains [1/s, 1/s^2, 1/s^3], shape (n, n).
    point : operating point, shape (n,) [rad or m].

    Raises
    ------
    UsageError : the error does not decay; the text is `complaint` with the slowest pole.
    """
    matrices = matrices_over_range(mechanics, L, K, E, point)
    slowest = mechanical_gains.slowest_pole(matrices[0])
    if slowest <= 0.0:
        raise UsageError(f'{complaint} (slowest pole {-slowest:+.3g} 1/s)')

    def describe(dt: float) -> dict[str, Any]:
        return describe_linear(L, K, matrices, dt)

    return around(
        linear_core(mechanics, gains, L, K, E, matrices), gains, mechanics, circle, describe
    )


def linear_core(
    mechanics: Mechanics,
    gains: MechanicalGains,
    L: Array,
    K: Array,
    E: Array | None,
    matrices: list[Array],
) -> MechanicalCore:
    """Return the core of HGO (if E is None) or EHGO.

    qh' = vh + L e, vh' = model + K e (+ sigma, sigma' = E e)

    Parameters
    ----------
    L, K, E : gains [1/s, 1/s^2, 1/s^3], shape (n, n).
    matrices : error systems [1/s], from `matrices_over_range`.
    """
    n = mechanics.degrees
    extended = E is not None
    diagonal = bool(np.all(np.diag(np.diag(L)) == L))
    paper = gains.form == PAPER
    linear_hold = gains.hold == LINEAR and not paper
    algebra = mechanical_algebra(n)
    towards, minus, scale, zeros_like = (
        algebra.towards,
        algebra.minus,
        algebra.scale,
        algebra.zeros_like,
    )
    apply, times = algebra.apply, algebra.times
    flow = make_flow(n, diagonal=diagonal, damped=is_resisted(mechanics), disturbed=extended)
    acceleration, drift = make_acceleration(mechanics), make_drift(mechanics)
    place = make_place(n, gains)
    admits = mechanics.admits
    zeros = (0.0,) * n
    gain_e = np.zeros((n, n)) if E is None else E

    def design() -> tuple:
        return (
            mechanics.values,
            tuple_of(np.diag(L)) if diagonal else tuple_of(L),
            tuple_of(K),
            tuple_of(gain_e),
            tuple_of(np.eye(n)),
        )

    def begin() -> tuple:
        return (zeros, zeros, zeros, zeros)

    def advance(
        core: tuple,
        coefficients: tuple,
        design: tuple,
        before: tuple,
        moved: tuple,
        measurement: tuple,
        known_input: tuple,
    ) -> tuple:
        e, x, d, v = core
        values, L, K, E, one = design
        dt, inverse_dt = coefficients
        at = place(before, moved, e)
        if not admits(values, at):
            return core, False
        good = True
        if paper:
            f = acceleration(values, at, x, known_input)
            rate = minus(x, times(L, e)) if diagonal else minus(x, apply(L, e))
            f = minus(f, apply(K, e))
            if extended:
                f = towards(f, 1.0, d)
                d = towards(d, -dt, apply(E, e))
            e = minus(towards(e, dt, rate), moved)
            x = towards(x, dt, f)
        else:
            f, w = drift(values, at, x, known_input, dt)
            rate = scale(inverse_dt, moved) if linear_hold else zeros_like(moved)
            e, x, d, good = flow(e, x, d, one, one, K, L, w, E, f, rate, dt)
            if not linear_hold:
                e = minus(e, moved)
        return (e, x, d, x), good

    def carry(core: tuple, design: tuple, at: tuple) -> tuple:
        return core

    def linear(at: Array, power: Array) -> tuple[Array, Array]:
        return linear_matrix(mechanics, L, K, E, at), np.eye(n)

    return MechanicalCore(
        design=design,
        prepare=prepare_dt,
        begin=begin,
        advance=advance,
        carry=carry,
        linear=linear,
        limits=(
            mechanical_gains.euler_limit(matrices)
            if paper
            else mechanical_gains.exact_limit(matrices, n)
        ),
        slowest=mechanical_gains.slowest_pole(matrices[0]),
        lag=0.0 if extended else float(np.max(np.diag(L) / np.diag(K))),
    )


def matrices_over_range(
    mechanics: Mechanics, L: Array, K: Array, E: Array | None, point: Array
) -> list[Array]:
    """Return the error systems [1/s], shape (m, m), at `point`; with damping, over the range."""
    places = [point]
    if mechanics.damping is not None:
        places += [q for q, _ in check.random_states(mechanics)]
    return [linear_matrix(mechanics, L, K, E, q) for q in places]


def describe_linear(L: Array, K: Array, matrices: list[Array], dt: float) -> dict[str, Any]:
    """Return properties of these gains by name; `gains.MEANINGS` has their titles and units.

    Parameters
    ----------
    L, K : gains [1/s, 1/s^2], shape (n, n).
    matrices : error systems [1/s], shape (m, m), from `matrices_over_range`.
    dt : sample time [s].
    """
    return {
        'L': L.tolist(),
        'K': K.tolist(),
        'poles': sorted(
            (complex(pole) for pole in np.linalg.eigvals(matrices[0])),
            key=lambda pole: (pole.real, pole.imag),
        ),
        'noise_figure': (np.diag(K) ** 2 / (2.0 * np.diag(L))).tolist(),
        'slowest_pole_over_range': min(map(mechanical_gains.slowest_pole, matrices)),
        'dt_K': (dt * np.diag(K)).tolist(),
        'dt_K_below_L': bool(np.all(dt * np.diag(K) < np.diag(L))),
        'longest_euler_dt': mechanical_gains.longest_euler(matrices),
    }
