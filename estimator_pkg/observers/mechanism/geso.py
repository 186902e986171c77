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

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.models import check
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.tracking import natural_frequency
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
from estimator_pkg.observers.mechanism.gains import Tuning
from estimator_pkg.observers.mechanism.parameters import (
    LINEAR,
    MEASUREMENT,
    PAPER,
    LoopGains,
    MechanicalGains,
    gain_matrix,
    model_of,
    operating_point,
    tuple_of,
)
from estimator_pkg.parameters import parameter

Array = NDArray[np.float64]
TURN = 2.0 * np.pi


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


def tune(gains: Gains, mechanics: Mechanics, point: Array) -> Tuning:
    """Return the gain matrices, shape (n, n), that these parameters request at `point`, (n,).

    Raises
    ------
    UsageError : a gain is not positive definite, not Hurwitz, of wrong size, or set twice.
    """
    n = mechanics.degrees
    calm = check.factors(mechanics, point)[0]
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
    E = check.matrix(mechanics.inertia, mechanics, point) @ product
    return Tuning(L, Gamma, P0, E)


def build(gains: Gains, circle: Any) -> MechanicalFunctions:
    """Return the functions of the observer with these gains.

    Raises
    ------
    UserError, UsageError : the model or the gains cannot work.
    """
    mechanics = model_of(gains)
    if mechanics.factors is None:
        raise UserError(
            f"model '{mechanics.name}' is not partially linearisable (it has no Psi, and the "
            "Cholesky factor of M^-1 is not one): use the observer 'hgo', which does not need it"
        )
    point = operating_point(gains, mechanics)
    tuned = tune(gains, mechanics, point)
    n = mechanics.degrees
    disturbed = gains.disturbance_hz > 0.0
    paper = gains.form == PAPER
    damped = mechanics.damping is not None if paper else is_resisted(mechanics)
    diagonal = bool(np.all(np.diag(np.diag(tuned.L)) == tuned.L))
    simple = bool(np.all(tuned.Gamma == np.diag(np.diag(tuned.Gamma)))) and bool(
        np.all(np.eye(n) == tuned.P0)
    )
    at_measurement = gains.schedule == MEASUREMENT
    linear_hold = gains.hold == LINEAR and not paper
    algebra = mechanical_algebra(n)
    apply, turned, product, product_t = (
        algebra.apply,
        algebra.turned,
        algebra.product,
        algebra.product_t,
    )
    scaled_t, scale, zeros_like = algebra.scaled_t, algebra.scale, algebra.zeros_like
    towards, minus, times = algebra.towards, algebra.minus, algebra.times
    transposed, finite = algebra.transposed, algebra.finite
    flow = make_flow(n, diagonal=diagonal, damped=damped, disturbed=disturbed)
    inertia, factors, force = mechanics.inertia, mechanics.factors, mechanics.force
    admits = mechanics.admits
    damping_of = mechanics.damping if mechanics.damping is not None else mechanics.inertia
    resistance, dry = make_resistance(mechanics), mechanics.speed_matters
    zeros = (0.0,) * n

    def design() -> tuple:
        L = tuple_of(np.diag(tuned.L)) if diagonal else tuple_of(tuned.L)
        Gamma = tuple_of(np.diag(tuned.Gamma)) if simple else tuple_of(tuned.Gamma)
        return (mechanics.values, L, Gamma, tuple_of(tuned.P0), tuple_of(tuned.E))

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
        e, p, d, v = core
        values, L, Gamma, P0, E = design
        dt, inverse_dt = coefficients
        if not at_measurement:
            at = towards(before, 1.0, e)
        elif linear_hold:
            at = towards(before, 0.5, moved)
        else:
            at = before
        if not admits(values, at):
            return core, False
        calm, psi = factors(values, at)
        if simple:
            b = scaled_t(Gamma, calm)  # Gamma calM^T
        else:
            b = product(product_t(Gamma, calm), P0)
        if paper:
            f, friction = force(values, at, v, known_input), damping_of(values, at)
        else:
            mass = inertia(values, at) if dry else calm
            f, friction = resistance(values, at, v, known_input, mass, dt)
        f = turned(psi, f)
        if damped:
            w = product(transposed(psi), product(friction, calm))  # Psi^T D calM
        else:
            w = calm
        good = True
        if paper:  # forward Euler of (11)
            rate = apply(calm, p)
            pushed = apply(b, e)
            if diagonal:
                rate = minus(rate, times(L, e))
            else:
                rate = minus(rate, apply(L, e))
            f = minus(f, pushed)
            if damped:
                f = minus(f, apply(w, p))
            if disturbed:
                f = towards(f, 1.0, turned(psi, d))
                d = towards(d, -dt, apply(E, e))
            e = minus(towards(e, dt, rate), moved)
            p = towards(p, dt, f)
        else:
            rate = scale(inverse_dt, moved) if linear_hold else zeros_like(moved)
            e, p, d, good = flow(e, p, d, calm, psi, b, L, w, E, f, rate, dt)
            if not linear_hold:
                e = minus(e, moved)
        now = measurement if at_measurement else towards(measurement, 1.0, e)
        if not good or not admits(values, now):
            return core, False
        return (e, p, d, apply(factors(values, now)[0], p)), True

    def carry(core: tuple, design: tuple, at: tuple) -> tuple:
        """Keep the momenta: without forces they are constant at all positions."""
        e, p, d, v = core
        values, L, Gamma, P0, E = design
        if not admits(values, at):
            return core
        velocity = apply(factors(values, at)[0], p)
        return (e, p, d, velocity) if finite(velocity) else core

    def linear(at: Array, power: Array) -> tuple[Array, Array]:
        return (
            mechanical_gains.error_matrix(mechanics, tuned, at, disturbed),
            check.factors(mechanics, at)[0],
        )

    configurations = [point, *(q for q, _ in check.random_states(mechanics))]
    matrices = [
        mechanical_gains.error_matrix(mechanics, tuned, q, disturbed) for q in configurations
    ]
    limits = (
        mechanical_gains.euler_limit(matrices)
        if paper
        else mechanical_gains.exact_limit(matrices, n)
    )
    calm_there = check.factors(mechanics, point)[0]
    K = calm_there @ tuned.Gamma @ calm_there.T @ tuned.P0

    def describe(dt: float) -> dict[str, Any]:
        return mechanical_gains.describe(mechanics, tuned, point, dt, disturbed=disturbed)

    core = MechanicalCore(
        design=design,
        prepare=prepare_dt,
        begin=begin,
        advance=advance,
        carry=carry,
        linear=linear,
        limits=limits,
        slowest=mechanical_gains.slowest_pole(matrices[0]),
        lag=0.0 if disturbed else float(np.max(np.diag(tuned.L) / np.diag(K))),
    )
    return around(core, gains, mechanics, circle, describe)


OBSERVER = Observer(
    name='geso',
    summary='globally exponentially stable observer of a mechanism with known model and input',
    gains=Gains,
    build=build,
    kind='mechanical',
    reference='Aranovskiy, Ortega, Romero, Sokolov (IJC 2019), equation (11)',
)
