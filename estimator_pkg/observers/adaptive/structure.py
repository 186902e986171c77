# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The gains of the observer `adaptive`, and its theta: names, known values, bounds, matrices."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.observers.adaptive.state import Array, Design
from estimator_pkg.observers.maths.linear import companion
from estimator_pkg.parameters import parameter, structural

SAMPLED_FORM, PUBLISHED_FORM = 'sampled', 'paper'
GRADIENT, LEAST_SQUARES = 'gradient', 'least_squares'
_CONSTRAINT = re.compile(r'\s*([\w/]+)\s*(=|>=|<=)\s*(\S+)\s*')
POLE_RATIO = 1.1  # of two automatic poles, for good conditioning
START_VARIANCE = 1e4  # of P, per variance of the measurement and power of the poles' pace


@dataclass(frozen=True)
class Gains:
    """Parameters of `adaptive`."""

    order: int = structural(
        2,
        range=(1, 6),
        description='order of the plant from input to angle; 2: inertia, damping and spring',
        equation='(1), observable canonical form',
    )
    form: str = structural(
        SAMPLED_FORM,
        choices=(SAMPLED_FORM, PUBLISHED_FORM),
        description='sampled: filters exact for the sample time and a step that is stable for '
        'every gain; paper: (11) to (13) by forward Euler, whose damping b/J has an error of '
        'dt k/J',
    )
    law: str = structural(
        LEAST_SQUARES,
        choices=(LEAST_SQUARES, GRADIENT),
        description='adaptation law: least squares needs no scaling and converges about a hundred '
        "times faster than the paper's gradient (12)",
    )
    observer_poles: tuple[float, ...] | None = structural(
        None,
        unit='1/s',
        kind=list,
        range=(-1e6, -1e-6),
        description='eigenvalues of A_c - K C, one per order: bandwidth of the filters; automatic: '
        'from bandwidth_hz',
    )
    bandwidth_hz: float = structural(
        5.0,
        unit='Hz',
        range=(1e-3, 1e4),
        search=(0.5, 100.0),
        description='magnitude of the observer poles where observer_poles is automatic; set it '
        'well above the frequencies of the motion, and low enough to suppress the noise',
    )
    model_poles: tuple[float, ...] | None = structural(
        None,
        unit='1/s',
        kind=list,
        range=(-1e6, -1e-6),
        description='eigenvalues of A_c, one per order: the plant that is assumed before '
        'adaptation; automatic: half the observer poles',
        equation='(2), (40)',
    )
    gamma: tuple[float, ...] = structural(
        (1000.0,),
        kind=list,
        description='gain of the gradient: one number, one for each free parameter (about '
        '1/mean square of its signal), or a positive definite matrix row by row',
        equation='Gamma in (12)',
    )
    memory: float = parameter(
        0.0,
        unit='s',
        range=(0.0, 1e9),
        description='time constant, in time spent adapting, with which least squares forgets; the '
        'variance never exceeds the initial one; 0: it forgets nothing',
    )
    load: bool = structural(
        False,
        description='learn a constant load (or an offset of the spring) too, as one more parameter '
        'd<order>; without it a constant load biases the other parameters',
    )
    gravity: bool = structural(
        False,
        description='learn a torque proportional to the sine of the angle too (a pendulum or arm, '
        'whose angle is 0 where it hangs), as one more parameter s<order>; set '
        "known: ['k/J=0'] if there is no spring",
    )
    known: tuple[str, ...] = structural(
        (),
        description="parameters that are known, such as 'b1=0', 'k/J=0': l1.., b1.., d<order>, "
        's<order>, and for order 2 b/J, k/J, Kv/J, load/J, mgl/J',
    )
    bounds: tuple[str, ...] = structural(
        (), description="bounds of free parameters, such as 'b/J>=0', 'b2<=50'"
    )
    theta: tuple[float, ...] | None = structural(
        None,
        kind=list,
        description='initial parameters, l1.. then b1.. (then d<order>, s<order>); automatic: zero',
    )
    adapt: bool = parameter(
        True,
        description='false freezes the parameters; the filters keep running, so that adaptation '
        'resumes without a bump',
    )
    velocity: str = structural(
        'full',
        choices=('full', 'paper'),
        description='full: C (A x + B u), correct once the innovation is zero; paper: (38), '
        'which needs b1 = 0 and correct parameters',
    )
    gate: str = structural(
        'noise',
        choices=('noise', 'none'),
        description='adapt only while the signals determine the parameters. noise: the '
        'information matrix exceeds 100 times the one of measurement noise alone; none: adapt '
        'always',
    )
    knock: float = structural(
        5.0,
        range=(0.0, 1e9),
        description='an innovation larger than this multiple of its usual size is a knock from '
        'outside: adaptation pauses until the filters have settled; 0: never',
    )
    moving_above: float = structural(
        0.0,
        unit='rad/s',
        range=(0.0, 1e6),
        description='adapt only while the joint moves faster: the model is not valid while dry '
        'friction sticks; 0: always',
    )
    settle: float | None = parameter(
        None,
        unit='s',
        kind=float,
        range=(0.0, 1e6),
        advanced=True,
        description='time without adaptation after a start or a gap; automatic: five time '
        'constants of the slowest observer pole',
    )
    torque_constant: float | None = parameter(
        None,
        unit='N m per unit of input',
        kind=float,
        range=(1e-9, 1e9),
        description='Kv, if known (1 if the input is a torque): then J, b and k are reported too; '
        'automatic: not known',
    )
    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        description='smallest step of the measurement (2 pi / counts); 0: not known',
    )
    noise: float | None = parameter(
        None,
        unit='rad',
        range=(1e-12, 10.0),
        description='standard deviation of the measurement noise, without quantisation; '
        'automatic: estimated from third differences',
    )


def names_of(gains: Gains) -> tuple[str, ...]:
    """Return the names of all parameters in the order of theta, shape (p,)."""
    places = [str(i + 1) for i in range(gains.order)]
    ends = ('d',) * gains.load + ('s',) * gains.gravity
    return (*map('l'.__add__, places), *map('b'.__add__, places), *(x + places[-1] for x in ends))


def structure(gains: Gains) -> Design:
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


def _constrain(made: Design, gains: Gains, names: tuple[str, ...]) -> None:
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
