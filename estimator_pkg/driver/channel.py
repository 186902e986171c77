# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One joint's samples through guard and observer: the core of the driver.

The observer's module is an argument. The functions run as plain Python, and the engine has them as
C for each observer that is ours. `reset_channel` prepares a channel, `take` takes one sample,
`write_estimate` and `write_deviation` set the estimate; `message` and `batch` do it for many. In
plain Python a measurement, a known input and the numbers of an estimate can be vectors.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import wrap
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED, Deviation, Estimate
from estimator_pkg.record import record
from estimator_pkg.sensor.calibration import BROKEN, Calibration, begin_calibration, calibrate
from estimator_pkg.sensor.clock import RATE_WEIGHT, Clock, follow_outage, judge_stamp
from estimator_pkg.sensor.faults import (
    EncoderFaults,
    begin_faults,
    examine_step,
    forget_motion,
    inflate,
    is_usual,
    name_rest,
)
from estimator_pkg.sensor.guard import (
    AFTER_GAP,
    AFTER_OUTAGE,
    AFTER_STRAY_STAMP,
    DUPLICATE,
    FIRST_SAMPLE,
    LATE_STAMP,
    NON_FINITE,
    REPEATED_READING,
    SLOW_STREAM,
    UNSTABLE_GAINS,
    USED_SAMPLE,
    ZERO_STAMP,
    Limits,
)
from estimator_pkg.sensor.holds import Holds, is_repeated, note_reading, shown_speed, unshown_speed
from estimator_pkg.sensor.sample_time import (
    SampleTime,
    begin_sample_time,
    reset_sample_time,
    sample_time,
)
from estimator_pkg.sensor.turns import Turns, follow_turns, is_news


@record
class Track:
    """What is known of one joint: of its clock, its readings, its motion."""

    clock: Clock
    sample_time: SampleTime
    reading: float  # the newest reading, of a single angle [rad or m]
    earlier: float  # the reading before it
    holds: Holds
    calibration: Calibration
    coefficients: observer.Coefficients  # type: ignore[name-defined]  # noqa: F821  (bound by `Track.of`)
    state: observer.State  # type: ignore[name-defined]  # noqa: F821
    # that before the last gap, in case its stamp is a stray one
    state_before_gap: observer.State  # type: ignore[name-defined]  # noqa: F821


@record
class Frame:
    """What the gains imply with a circle, or without."""

    design: observer.Design  # type: ignore[name-defined]  # noqa: F821  (bound by `Channel.of`)
    longest_dt: float  # see `Limits`
    period: float


@record
class Channel:
    """One joint: what its gains imply, what is known of it, what came, and the newest estimate."""

    design: observer.Design  # type: ignore[name-defined]  # noqa: F821  (bound by `Channel.of`)
    limits: Limits
    track: Track
    turns: Turns
    faults: EncoderFaults
    wrapped: Frame  # with the joint's circle
    counted: Frame  # without, where the sensor counts turns
    verdict: int  # on the newest sample
    counts: Annotated[list[int], 12]  # of the samples, by verdict
    stamp_ns: int  # of the newest sample that was used
    measurement: float  # [rad or m]
    known_input: float
    estimate: Estimate
    deviation: Deviation


def use_frame(channel: Any, frame: Any) -> None:
    """Go on with a circle, or without; the next sample computes the coefficients anew."""
    channel.design.take(frame.design)
    channel.limits.longest_dt, channel.limits.period = frame.longest_dt, frame.period
    channel.track.clock.dt = 0.0
    begin_sample_time(channel.track.sample_time)


def reset_channel(observer: Any, channel: Channel) -> None:
    """Set everything before the first sample, with a circle if the joint has one."""
    use_frame(channel, channel.wrapped)
    reset_track(observer, channel.track, channel.design)
    channel.measurement = channel.known_input = 0.0
    begin_faults(channel.faults)


def reset_track(observer: Any, track: Any, design: Any) -> None:
    """Set everything before the first sample but the observer's state."""
    blank = Clock()
    track.clock.take(blank)
    reset_sample_time(track.sample_time)
    track.reading = track.earlier = 0.0
    no_pattern = Holds()
    track.holds.take(no_pattern)
    begin_calibration(track.calibration)
    observer.prepare(track.coefficients, design, 1e-3)


def take(
    observer: Any, channel: Channel, stamp_ns: int, measurement: float, known_input: float
) -> int:
    """Take one sample and count it; return the verdict."""
    if observer.TURNS:
        if is_news(channel.turns, measurement):
            if follow_turns(channel.turns, stamp_ns, measurement):
                if channel.turns.counts:
                    use_frame(channel, channel.counted)
                else:
                    use_frame(channel, channel.wrapped)
    verdict = advance(
        observer, channel.track, channel.design, channel.limits, stamp_ns, measurement, known_input
    )
    if observer.SINGLE_ANGLE:
        if verdict == USED_SAMPLE:
            if channel.track.holds.missing:
                name_rest(channel.faults, channel.track.holds, stamp_ns)
            if not is_usual(channel.faults, measurement, stamp_ns):
                examine_step(
                    channel.faults, measurement, channel.track.clock, channel.limits.period
                )
        elif verdict < DUPLICATE:
            forget_motion(channel.faults, measurement)
    channel.verdict = verdict
    channel.counts[verdict] += 1
    if verdict < DUPLICATE:
        channel.stamp_ns = stamp_ns
        channel.measurement = measurement
        channel.known_input = known_input
    return verdict


def advance(
    observer: Any,
    track: Any,
    design: Any,
    limits: Limits,
    stamp_ns: int,
    measurement: Any,
    known_input: Any,
) -> int:
    """Take one sample; return the verdict. A dropped one does not change the estimate."""
    clock = track.clock
    if not observer.is_reading(measurement):
        return NON_FINITE
    if stamp_ns <= 0:
        return ZERO_STAMP
    verdict = judge_stamp(clock, limits, stamp_ns)
    if observer.SINGLE_ANGLE:
        if verdict == USED_SAMPLE and (measurement == track.reading or track.holds.most > 0):
            verdict = check_repeat(observer, track, design, limits, stamp_ns, measurement)
    if verdict >= DUPLICATE:
        if verdict == LATE_STAMP:
            clock.late_in_a_row += 1
        return verdict
    if verdict == USED_SAMPLE or verdict == AFTER_STRAY_STAMP:
        before_dt = clock.dt
        verdict, passed = follow_time(
            observer, track, design, limits, stamp_ns, measurement, verdict
        )
        if clock.dt != before_dt:
            observer.prepare(track.coefficients, design, clock.dt)
        if (
            verdict == USED_SAMPLE
            and passed <= limits.longest_dt
            and clock.mean_dt <= limits.longest_dt
        ):
            observer.step(
                observer, track.state, track.coefficients, design, measurement, known_input
            )
            clock.last_ns = stamp_ns
            clock.late_in_a_row = 0
            if observer.SINGLE_ANGLE:
                if stamp_ns >= track.calibration.due_ns:
                    calibrate(observer, track, design, limits, stamp_ns, measurement, known_input)
                note_reading(
                    track.holds,
                    stamp_ns,
                    wrap(measurement - track.reading, limits.period),
                    clock.mean_dt,
                    abs(measurement),
                    limits.count,
                )
                track.earlier = track.reading
                track.reading = measurement
            return USED_SAMPLE
        if clock.mean_dt > limits.longest_dt:
            verdict = UNSTABLE_GAINS
        elif verdict == USED_SAMPLE:  # unstable if it were constant: handled like a gap
            verdict = AFTER_GAP
    elif verdict == AFTER_GAP or verdict == AFTER_OUTAGE:
        follow_outage(clock, stamp_ns)
        track.state_before_gap.take(track.state)
    else:
        clock.before_ns = 0
    start_at(observer, track, design, stamp_ns, measurement, verdict)
    return verdict


def check_repeat(
    observer: Any, track: Any, design: Any, limits: Limits, stamp_ns: int, measurement: float
) -> int:
    """Return REPEATED_READING for an earlier reading, published again; else USED_SAMPLE."""
    clock, holds = track.clock, track.holds
    recognised = holds.most > 0
    if not is_repeated(
        holds,
        stamp_ns,
        stamp_ns - clock.last_ns,
        measurement,
        track.reading,
        track.earlier,
        clock.mean_dt,
        limits.period,
    ):
        return USED_SAMPLE
    clock.late_in_a_row = 0
    if not recognised:  # the state learnt from such a sensor is wrong
        observer.restart(observer, track.state, track.coefficients, design, measurement)
        reset_sample_time(track.sample_time)
        track.calibration.due_ns = BROKEN
        clock.mean_dt = max(clock.mean_dt, 1e-9 * holds.spacing_ns)
    return REPEATED_READING


def follow_time(
    observer: Any,
    track: Any,
    design: Any,
    limits: Limits,
    stamp_ns: int,
    measurement: Any,
    verdict: int,
) -> tuple[int, float]:
    """Follow the sample time; return (verdict, time since the last sample [s]).

    The verdict becomes AFTER_OUTAGE where the mean sample time came from a gap.
    """
    clock = track.clock
    before_dt_ns, last_ns, before_ns = clock.dt_ns, clock.last_ns, clock.before_ns
    clock.dt_ns = stamp_ns - last_ns
    clock.before_ns = 0  # the previous stamp if the next one may reveal this one as a stray
    if verdict == AFTER_STRAY_STAMP:
        clock.dt_ns = stamp_ns - before_ns
        track.state.take(track.state_before_gap)
    passed = clock.dt_ns * 1e-9
    if verdict == AFTER_STRAY_STAMP:
        if (last_ns - before_ns) * 1e-9 <= clock.mean_dt:
            clock.mean_dt = 0.0  # it came from that stamp only
    elif clock.mean_dt == 0.0:
        clock.mean_dt = passed
        if stamp_ns - last_ns > limits.gap_ns:
            clock.before_ns = last_ns
            track.state_before_gap.take(track.state)
    elif SLOW_STREAM * passed >= clock.mean_dt:
        clock.mean_dt += RATE_WEIGHT * (passed - clock.mean_dt)
    elif before_ns != 0 and before_dt_ns == last_ns - before_ns:
        clock.mean_dt = passed  # the mean came from a gap
        verdict = AFTER_OUTAGE
    elif before_ns != 0 and SLOW_STREAM * 1e-9 * before_dt_ns < clock.mean_dt:
        clock.mean_dt = passed  # the mean came from two gaps
    else:
        clock.mean_dt += RATE_WEIGHT * (passed - clock.mean_dt)
    if observer.SINGLE_ANGLE:
        passed = sample_time(
            track.sample_time, passed, wrap(measurement - track.reading, limits.period)
        )
    clock.dt = passed
    return verdict, passed


def start_at(
    observer: Any, track: Any, design: Any, stamp_ns: int, measurement: Any, verdict: int
) -> None:
    """Take a sample that no prediction reaches."""
    clock = track.clock
    if verdict == FIRST_SAMPLE:
        observer.start(observer, track.state, design, measurement)
    elif verdict == AFTER_GAP or verdict == AFTER_STRAY_STAMP:
        resume_after_gap(observer, track, design, stamp_ns, measurement, verdict)
    else:
        observer.restart(observer, track.state, track.coefficients, design, measurement)
    clock.running = True
    clock.last_ns = stamp_ns
    clock.late_in_a_row = 0
    if observer.SINGLE_ANGLE:
        track.reading = track.earlier = measurement
        track.holds.changed_ns, track.holds.leap = stamp_ns, 0.0
        track.holds.unchanged = track.holds.steady = 0
        begin_sample_time(track.sample_time)
        track.calibration.due_ns = BROKEN


def resume_after_gap(
    observer: Any, track: Any, design: Any, stamp_ns: int, measurement: Any, verdict: int
) -> None:
    """Go on after a gap; the coefficients are those of its length."""
    clock = track.clock
    gap_ns = stamp_ns - clock.last_ns if verdict == AFTER_GAP else clock.dt_ns
    if observer.EDGES and clock.dt > 0.0:  # it takes the line through the gap
        observer.prepare(track.coefficients, design, gap_ns * 1e-9)
        observer.resume(observer, track.state, track.coefficients, design, measurement)
        observer.prepare(track.coefficients, design, clock.dt)
    else:
        observer.resume(observer, track.state, track.coefficients, design, measurement)


def write_estimate(observer: Any, channel: Channel) -> None:
    """Set the estimate at the last used sample."""
    out, track = channel.estimate, channel.track
    out.position = out.velocity = out.acceleration = math.nan
    if not track.clock.running:
        out.status = INITIALISING
    elif track.clock.mean_dt > channel.limits.longest_dt:
        out.status = MISCONFIGURED
    else:
        observer.estimate(
            observer,
            out,
            track.state,
            track.coefficients,
            channel.design,
            channel.measurement,
            channel.known_input,
        )
        if observer.SINGLE_ANGLE:
            if track.holds.leap > 0.0:
                out.velocity = shown_speed(track.holds, track.clock.last_ns, out.velocity)


def write_deviation(observer: Any, channel: Channel) -> None:
    """Set one standard deviation of position and velocity, the latter calibrated."""
    track = channel.track
    scale = track.calibration.scale
    observer.deviation(
        observer, channel.deviation, track.state, track.coefficients, channel.design, scale
    )
    if observer.SINGLE_ANGLE:
        holds = track.holds
        if holds.unchanged > 0 or holds.leap > 0.0 or channel.faults.doubted:
            write_estimate(observer, channel)
            velocity = channel.estimate.velocity
            least = unshown_speed(holds, track.clock.last_ns, velocity)
            channel.deviation.velocity = max(channel.deviation.velocity, least)
            if channel.faults.doubted:
                inflate(channel.faults, channel.deviation, velocity)


def message(
    observer: Any,
    channels: list[Channel],
    count: int,
    stamp_ns: int,
    readings: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Take one message of `count` joints.

    Parameters
    ----------
    readings : shape (count,) [rad or m].
    out : shape (4 count,): for each joint (position, velocity, acceleration, status); status -1:
        the sample was not used.
    """
    for k in range(count):
        channel = channels[k]
        row = 4 * k
        if take(observer, channel, stamp_ns, readings[k], 0.0) < DUPLICATE:
            write_estimate(observer, channel)
            estimate = channel.estimate
            out[row] = estimate.position
            out[row + 1] = estimate.velocity
            out[row + 2] = estimate.acceleration
            out[row + 3] = float(estimate.status)
        else:
            out[row + 3] = -1.0


def deviations(
    observer: Any, channels: list[Channel], count: int, sigmas: NDArray[np.float64]
) -> None:
    """Set one standard deviation of position and velocity of each joint, shape (2 count,)."""
    for k in range(count):
        channel = channels[k]
        write_deviation(observer, channel)
        sigmas[2 * k] = channel.deviation.position
        sigmas[2 * k + 1] = channel.deviation.velocity


def batch(
    observer: Any,
    channel: Channel,
    count: int,
    stamps: NDArray[np.int64],
    measurements: NDArray[np.float64],
    known_input: NDArray[np.float64],
    position: NDArray[np.float64],
    velocity: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    position_stddev: NDArray[np.float64],
    velocity_stddev: NDArray[np.float64],
    status: NDArray[np.int8],
    verdicts: NDArray[np.int8],
) -> None:
    """Take many samples; the arrays have the shape (count,)."""
    estimate, sigma = channel.estimate, channel.deviation
    for k in range(count):
        verdict = take(observer, channel, stamps[k], measurements[k], known_input[k])
        verdicts[k] = verdict
        if verdict < DUPLICATE:
            write_estimate(observer, channel)
            write_deviation(observer, channel)
            position[k] = estimate.position
            velocity[k] = estimate.velocity
            acceleration[k] = estimate.acceleration
            status[k] = estimate.status
            position_stddev[k] = sigma.position
            velocity_stddev[k] = sigma.velocity
        else:
            position[k] = velocity[k] = acceleration[k] = math.nan
            position_stddev[k] = velocity_stddev[k] = math.nan
            status[k] = INITIALISING
