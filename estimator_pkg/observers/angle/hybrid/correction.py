"""The robust sampled form of the hybrid observer: its corrections, second and third order.

Against Algorithm 1 of Brentari et al. (2018):

* The innovation is continued from the error that the last correction left: it may pass pi, where
  the wrapped one would fold over and could hold a false speed for ever.
* The reset (J2) comes before the injection, and the injection never moves the position past the
  measurement (that tames tan).
* The start is an expanding memory: least squares over the samples so far, until its gains have come
  down to the steady ones. The speed is right from the second sample on.
* A sample that is off by more than an eighth of a turn, at once, is not injected: one kick could
  carry the speed to another that fits the samples as well (v + n 2 pi/T). The speed is held. If
  the next samples fit again it was an outlier; if they do not, a new start is made from them.

State and coefficients are those of `robust`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.angle.hybrid.injections import Injection
from estimator_pkg.observers.circle import wrap

DOUBTFUL = 0.125  # part of a turn by which one sample may be off at once
HOLD = 0.02  # a speed is held against such samples for so long [s] ...
HOLD_SAMPLES = 3  # ... and for so many of them, before a new start

Correct = Callable[[tuple, tuple, float], tuple[tuple, float]]


def held(velocity: float, fastest: float) -> float:
    """`velocity` within +-fastest [rad/s]."""
    if velocity > fastest:
        return fastest
    if velocity < -fastest:
        return -fastest
    return velocity


def make_correct_2(injection: Injection, linear: bool, period: float) -> Correct:
    """`correct` of the second order.

    Parameters
    ----------
    linear : the injection is the wrapped error itself (saw).
    period : of the circle [rad]; 0: none.
    """
    doubtful = DOUBTFUL * period if period > 0.0 else math.inf

    def start(
        state: tuple, coefficients: tuple, measurement: float, error: float
    ) -> tuple[tuple, float]:
        """The expanding memory of a straight line: one sample further."""
        last, _, velocity, phase = state
        alpha, beta, dt, _, _, fastest = coefficients
        if phase > 1.0 and not -doubtful <= error <= doubtful:
            velocity = wrap(measurement - last, period) / dt
            return (measurement, 0.0, held(velocity, fastest), 2.0), error
        phase += 1.0
        rate = 6.0 / (phase * (phase + 1.0) * dt)
        if rate < beta:
            phase = 0.0
        else:
            alpha, beta = (4.0 * phase - 2.0) / (phase * (phase + 1.0)), rate
        velocity = held(velocity + beta * error, fastest)
        if phase == 2.0:
            return (measurement, 0.0, velocity, phase), 0.0  # the speed was not known: no surprise
        return (measurement, error - alpha * error, velocity, phase), error

    def hold(
        state: tuple, coefficients: tuple, measurement: float, unforeseen: float, error: float
    ) -> tuple[tuple, float]:
        """A sample far off, or one after it: the speed is held."""
        velocity, phase = state[2], state[3]
        dt, fastest = coefficients[2], coefficients[5]
        error = wrap(error, period)
        if -doubtful <= error <= doubtful and -doubtful <= unforeseen <= doubtful:
            return (measurement, error, velocity, 0.0), error
        phase -= 1.0
        if -phase > HOLD_SAMPLES and -phase * dt > HOLD:
            velocity = held(wrap(measurement - state[0], period) / dt, fastest)
            return (measurement, 0.0, velocity, 2.0), math.inf
        return (measurement, error, velocity, phase), error

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
        last, error, velocity, phase = state
        alpha, beta, dt, reach, saturation, fastest = coefficients
        unforeseen = measurement - last - velocity * dt
        strange = False
        if not -doubtful <= unforeseen <= doubtful:
            unforeseen = wrap(unforeseen, period)
            strange = not -doubtful <= unforeseen <= doubtful
        error += unforeseen
        if phase > 0.0:
            return start(state, coefficients, measurement, error)
        if strange or phase < 0.0:
            return hold(state, coefficients, measurement, unforeseen, error)
        if not -reach < error < reach:
            return (measurement, 0.0, velocity, 0.0), error
        push = error
        if not linear:
            push = injection(error, period, saturation)
            if abs(push) * alpha > abs(error):
                push = error / alpha
        velocity += beta * push
        if not -fastest <= velocity <= fastest:
            velocity = held(velocity, fastest)
        return (measurement, error - alpha * push, velocity, 0.0), error

    return correct


def make_correct_3(injection: Injection, linear: bool, period: float) -> Correct:
    """`correct` of the third order; parameters as for `make_correct_2`."""
    doubtful = DOUBTFUL * period if period > 0.0 else math.inf

    def start(
        state: tuple, coefficients: tuple, measurement: float, error: float
    ) -> tuple[tuple, float]:
        """The expanding memory: a straight line through two samples, then a parabola."""
        last, _, velocity, acceleration, phase = state
        alpha, beta, gamma, dt, _, _, fastest, _ = coefficients
        if phase < 2.0:
            velocity = held(velocity + error / dt, fastest)
            return (measurement, 0.0, velocity, 0.0, 2.0), 0.0  # speed not known: no surprise
        if not -doubtful <= error <= doubtful:
            velocity = held(wrap(measurement - last, period) / dt, fastest)
            return (measurement, 0.0, velocity, 0.0, 2.0), error
        phase += 1.0
        part = 1.0 / (phase * (phase + 1.0) * (phase + 2.0))
        slope = 60.0 * part / (dt * dt)
        if slope < gamma:
            phase = 0.0
        else:
            alpha = (9.0 * phase * (phase - 1.0) + 6.0) * part
            beta = (36.0 * phase - 18.0) * part / dt
            gamma = slope
        velocity = held(velocity + acceleration * dt + beta * error, fastest)
        return (
            (measurement, error - alpha * error, velocity, acceleration + gamma * error, phase),
            error,
        )

    def hold(
        state: tuple, coefficients: tuple, measurement: float, unforeseen: float, error: float
    ) -> tuple[tuple, float]:
        """A sample far off, or one after it: the speed is held."""
        velocity, acceleration, phase = state[2], state[3], state[4]
        dt, fastest = coefficients[3], coefficients[6]
        error = wrap(error, period)
        velocity = held(velocity + acceleration * dt, fastest)
        if -doubtful <= error <= doubtful and -doubtful <= unforeseen <= doubtful:
            return (measurement, error, velocity, acceleration, 0.0), error
        phase -= 1.0
        if -phase > HOLD_SAMPLES and -phase * dt > HOLD:
            velocity = held(wrap(measurement - state[0], period) / dt, fastest)
            return (measurement, 0.0, velocity, 0.0, 2.0), math.inf
        return (measurement, error, velocity, 0.0, phase), error

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
        last, error, velocity, acceleration, phase = state
        alpha, beta, gamma, dt, reach, saturation, fastest, _ = coefficients
        gained = acceleration * dt
        unforeseen = measurement - last - (velocity + 0.5 * gained) * dt
        strange = False
        if not -doubtful <= unforeseen <= doubtful:
            unforeseen = wrap(unforeseen, period)
            strange = not -doubtful <= unforeseen <= doubtful
        error += unforeseen
        if phase > 0.0:
            return start(state, coefficients, measurement, error)
        if strange or phase < 0.0:
            return hold(state, coefficients, measurement, unforeseen, error)
        velocity += gained
        if not -reach < error < reach:
            return (measurement, 0.0, held(velocity, fastest), acceleration, 0.0), error
        push = error
        if not linear:
            push = injection(error, period, saturation)
            if abs(push) * alpha > abs(error):
                push = error / alpha
        velocity += beta * push
        acceleration += gamma * push
        if not -fastest <= velocity <= fastest:
            velocity = held(velocity, fastest)
            acceleration = 0.0
        return (measurement, error - alpha * push, velocity, acceleration, 0.0), error

    return correct
