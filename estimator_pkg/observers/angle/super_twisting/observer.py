# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Super-twisting differentiators of order 1, 2 and 3 (sliding-mode observers of an angle alone).

The continuous differentiator of order n bounds its error by L, the bound of derivative n + 1:

    z_j' = z_{j+1} + c_{j+1} L^{(j+1)/(n+1)} |e|^{(n-j)/(n+1)} sgn e,   e = y - z_0,  j = 0..n

What matters in practice is how it is sampled (`form`). Every form is written here as a prediction
over the true dt and a correction by the wrapped innovation, so that the estimate belongs to the
newest sample. The published predictor forms (correction first, then the step) are the same
filters: their gain is A times ours.

Barbot, Djemai, Manamanni (2007), use order 1: equations (5) and (14).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.core import OUTSIDE, AngleCore, AngleGains, around
from estimator_pkg.observers.angle.super_twisting.gains import (
    COEFFICIENTS,
    MATCHED,
    NOISE_GAINS,
    SMALLEST,
    Design,
    implicit_table,
    noise_gains_tabled,
    noise_table,
    roots,
)
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import Functions, Observer
from estimator_pkg.observers.maths.twisting import implicit_step
from estimator_pkg.parameters import parameter, structural

EXPLICIT = ('taylor', 'explicit')
PACE = 0.55  # of (L/|e|)^(1/(n+1)): its slowest error decays so fast
REFRESH = 8.0  # samples after which the noise gains are computed again
NEWEST = 0.15  # weight of the mean square of the newest REFRESH samples: 50 samples in all
CALM = 16.0  # times less than the mean square: a transient is over, ...
HALVED = 0.5  # ... and is forgotten by this factor every REFRESH samples


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `super_twisting`."""

    order: int = structural(
        2,
        range=(1, 3),
        description='1: velocity, from a bound of acceleration; 2: and acceleration, from a bound '
        'of jerk; 3: from a bound of snap',
    )
    bound: float = parameter(
        5000.0,
        unit='rad/s^(order+1)',
        range=(1e-6, 1e15),
        search=(1.0, 1e7),
        description='largest acceleration (order 1), jerk (2) or snap (3) of the motion; too small '
        'fails hard, too large costs about its square root in noise',
        equation='L in lambda_j = c_j L^(j/(n+1))',
    )
    form: str = structural(
        'matching',
        choices=('matching', 'implicit', 'taylor', 'explicit'),
        description='sampling: matching (eigenvalues matched to dt), implicit (order 1 only), '
        'taylor (explicit with Taylor terms), explicit (Euler; chatters by dt times '
        'the gain, kept to show why not)',
    )


def taylor(chain: tuple, dt: float) -> tuple[float, float, float, float]:
    """Return position and its derivatives dt later, the highest one constant."""
    x, v, a, j = chain
    return (
        x + dt * (v + dt * (0.5 * a + dt * (j / 6.0))),
        v + dt * (a + 0.5 * dt * j),
        a + dt * j,
        j,
    )


def euler(chain: tuple, dt: float) -> tuple[float, float, float, float]:
    """Return the same by forward Euler: every derivative moves with the next one only."""
    x, v, a, j = chain
    return (x + dt * v, v + dt * a, a + dt * j, j)


def taylor_back(k: tuple, dt: float) -> tuple[float, float, float, float]:
    """Return the correction before the step of a predictor's correction `k` after it: A^-1 k."""
    return taylor(k, -dt)


def euler_back(k: tuple, dt: float) -> tuple[float, float, float, float]:
    """Return the same for `euler`."""
    k0, k1, k2, j = k
    a = k2 - dt * j
    v = k1 - dt * a
    return (k0 - dt * v, v, a, j)


def power_terms(innovation: float, design: Design, dt: float) -> tuple[float, float, float, float]:
    """Return dt times the right-hand sides of the differentiator (explicit forms)."""
    size = abs(innovation)
    if size < SMALLEST:
        return (0.0, 0.0, 0.0, 0.0)
    signed = dt * size if innovation > 0.0 else -dt * size
    pace = design.scale / size ** (1.0 / (design.order + 1.0))  # (L/|e|)^(1/(n+1)) [1/s]
    fast = pace * signed
    second = design.c2 * pace * fast
    third = design.c3 * pace * pace * fast
    return (design.c1 * fast, second, third, design.c4 * pace * pace * pace * fast)


def prepare(design: Design, dt: float) -> tuple:
    """Return (dt, design, roots, period, 1/dt, 1/dt^2, 1/dt^3, pace).

    `pace` is dt times the speed of the error dynamics at an innovation of 1 rad.

    The gains depend on the innovation, so no more can be made beforehand.
    """
    rate = 1.0 / dt
    return (
        dt,
        design,
        design.roots,
        design.period,
        rate,
        rate * rate,
        rate * rate * rate,
        dt * design.scale,
    )


def init(measurement: float, design: Design) -> tuple:
    """Return the state after the first sample [rad].

    (position, velocity, acceleration, jerk, sum of the squared innovations since the noise gains
    were computed, samples since then (0: only one sample has come), noise gains, mean square
    innovation)
    """
    return (measurement, 0.0, 0.0, 0.0, 0.0, 0.0, (1.0, 1.0, 1.0), 0.0)


def averaged(power: float, total: float) -> float:
    """Return the mean square innovation, after REFRESH samples whose squares make this `total`.

    What noise makes of the gains follows from it, so a transient must not stay in it for long.
    """
    mean = total / REFRESH
    if CALM * mean < power:
        return HALVED * power
    return power + NEWEST * (mean - power)


def correction(form: str, order: int) -> Callable[..., tuple]:
    """Return `correct` of the core for this form."""
    of_power = noise_gains_tabled if form == 'implicit' else NOISE_GAINS[order]

    def begin(state: tuple, coefficients: tuple, measurement: float) -> tuple:
        """Return the state after the second sample, which gives the speed.

        It is right below half a turn per sample.
        """
        first, _, _, _, _, _, _, _ = state
        dt, _, _, period, _, _, _, _ = coefficients
        speed = wrap(measurement - first, period) / dt
        noise = of_power(0.0, coefficients)
        return (measurement, speed, 0.0, 0.0, 0.0, 1.0, noise, 0.0), 0.0

    def moved(
        predicted: tuple, k: tuple, innovation: float, averages: tuple, coefficients: tuple
    ) -> tuple:
        """Return the predicted chain plus the correction `k`; the position is on the circle."""
        x, v, a, j = predicted
        k0, k1, k2, k3 = k
        total, tick, noise, power = averages
        _, _, _, period, _, _, _, _ = coefficients
        total += innovation * innovation
        tick += 1.0
        if tick > REFRESH:
            power = averaged(power, total)
            total, tick, noise = 0.0, 1.0, of_power(power, coefficients)
        x = wrap(x + k0, period)
        return (x, v + k1, a + k2, j + k3, total, tick, noise, power), innovation

    if form == 'matching':
        return _matching(order, begin)
    if form == 'implicit':
        return _implicit(begin, moved)
    ahead, back = (taylor, taylor_back) if form == 'taylor' else (euler, euler_back)
    return _explicit(ahead, back, begin, moved)


def _matching(order: int, begin: Callable[..., tuple]) -> Callable[..., tuple]:
    """Return `correct` with eigenvalues exp(dt (L/|e|)^(1/(n+1)) p_i) of the error; see `gains`."""
    matched, exponent, of_power = MATCHED[order], 1.0 / (order + 1.0), NOISE_GAINS[order]

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple:
        x, v, a, j, total, tick, noise, power = state
        if tick == 0.0:
            return begin(state, coefficients, measurement)
        dt, _, roots, period, rate, rate_2, rate_3, pace = coefficients
        x += dt * (v + dt * (0.5 * a + dt * j / 6.0))
        v += dt * (a + 0.5 * dt * j)
        a += dt * j
        innovation = measurement - x
        if not -period <= innovation + innovation < period:
            innovation = wrap(innovation, period)
        size = abs(innovation)
        if size > SMALLEST:
            k0, k1, k2, k3 = matched(pace / size**exponent, roots)
            x += k0 * innovation
            v += k1 * innovation * rate
            a += k2 * innovation * rate_2
            j += k3 * innovation * rate_3
        if not -period <= x + x < period:
            x = wrap(x, period)
        total += innovation * innovation
        if tick >= REFRESH:
            power = averaged(power, total)
            return (x, v, a, j, 0.0, 1.0, of_power(power, coefficients), power), innovation
        return (x, v, a, j, total, tick + 1.0, noise, power), innovation

    return correct


def _explicit(
    ahead: Callable[..., tuple],
    back: Callable[..., tuple],
    begin: Callable[..., tuple],
    moved: Callable[..., tuple],
) -> Callable[..., tuple]:
    """Return the explicit `correct`: Taylor terms, or forward Euler as printed in textbooks."""

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple:
        x, v, a, j, total, tick, noise, power = state
        if tick == 0.0:
            return begin(state, coefficients, measurement)
        dt, design, _, period, _, _, _, _ = coefficients
        predicted = ahead((x, v, a, j), dt)
        x, _, _, _ = predicted
        innovation = wrap(measurement - x, period)
        k = back(power_terms(innovation, design, dt), dt)
        return moved(predicted, k, innovation, (total, tick, noise, power), coefficients)

    return correct


def _implicit(begin: Callable[..., tuple], moved: Callable[..., tuple]) -> Callable[..., tuple]:
    """Return `correct` of the implicit Euler form of order 1, in closed form.

    In sliding it is the backward difference; outside it the change of the velocity is clipped to
    dt alpha.
    """

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple:
        x, v, _, _, total, tick, noise, power = state
        if tick == 0.0:
            return begin(state, coefficients, measurement)
        dt, design, _, period, _, _, _, _ = coefficients
        x += dt * v
        innovation = wrap(measurement - x, period)
        root = design.scale  # sqrt(L)
        left, slope = implicit_step(innovation, dt, design.c1 * root, design.c2 * root * root)
        return moved(
            (x, v, 0.0, 0.0),
            (innovation - left, dt * slope, 0.0, 0.0),
            innovation,
            (total, tick, noise, power),
            coefficients,
        )

    return correct


def estimate_velocity(state: tuple) -> tuple[float, float, float]:
    """Return position [rad] and velocity [rad/s]; order 1 gives no acceleration."""
    x, v, _, _, _, _, _, _ = state
    return x, v, math.nan


def estimate_acceleration(state: tuple) -> tuple[float, float, float]:
    """Return position [rad], velocity [rad/s] and acceleration [rad/s^2]."""
    x, v, a, _, _, _, _, _ = state
    return x, v, a


def resume(state: tuple, measurement: float) -> tuple:
    """Return the state after a gap: the speed is kept, higher derivatives are not."""
    _, v, _, _, total, tick, noise, power = state
    return (measurement, v, 0.0, 0.0, total, tick, noise, power)


def noise_gains(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Return the noise gains as they were computed, REFRESH samples ago at most."""
    _, _, _, _, _, _, noise, _ = state
    return noise


def make_pace(order: int) -> Callable[[tuple, tuple, float], float]:
    """Return `AngleCore.pace`: the error dynamics are the slower, the larger the innovation is."""
    exponent = 0.5 / (order + 1.0)

    def pace(state: tuple, coefficients: tuple, dt: float) -> float:
        _, _, _, _, total, _, _, power = state
        _, design, _, _, _, _, _, _ = coefficients
        power = total if total > power else power  # that of a transient, from its begin
        if power < SMALLEST:
            power = SMALLEST
        # one neper per sample: dead beat is no faster
        return min(PACE * design.scale / power**exponent, 1.0 / dt)

    return pace


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions at these gains.

    Raises
    ------
    UsageError : the implicit form with another order than 1 (naive ones bias or chatter).
    """
    order = gains.order
    if gains.form == 'implicit' and order != 1:
        raise UsageError(
            "form 'implicit' exists for order 1 only (of higher order it would bias "
            "or chatter): use 'matching'"
        )
    correct = correction(gains.form, order)

    def design() -> Design:
        c1, c2, c3, c4 = COEFFICIENTS[order] + (0.0,) * (3 - order)
        poles = roots(order)
        table: tuple[tuple[float, ...], ...] = ((0.0,),)
        if gains.form == 'implicit':
            table = implicit_table()
        elif order == 3:
            table = noise_table(poles)
        return Design(
            float(order),
            gains.bound ** (1.0 / (order + 1)),
            c1,
            c2,
            c3,
            c4,
            poles,
            float(circle.period),
            table,
        )

    widest = OUTSIDE * circle.period if circle.period > 0.0 and gains.form in EXPLICIT else math.inf
    longest = (widest / gains.bound) ** (1.0 / (order + 1))

    def limits(dt: float) -> str | None:
        if dt <= longest:
            return None
        return (
            f"form '{gains.form}' chatters over more than an eighth of a turn at a sample time "
            f"of {dt:.3g} s: it needs less than {longest:.3g} s, or a lower bound; 'matching' "
            'does not chatter'
        )

    # Convergence from an error that one sample can hide: about the time that the bound needs to
    # make a speed of its own scale.
    settle = 3.0 * (0.01 / gains.bound) ** (1.0 / (order + 1))
    return around(
        AngleCore(
            design=design,
            settle=settle,
            prepare=prepare,
            init=init,
            correct=correct,
            estimate=estimate_velocity if order == 1 else estimate_acceleration,
            resume=resume,
            noise_gains=noise_gains,
            limits=limits,
            group_delay=lambda dt: 0.0,
            pace=make_pace(order),
        ),
        gains,
        circle,
    )


OBSERVER = Observer(
    name='super_twisting',
    summary='super-twisting differentiators of order 1 to 3',
    gains=Gains,
    build=build,
    reference='Barbot, Djemai, Manamanni (2007); Levant (2003); matching discretisation',
    gives_acceleration=lambda gains: gains.order > 1,
)
