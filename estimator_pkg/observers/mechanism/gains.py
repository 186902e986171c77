"""From what a person asks of an observer of a mechanism to its gain matrices, and back to words."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.models import check
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.mechanism.flow import LARGEST_PART, MOST_PARTS

Array = NDArray[np.float64]
Limits = Callable[[float], str | None]


class Tuning(NamedTuple):
    """Gains of GESO: qh' = calM ph + L e, ph' = ... + Gamma calM^T P0 e, d' = E e."""

    L: Array
    Gamma: Array
    P0: Array
    E: Array


def require_hurwitz(L: Array) -> None:
    """-L must be Hurwitz; raises UsageError."""
    slowest = float(np.min(np.linalg.eigvals(L).real))
    if not slowest > 0.0:
        raise UsageError(
            f"parameter 'L': -L is not Hurwitz (its slowest eigenvalue is "
            f'{-slowest:+.3g} 1/s): every eigenvalue of L needs a positive real part'
        )


def require_positive(name: str, gain: Array) -> Array:
    """The symmetric positive definite gain; raises UsageError."""
    if float(np.max(np.abs(gain - gain.T))) > 1e-9 * float(np.max(np.abs(gain))):
        raise UsageError(f"parameter '{name}' is not symmetric")
    lowest = float(np.linalg.eigvalsh(0.5 * (gain + gain.T))[0])
    if not lowest > 0.0:
        raise UsageError(
            f"parameter '{name}' is not positive definite (lowest eigenvalue {lowest:.3g})"
        )
    return 0.5 * (gain + gain.T)


def lyapunov_weight(L: Array) -> Array:
    """P0 of Remark 5 in its corrected form: P0 L + L^T P0 > 0.

    The identity where L + L^T > 0 (the paper's own case), else the solution with right-hand side
    I.
    """
    n = len(L)
    if float(np.linalg.eigvalsh(L + L.T)[0]) > 0.0:
        return np.eye(n)
    system = np.kron(np.eye(n), L.T) + np.kron(L.T, np.eye(n))
    weight = np.linalg.solve(system, np.eye(n).ravel()).reshape(n, n)
    return 0.5 * (weight + weight.T)


def error_matrix(mechanics: Mechanics, tuning: Tuning, q: Array, disturbed: bool) -> Array:
    """A of (e, p, d)' = A (e, p, d), with the configuration frozen at q."""
    calm, psi = check.factors(mechanics, q)
    n = mechanics.degrees
    size = 3 * n if disturbed else 2 * n
    matrix = np.zeros((size, size))
    matrix[:n, :n] = -tuning.L
    matrix[:n, n : 2 * n] = calm
    matrix[n : 2 * n, :n] = -tuning.Gamma @ calm.T @ tuning.P0
    if mechanics.damping is not None:
        damping = check.matrix(mechanics.damping, mechanics, q)
        matrix[n : 2 * n, n : 2 * n] = -psi.T @ damping @ calm
    if disturbed:
        matrix[n : 2 * n, 2 * n :] = psi.T
        matrix[2 * n :, :n] = -tuning.E
    return matrix


def slowest_pole(matrix: Array) -> float:
    """-(largest real part) [1/s]."""
    return -float(np.max(np.linalg.eigvals(matrix).real))


def longest_euler(matrices: list[Array]) -> float:
    """The sample time [s] up to which forward Euler is stable at all of these."""
    longest = math.inf
    for matrix in matrices:
        for pole in np.linalg.eigvals(matrix):
            if pole.real >= 0.0:
                return 0.0
            longest = min(longest, -2.0 * pole.real / abs(pole) ** 2)
    return longest


def euler_limit(matrices: list[Array]) -> Limits:
    """`limits` of a forward Euler observer whose error obeys one of these matrices."""
    longest = longest_euler(matrices)

    def limits(dt: float) -> str | None:
        if dt < longest:
            return None
        return (
            f'forward Euler (form: paper) is unstable at a sample time of {dt:.4g} s: these '
            f'gains need less than {longest:.4g} s; use form: exact or lower gains'
        )

    return limits


def exact_limit(matrices: list[Array], n: int) -> Limits:
    """`limits` of the exact step of `flow`, whose error obeys one of these matrices.

    Far beyond the sample rate its gains have nothing to do with it, and it would take thousands of
    parts.
    """
    longest = LARGEST_PART * MOST_PARTS / max(_pace(matrix, n) for matrix in matrices)

    def limits(dt: float) -> str | None:
        if dt < longest:
            return None
        return (
            f'the gains are far too fast for a sample time of {dt:.4g} s: these need less than '
            f'{longest:.4g} s; lower bandwidth_hz'
        )

    return limits


def _pace(matrix: Array, n: int) -> float:
    """What `flow` takes the speed of this error system to be [1/s]."""
    stiffness = abs(float(np.trace(matrix[:n, n : 2 * n] @ matrix[n : 2 * n, :n])))
    return float(np.sum(np.abs(np.diag(matrix)[: 2 * n]))) + math.sqrt(stiffness)


def never(dt: float) -> str | None:
    """`limits` of an observer that works at every sample time."""
    return None


class Guarantee(NamedTuple):
    """The constants of Proposition 4.1; `rate` [1/s] bounds the decay of |(q~, p~)|."""

    d2: float
    c1: float
    c3: float
    c4: float
    rate: float


def guaranteed_rate(L: Array, Gamma: Array, k0: float, k1: float, k2: float) -> Guarantee:
    """Proposition 4.1 in its corrected form.

    The printed proof bounds -|calM p~|^2 from above by -k1^2 |p~|^2 with k1 the largest norm of
    calM; it takes the smallest singular value, k0.

    Parameters
    ----------
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


def describe(
    mechanics: Mechanics,
    tuning: Tuning,
    point: Array,
    dt: float,
    *,
    disturbed: bool,
    speed: float = 1.0,
) -> dict[str, Any]:
    """What a person wants to know of GESO's gains.

    Parameters
    ----------
    speed : velocity for which the guaranteed rate is worked out [rad/s or m/s each].
    """
    calm = check.factors(mechanics, point)[0]
    K = calm @ tuning.Gamma @ calm.T @ tuning.P0
    configurations = [q for q, _ in check.random_states(mechanics)]
    matrices = [error_matrix(mechanics, tuning, q, disturbed) for q in (point, *configurations)]
    found = {
        'operating_point': point.tolist(),
        'L': tuning.L.tolist(),
        'Gamma': tuning.Gamma.tolist(),
        'K': K.tolist(),
        'poles': sorted(
            (complex(pole) for pole in np.linalg.eigvals(matrices[0])),
            key=lambda pole: (pole.real, pole.imag),
        ),
        'noise_figure': (np.diag(K) ** 2 / (2.0 * np.diag(tuning.L))).tolist(),
        'slowest_pole_over_range': min(slowest_pole(matrix) for matrix in matrices),
        'dt_K': (dt * np.diag(K)).tolist(),
        'dt_K_below_L': bool(np.all(dt * np.diag(K) < np.diag(tuning.L))),
        'longest_euler_dt': longest_euler(matrices),
    }
    # the proposition is about (11) itself: L + L^T > 0 and no disturbance state
    if not disturbed and np.allclose(tuning.P0, np.eye(len(tuning.P0))):
        sizes = [
            np.linalg.svd(check.factors(mechanics, q)[0], compute_uv=False) for q in configurations
        ]
        turning = max(
            sum(
                float(np.linalg.norm(slope, 2)) * speed
                for slope in check.slopes(mechanics, lambda x: check.factors(mechanics, x)[0], q)
            )
            for q in configurations
        )
        found['guaranteed_rate'] = guaranteed_rate(
            tuning.L,
            tuning.Gamma,
            min(size[-1] for size in sizes),
            max(size[0] for size in sizes),
            turning,
        ).rate
        found['guaranteed_for_speed'] = speed
    return found


# what each entry of `describe` is, for a person
MEANINGS = {
    'operating_point': 'operating point [rad or m]',
    'L': 'L, gain of the position [1/s]',
    'Gamma': 'Gamma, gain of the momenta',
    'K': 'K, gain of the velocity [1/s^2]',
    'poles': 'poles of the error there [1/s]',
    'noise_figure': 'noise figure K^2/(2 L) [1/s^3]',
    'slowest_pole_over_range': 'slowest pole over the range of q [1/s]',
    'dt_K': 'dt K [1/s]',
    'dt_K_below_L': 'dt K below L, as forward Euler needs',
    'longest_euler_dt': 'longest sample time with forward Euler [s]',
    'guaranteed_rate': 'guaranteed rate of decay, Proposition 4.1 as corrected [1/s]',
    'guaranteed_for_speed': 'guaranteed up to a speed of [rad/s or m/s]',
    'acceleration_limit': 'acceleration error up to which it is exact [rad/s^2 or m/s^2]',
    'chattering': 'chattering of a forward Euler step [rad/s or m/s]',
}


def in_words(found: dict[str, Any]) -> dict[str, str]:
    """`describe` as texts, for a status or a terminal; of a diagonal matrix the diagonal."""
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
    if abs(pole.imag) < 1e-6 * abs(pole):  # equal poles, apart by rounding alone
        return f'{pole.real:.4g}'
    return f'{pole.real:.4g}{pole.imag:+.4g}i'


def _row(values: Any) -> str:
    numbers = np.asarray(values, float)
    if numbers.ndim == 2:
        diagonal = np.diag(np.diag(numbers))
        if np.max(np.abs(numbers - diagonal)) <= 1e-12 * np.max(np.abs(numbers)):
            numbers = np.diag(numbers)
    return ', '.join(f'{value:.4g}' for value in numbers.ravel())
