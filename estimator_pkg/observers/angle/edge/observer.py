# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The edge-aware adaptive observer: a Kalman filter of an angle for which nothing need be tuned.

    a' = -a/T + w,  v' = a,  x' = v,       w white jerk of a density that is found on line

What differs from a Kalman filter (`covariance`) is what it makes of a reading (`interval`: a count
is an interval, an edge is a time; `update`), its process noise (`bandwidth`), that it learns its
sensor (`quantum`, `sensor`) and its stamps (`clock`), and how it starts (`start`). The one thing a
user says is the quantum, and even that is checked. The derivation is in
docs/observers/edge_adaptive_theory.md, whose headings are those of `step`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.estimate import COASTING, INITIALISING, TRACKING, Estimate
from estimator_pkg.observers.angle.edge import bandwidth, covariance, preference, sigma
from estimator_pkg.observers.angle.edge import start as starts
from estimator_pkg.observers.angle.edge.bandwidth import ProcessNoise, VelocityRandomWalk
from estimator_pkg.observers.angle.edge.constants import (
    CONFIRMED,
    NOISE_SAMPLES,
    NOISY_ABOVE,
    RATIO,
    REPEATS,
    RESTED_PART,
)
from estimator_pkg.observers.angle.edge.covariance import Coefficients, Motion
from estimator_pkg.observers.angle.edge.doubt import Tracking, coast, confirm, decide, is_spoilt
from estimator_pkg.observers.angle.edge.start import StartUncertainty
from estimator_pkg.observers.angle.edge.update import update
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.parameters import parameter
from estimator_pkg.record import record
from estimator_pkg.sensor import noise as sensing
from estimator_pkg.sensor import quantum as counts
from estimator_pkg.sensor import sampling
from estimator_pkg.sensor.convention import Convention, begin_convention, follow_convention, present

HASTY = 4.0  # first sample times: where the second is longer, the stamps of the first were wrong


@dataclass(frozen=True)
class Gains:
    """Parameters of `edge_adaptive`."""

    quantum: float = parameter(
        0.0,
        unit='rad',
        range=(0.0, 10.0),
        structural=False,
        description='smallest step of the measurement (2 pi / counts); 0: found from the smallest '
        'step seen',
    )
    prefer: str = parameter(
        'balanced',
        unit='',
        choices=('smooth', 'balanced', 'fast'),
        among=('smooth', 'balanced', 'fast'),
        description='smooth: half the variance at about twice the delay; fast: half the delay at '
        'about twice the variance',
        equation='density of the jerk: an eighth, once or eight times the one that is found',
    )


@record
class Design:
    """What the gains imply whatever the sample time is."""

    period: float  # wrap period [rad]; 0: none
    half_turn: float  # [rad]; inf: there is no circle
    unwrap: bool  # turns are counted from the first sample
    quantum: float  # as given [rad]; 0: not known
    ratio: float  # density of the published filter, over that of the first; see `preference`
    log_ratio: float
    of_angle: float  # variance of the published angle, over that of the first filter
    of_speed: float  # the same of the speed


@record
class Reading:
    """One reading, as the parts of a step pass it on."""

    angle: float  # [rad]
    change: float  # since the reading before [rad]
    passed: float  # time since the last reading that was used [s]
    repeat_duration: float  # for which the readings before it repeated [s]
    first: bool  # nothing has moved before
    starting: bool  # the speed is in doubt
    start_velocity_variance: float  # before this reading [(rad/s)^2]
    noise_known: bool  # the first motion is long ago
    evidence: float  # that the sensor has another clock, before this reading
    rested: float  # time for which the reading had not changed [s]
    previous_change: float  # of the reading before [rad]
    predicted_motion: float  # in this sample [rad]
    unpredicted_motion: float  # change of the reading beyond that [rad]
    innovation: float  # distance from the predicted angle [rad]


@record
class State:
    """What is known of the motion, the bandwidth, the sensor, its stamps and the start."""

    motion: Motion
    p: Covariance
    process_noise: ProcessNoise
    velocity_walk: VelocityRandomWalk
    sensor: sensing.Sensor
    steps: counts.Steps
    clock: sampling.Sampling
    convention: Convention
    tracking: Tracking
    uncertainty: StartUncertainty
    second: preference.SecondFilter
    reading: Reading


def design(gains: Gains, circle: Circle) -> Design:
    """Return what follows from the gains whatever the sample time is."""
    made, period = Design(), float(circle.period)
    made.period, made.unwrap = period, circle.unwrap
    made.half_turn = 0.5 * period if period > 0.0 else math.inf
    made.quantum = float(gains.quantum)
    made.ratio, made.of_angle, made.of_speed = preference.ratios(RATIO[gains.prefer])
    made.log_ratio = math.log(made.ratio)
    return made


def why(state: State, design: Design) -> str:
    """Return what a person should know of the given quantum, or ''."""
    return counts.misfit(state.steps, design.quantum)


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set what follows from dt [s]."""
    square = dt * dt
    cube = square * dt
    coefficients.dt = dt
    coefficients.half = 0.5 * square
    coefficients.q11 = cube / 3.0
    coefficients.q01 = 0.125 * cube * dt
    coefficients.q00 = 0.05 * cube * square


def start(observer: Any, state: State, design: Design, measurement: float) -> None:
    """Set the state after the first sample [rad]."""
    blank = State()
    state.take(blank)
    begin_convention(state.convention, measurement)
    counts.begin_steps(state.steps)
    reset(state, design.quantum, measurement)


def reset(state: State, quantum: float, measurement: float) -> None:
    """Reset all but the steps at this measurement [rad]; quantum [rad], 0: not known."""
    sensing.begin_sensor(state.sensor, quantum if quantum > 0.0 else counts.UNIT)
    starts.set_start_uncertainty(state.uncertainty, 0.0, starts.DURATION_ALONE, 0.0, 0.0)
    sampling.begin_sampling(state.clock)
    reset_motion(state, measurement)


def reset_motion(state: State, measurement: float) -> None:
    """Reset the motion at this measurement [rad]; sensor and stamps stay known."""
    motion, quantum = state.motion, state.sensor.quantum
    motion.angle = measurement
    motion.velocity = motion.acceleration = motion.idle = 0.0
    covariance.set_covariance(state.p, quantum * quantum / 12.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    bandwidth.reset_process_noise(state.process_noise, 0.0)
    state.tracking.status, state.tracking.count = INITIALISING, 1.0
    state.tracking.off = 0.0
    bandwidth.reset_velocity_walk(state.velocity_walk)
    preference.reset_second_filter(state.second)


def restart(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
) -> None:
    """Start again after an outage or a jump of the clock: what is known of the quantum stays."""
    follow_convention(state.convention, measurement, design.period)
    reset(state, counts.quantum_of(state.steps, design.quantum), measurement)


def resume(
    observer: Any, state: State, coefficients: Coefficients, design: Design, measurement: float
) -> None:
    """Go on after a gap [rad], whose length is in the coefficients.

    What moved in it is a manoeuvre as old as the gap; where more than half a turn may have passed
    the speed stays as it was, in doubt.
    """
    motion, p, sensor, clock = state.motion, state.p, state.sensor, state.clock
    quantum, v, dt = sensor.quantum, motion.velocity, coefficients.dt
    innovation = measurement - motion.angle
    if not -design.half_turn <= innovation < design.half_turn:
        innovation = wrap(innovation, design.period)
    innovation -= v * dt
    covariance.set_covariance(p, quantum * quantum / 12.0, 0.0, 0.0, p.p11, 0.0, p.p22)
    variance = v * v
    motion.angle, motion.acceleration, motion.idle = measurement, 0.0, 0.0
    if abs(v) * dt < design.half_turn:  # the reading shows how far it moved
        covariance.add_manoeuvre(p, innovation, dt)
        ratio = innovation / (p.p00 + sensor.noise)
        motion.velocity += p.p01 * ratio
        motion.acceleration = p.p02 * ratio
        covariance.correct_covariance(p, quantum * quantum / 12.0 + sensor.noise, 0.0)
        variance = innovation * innovation / (dt * dt)
    bandwidth.reset_cusum(state.process_noise)
    sensing.begin_differences(sensor)
    follow_convention(state.convention, measurement, design.period)
    if state.tracking.status == TRACKING:
        state.tracking.status = COASTING
    state.tracking.count = state.tracking.off = 0.0
    bandwidth.reset_velocity_walk(state.velocity_walk)
    starts.set_start_uncertainty(
        state.uncertainty, variance, starts.SETTLES, state.uncertainty.time_since_first_motion, 0.0
    )
    clock.repeat_duration = 0.0
    preference.reset_second_filter(state.second)


def step(
    observer: Any,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: float,
    known_input: float,
) -> None:
    """Process one reading [rad]: what it is, when it came, what it shows."""
    if classify_reading(state, design, measurement, coefficients.dt):
        process_reading(state, coefficients, design)
    else:
        predict_through_repeat(state, coefficients, design)


def classify_reading(state: State, design: Design, measurement: float, dt: float) -> bool:
    """Classify a reading; return False if it is an old one, published again."""
    reading, motion, sensor, clock = state.reading, state.motion, state.sensor, state.clock
    change = measurement - state.convention.last
    if not -design.half_turn <= change < design.half_turn:
        change = wrap(change, design.period)
    starting = state.uncertainty.edges_to_settle > 0.0
    if change == 0.0 and abs(motion.velocity) * dt > REPEATS * sensor.quantum:
        is_tracking = state.tracking.status == TRACKING
        if sampling.is_repeat(clock, motion, state.p, sensor.mean_sample_time, is_tracking, dt):
            return False
    if starting:
        starts.pass_time(state.uncertainty, dt)
    reading.angle, reading.change = measurement, change
    reading.start_velocity_variance, reading.starting = state.uncertainty.variance, starting
    reading.noise_known = state.uncertainty.time_since_first_motion >= starts.START_DURATION
    reading.evidence = clock.evidence
    reading.rested, reading.previous_change = sensor.since, sensor.step
    reading.repeat_duration = clock.repeat_duration
    reading.passed = clock.repeat_duration + dt
    if clock.repeat_duration > 0.0 or clock.evidence > 0.0:
        sampling.resume_sampling(
            clock, change, reading.passed, sensor.mean_sample_time, motion.velocity
        )
    return True


def predict_through_repeat(state: State, coefficients: Coefficients, design: Design) -> None:
    """Predict one sample on: the reading is an old one."""
    motion, dt = state.motion, coefficients.dt
    v, a = motion.velocity, motion.acceleration
    motion.angle = motion.angle + v * dt + a * coefficients.half
    covariance.predict(motion, state.p, state.process_noise.density, coefficients)
    preference.predict_second_filter(state, design, coefficients, 0.0, dt)
    state.clock.repeat_duration += dt


def process_reading(state: State, coefficients: Coefficients, design: Design) -> None:
    """Process a reading whose time is known: learn the sensor, predict, correct."""
    reading, dt = state.reading, coefficients.dt
    pace, previous = state.sensor.mean_sample_time, state.sensor.dt
    learn_sensor(state, design, dt)
    unknown = reading.starting or reading.first or state.p.p02 == 0.0
    if unknown and shows_line(state, design, dt, pace, previous):
        starts.begin_line(state)
        return
    predict(state, coefficients, design, pace)
    if reading.change != 0.0:  # a rest ends, in which samples may have been lost?
        if reading.rested > NOISE_SAMPLES * (pace if 0.0 < pace < dt else dt):
            doubt_velocity_after_rest(state, dt)
    if state.tracking.off != 0.0 and decide(state, design, dt):
        return
    correct(state, design, dt)


def learn_sensor(state: State, design: Design, dt: float) -> None:
    """Learn quantum, noise and vibration."""
    reading, sensor, steps, convention = state.reading, state.sensor, state.steps, state.convention
    quantum, change, last = sensor.quantum, reading.change, convention.last
    reading.first = change != 0.0 and convention.low == convention.high
    if change != 0.0 and counts.shows_quantum(steps, change, sensor.size, sensor.since, quantum):
        extent = abs(reading.angle) + abs(last)
        if counts.is_residue(change, extent, design.quantum, quantum, reading.first):
            reading.angle, reading.change, reading.first = last, 0.0, False  # it is used again
        else:
            found = counts.search_quantum(steps, change, extent, design.quantum, sensor)
            if found != quantum:
                rescale(state, found, reading.first)
                quantum = found
                preference.reset_second_filter(state.second)
    spoilt = is_spoilt(state, design, dt)
    sensing.follow_sensor(sensor, reading.change, reading.passed, quantum, spoilt)
    if reading.evidence > sampling.BELIEVED:
        sensing.age_noise(sensor, state.motion.velocity)
    follow_convention(convention, reading.angle, design.period)


def rescale(state: State, quantum: float, first: bool) -> None:
    """Use another quantum [rad] from now on.

    The process noise stays as it was in quanta. A finer quantum makes no estimate surer, and a
    larger one none vaguer.

    Parameters
    ----------
    first : this is the first step of all, and everything was relative to `counts.UNIT`.
    """
    p, sensor = state.p, state.sensor
    used, noise = sensor.quantum, sensor.noise
    scale = quantum * quantum / (used * used)
    if noise > NOISY_ABOVE * used * used:  # what is known stays as it was in noise
        scale = (quantum * quantum + 12.0 * noise) / (used * used + 12.0 * noise)
    state.process_noise.density *= scale
    if first:
        sensor.noise *= scale
        sensor.vibration_power *= scale
        p.p00, p.p01, p.p02 = p.p00 * scale, p.p01 * scale, p.p02 * scale
        p.p11, p.p12, p.p22 = p.p11 * scale, p.p12 * scale, p.p22 * scale


def shows_line(state: State, design: Design, dt: float, pace: float, previous: float) -> bool:
    """Return True if this reading shows the line of a start.

    The second reading; the third where that came too soon; the second that moves on after a rest;
    or the first that moves so early that it shows the quantum alone.

    Parameters
    ----------
    pace, previous : mean sample time, and the sample time before this one [s].
    """
    reading, p = state.reading, state.p
    return (
        p.p11 == 0.0
        or (p.p02 == 0.0 and pace == 0.0 and dt > HASTY * previous and previous > 0.0)
        or (
            reading.starting
            and reading.previous_change * reading.change > 0.0
            and state.uncertainty.edges_to_settle == starts.FIRST_EDGE
        )
        or (reading.first and design.quantum == 0.0 and reading.rested <= CONFIRMED * dt)
    )


def predict(state: State, coefficients: Coefficients, design: Design, pace: float) -> None:
    """Predict motion and covariance: a' = -a/T + w, v' = a, x' = v.

    Parameters
    ----------
    pace : mean sample time before this one [s].
    """
    motion, p, sensor, reading = state.motion, state.p, state.sensor, state.reading
    dt, v, a = coefficients.dt, motion.velocity, motion.acceleration
    predicted = v * dt + a * coefficients.half
    unpredicted = reading.change - predicted
    if reading.repeat_duration > 0.0:  # and moved while the reading repeated
        unpredicted -= (v - 0.5 * a * reading.repeat_duration) * reading.repeat_duration
    innovation = reading.angle - motion.angle - predicted
    if innovation + innovation >= design.period or innovation + innovation < -design.period:
        innovation = wrap(innovation, design.period)
    reading.predicted_motion, reading.unpredicted_motion = predicted, unpredicted
    reading.innovation = innovation
    covariance.predict(motion, p, state.process_noise.density, coefficients)
    swing = lasted = 0.0
    walk = state.velocity_walk
    if walk.mean > 0.0:
        lasted = (
            dt if dt > sampling.EVEN_SAMPLING * pace else pace
        )  # readings in bursts are not that near
        swing = walk.mean - sensor.quantum * sensor.quantum / 6.0 - 2.0 * sensor.noise
        covariance.add_velocity_noise(p, swing, lasted)
    if design.ratio != 1.0 or state.second.apart:
        preference.predict_second_filter(state, design, coefficients, swing, lasted)


def doubt_velocity_after_rest(state: State, dt: float) -> None:
    """Doubt the speed at the first changed reading after a rest.

    Not where noise hides single edges (see `doubt_in_noise`), and where the angle is known too
    well: an edge came meanwhile, that noise took back.
    """
    reading, uncertainty = state.reading, state.uncertainty
    square = state.sensor.quantum * state.sensor.quantum
    if state.sensor.noise <= NOISY_ABOVE * square and (
        reading.first or 12.0 * state.p.p00 > RESTED_PART * square
    ):
        since = 0.0 if reading.first else uncertainty.time_since_first_motion
        age = uncertainty.age if reading.rested < starts.RESTS else 0.0
        starts.doubt_speed(state, reading.change, dt, since, age)
        reading.starting = False


def correct(state: State, design: Design, dt: float) -> None:
    """Correct by a reading: random walk, noise that hides single edges, what an edge shows."""
    reading, motion, p, sensor = state.reading, state.motion, state.p, state.sensor
    walk, tracking, quantum = state.velocity_walk, state.tracking, sensor.quantum
    mean, last, before = walk.mean, walk.last, walk.before
    innovation, square = reading.innovation, quantum * quantum
    # unless it moved away from a reading that was not believed
    bandwidth.update_velocity_walk(
        walk,
        reading.unpredicted_motion,
        sensing.OUTLIER_RATIO * (sensor.noise_bound + square),
        tracking.count > 0.0,
    )
    half, noisy = 0.5 * quantum, sensor.noise > NOISY_ABOVE * square
    if noisy:
        starts.doubt_in_noise(state, dt)
    elif reading.change * reading.previous_change < 0.0 and -half < reading.predicted_motion < half:
        if walk.mean <= 0.0:
            # a reading that the next undoes: its noise is as unknown as an angle in its cell
            sensor.noise, noisy = square / 12.0, True
    noise = sensor.noise
    flickers = noisy and reading.predicted_motion * reading.predicted_motion < noise < half * half
    # most readings are plainly no news: no edge, and none was expected
    inside = -half <= reading.unpredicted_motion <= half and -half <= innovation <= half
    if not inside or flickers or 12.0 * p.p00 > square:
        if not update(state, design, flickers, dt):
            coast(state, dt)
            walk.mean, walk.last, walk.before = mean, last, before
            return
        if motion.idle == 0.0 and abs(2.0 * motion.velocity) * dt > design.period > 0.0:
            reset_motion(state, reading.angle)  # faster than half a turn per sample: lost
            return
    if reading.change != 0.0 and reading.start_velocity_variance > 0.0:
        starts.inflate_for_missing_edge(state.uncertainty, 0.0)
    if reading.starting and reading.change != 0.0:
        starts.settle(state, noise, dt)
    if tracking.status != TRACKING:
        confirm(tracking, p.p11, dt, square + 12.0 * noise)
    motion.angle = reading.angle - reading.innovation


def estimate(
    observer: Any,
    out: Estimate,
    state: State,
    coefficients: Coefficients,
    design: Design,
    measurement: float,
    known_input: float,
) -> None:
    """Set the estimate."""
    motion, second, sensor = state.motion, state.second, state.sensor
    v = motion.velocity + second.v
    if sensor.since > 0.0:
        most = sigma.fastest(sensor)
        v = most if v > most else -most if v < -most else v
    angle = motion.angle + second.x
    out.position = present(state.convention, angle, design.period, design.unwrap)
    out.velocity, out.acceleration = v, motion.acceleration + second.a
    out.status = state.tracking.status
