# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Numerical checks of a model when it is loaded, so that a wrong one is refused.

At random configurations and velocities: M is symmetric and positive definite; calM is M^-1 Psi^-T;
the momenta Psi^T M v are partially linear (PLvCC); the Coriolis forces belong to M. Derivatives are
central differences. All is in SI units: q and v of shape (n,), matrices (n, n).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError
from estimator_pkg.models.mechanics import Mechanics

Array = NDArray[np.float64]

STATES = 24  # number of random states
STEP = 1e-5  # step of the central differences, over the reach of a position
CALM_EXACT = 1e-9  # allowed relative residual of calM Psi^T M = I
DERIVED = 1e-6  # allowed relative residual of equations with central differences
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
    tests = [finite, positive_inertia, coriolis_of_inertia]
    if mechanics.damped:
        tests.append(dissipating)
    if mechanics.linearisable:
        tests += [inverse_factors, partially_linear]
    states = random_states(mechanics)
    for test in tests:
        for q, v in states:
            test(mechanics, q, v)
    if not mechanics.linearisable:
        residuals = (linear_residual(mechanics, *state) for state in states)
        mechanics.linearisable = all(rest <= DERIVED * size for rest, size in residuals)


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
        if _call(mechanics, 'admits', q):
            states.append((q, random.uniform(-1.0, 1.0, mechanics.degrees)))
            if len(states) == STATES:
                return states
    raise UserError(
        f"model '{mechanics.name}': `admits` refuses nearly every configuration within "
        f'{_text(centre)} +- {_text(reach)}: correct `admits`, `centre` or `reach`'
    )


def _call(mechanics: Mechanics, name: str, *at: Array) -> Any:
    try:
        return getattr(mechanics, name)(*at)
    except UserError:
        raise
    except Exception as error:  # a user's model may fail in any way
        raise UserError(
            f"model '{mechanics.name}': {name} fails at q = {_text(at[0])}: "
            f'{type(error).__name__}: {error}'
        ) from error


def finite(mechanics: Mechanics, q: Array, v: Array) -> None:
    """Call every function; raise UserError if one fails or a result is not finite."""
    calls: dict[str, tuple[Any, ...]] = {
        'inertia': (q,),
        'force': (q, v, np.zeros(mechanics.inputs)),
        'coriolis': (q, v),
        'damping': (q,),
    }
    if mechanics.linearisable:
        calls['factors'] = (q,)
    for name, at in calls.items():
        if not np.all(np.isfinite(_call(mechanics, name, *at))):
            raise UserError(f"model '{mechanics.name}': {name} is not finite at q = {_text(q)}")


def positive_inertia(mechanics: Mechanics, q: Array, v: Array) -> None:
    """Raise UserError unless M is symmetric and positive definite."""
    inertia = mechanics.inertia(q)
    size = float(np.max(np.abs(inertia)))
    if float(np.max(np.abs(inertia - inertia.T))) > 1e-9 * size:
        raise UserError(
            f"model '{mechanics.name}': the mass matrix is not symmetric at "
            f'q = {_text(q)} (residual {_rest(inertia - inertia.T)})'
        )
    lowest = float(np.linalg.eigvalsh(inertia)[0])
    if lowest <= 1e-12 * size:
        raise UserError(
            f"model '{mechanics.name}': the mass matrix is not positive definite at "
            f'q = {_text(q)} (lowest eigenvalue {lowest:.3g})'
        )


def dissipating(mechanics: Mechanics, q: Array, v: Array) -> None:
    """Raise UserError if D adds energy to a motion."""
    damping = mechanics.damping(q)
    lowest = float(np.linalg.eigvalsh(0.5 * (damping + damping.T))[0])
    if lowest < -1e-12 * float(np.max(np.abs(damping))):
        raise UserError(
            f"model '{mechanics.name}': the damping drives the mechanism at "
            f'q = {_text(q)} (lowest eigenvalue of D {lowest:.3g})'
        )


def inverse_factors(mechanics: Mechanics, q: Array, v: Array) -> None:
    """Raise UserError unless calM = M^-1 Psi^-T."""
    calm, psi = mechanics.factors(q)
    rest = calm @ psi.T @ mechanics.inertia(q) - np.eye(mechanics.degrees)
    if float(np.max(np.abs(rest))) > CALM_EXACT * max(1.0, float(np.linalg.cond(psi))):
        raise UserError(
            f"model '{mechanics.name}': calM is not M^-1 Psi^-T at q = {_text(q)} "
            f'(residual {_rest(rest)})'
        )


def slopes(mechanics: Mechanics, function: Callable[[Array], Array], q: Array) -> list[Array]:
    """Return the derivatives of `function` by each position: n arrays of its result's shape."""
    found = []
    for index, reach in enumerate(mechanics.reach):
        step = np.zeros(mechanics.degrees)
        step[index] = STEP * max(reach, 1e-6)
        found.append((function(q + step) - function(q - step)) / (2.0 * step[index]))
    return found


def linear_residual(mechanics: Mechanics, q: Array, v: Array) -> tuple[float, float]:
    """Return (|Psi^T d/dq (P^T M^-1 P / 2) - (dPsi/dt)^T P|, size of its terms); 0 for PLvCC."""
    inertia = mechanics.inertia(q)
    psi = mechanics.factors(q)[1]
    momentum = inertia @ v
    of_inertia = slopes(mechanics, lambda x: mechanics.inertia(x), q)
    of_psi = slopes(mechanics, lambda x: mechanics.factors(x)[1], q)
    # d(M^-1) = -M^-1 dM M^-1
    energy = np.array([-0.5 * v @ slope @ v for slope in of_inertia])
    turning = sum(rate * slope for rate, slope in zip(v, of_psi))
    first, second = psi.T @ energy, np.asarray(turning).T @ momentum
    size = float(np.max(np.abs(psi)) * np.max(np.abs(momentum)))
    return float(np.max(np.abs(first - second))), max(size, 1e-12)


def partially_linear(mechanics: Mechanics, q: Array, v: Array) -> None:
    """Raise UserError unless the PLvCC identity is satisfied; it proposes another observer."""
    rest, size = linear_residual(mechanics, q, v)
    if rest > DERIVED * size:
        raise UserError(
            f"model '{mechanics.name}' is not partially linearisable with its Psi "
            f'(PLvCC residual {rest:.3g} at q = {_text(q)}): correct Psi, or omit it '
            "and use the observer 'hgo'"
        )


def coriolis_of_inertia(mechanics: Mechanics, q: Array, v: Array) -> None:
    """Raise UserError unless C v = (dM/dt) v - d/dq (v^T M v / 2)."""
    of_inertia = slopes(mechanics, lambda x: mechanics.inertia(x), q)
    turning = sum(rate * slope for rate, slope in zip(v, of_inertia))
    expected = np.asarray(turning) @ v - np.array([0.5 * v @ slope @ v for slope in of_inertia])
    provided = mechanics.coriolis(q, v)
    size = max(float(np.max(np.abs(expected))), float(np.max(np.abs(mechanics.inertia(q)))))
    if float(np.max(np.abs(provided - expected))) > DERIVED * size:
        raise UserError(
            f"model '{mechanics.name}': the Coriolis forces do not belong to the mass "
            f'matrix at q = {_text(q)}, v = {_text(v)} '
            f'(residual {_rest(provided - expected)})'
        )


def _text(values: Array) -> str:
    return '(' + ', '.join(f'{value:.4g}' for value in values) + ')'


def _rest(values: Array) -> str:
    return f'{float(np.max(np.abs(values))):.3g}'
