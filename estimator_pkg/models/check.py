# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Numerical checks of a model when it is loaded, so that a wrong one is refused.

Each property is a row of `PROPERTIES`, evaluated at random configurations and velocities.
Derivatives are central differences. All is in SI units: q and v of shape (n,), matrices (n, n).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError
from estimator_pkg.models.mechanics import Mechanics

Array = NDArray[np.float64]
Function = Callable[[Mechanics, Array, Array], tuple[float, float]]

STATES = 24  # number of random states
STEP = 1e-5  # step of the central differences, over the reach of a position
DERIVED = 1e-6  # allowed relative residual of equations with central differences
EXACT = 1e-9  # allowed relative residual of calM Psi^T M = I, and of M = M^T
POSITIVE = 1e-12  # least eigenvalue, relative to the largest entry
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
        _call_all(mechanics, q, v)
    for needs, residual, wrong, remedy in PROPERTIES:
        for q, v in states if getattr(mechanics, needs, True) else ():
            found, allowed = residual(mechanics, q, v)
            if not found <= allowed:
                raise UserError(
                    f"model '{mechanics.name}'{wrong} (residual {found:.3g} at q = {_text(q)}, "
                    f'v = {_text(v)}){remedy}'
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
        f'{_text(centre)} +- {_text(reach)}: correct `admits`, `centre` or `reach`'
    )


def _call_all(mechanics: Mechanics, q: Array, v: Array) -> None:
    """Call every function; raise UserError if one fails or a result is not finite."""
    calls = {
        'inertia': (q,),
        'force': (q, v, np.zeros(mechanics.inputs)),
        'coriolis': (q, v),
        'damping': (q,),
        **({'factors': (q,)} if mechanics.linearisable else {}),
    }
    for name, at in calls.items():
        try:
            finite = bool(np.all(np.isfinite(getattr(mechanics, name)(*at))))
        except UserError:
            raise
        except Exception as error:  # a user's model may fail in any way
            raise UserError(
                f"model '{mechanics.name}': {name} fails at q = {_text(q)}: "
                f'{type(error).__name__}: {error}'
            ) from error
        if not finite:
            raise UserError(f"model '{mechanics.name}': {name} is not finite at q = {_text(q)}")


def slopes(mechanics: Mechanics, function: Callable[[Array], Array], q: Array) -> list[Array]:
    """Return the derivatives of `function` by each position: n arrays of its result's shape."""
    found = []
    for index, reach in enumerate(mechanics.reach):
        step = np.zeros(mechanics.degrees)
        step[index] = STEP * max(reach, 1e-6)
        found.append((function(q + step) - function(q - step)) / (2.0 * step[index]))
    return found


def asymmetry(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (|M - M^T|, what is allowed)."""
    inertia = mechanics.inertia(q)
    return _largest(inertia - inertia.T), EXACT * _largest(inertia)


def negative_inertia(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (-least eigenvalue of M, what is allowed)."""
    inertia = mechanics.inertia(q)
    return -float(np.linalg.eigvalsh(inertia)[0]), -POSITIVE * _largest(inertia)


def driving(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (-least eigenvalue of D + D^T over 2, what is allowed)."""
    damping = mechanics.damping(q)
    lowest = float(np.linalg.eigvalsh(0.5 * (damping + damping.T))[0])
    return -lowest, POSITIVE * _largest(damping)


def factor_residual(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (|calM Psi^T M - I|, what is allowed)."""
    calm, psi = mechanics.factors(q)
    rest = calm @ psi.T @ mechanics.inertia(q) - np.eye(mechanics.degrees)
    return _largest(rest), EXACT * max(1.0, float(np.linalg.cond(psi)))


def coriolis_residual(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (|C v - (dM/dt) v + d/dq (v^T M v / 2)|, what is allowed)."""
    of_inertia = slopes(mechanics, mechanics.inertia, q)
    turning = sum(rate * slope for rate, slope in zip(v, of_inertia))
    expected = np.asarray(turning) @ v - np.array([0.5 * v @ slope @ v for slope in of_inertia])
    size = max(_largest(expected), _largest(mechanics.inertia(q)))
    return _largest(mechanics.coriolis(q, v) - expected), DERIVED * size


def linear_residual(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (|Psi^T d/dq (P^T M^-1 P / 2) - (dPsi/dt)^T P|, what is allowed); 0 for PLvCC."""
    inertia = mechanics.inertia(q)
    psi = mechanics.factors(q)[1]
    momentum = inertia @ v
    of_inertia = slopes(mechanics, mechanics.inertia, q)
    of_psi = slopes(mechanics, lambda x: mechanics.factors(x)[1], q)
    # d(M^-1) = -M^-1 dM M^-1
    energy = np.array([-0.5 * v @ slope @ v for slope in of_inertia])
    turning = sum(rate * slope for rate, slope in zip(v, of_psi))
    first, second = psi.T @ energy, np.asarray(turning).T @ momentum
    size = _largest(psi) * _largest(momentum)
    return _largest(first - second), DERIVED * max(size, 1e-12)


# attribute that says whether it applies ('': always), residual, what is wrong, remedy
PROPERTIES: tuple[tuple[str, Function, str, str], ...] = (
    ('', asymmetry, ': the mass matrix is not symmetric', ''),
    ('', negative_inertia, ': the mass matrix is not positive definite', ''),
    ('', coriolis_residual, ': the Coriolis forces do not belong to the mass matrix', ''),
    ('damped', driving, ': the damping drives the mechanism', ''),
    ('linearisable', factor_residual, ': calM is not M^-1 Psi^-T', ''),
    (
        'linearisable',
        linear_residual,
        ' is not partially linearisable (PLvCC) with its Psi',
        ": correct Psi, or omit it and use the observer 'hgo'",
    ),
)


def _text(values: Array) -> str:
    return '(' + ', '.join(f'{value:.4g}' for value in values) + ')'


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values)))
