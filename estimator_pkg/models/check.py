# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Numerical checks of a model when it is loaded, so that a wrong one is refused.

`table` is the table of checks, evaluated at random configurations and velocities. All is in SI
units: q and v of shape (n,), matrices (n, n).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimator_pkg.errors import UserError
from estimator_pkg.models.mechanics import Array, Mechanics, text

STATES = 24  # number of random states
DERIVED = 1e-6  # allowed relative residual of equations with central differences
EXACT = 1e-9  # allowed relative residual of M = M^T
DEFINITE = 1e-12  # least eigenvalue, relative to the largest entry
SEED = 20170915


def check(mechanics: Mechanics) -> None:
    """Raise UserError unless the model's functions are consistent; see whether it has a Psi.

    Where the model has no Psi, the lower Cholesky factor of M^-1 is one if it is PLvCC. It is for
    every constant M, for every single joint, and for a mechanism such as the cart-pendulum.

    Raises
    ------
    UserError : one line with the model, the property, the residual and the state.
    """
    if not all(reach > 0.0 for reach in mechanics.reach):
        raise UserError(
            f"model '{mechanics.name}': reach is {mechanics.reach}: it must be above 0 for each "
            'position'
        )
    states = random_states(mechanics)
    for q, v in states:
        for wrong, residual, allowed in table(mechanics, q, v):
            if not residual <= allowed:
                raise UserError(
                    f"model '{mechanics.name}': {wrong} (residual {residual:.3g} at q = {text(q)}, "
                    f'v = {text(v)})'
                )
    if not mechanics.linearisable:
        residuals = (linear_residual(mechanics, *state) for state in states)
        mechanics.linearisable = all(rest <= allowed for rest, allowed in residuals)


def random_states(mechanics: Mechanics) -> list[tuple[Array, Array]]:
    """Return `STATES` random (q, v) within the model's region and domain.

    Raises
    ------
    UserError : almost no configuration of the region is in the domain.
    """
    random = np.random.default_rng(SEED)
    centre, reach = np.array(mechanics.centre), np.array(mechanics.reach)
    states = []
    for _ in range(100 * STATES):
        q = centre + reach * random.uniform(-1.0, 1.0, mechanics.degrees)
        if mechanics.admits(q):
            states.append((q, random.uniform(-1.0, 1.0, mechanics.degrees)))
            if len(states) == STATES:
                return states
    raise UserError(
        f"model '{mechanics.name}': `admits` refuses nearly every configuration within "
        f'{text(centre)} +- {text(reach)}: correct `admits`, `centre` or `reach`'
    )


def table(mechanics: Mechanics, q: Array, v: Array) -> Iterator[tuple[str, float, float]]:
    """Yield each check at one state: what is wrong if it fails, the residual, what is allowed."""
    inertia, damping = mechanics.inertia(q), mechanics.damping(q)
    coriolis = mechanics.coriolis(q, v)
    values = {
        'inertia': inertia,
        'force': mechanics.force(q, v, np.zeros(mechanics.inputs)),
        'coriolis': coriolis,
        'damping': damping,
        **({'psi': np.array(mechanics.factors(q))} if mechanics.linearisable else {}),
    }
    for name, value in values.items():
        yield f'{name} is not finite', float(np.sum(~np.isfinite(value))), 0.0
    size = _largest(inertia)
    yield 'the mass matrix is not symmetric', _largest(inertia - inertia.T), EXACT * size
    lowest = float(np.linalg.eigvalsh(inertia)[0])
    yield 'the mass matrix is not positive definite', -lowest, -DEFINITE * size
    expected = mechanics.christoffel(q, v)
    yield (
        'the Coriolis forces do not belong to the mass matrix',
        _largest(coriolis - expected),
        DERIVED * max(_largest(expected), size),
    )
    lowest = float(np.linalg.eigvalsh(0.5 * (damping + damping.T))[0])
    yield 'the damping drives the mechanism', -lowest, DEFINITE * _largest(damping)
    if mechanics.linearisable:
        yield (
            'it is not partially linearisable (PLvCC) with its Psi: correct Psi, or omit it and '
            "use the observer 'hgo'",
            *linear_residual(mechanics, q, v),
        )


def linear_residual(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (|Psi^T d/dq (P^T M^-1 P / 2) - (dPsi/dt)^T P|, what is allowed); 0 for PLvCC."""
    psi, momentum = mechanics.factors(q)[1], mechanics.inertia(q) @ v
    # d(M^-1) = -M^-1 dM M^-1
    energy = -0.5 * (mechanics.slopes(mechanics.inertia, q) @ v) @ v
    turning = np.tensordot(v, mechanics.slopes(lambda x: mechanics.factors(x)[1], q), 1)
    size = _largest(psi) * _largest(momentum)
    return _largest(psi.T @ energy - turning.T @ momentum), DERIVED * max(size, 1e-12)


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values)))
