"""Super-twisting differentiators of order 1, 2 and 3 (sliding-mode observers of an angle alone).

The continuous differentiator of order n bounds its error by L, the bound of derivative n + 1:

    z_j' = z_{j+1} + c_{j+1} L^{(j+1)/(n+1)} |e|^{(n-j)/(n+1)} sgn e,   e = y - z_0,  j = 0..n

What matters in practice is how it is sampled (`form`). Every form is written here as a prediction
over the true dt and a correction by the wrapped innovation, so that the estimate belongs to the
newest sample. The published predictor forms (correction first, then the step) are the same
filters: their gain is A times ours.

Barbot, Djemai, Manamanni (2007), equations (5) and (14), stand on order 1.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle import AngleCore, AngleGains, around
from estimator_pkg.observers.circle import Circle, wrap
from estimator_pkg.observers.contract import Functions, Observer
from estimator_pkg.observers.steady_noise import steady_variances
from estimator_pkg.observers.tracking import noise_of_three, noise_of_two
from estimator_pkg.parameters import parameter

# c_1 .. c_{n+1} for a bound of 1; larger ones converge faster and are noisier.
COEFFICIENTS = {1: (1.5, 1.1), 2: (2.0, 2.12, 1.1), 3: (3.0, 4.16, 3.06, 1.1)}

SMALLEST = 1e-150   # innovations below this are zero: no power of them overflows
TABLE = 48          # points of the noise table
TABLE_FROM = -3.0   # log10 of the smallest speed of the error dynamics in it
TABLE_STEP = 0.1


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `super_twisting`."""

    order: int = parameter(
        2, unit='', range=(1, 3), structural=True,
        description='1: velocity, from a bound of acceleration; 2: and acceleration, from a bound '
                    'of jerk; 3: from a bound of snap')
    bound: float = parameter(
        5000.0, unit='rad/s^(order+1)', range=(1e-6, 1e15), search=(1.0, 1e7),
        description='largest acceleration (order 1), jerk (2) or snap (3) of the motion; too small '
                    'fails hard, too large costs about its square root in noise',
        equation='L in lambda_j = c_j L^(j/(n+1))')
    form: str = parameter(
        'matching', unit='', choices=('matching', 'implicit', 'taylor', 'explicit'),
        structural=True,
        description='sampling: matching (eigenvalues matched to dt), implicit (order 1 only), '
                    'taylor (explicit with Taylor terms), explicit (Euler; chatters by dt times '
                    'the gain, kept to show why not)')


def taylor(state: tuple, dt: float) -> tuple[float, float, float, float]:
    """Position and its derivatives dt later, the highest one constant."""
    x, v, a, j = state[0], state[1], state[2], state[3]
    return (x + dt * (v + dt * (0.5 * a + dt * (j / 6.0))), v + dt * (a + 0.5 * dt * j),
            a + dt * j, j)


def euler(state: tuple, dt: float) -> tuple[float, float, float, float]:
    """The same by forward Euler: every state moves with the next one only."""
    x, v, a, j = state[0], state[1], state[2], state[3]
    return (x + dt * v, v + dt * a, a + dt * j, j)


def moved_back(k: tuple, dt: float, is_euler: float) -> tuple[float, float, float, float]:
    """The correction that a predictor's gain times innovation `k` is before the step: A^-1 k."""
    if is_euler > 0.0:
        j = k[3]
        a = k[2] - dt * j
        v = k[1] - dt * a
        return (k[0] - dt * v, v, a, j)
    return taylor(k, -dt)


def power_terms(innovation: float, design: tuple, dt: float) -> tuple[float, float, float, float]:
    """dt times the right-hand sides of the differentiator (explicit forms)."""
    size = abs(innovation)
    if size < SMALLEST:
        return (0.0, 0.0, 0.0, 0.0)
    order, root, c1, c2, c3, c4 = design[0], design[1], design[2], design[3], design[4], design[5]
    signed = dt * size if innovation > 0.0 else -dt * size
    pace = root / size ** (1.0 / (order + 1.0))  # (L/|e|)^(1/(n+1)) [1/s]
    fast = pace * signed
    second = c2 * pace * fast
    third = c3 * pace * pace * fast
    return (c1 * fast, second, third, c4 * pace * pace * pace * fast)


def matched_1(s: float, design: tuple) -> tuple[float, float, float, float]:
    """Gains (of position, velocity dt, acceleration dt^2, jerk dt^3) of order 1; see `_matching`.

    s : dt times the speed (L/|e|)^(1/2) of the error dynamics.
    """
    total, product = pair(s, design[7], design[8])
    return total - product, product, 0.0, 0.0


def matched_2(s: float, design: tuple) -> tuple[float, float, float, float]:
    """The same of order 2."""
    total, product = pair(s, design[7], design[8])
    d = 1.0 - math.exp(design[6] * s)
    e2, e3 = product + total * d, product * d
    return total + d - e2 + e3, e2 - 1.5 * e3, e3, 0.0


def matched_3(s: float, design: tuple) -> tuple[float, float, float, float]:
    """The same of order 3."""
    total, product = pair(s, design[7], design[8])
    total_2, product_2 = pair(s, design[9], design[10])
    e2, e3 = product + product_2 + total * total_2, total * product_2 + total_2 * product
    e4 = product * product_2
    return (total + total_2 - e2 + e3 - e4, e2 - 1.5 * e3 + 11.0 / 6.0 * e4, e3 - 2.0 * e4, e4)


def pair(s: float, real: float, imaginary: float) -> tuple[float, float]:
    """Sum and product of 1 - z for the eigenvalues z = exp(s (real +- i imaginary))."""
    radius = math.exp(real * s)
    kept = 2.0 * radius * math.cos(imaginary * s)
    return 2.0 - kept, 1.0 - kept + radius * radius


MATCHED = {1: matched_1, 2: matched_2, 3: matched_3}


def prepare(design: tuple, dt: float) -> tuple:
    """(dt, design, powers of 1/dt, dt times the speed of the error dynamics at |e| = 1 rad).

    The gains depend on the innovation, so no more can be made beforehand.
    """
    rate = 1.0 / dt
    return (dt, design, rate, rate * rate, rate * rate * rate, dt * design[1])


def init(measurement: float, design: tuple) -> tuple:
    """(position, velocity, acceleration, jerk, mean square innovation, started)."""
    return (measurement, 0.0, 0.0, 0.0, 0.0, 0.0)


def begin(state: tuple, coefficients: tuple, measurement: float) -> tuple:
    """The second sample gives the speed: a cold start at any speed below half a turn a sample."""
    dt, design = coefficients[0], coefficients[1]
    change = wrap(measurement - state[0], design[11])
    return (measurement, change / dt, 0.0, 0.0, 0.0, 1.0), 0.0


def moved(state: tuple, k: tuple, innovation: float, design: tuple) -> tuple:
    """The predicted state plus the correction; the position is kept on the circle."""
    power = state[4] + 0.02 * (innovation * innovation - state[4])
    return (wrap(state[0] + k[0], design[11]), state[1] + k[1], state[2] + k[2], state[3] + k[3],
            power, 1.0), innovation


def _matching(order: int) -> Callable[..., tuple]:
    """One sample further, with eigenvalues exp(dt (L/|e|)^(1/(n+1)) p_i) of the error.

    p_i are the roots of the coefficients. With d_i = 1 - eigenvalue and E_j their elementary
    symmetric sums, the gains are those of a Taylor chain with these eigenvalues.
    """
    matched, root = MATCHED[order], 1.0 / (order + 1.0)

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple:
        x, v, a, j, power, started = state
        if started == 0.0:
            return begin(state, coefficients, measurement)
        dt, design, rate, rate_2, rate_3, pace = coefficients
        period = design[11]
        x += dt * (v + dt * (0.5 * a + dt * j / 6.0))
        v += dt * (a + 0.5 * dt * j)
        a += dt * j
        innovation = measurement - x
        if not -period <= innovation + innovation < period:
            innovation = wrap(innovation, period)
        size = abs(innovation)
        if size > SMALLEST:
            k0, k1, k2, k3 = matched(pace / size ** root, design)
            x += k0 * innovation
            v += k1 * innovation * rate
            a += k2 * innovation * rate_2
            j += k3 * innovation * rate_3
        if not -period <= x + x < period:
            x = wrap(x, period)
        return (x, v, a, j, power + 0.02 * (innovation * innovation - power), 1.0), innovation

    return correct


CORRECT_MATCHING = {order: _matching(order) for order in MATCHED}


def correct_taylor(state: tuple, coefficients: tuple, measurement: float) -> tuple:
    """One sample further, explicit with Taylor terms."""
    if state[5] == 0.0:
        return begin(state, coefficients, measurement)
    dt, design = coefficients[0], coefficients[1]
    x, v, a, j = taylor(state, dt)
    innovation = wrap(measurement - x, design[11])
    k = moved_back(power_terms(innovation, design, dt), dt, 0.0)
    return moved((x, v, a, j, state[4]), k, innovation, design)


def correct_explicit(state: tuple, coefficients: tuple, measurement: float) -> tuple:
    """One sample further, forward Euler as printed in textbooks."""
    if state[5] == 0.0:
        return begin(state, coefficients, measurement)
    dt, design = coefficients[0], coefficients[1]
    x, v, a, j = euler(state, dt)
    innovation = wrap(measurement - x, design[11])
    k = moved_back(power_terms(innovation, design, dt), dt, 1.0)
    return moved((x, v, a, j, state[4]), k, innovation, design)


def correct_implicit(state: tuple, coefficients: tuple, measurement: float) -> tuple:
    """One sample further by the implicit Euler form of order 1, in closed form.

    In sliding (|e| <= dt^2 alpha) it is the backward difference; outside it the change of the
    velocity is clipped to dt alpha. It cannot chatter.
    """
    if state[5] == 0.0:
        return begin(state, coefficients, measurement)
    dt, design = coefficients[0], coefficients[1]
    x = state[0] + dt * state[1]
    innovation = wrap(measurement - x, design[11])
    root = design[1]  # sqrt(L)
    gain, step = design[2] * root, dt * dt * design[3] * root * root
    size = abs(innovation)
    if size <= step:
        k0, k1 = innovation, innovation / dt
    else:
        q = 0.5 * (math.sqrt(dt * dt * gain * gain + 4.0 * (size - step)) - dt * gain)
        sign = 1.0 if innovation > 0.0 else -1.0
        k0, k1 = innovation - sign * q * q, sign * step / dt
    return moved((x, state[1], 0.0, 0.0, state[4]), (k0, k1, 0.0, 0.0), innovation, design)


def estimate_velocity(state: tuple) -> tuple[float, float, float]:
    """Position and velocity; order 1 gives no acceleration."""
    return state[0], state[1], math.nan


def estimate_acceleration(state: tuple) -> tuple[float, float, float]:
    """Position, velocity and acceleration."""
    return state[0], state[1], state[2]


def resume(state: tuple, measurement: float) -> tuple:
    """After a gap the speed is kept, higher derivatives are not."""
    return (measurement, state[1], 0.0, 0.0, state[4], state[5])


def equivalent(state: tuple, coefficients: tuple) -> float:
    """dt times the speed of the error dynamics at innovations of the rms size.

    For one size of innovation the observer is linear; what noise makes of it is taken from there.
    """
    power = state[4] if state[4] > SMALLEST else SMALLEST
    return coefficients[5] / power ** (0.5 / (coefficients[1][0] + 1.0))


def noise_gains_1(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """Variances of position, velocity and innovation per unit variance of white noise."""
    k0, k1, k2, k3 = matched_1(equivalent(state, coefficients), coefficients[1])
    return noise_of_two(k0, k1, coefficients[0])


def noise_gains_2(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """The same of order 2."""
    k0, k1, k2, k3 = matched_2(equivalent(state, coefficients), coefficients[1])
    return noise_of_three(k0, k1, k2, coefficients[0])


def noise_gains_3(state: tuple, coefficients: tuple) -> tuple[float, float, float]:
    """The same of order 3, which has no short closed form, from a table."""
    at = (math.log10(equivalent(state, coefficients)) - TABLE_FROM) / TABLE_STEP
    if at < 0.0:
        at = 0.0
    elif at > TABLE - 1.001:
        at = TABLE - 1.001
    i = int(at)
    part = at - i
    here, next_one = coefficients[1][12][i], coefficients[1][12][i + 1]
    return (math.exp(here[0] + part * (next_one[0] - here[0])),
            math.exp(here[1] + part * (next_one[1] - here[1])) * coefficients[3],
            math.exp(here[2] + part * (next_one[2] - here[2])))


NOISE_GAINS = {1: noise_gains_1, 2: noise_gains_2, 3: noise_gains_3}


def _roots(order: int) -> tuple[float, float, float, float, float]:
    """Roots of p^m + c_1 p^(m-1) + ...: the real one (order 2), then one or two complex pairs."""
    roots = np.roots((1.0, *COEFFICIENTS[order]))
    pairs = [complex(root) for root in sorted(roots, key=cmath.phase) if root.imag > 1e-9]
    reals = [float(root.real) for root in roots if abs(root.imag) <= 1e-9]
    real = reals[0] if reals else 0.0
    second = pairs[1] if len(pairs) > 1 else 0j
    return real, pairs[0].real, pairs[0].imag, second.real, second.imag


def _noise_table(design: tuple) -> tuple[tuple[float, ...], ...]:
    """Logarithms of the noise gains of order 3 at dt = 1 over the speed of the error dynamics."""
    chain = np.array([[1.0 / math.factorial(j - i) if j >= i else 0.0 for j in range(4)]
                      for i in range(4)])
    return tuple(tuple(math.log(gain) for gain in steady_variances(
        chain, np.array(matched_3(10.0 ** (TABLE_FROM + TABLE_STEP * point), design))))
        for point in range(TABLE))


def correction(form: str, order: int) -> Callable[..., tuple]:
    """The function of the core that takes one sample in."""
    if form == 'matching':
        return CORRECT_MATCHING[order]
    return {'implicit': correct_implicit, 'taylor': correct_taylor,
            'explicit': correct_explicit}[form]


def build(gains: Gains, circle: Circle) -> Functions:
    """The functions at these gains.

    Raises
    ------
    UsageError : the implicit form with another order than 1 (naive ones bias or chatter).
    """
    order = gains.order
    if gains.form == 'implicit' and order != 1:
        raise UsageError("form 'implicit' exists for order 1 only (of higher order it would bias "
                         "or chatter): use 'matching'")
    correct = correction(gains.form, order)

    def design() -> tuple:
        coefficients = COEFFICIENTS[order] + (0.0,) * (3 - order)
        numbers = (float(order), gains.bound ** (1.0 / (order + 1)), *coefficients, *_roots(order),
                   float(circle.period))
        return (*numbers, _noise_table(numbers) if order == 3 else ((0.0,),))

    # Convergence from an error that one sample can hide: about the time that the bound needs to
    # make a speed of its own scale.
    settle = 3.0 * (0.01 / gains.bound) ** (1.0 / (order + 1))
    return around(AngleCore(
        design=design, settle=settle, prepare=prepare, init=init, correct=correct,
        estimate=estimate_velocity if order == 1 else estimate_acceleration, resume=resume,
        noise_gains=NOISE_GAINS[order], limits=lambda dt: None, group_delay=lambda dt: 0.0),
        gains, circle)


OBSERVER = Observer(
    name='super_twisting', summary='super-twisting differentiators of order 1 to 3',
    gains=Gains, build=build,
    reference='Barbot, Djemai, Manamanni (2007); Levant (2003); matching discretisation',
    gives_acceleration=lambda gains: gains.order > 1)
