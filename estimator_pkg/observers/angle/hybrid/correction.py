# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

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
  the next samples fit again it was an outlier; if they do not, a new start is made from them. Where
  a turn has so few counts that the next one is further, `quantum` says so: 1.5 of them then.

State and coefficients are those of `robust`. The innovation is the error that the last correction
left plus the motion that was not predicted.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.angle.hybrid.injections import Injection
from estimator_pkg.observers.circle import FURTHER, wrap

DOUBTFUL = 0.125  # of a turn: a larger innovation is doubtful, unless a turn has few counts
# Doubtful samples do not correct the speed for HOLD [s] and HOLD_SAMPLES samples; then comes a new
# start.
HOLD = 0.02
HOLD_SAMPLES = 3

Correct = Callable[[tuple, tuple, float], tuple[tuple, float]]


def doubtful(quantum: float, period: float) -> float:
    """Return the innovation [rad] beyond which one is doubtful; inf where there is no circle.

    Parameters
    ----------
    quantum : as the user gave it [rad]; 0: not known.
    """
    return max(DOUBTFUL * period, FURTHER * quantum) if period > 0.0 else math.inf


def clamped(velocity: float, fastest: float) -> float:
    """Return `velocity` clamped to +-fastest [rad/s]."""
    if velocity > fastest:
        return fastest
    if velocity < -fastest:
        return -fastest
    return velocity


def make_correct_2(injection: Injection, linear: bool, period: float) -> Correct:
    """Return `correct` of the second order.

    Parameters
    ----------
    linear : the injection is the wrapped error itself (saw).
    period : of the circle [rad]; 0: none.
    """

    def start(
        state: tuple, coefficients: tuple, measurement: float, innovation: float
    ) -> tuple[tuple, float]:
        """Return the state one sample further: expanding memory of a straight line."""
        last, _, velocity, phase = state
        alpha, beta, dt, _, doubtful, _, fastest = coefficients
        if phase > 1.0 and not -doubtful <= innovation <= doubtful:
            velocity = wrap(measurement - last, period) / dt
            return (measurement, 0.0, clamped(velocity, fastest), 2.0), innovation
        phase += 1.0
        rate = 6.0 / (phase * (phase + 1.0) * dt)
        if rate < beta:
            phase = 0.0
        else:
            alpha, beta = (4.0 * phase - 2.0) / (phase * (phase + 1.0)), rate
        velocity = clamped(velocity + beta * innovation, fastest)
        if phase == 2.0:
            # the speed was not known: no innovation
            return (measurement, 0.0, velocity, phase), 0.0
        return (measurement, innovation - alpha * innovation, velocity, phase), innovation

    def hold(
        state: tuple, coefficients: tuple, measurement: float, unpredicted: float, innovation: float
    ) -> tuple[tuple, float]:
        """Return the state after an outlier, or the sample after one: the speed is held."""
        last, _, velocity, phase = state
        _, _, dt, _, doubtful, _, fastest = coefficients
        innovation = wrap(innovation, period)
        if -doubtful <= innovation <= doubtful and -doubtful <= unpredicted <= doubtful:
            return (measurement, innovation, velocity, 0.0), innovation
        phase -= 1.0
        if -phase > HOLD_SAMPLES and -phase * dt > HOLD:
            velocity = clamped(wrap(measurement - last, period) / dt, fastest)
            return (measurement, 0.0, velocity, 2.0), math.inf
        return (measurement, innovation, velocity, phase), innovation

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
        last, error, velocity, phase = state
        alpha, beta, dt, reset_from, doubtful, saturation, fastest = coefficients
        unpredicted = measurement - last - velocity * dt
        strange = False
        if not -doubtful <= unpredicted <= doubtful:
            unpredicted = wrap(unpredicted, period)
            strange = not -doubtful <= unpredicted <= doubtful
        innovation = error + unpredicted
        if strange or phase != 0.0:
            if phase > 0.0:
                return start(state, coefficients, measurement, innovation)
            return hold(state, coefficients, measurement, unpredicted, innovation)
        if not -reset_from < innovation < reset_from:
            return (measurement, 0.0, velocity, 0.0), innovation
        injected = innovation
        if not linear:
            injected = injection(innovation, period, saturation)
            if abs(injected) * alpha > abs(innovation):
                injected = innovation / alpha
        velocity += beta * injected
        if not -fastest <= velocity <= fastest:
            velocity = clamped(velocity, fastest)
        return (measurement, innovation - alpha * injected, velocity, 0.0), innovation

    return correct


def make_correct_3(injection: Injection, linear: bool, period: float) -> Correct:
    """Return `correct` of the third order; parameters as for `make_correct_2`."""

    def start(
        state: tuple, coefficients: tuple, measurement: float, innovation: float
    ) -> tuple[tuple, float]:
        """Return the same: a straight line through two samples, then a parabola."""
        last, _, velocity, acceleration, phase = state
        alpha, beta, gamma, dt, _, doubtful, _, fastest, _ = coefficients
        if phase < 2.0:
            velocity = clamped(velocity + innovation / dt, fastest)
            return (measurement, 0.0, velocity, 0.0, 2.0), 0.0  # speed not known: no innovation
        if not -doubtful <= innovation <= doubtful:
            velocity = clamped(wrap(measurement - last, period) / dt, fastest)
            return (measurement, 0.0, velocity, 0.0, 2.0), innovation
        phase += 1.0
        part = 1.0 / (phase * (phase + 1.0) * (phase + 2.0))
        slope = 60.0 * part / (dt * dt)
        if slope < gamma:
            phase = 0.0
        else:
            alpha = (9.0 * phase * (phase - 1.0) + 6.0) * part
            beta = (36.0 * phase - 18.0) * part / dt
            gamma = slope
        velocity = clamped(velocity + acceleration * dt + beta * innovation, fastest)
        return (
            (
                measurement,
                innovation - alpha * innovation,
                velocity,
                acceleration + gamma * innovation,
                phase,
            ),
            innovation,
        )

    def hold(
        state: tuple, coefficients: tuple, measurement: float, unpredicted: float, innovation: float
    ) -> tuple[tuple, float]:
        """Return the state after an outlier, or the sample after one: the speed is held."""
        last, _, velocity, acceleration, phase = state
        _, _, _, dt, _, doubtful, _, fastest, _ = coefficients
        innovation = wrap(innovation, period)
        velocity = clamped(velocity + acceleration * dt, fastest)
        if -doubtful <= innovation <= doubtful and -doubtful <= unpredicted <= doubtful:
            return (measurement, innovation, velocity, acceleration, 0.0), innovation
        phase -= 1.0
        if -phase > HOLD_SAMPLES and -phase * dt > HOLD:
            velocity = clamped(wrap(measurement - last, period) / dt, fastest)
            return (measurement, 0.0, velocity, 0.0, 2.0), math.inf
        return (measurement, innovation, velocity, 0.0, phase), innovation

    def correct(state: tuple, coefficients: tuple, measurement: float) -> tuple[tuple, float]:
        last, error, velocity, acceleration, phase = state
        alpha, beta, gamma, dt, reset_from, doubtful, saturation, fastest, _ = coefficients
        gained = acceleration * dt
        unpredicted = measurement - last - (velocity + 0.5 * gained) * dt
        strange = False
        if not -doubtful <= unpredicted <= doubtful:
            unpredicted = wrap(unpredicted, period)
            strange = not -doubtful <= unpredicted <= doubtful
        innovation = error + unpredicted
        if strange or phase != 0.0:
            if phase > 0.0:
                return start(state, coefficients, measurement, innovation)
            return hold(state, coefficients, measurement, unpredicted, innovation)
        velocity += gained
        if not -reset_from < innovation < reset_from:
            return (measurement, 0.0, clamped(velocity, fastest), acceleration, 0.0), innovation
        injected = innovation
        if not linear:
            injected = injection(innovation, period, saturation)
            if abs(injected) * alpha > abs(innovation):
                injected = innovation / alpha
        velocity += beta * injected
        acceleration += gamma * injected
        if not -fastest <= velocity <= fastest:
            velocity = clamped(velocity, fastest)
            acceleration = 0.0
        return (measurement, innovation - alpha * injected, velocity, acceleration, 0.0), innovation

    return correct
