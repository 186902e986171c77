"""SMO: sliding-mode observers of a mechanism.

super_twisting (Davila, Fridman, Levant; (22) of the paper), with e = y - x1h:
    x1h' = x2h + 1.5 sqrt(mu |e|) sgn e,   x2h' = model + 1.1 mu sgn e
uniform (Cruz-Zavala, Moreno, Fridman; the robotic leg's of section 5.2):
    x1h' = x2h + k1 (m1 |e|^(1/2) + m2 |e|^(3/2)) sgn e
    x2h' = model + k2 (m1^2/2 sgn e + 2 m1 m2 e + 3/2 m2^2 |e|^2 sgn e)

They are exact after a finite time as long as the model's acceleration is wrong by less than 1.1 mu,
and fail beyond it. Injections with a sign have no matrix exponential: the default form steps them
implicitly, which has a closed form for super_twisting and a monotone one for uniform, and makes no
chattering of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError
from estimator_pkg.observers import mechanical_gains
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.mechanical import (
    LINEAR,
    PAPER,
    MechanicalCore,
    MechanicalFunctions,
    MechanicalGains,
    around,
    model_of,
    per_joint,
)
from estimator_pkg.observers.mechanical_algebra import column, mechanical_algebra
from estimator_pkg.observers.mechanical_velocity import (
    linear_matrix,
    make_acceleration,
    make_place,
)
from estimator_pkg.parameters import parameter

Array = NDArray[np.float64]

SUPER_TWISTING, UNIFORM = 'super_twisting', 'uniform'
FIRST, SECOND = 1.5, 1.1    # of (22)
NEWTON = 60                 # steps at most; from above they fall monotonically
# describing functions: a Gaussian e of deviation s through sqrt(|e|) sgn e and through sgn e, per s
OF_ROOT = 2.0 ** 0.75 * math.gamma(1.25) / math.sqrt(math.pi)
OF_SIGN = math.sqrt(2.0 / math.pi)


@dataclass(frozen=True)
class Gains(MechanicalGains):
    """Parameters of `smo`; `L`, `bandwidth_hz`, `damping`, `disturbance_hz` are not used."""

    variant: str = parameter(
        SUPER_TWISTING, unit='', choices=(SUPER_TWISTING, UNIFORM), structural=True,
        description='which injections')
    mu: tuple[float, ...] = parameter(
        (10.0,), unit='rad/s^2 or m/s^2', kind=list, range=(1e-9, 1e9), search=(0.1, 1e4),
        description='super_twisting: about the largest acceleration that the model does not '
                    'explain, for all positions or each')
    k1: tuple[float, ...] = parameter(
        (1.0,), unit='', kind=list, range=(1e-9, 1e9), description='uniform: gain of the position')
    k2: tuple[float, ...] = parameter(
        (1.0,), unit='', kind=list, range=(1e-9, 1e9), description='uniform: gain of the velocity')
    mu1: float = parameter(
        1.86, unit='', range=(1e-9, 1e6), description='uniform: of the root, and of the sign')
    mu2: float = parameter(
        0.303, unit='', range=(0.0, 1e6), description='uniform: of the powers 3/2 and 2')


def twisting(e: float, first: float, second: float, m1: float, m2: float) -> tuple[float, float]:
    """The two injections of super_twisting at e."""
    if e == 0.0:
        return 0.0, 0.0
    root = math.sqrt(abs(e))
    if e > 0.0:
        return first * root, second
    return -first * root, -second


def uniform(e: float, first: float, second: float, m1: float, m2: float) -> tuple[float, float]:
    """The two injections of uniform at e."""
    if e == 0.0:
        return 0.0, 0.0
    size = abs(e)
    root = math.sqrt(size)
    one = first * (m1 * root + m2 * root * size)
    two = second * (0.5 * m1 * m1 + 2.0 * m1 * m2 * size + 1.5 * m2 * m2 * size * size)
    return (one, two) if e > 0.0 else (-one, -two)


def implicit_twisting(free: float, h: float, first: float, second: float, m1: float, m2: float
                      ) -> tuple[float, float]:
    """(e, second injection) after an implicit step: e + h first sqrt|e| sgn e + h^2 second sgn e
    = free, with sgn 0 anything in [-1, 1].
    """
    size = abs(free)
    held = h * h * second
    if size <= held:
        return 0.0, free / (h * h)
    half = 0.5 * h * first
    over = size - held
    root = over / (half + math.sqrt(half * half + over))
    if free > 0.0:
        return root * root, second
    return -root * root, -second


def implicit_uniform(free: float, h: float, first: float, second: float, m1: float, m2: float
                     ) -> tuple[float, float]:
    """As `implicit_twisting`, for `uniform`: a quartic in sqrt|e|, by Newton from above."""
    size = abs(free)
    held = h * h * second * 0.5 * m1 * m1
    if size <= held:
        return 0.0, free / (h * h)
    over = size - held
    a1, a3 = h * first * m1, h * first * m2
    a2 = 1.0 + h * h * second * 2.0 * m1 * m2
    a4 = h * h * second * 1.5 * m2 * m2
    root = math.sqrt(over)
    for _ in range(NEWTON):
        value = root * (a1 + root * (a2 + root * (a3 + root * a4))) - over
        slope = a1 + root * (2.0 * a2 + root * (3.0 * a3 + root * 4.0 * a4))
        change = value / slope
        root -= change
        if change <= 1e-16 * root:
            break
    e = root * root
    two = second * (0.5 * m1 * m1 + 2.0 * m1 * m2 * e + 1.5 * m2 * m2 * e * e)
    return (e, two) if free > 0.0 else (-e, -two)


def make_inject(n: int, one: Any) -> Any:
    """inject(e, first, second, m1, m2) -> two vectors, of one channel's injections `one`."""
    body = '\n'.join(['def inject(e, first, second, m1, m2):']
                     + [f'    a{i}, b{i} = {one.__name__}(e[{i}], first[{i}], second[{i}], m1, m2)'
                        for i in range(n)]
                     + [f'    return {column("a{i}", n)}, {column("b{i}", n)}'])
    names: dict[str, Any] = {one.__name__: one}
    exec(compile(body, f'<injections of {n}, {one.__name__}>', 'exec'), names)
    return names['inject']


def make_settle(n: int, one: Any) -> Any:
    """settle(free, h, first, second, m1, m2) -> (e, second injections): `one` for each channel."""
    body = '\n'.join(['def settle(free, h, first, second, m1, m2):']
                     + [f'    a{i}, b{i} = {one.__name__}(free[{i}], h, first[{i}], second[{i}], '
                        'm1, m2)'
                        for i in range(n)]
                     + [f'    return {column("a{i}", n)}, {column("b{i}", n)}'])
    names: dict[str, Any] = {one.__name__: one}
    exec(compile(body, f'<implicit steps of {n}, {one.__name__}>', 'exec'), names)
    return names['settle']


def build(gains: Gains, circle: Any) -> MechanicalFunctions:
    """The functions of the observer at these gains; raises UserError, UsageError."""
    mechanics = model_of(gains)
    n = mechanics.degrees
    if gains.L is not None or gains.disturbance_hz > 0.0:
        raise UsageError("'smo' takes 'mu', or 'k1' and 'k2': no 'L', no 'disturbance_hz'")
    twists = gains.variant == SUPER_TWISTING
    if twists:
        mu = np.array(per_joint('mu', gains.mu, n))
        first, second = FIRST * np.sqrt(mu), SECOND * mu
        acceleration_limit = second
    else:
        first = np.array(per_joint('k1', gains.k1, n))
        second = np.array(per_joint('k2', gains.k2, n))
        acceleration_limit = second * 0.5 * gains.mu1 ** 2
    paper = gains.form == PAPER
    linear_hold = gains.hold == LINEAR and not paper
    algebra = mechanical_algebra(n)
    towards, minus = algebra.towards, algebra.minus
    inject = make_inject(n, twisting if twists else uniform)
    settle = make_settle(n, implicit_twisting if twists else implicit_uniform)
    acceleration, place = make_acceleration(mechanics), make_place(n, gains)
    admits = mechanics.admits
    zeros = (0.0,) * n

    def design() -> tuple:
        return (mechanics.values, tuple(first.tolist()), tuple(second.tolist()),
                float(gains.mu1), float(gains.mu2))

    def prepare(design: tuple, dt: float) -> tuple:
        return (dt, 1.0 / dt)

    def begin() -> tuple:
        return (zeros, zeros, (), zeros)

    def advance(core: tuple, coefficients: tuple, design: tuple, before: tuple, moved: tuple,
                measurement: tuple, given: tuple) -> tuple:
        e, x, d, v = core
        values, gain_1, gain_2, m1, m2 = design
        dt = coefficients[0]
        at = place(before, moved, e)
        if not admits(values, at):
            return core, False
        f = acceleration(values, at, x, given)
        if paper:
            a, b = inject(e, gain_1, gain_2, m1, m2)
            e = minus(towards(e, dt, minus(x, a)), moved)
            x = towards(x, dt, minus(f, b))
        else:
            free = towards(e, dt, towards(x, dt, f))
            if linear_hold:
                free = minus(free, moved)
            e, b = settle(free, dt, gain_1, gain_2, m1, m2)
            x = towards(x, dt, minus(f, b))
            if not linear_hold:
                e = minus(e, moved)
        return (e, x, d, x), True

    def rejoin(core: tuple, design: tuple, at: tuple) -> tuple:
        return (core[0], core[3], core[2], core[3])

    def linear(at: Array, power: Array) -> tuple[Array, Array]:
        """By describing functions, at the present size of e; it tells some 30 % too little, because
        the harmonics of the switching are left out.
        """
        size = np.sqrt(np.maximum(power, 1e-18))
        if twists:
            one, two = first * OF_ROOT / np.sqrt(size), second * OF_SIGN / size
        else:
            one = first * (gains.mu1 * OF_ROOT / np.sqrt(size) + gains.mu2 * np.sqrt(size))
            two = second * (0.5 * gains.mu1 ** 2 * OF_SIGN / size + 2.0 * gains.mu1 * gains.mu2
                            + 1.5 * gains.mu2 ** 2 * size)
        return linear_matrix(mechanics, np.diag(one), np.diag(two), None, at), np.eye(n)

    def describe(dt: float) -> dict[str, Any]:
        return {'acceleration_limit': acceleration_limit.tolist(),
                'chattering': (dt * acceleration_limit).tolist()}

    core = MechanicalCore(
        design=design, prepare=prepare, begin=begin, advance=advance, rejoin=rejoin, linear=linear,
        limits=mechanical_gains.never, slowest=4.0 * float(np.min(acceleration_limit)), lag=0.0)
    return around(core, gains, mechanics, circle, describe)


OBSERVER = Observer(
    name='smo', summary='sliding-mode observer of any mechanism whose model and input are known',
    gains=Gains, build=build, kind='mechanical',
    reference='Davila, Fridman, Levant (2005) and Cruz-Zavala, Moreno, Fridman (2010); (22) of '
              'Aranovskiy et al. (IJC 2019)')
