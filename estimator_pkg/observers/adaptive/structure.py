# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The numbers that follow from the gains of the observer `adaptive`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, suggestion

_CONSTRAINT = re.compile(r'\s*([\w/]+)\s*(=|>=|<=)\s*(\S+)\s*')

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Structure:
    """The numbers that follow from the gains, for order n and m free parameters."""

    names: tuple[str, ...]  # of all parameters, in the order of theta
    observer: tuple[float, ...]  # first column of A_c - K C, shape (n,)
    model: tuple[float, ...]  # first column of A_c, shape (n,)
    injection: tuple[float, ...]  # K, shape (n,)
    free: tuple[int, ...]  # indices of the free parameters in theta
    fixed: tuple[float, ...]  # theta with zeros for the free parameters
    start: tuple[float, ...]  # initial values of the free parameters, shape (m,)
    low: tuple[float, ...]  # their bounds
    high: tuple[float, ...]
    gamma: Array  # Gamma, shape (m, m)
    variance: tuple[float, ...]  # diagonal of the initial P of least squares, shape (m,)
    slowest: float  # magnitude of the slowest observer pole [1/s]
    fastest: float  # of the fastest


def structure(gains: Any) -> Structure:
    """Return the structure of an observer with these `Gains`.

    Raises
    ------
    UsageError : poles, gamma, theta or constraints have the wrong size or contradict each other.
    """
    n = gains.order
    observer = gains.observer_poles or _distinct_poles(-2.0 * math.pi * gains.bandwidth_hz, n)
    model = gains.model_poles or tuple(0.5 * pole for pole in observer)
    for name, poles in (('observer_poles', observer), ('model_poles', model)):
        if len(poles) != n:
            raise UsageError(f"parameter '{name}' needs {n} poles for order {n}, not {len(poles)}")
    slowest, fastest = min(-pole for pole in observer), max(-pole for pole in observer)
    if 0.0 < gains.memory < 1.0 / slowest:
        raise UsageError(
            f"parameter 'memory' = {gains.memory:g} s is shorter than the filters' time constant: "
            f'set 0, or at least {1.0 / slowest:.3g} s'
        )
    column = tuple(-float(c) for c in np.poly(observer)[1:])
    model_column = tuple(-float(c) for c in np.poly(model)[1:])
    names = (
        *(f'l{i + 1}' for i in range(n)),
        *(f'b{i + 1}' for i in range(n)),
        *((f'd{n}',) if gains.load else ()),
        *((f's{n}',) if gains.gravity else ()),
    )
    low, high = [-math.inf] * len(names), [math.inf] * len(names)
    fixed: dict[int, float] = {}
    for text in gains.known:
        place, sign, value = _constraint(text, '=', 'known', names, model_column)
        fixed[place] = value
    for text in gains.bounds:
        place, sign, value = _constraint(text, '<>', 'bounds', names, model_column)
        if sign > 0:
            low[place] = max(low[place], value)
        else:
            high[place] = min(high[place], value)
    free = tuple(i for i in range(len(names)) if i not in fixed)
    if not free:
        raise UsageError(
            f"parameter 'known' = {list(gains.known)} names every parameter, so none is left to "
            'identify: remove at least one'
        )
    for i in free:
        if low[i] > high[i]:
            raise UsageError(
                f"parameter 'bounds' leaves no value for {names[i]}: its lower bound {low[i]:g} is "
                f'above its upper bound {high[i]:g}'
            )
    theta = gains.theta if gains.theta is not None else (0.0,) * len(names)
    if len(theta) != len(names):
        raise UsageError(
            f"parameter 'theta' needs {len(names)} numbers ({', '.join(names)}), not {len(theta)}"
        )
    return Structure(
        names,
        column,
        model_column,
        tuple(m - o for m, o in zip(model_column, column)),
        free,
        tuple(fixed.get(i, 0.0) for i in range(len(names))),
        tuple(min(max(theta[i], low[i]), high[i]) for i in free),
        tuple(low[i] for i in free),
        tuple(high[i] for i in free),
        _gamma(gains.gamma, [names[i] for i in free]),
        _variance(gains.start_variance, [names[i] for i in free], (-column[-1]) ** (1.0 / n)),
        slowest,
        fastest,
    )


def _distinct_poles(pole: float, count: int) -> tuple[float, ...]:
    """Return `count` real poles around `pole`, with ratios of 1.1 for good conditioning."""
    return tuple(pole * 1.1 ** (i - 0.5 * (count - 1)) for i in range(count))


def _gamma(values: tuple[float, ...], names: list[str]) -> Array:
    """Return the matrix Gamma of the free parameters; raises UsageError."""
    m = len(names)
    if len(values) == 1:
        matrix = values[0] * np.eye(m)
    elif len(values) == m:
        matrix = np.diag(values)
    elif len(values) == m * m:
        matrix = np.array(values).reshape(m, m)
        if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
            raise UsageError(
                "parameter 'gamma' is not symmetric: give a symmetric matrix row by row"
            )
    else:
        raise UsageError(
            f"parameter 'gamma' needs 1, {m} or {m * m} numbers for the {m} free "
            f'parameters ({", ".join(names)}), not {len(values)}'
        )
    if np.min(np.linalg.eigvalsh(matrix)) <= 0.0:
        raise UsageError(
            "parameter 'gamma' is not positive definite: its smallest eigenvalue is "
            f'{np.min(np.linalg.eigvalsh(matrix)):.3g}, it must be positive'
        )
    return matrix


def _variance(values: tuple[float, ...] | None, names: list[str], pace: float) -> tuple[float, ...]:
    """Return the diagonal of the initial P; `pace`: geometric mean of the observer poles [1/s]."""
    if values is None:
        return tuple(1e4 * pace ** (2 * int(name[1:])) for name in names)
    if len(values) not in (1, len(names)):
        raise UsageError(
            f"parameter 'start_variance' needs 1 or {len(names)} numbers, not {len(values)}"
        )
    return tuple(values) if len(values) == len(names) else tuple(values) * len(names)


def physical(
    names: tuple[str, ...], model: tuple[float, ...]
) -> dict[str, tuple[int, float, float, str]]:
    """Return physical ratios by name: (index in theta, offset, sign, unit).

    A ratio is offset + sign theta[index].

    For order 2 only, J q'' + b q' + k q + m g l sin q = Kv u + load.
    """
    if len(model) != 2:
        return {}
    ratios = {
        'b/J': (0, -model[0], -1.0, '1/s'),
        'k/J': (1, -model[1], -1.0, '1/s^2'),
        'Kv/J': (3, 0.0, 1.0, 'rad/s^2 per unit of input'),
    }
    if 'd2' in names:
        ratios['load/J'] = (names.index('d2'), 0.0, 1.0, 'rad/s^2')
    if 's2' in names:
        ratios['mgl/J'] = (names.index('s2'), 0.0, -1.0, '1/s^2')
    return ratios


def _constraint(
    text: str, signs: str, owner: str, names: tuple[str, ...], model: tuple[float, ...]
) -> tuple[int, int, float]:
    """Return (index in theta, relation, value) of a text such as 'name>=value'.

    The relation is 1 for at least, -1 for at most, 0 for equal.
    """
    ratios = physical(names, model)
    match = _CONSTRAINT.fullmatch(text)
    value = math.nan
    if match:
        try:
            value = float(match[3])
        except ValueError:
            match = None
    if not match or not math.isfinite(value) or match[2][0] not in signs:
        example = 'b1=0' if signs == '=' else 'b/J>=0'
        raise UsageError(
            f"parameter '{owner}': '{text}' does not have the right form: write it as '{example}'"
        )
    name, sign = match[1], {'=': 0, '>=': 1, '<=': -1}[match[2]]
    if name in names:
        return names.index(name), sign, value
    if name in ratios:
        place, offset, factor, unit = ratios[name]
        return place, int(sign * factor), (value - offset) * factor
    raise UsageError(
        f"parameter '{owner}': no parameter is called '{name}': "
        f'{suggestion(name, (*names, *ratios))}'
    )
