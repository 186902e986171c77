# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A start: the time after a shaft at rest began to move, or after a gap.

The core still carries the old speed, so it errs by more than noise explains until its errors have
decayed. `deviation` is what this adds to the standard deviation of the speed; docs/coverage.md
derives it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from estimator_pkg.observers.circle import wrap

RECENT = 32.0  # samples over which a rest is averaged, and the power of recent innovations
RESTED = 0.12  # [s] within the noise of one angle: the shaft rests, and may start
LASTS = 0.25  # [s] that a start lasts at least, ...
DECAYED = 10.0  # ... and nepers by which the errors of the core must have decayed
PACE = 0.8  # of the cube root of (velocity noise gain)/dt: the pace of a tracking loop
TAIL = 1.18  # of these nepers, where the polynomial before the exponential is generous
LEARNT = 6.0  # nepers after which innovations of a start show the noise again
BEGUN = 0.75  # sample times by which motion may have begun after the last reading at rest
FIRST = 0.95  # the same at the first reading, which shows no speed at all
BAND = 10.0  # (3.2)^2: times the power of the innovations; a larger distance is no rest
LARGEST_GAIN = 8.0  # of innovations over readings, in noise power, but for a few first samples
SHOWN = 12.0  # samples at least without a larger distance, after which a rest has shown its noise
SLOW = 4.0  # (2)^2: times the variance of the speed's noise; a faster joint is not at rest
FIVE = 25.0  # (5)^2: five standard deviations cover an error
FURTHER = 1.001  # times the largest distance within a rest: a reading beyond it ends the rest

# (clock [s], anchor [rad], reach [rad], decay, travelled [rad], kept [rad/s])
#
# clock: the time since the motion began while a start is in force, 0 in motion, and below 0 while
# the readings stay within the noise of one angle: minus the time at rest until the last change.
# anchor: angle of the rest before. reach: largest distance from it within the rest. decay: nepers
# by which the errors of the core decayed. travelled: angle since then; at rest the mean square of
# the changes of the reading [rad^2]. kept: speed that was kept across a gap.
Start = tuple[float, float, float, float, float, float]

NoiseGains = Callable[[tuple, tuple], tuple[float, float, float]]
Pace = Callable[[tuple, tuple, float], float]


class StartFunctions(NamedTuple):
    """Functions of the start of one observer.

    at_rest : (start, measurement, moved, since, power, coefficients, inner) -> start, after a
        reading that `moved` [rad], unchanged for `since` [s] before, while no start is in force.
    in_force : (start, moved, since, power, coefficients, inner) -> start, while one is in force.
    deviation : (start, speed, dt, quantum) -> standard deviation of the speed that a start adds
        [rad/s].

    `power` is the recent one of the innovations [rad^2], `inner` the state of the core,
    `coefficients` is (those of the core, dt [s]).
    """

    at_rest: Callable[..., Start]
    in_force: Callable[..., Start]
    deviation: Callable[[Start, float, float, float], float]


def first_start(measurement: float) -> Start:
    """Return the start of a shaft at rest at its first sample [rad]."""
    return (-RESTED, measurement, 0.0, 0.0, 0.0, 0.0)


def linear_pace(noise_gains: NoiseGains) -> Pace:
    """Return the function that gives how fast the errors of a tracking loop decay [1/s].

    It follows from what the loop makes of noise. A loop whose poles are all at w lets through a
    velocity variance of 1/4 (order 2) to 7/4 (order 3) of w^3 dt per unit variance of white noise.
    """

    def pace(inner: tuple, coefficients: tuple, dt: float) -> float:
        _, of_velocity, _ = noise_gains(inner, coefficients)
        return PACE * (of_velocity / dt) ** (1.0 / 3.0)

    return pace


def make_start(
    estimate: Callable[[tuple], tuple[float, float, float]],
    noise_gains: NoiseGains,
    pace: Pace,
    lag: float,
    period: float,
) -> StartFunctions:
    """Return the functions of the start of one core.

    Parameters
    ----------
    estimate, noise_gains, pace, lag : of the core; see `AngleCore`.
    period : wrap period [rad]; 0: none.
    """
    return StartFunctions(
        _make_at_rest(noise_gains, period),
        _make_in_force(estimate, noise_gains, pace),
        _make_deviation(lag),
    )


def _make_at_rest(noise_gains: NoiseGains, period: float) -> Callable[..., Start]:
    half = 0.5 * period if period > 0.0 else math.inf

    def at_rest(
        start: Start,
        measurement: float,
        moved: float,
        since: float,
        power: float,
        coefficients: tuple,
        inner: tuple,
    ) -> Start:
        clock, anchor, reach, _, changes, _ = start
        of_core, dt = coefficients
        if clock == 0.0:
            anchor, reach, changes = measurement - moved, abs(moved), 0.0
        distance = measurement - anchor
        if not -half <= distance < half:
            distance = wrap(distance, period)
        square, band, rested = distance * distance, BAND * power, since - clock
        changes += (moved * moved - changes) / (RECENT if changes > 0.0 else 1.0)
        beyond = abs(distance) > FURTHER * reach
        reach = max(reach, abs(distance))
        if rested < RESTED or rested < SHOWN * dt:
            # white noise of variance R changes by 2 R; innovations may be those of a lag
            if square > band or square > BAND * 0.5 * changes:
                return (0.0, measurement, 0.0, 0.0, 0.0, 0.0)
            if beyond:
                rested = 0.0
        elif beyond:
            return (dt, anchor, reach, 0.0, distance, 0.0)
        # of noise alone the innovations have more power than the readings
        elif LARGEST_GAIN * square > band:
            _, _, of_innovation = noise_gains(inner, of_core)
            if square * of_innovation > band:
                return (dt, anchor, reach, 0.0, distance, 0.0)
        return (-rested - dt, anchor + distance / RECENT, reach, 0.0, changes, 0.0)

    return at_rest


def _make_in_force(
    estimate: Callable[[tuple], tuple[float, float, float]], noise_gains: NoiseGains, pace: Pace
) -> Callable[..., Start]:
    def in_force(
        start: Start, moved: float, since: float, power: float, coefficients: tuple, inner: tuple
    ) -> Start:
        """Return the start, over when it is old and its errors have decayed, when the shaft rests
        again, and when it only swayed. While the reading is back in the noise of the rest, though
        the speed is not, the motion may begin at any time.
        """
        clock, anchor, reach, decay, before, kept = start
        of_core, dt = coefficients
        travelled = before + moved
        if kept == 0.0:
            within = math.sqrt(BAND * power)
            if abs(travelled) <= within:  # back where it was ...
                _, speed, _ = estimate(inner)
                _, of_velocity, of_innovation = noise_gains(inner, of_core)
                if moved == 0.0 or speed * speed * of_innovation <= SLOW * power * of_velocity:
                    return (-RESTED, anchor, reach, 0.0, 0.0, 0.0)
                if decay < 1.0:
                    decay += pace(inner, of_core, dt) * dt
                    return (2.0 * dt, anchor, reach, decay, travelled, 0.0)
            elif abs(before) <= within and decay < 1.0:
                return (dt, anchor, reach, 0.0, travelled, 0.0)
        if moved == 0.0 and since >= RESTED and decay >= LEARNT:
            return (0.0, anchor, 0.0, 0.0, 0.0, 0.0)
        clock += dt
        decay += pace(inner, of_core, dt) * dt
        if clock >= LASTS and decay >= DECAYED:
            return (0.0, anchor, 0.0, 0.0, 0.0, 0.0)
        return (clock, anchor, reach, decay, travelled, kept)

    return in_force


def _make_deviation(lag: float) -> Callable[[Start, float, float, float], float]:
    bent = 2.0 * lag

    def deviation(start: Start, speed: float, dt: float, quantum: float) -> float:
        clock, _, _, decay, travelled, kept = start
        mean = travelled / (clock - (BEGUN if clock > dt else FIRST) * dt)
        scale = 2.0 * abs(mean)
        if kept > scale:
            scale = kept
        # docs/coverage.md (1): what is left of a step of the speed
        left = 0.5 * scale * (1.0 + decay * (1.0 + decay)) * math.exp(-TAIL * decay)
        # docs/coverage.md (2): what a ramp of the speed leaves
        change = abs(speed - mean)
        if decay > LEARNT:  # the first term no longer covers a motion that began earlier
            change += abs(mean) * BEGUN * dt / clock
        bend = bent * change
        if decay > 1.0:
            bend /= decay
        square = left * left + bend * bend
        # docs/coverage.md (5): a ramp through a whole number of quanta per sample
        if decay > LEARNT and quantum > 0.0:
            repeats, pace = 4.0 * quantum * change / clock, quantum * decay / clock
            if repeats < pace * pace:
                beyond = wrap(speed, quantum / dt)
                if beyond * beyond < repeats:
                    square += repeats / FIVE
        return math.sqrt(square)

    return deviation
