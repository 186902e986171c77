# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The parameters theta of the observer `adaptive`: names, known values, bounds, and matrices."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.observers.adaptive.state import Array, Design
from estimator_pkg.observers.maths.linear import companion

_CONSTRAINT = re.compile(r'\s*([\w/]+)\s*(=|>=|<=)\s*(\S+)\s*')
POLE_RATIO = 1.1  # of two automatic poles, for good conditioning
START_VARIANCE = 1e4  # of P, per variance of the measurement and power of the poles' pace


def names_of(gains: Any) -> tuple[str, ...]:
    """Return the names of all parameters in the order of theta, shape (p,)."""
    places = [str(i + 1) for i in range(gains.order)]
    ends = ('d',) * gains.load + ('s',) * gains.gravity
    return (*map('l'.__add__, places), *map('b'.__add__, places), *(x + places[-1] for x in ends))


def structure(gains: Any) -> Design:
    """Return poles, parameters and matrices of an observer with these `Gains`.

    Raises
    ------
    UsageError : poles, gamma, theta or constraints have the wrong size or contradict each other.
    """
    n, made, names = gains.order, Design(), names_of(gains)
    pole, steps = -2.0 * math.pi * gains.bandwidth_hz, np.arange(n) - 0.5 * (n - 1)
    observer = np.array(gains.observer_poles or pole * POLE_RATIO**steps)
    model = np.array(gains.model_poles or 0.5 * observer)
    for name, poles in (('observer_poles', observer), ('model_poles', model)):
        if len(poles) != n:
            raise UsageError(f"parameter '{name}' needs {n} poles for order {n}, not {len(poles)}")
    made.order, made.load, made.gravity = n, gains.load, gains.gravity
    made.slowest, made.fastest = float(min(-observer)), float(max(-observer))
    if 0.0 < gains.memory < 1.0 / made.slowest:
        raise UsageError(
            f"parameter 'memory' = {gains.memory:g} s is shorter than the filters' time constant: "
            f'set 0, or at least {1.0 / made.slowest:.3g} s'
        )
    made.observer, made.model = ((-np.poly(poles)[1:]).tolist() for poles in (observer, model))
    made.pace = float((-made.observer[-1]) ** (1.0 / n))
    made.a_k = companion(made.observer)
    made.w = gramian(made.a_k)
    units = np.zeros((4, n, len(names)))
    units[0, :, :n] = units[1, :, n : 2 * n] = np.eye(n)
    units[2, -1, 2 * n : 2 * n + gains.load] = 1.0
    units[3, -1, 2 * n + gains.load :] = 1.0
    made.units = units.reshape(4, -1)
    made.injection = np.zeros(len(names))
    made.injection[:n] = np.subtract(made.model, made.observer)
    _constrain(made, gains, names)
    theta = np.zeros(len(names)) if gains.theta is None else np.array(gains.theta, float)
    if len(theta) != len(names):
        raise UsageError(
            f"parameter 'theta' needs {len(names)} numbers ({', '.join(names)}), not {len(theta)}"
        )
    made.start = np.clip(theta, made.low, made.high)[made.free]
    free = [names[i] for i in made.free]
    made.gamma = _gamma(gains.gamma, free)
    powers = np.array([int(name[1:]) for name in free])
    made.variance = START_VARIANCE * made.pace ** (2 * powers)
    return made


def _constrain(made: Design, gains: Any, names: tuple[str, ...]) -> None:
    """Set which parameters are free, the values of the others, and the bounds."""
    low, high = np.full(len(names), -math.inf), np.full(len(names), math.inf)
    fixed: dict[int, float] = {}
    for text in gains.known:
        place, sign, value = _constraint(text, '=', 'known', names, made.model)
        fixed[place] = value
    for text in gains.bounds:
        place, sign, value = _constraint(text, '<>', 'bounds', names, made.model)
        if sign > 0:
            low[place] = max(low[place], value)
        else:
            high[place] = min(high[place], value)
    made.free = [i for i in range(len(names)) if i not in fixed]
    if not made.free:
        raise UsageError(
            f"parameter 'known' = {list(gains.known)} names every parameter, so none is left to "
            'identify: remove at least one'
        )
    for i in made.free:
        if low[i] > high[i]:
            raise UsageError(
                f"parameter 'bounds' leaves no value for {names[i]}: its lower bound {low[i]:g} is "
                f'above its upper bound {high[i]:g}'
            )
    made.fixed = np.array([fixed.get(i, 0.0) for i in range(len(names))])
    known = list(fixed)
    low[known] = high[known] = made.fixed[known]
    made.low, made.high = low, high


def gramian(a: Array) -> Array:
    """Return W = int exp(A's)' C'C exp(A s) ds, shape (n, n), for the noise of filter outputs."""
    n = len(a)
    both = np.kron(a.T, np.eye(n)) + np.kron(np.eye(n), a.T)
    right = np.zeros(n * n)
    right[0] = -1.0  # -C'C
    w = np.linalg.solve(both, right).reshape(n, n)
    return 0.5 * (w + w.T)


def _gamma(values: tuple[float, ...], names: list[str]) -> Array:
    """Return the matrix Gamma of the free parameters; raises UsageError."""
    m = len(names)
    if len(values) == m * m:
        matrix = np.array(values, float).reshape(m, m)
        if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
            raise UsageError(
                "parameter 'gamma' is not symmetric: give a symmetric matrix row by row"
            )
    elif len(values) in (1, m):
        matrix = np.diag(np.broadcast_to(np.array(values, float), m))
    else:
        raise UsageError(
            f"parameter 'gamma' needs 1, {m} or {m * m} numbers for the {m} free "
            f'parameters ({", ".join(names)}), not {len(values)}'
        )
    least = np.min(np.linalg.eigvalsh(matrix))
    if least <= 0.0:
        raise UsageError(
            "parameter 'gamma' is not positive definite: its smallest eigenvalue is "
            f'{least:.3g}, it must be positive'
        )
    return matrix


def physical(
    names: tuple[str, ...], model: Sequence[float]
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
    text: str, signs: str, owner: str, names: tuple[str, ...], model: Sequence[float]
) -> tuple[int, int, float]:
    """Return (index in theta, relation, value) of a text such as 'name>=value'.

    The relation is 1 for at least, -1 for at most, 0 for equal.
    """
    ratios = physical(names, model)
    match, value = _CONSTRAINT.fullmatch(text), math.nan
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
