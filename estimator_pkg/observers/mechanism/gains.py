# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks and properties of the gain matrices of observers of mechanisms."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.models.mechanics import Array, Mechanics

FASTEST = 3000.0  # largest dt (|L| + sqrt(trace K)): beyond it gains do not fit the sample rate
GUARANTEED_SPEED = 1.0  # of each position, for the guaranteed rate [rad/s or m/s]


def require_hurwitz(L: Array) -> None:
    """Raise UsageError unless -L [1/s], shape (n, n), is Hurwitz."""
    slowest = float(np.min(np.linalg.eigvals(L).real))
    if not slowest > 0.0:
        raise UsageError(
            f"parameter 'L': -L is not Hurwitz (its slowest eigenvalue is "
            f'{-slowest:+.3g} 1/s): every eigenvalue of L needs a positive real part'
        )


def require_positive(name: str, gain: Array) -> Array:
    """Return the gain, shape (n, n), made exactly symmetric, in its unit.

    Raises
    ------
    UsageError : it is not positive definite.
    """
    if float(np.max(np.abs(gain - gain.T))) > 1e-9 * float(np.max(np.abs(gain))):
        raise UsageError(
            f"parameter '{name}' is not symmetric: give a symmetric matrix row by row, or one "
            'number per position'
        )
    lowest = float(np.linalg.eigvalsh(0.5 * (gain + gain.T))[0])
    if not lowest > 0.0:
        raise UsageError(
            f"parameter '{name}' is not positive definite: its smallest eigenvalue is "
            f'{lowest:.3g}, it must be positive'
        )
    return 0.5 * (gain + gain.T)


def lyapunov_weight(L: Array) -> Array:
    """Return P0 of Remark 5 in its corrected form: P0 L + L^T P0 > 0, shape (n, n).

    It is the identity if L + L^T > 0 (the paper's case), else the solution with right-hand side I.
    """
    n = len(L)
    if float(np.linalg.eigvalsh(L + L.T)[0]) > 0.0:
        return np.eye(n)
    system = np.kron(np.eye(n), L.T) + np.kron(L.T, np.eye(n))
    weight = np.linalg.solve(system, np.eye(n).ravel()).reshape(n, n)
    return 0.5 * (weight + weight.T)


def slowest_pole(matrix: Array) -> float:
    """Return the slowest pole of x' = matrix x, shape (n, n): -(largest real part) [1/s]."""
    return -float(np.max(np.linalg.eigvals(matrix).real))


def longest_euler(matrices: list[Array]) -> float:
    """Return the longest sample time [s] at which forward Euler is stable for all x' = matrix x.

    Each matrix has shape (m, m), an m of its own, and poles in 1/s.
    """
    longest = math.inf
    for matrix in matrices:
        for pole in np.linalg.eigvals(matrix):
            if pole.real >= 0.0:
                return 0.0
            longest = min(longest, -2.0 * pole.real / abs(pole) ** 2)
    return longest


def longest_exact(matrices: list[Array], n: int) -> float:
    """Return the longest sample time [s] of the exact step with these error systems.

    They have shape (2 n, 2 n) or (3 n, 3 n) [1/s], n the number of positions.
    """
    paces = []
    for A in matrices:
        stiffness = abs(float(np.trace(A[:n, n : 2 * n] @ A[n : 2 * n, :n])))
        paces.append(float(np.abs(np.diag(A)[: 2 * n]).sum()) + math.sqrt(stiffness))
    return FASTEST / max(paces)


class Guarantee(NamedTuple):
    """The constants of Proposition 4.1; `rate` [1/s] bounds the decay of |(q~, p~)|."""

    d2: float
    c1: float
    c3: float
    c4: float
    rate: float


def guaranteed_rate(L: Array, Gamma: Array, k0: float, k1: float, k2: float) -> Guarantee:
    """Return the constants of Proposition 4.1 in its corrected form.

    The printed proof bounds -|calM p~|^2 from above by -k1^2 |p~|^2 with k1 the largest norm of
    calM. The correct bound has the smallest singular value, k0.

    Parameters
    ----------
    L, Gamma : gains of the observer, shape (n, n).
    k0, k1 : smallest singular value and largest norm of calM over the motion.
    k2 : largest norm of d calM/dt.
    """
    k3 = float(np.linalg.norm(L, 2))
    k4 = float(np.linalg.eigvalsh(0.5 * (L + L.T))[0])
    of_gamma = np.linalg.eigvalsh(Gamma)
    k5, k6, k7 = float(of_gamma[-1]), min(1.0, float(of_gamma[0])), max(1.0, float(of_gamma[-1]))
    d2 = (k1 * k3 + k2) ** 2 / (2.0 * k0**2) + k1**2 * k5 + 0.5 * k4
    c1 = 2.0 / k4 * d2 + k1 * k7
    c3 = (2.0 / k4 * d2 + 2.0 * k1 * k7) / k6
    c4 = min(0.5 * k0**2, d2 + k1 * k4 * k7)
    return Guarantee(d2, c1, c3, c4, c4 / c3)


def describe_loop(L: Array, K: Array, matrices: list[Array], dt: float) -> dict[str, Any]:
    """Return properties of these gains by name; `MEANINGS` has their titles and units.

    Parameters
    ----------
    L, K : gains [1/s, 1/s^2], shape (n, n).
    matrices : error systems [1/s], shape (m, m): at the operating point, then over the range.
    dt : sample time [s].
    """
    poles = map(complex, np.linalg.eigvals(matrices[0]))
    return {
        'L': L.tolist(),
        'K': K.tolist(),
        'poles': sorted(poles, key=lambda pole: (pole.real, pole.imag)),
        'noise_figure': (np.diag(K) ** 2 / (2.0 * np.diag(L))).tolist(),
        'slowest_pole_over_range': min(map(slowest_pole, matrices)),
        'dt_K': (dt * np.diag(K)).tolist(),
        'dt_K_below_L': bool(np.all(dt * np.diag(K) < np.diag(L))),
        'longest_euler_dt': longest_euler(matrices),
    }


def guaranteed(
    mechanics: Mechanics, L: Array, Gamma: Array, configurations: list[Array]
) -> dict[str, float]:
    """Return the guaranteed rate of decay of (11), and the speed up to which it is valid.

    L and Gamma have shape (n, n), each configuration (n,).
    """
    sizes = [np.linalg.svd(mechanics.factors(q)[0], compute_uv=False) for q in configurations]
    turning = max(
        sum(
            float(np.linalg.norm(slope, 2)) * GUARANTEED_SPEED
            for slope in mechanics.slopes(lambda x: mechanics.factors(x)[0], q)
        )
        for q in configurations
    )
    smallest, largest = min(size[-1] for size in sizes), max(size[0] for size in sizes)
    return {
        'guaranteed_rate': guaranteed_rate(L, Gamma, smallest, largest, turning).rate,
        'guaranteed_for_speed': GUARANTEED_SPEED,
    }


# titles of the numbers that an observer's `describe` returns
MEANINGS = {
    'operating_point': 'operating point [rad or m]',
    'L': 'L, gain of the position [1/s]',
    'Gamma': 'Gamma, gain of the momenta',
    'K': 'K, gain of the velocity [1/s^2]',
    'poles': 'poles of the error at the operating point [1/s]',
    'noise_figure': 'noise figure K^2/(2 L) [1/s^3]',
    'slowest_pole_over_range': 'slowest pole over the range of q [1/s]',
    'dt_K': 'dt K [1/s]',
    'dt_K_below_L': 'dt K below L, required by forward Euler',
    'longest_euler_dt': 'longest sample time with forward Euler [s]',
    'guaranteed_rate': 'guaranteed rate of decay, Proposition 4.1 as corrected [1/s]',
    'guaranteed_for_speed': 'guaranteed up to a speed of [rad/s or m/s]',
    'acceleration_limit': 'model error up to which the estimate is exact [rad/s^2 or m/s^2]',
    'chattering': 'chattering of a forward Euler step [rad/s or m/s]',
}


def in_words(found: dict[str, Any]) -> dict[str, str]:
    """Return what `describe` returns as texts; of a diagonal matrix only the diagonal."""
    words = {}
    for name, value in found.items():
        if name == 'poles':
            words[name] = ', '.join(map(_pole, value))
        elif isinstance(value, bool):
            words[name] = 'yes' if value else 'no'
        else:
            words[name] = _row(value)
    return words


def _pole(pole: complex) -> str:
    if abs(pole.imag) < 1e-6 * abs(pole):  # a pair of equal poles that differ by rounding only
        return f'{pole.real:.4g}'
    return f'{pole.real:.4g}{pole.imag:+.4g}i'


def _row(values: Any) -> str:
    numbers = np.asarray(values, float)
    if numbers.ndim == 2:
        diagonal = np.diag(np.diag(numbers))
        if np.max(np.abs(numbers - diagonal)) <= 1e-12 * np.max(np.abs(numbers)):
            numbers = np.diag(numbers)
    return ', '.join(f'{value:.4g}' for value in numbers.ravel())
