# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One joint's samples through guard and observer, as pure functions: the core of the driver.

The live node calls them as plain Python, replay and benchmarks may compile them. A track is a plain
tuple with the fields of `Track` (making a NamedTuple at each sample would cost half a
microsecond). `blank` returns an empty one, `advance` takes one sample, `read` returns the estimate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import itemgetter
from typing import Any, NamedTuple

from estimator_pkg.driver.guard import (
    AFTER_GAP,
    AFTER_OUTAGE,
    AFTER_STRAY_STAMP,
    DUPLICATE,
    FIRST,
    LATE,
    MISCONFIGURED,
    NON_FINITE,
    REPEATED,
    SLOW_STREAM,
    USED,
    ZERO_STAMP,
    judge,
)
from estimator_pkg.driver.queues import EVIDENCE, QUEUED, make_waited, never_waited
from estimator_pkg.driver.repeats import BLANK, Repeats, changed, hold, repeated
from estimator_pkg.observers.angle.calibration import (
    BROKEN,
    FIRST_INTERVAL,
    Interval,
    make_calibrate,
    no_calibration,
)
from estimator_pkg.observers.circle import wrap
from estimator_pkg.observers.contract import INITIALISING, Functions
from estimator_pkg.observers.contract import MISCONFIGURED as STATUS_MISCONFIGURED

RATE_WEIGHT = 0.02  # weight of the newest sample time in the mean


class Track(NamedTuple):
    """The fields of a track, in their order."""

    last_ns: int  # the last stamp
    before_ns: int  # the stamp before it, after a gap or an implausible first sample time; else 0
    late: int  # late stamps in a row
    dt_ns: int  # the last sample time
    mean_dt: float  # the mean sample time [s]
    coefficients: tuple  # of the observer
    state: tuple  # of the observer
    running: bool  # True after the first sample
    kept: tuple  # the state before the last gap, in case that stamp is a stray one
    reading: Any  # the newest reading
    earlier: Any  # the reading before it
    queue: float  # evidence that samples which come at once waited in a queue, from 0 to 1
    repeats: Repeats  # state of the detection of repeated readings
    interval: Interval  # scale of the standard deviation, and how it is learnt


def field_of(name: str) -> Callable[[tuple], Any]:
    """Return a function that reads this field of a track."""
    return itemgetter(Track._fields.index(name))


def replaced(track: tuple, **fields: Any) -> tuple:
    """Return the track with other values of these fields; further ones stay."""
    count = len(Track._fields)
    return tuple(Track(*track[:count])._replace(**fields)) + track[count:]


def newest(track: tuple) -> tuple[int, tuple, tuple]:
    """Return (stamp [ns], coefficients, state) of the last sample."""
    last_ns, _, _, _, _, coefficients, state, _, _, _, _, _, _, _ = track
    return last_ns, coefficients, state


def with_state(track: tuple, state: tuple) -> tuple:
    """Return the track with another state of the observer."""
    (
        last_ns,
        before_ns,
        late,
        dt_ns,
        mean_dt,
        coefficients,
        _,
        running,
        kept,
        reading,
        earlier,
        queue,
        repeats,
        interval,
    ) = track
    return (
        last_ns,
        before_ns,
        late,
        dt_ns,
        mean_dt,
        coefficients,
        state,
        running,
        kept,
        reading,
        earlier,
        queue,
        repeats,
        interval,
    )


class TrackFunctions(NamedTuple):
    """`blank(design)`, `advance(...)`, `read(...)` and `deviation(...)` of one observer."""

    blank: Callable[..., tuple]
    advance: Callable[..., tuple]
    read: Callable[..., tuple]
    deviation: Callable[..., tuple[float, float]]


def make_sieve(period: float) -> Callable[..., tuple[Repeats, bool]]:
    """Return the function that finds repeated readings, called where a reading may be one.

    Parameters
    ----------
    period : wrap period [rad]; 0: none.
    """

    def sieve(
        repeats: Repeats,
        stamp_ns: int,
        passed_ns: int,
        measurement: float,
        reading: float,
        earlier: float,
        mean_dt: float,
    ) -> tuple[Repeats, bool]:
        """Return the state of the detection, and True if this reading is dropped."""
        most, length, chain = repeats
        if most > 0:
            if measurement == reading:
                return repeated(repeats)
            return changed(repeats, passed_ns, wrap(measurement - reading, period)), False
        if reading != earlier:
            repeats = hold(repeats, stamp_ns, reading, earlier, mean_dt, period)
            most, _, _ = repeats
            return repeats, most > 0
        if length == 1:
            return (most, 2, chain), False
        return repeats, False

    return sieve


def take_all(
    repeats: Repeats,
    stamp_ns: int,
    passed_ns: int,
    measurement: Any,
    reading: Any,
    earlier: Any,
    mean_dt: float,
) -> tuple[Repeats, bool]:
    """Use every sample: replaces `make_sieve` for measurements that are not a single angle."""
    return repeats, False


def make_track(
    functions: Functions, period: float | None = None, calibrated: bool = True
) -> TrackFunctions:
    """Return the driver's functions for an observer's.

    Parameters
    ----------
    period : wrap period of a measurement that is a single angle [rad], whose repeated readings
        are dropped; None: another measurement, nothing is dropped.
    calibrated : for a single angle, scale the standard deviation by what later readings show.
    """
    sieve = take_all if period is None else make_sieve(float(period))
    calibrate = (
        no_calibration
        if period is None or not calibrated
        else make_calibrate(functions.output, functions.stddev, float(period))
    )
    waited = never_waited if period is None else make_waited(functions, float(period))
    prepare, init, step = functions.prepare, functions.init, functions.step
    resume, output, stddev, finite = (
        functions.resume,
        functions.output,
        functions.stddev,
        functions.finite,
    )
    nothing, restart = functions.blank, functions.new_start
    scaled_stddev = functions.scaled_stddev

    def blank(design: tuple) -> tuple:
        """Return a track before its first sample."""
        empty = init(nothing, design)
        return (
            0,
            0,
            0,
            0,
            0.0,
            prepare(design, 1e-3),
            empty,
            False,
            empty,
            nothing,
            nothing,
            EVIDENCE,
            BLANK,
            FIRST_INTERVAL,
        )

    def advance(
        track: tuple,
        design: tuple,
        limits: tuple,
        stamp_ns: int,
        measurement: Any,
        known_input: Any,
    ) -> tuple[tuple, int]:
        """Return (track, verdict) after one sample; a dropped one does not change the estimate."""
        (
            last_ns,
            before_ns,
            late,
            dt_ns,
            mean_dt,
            coefficients,
            state,
            running,
            kept,
            reading,
            earlier,
            queue,
            repeats,
            interval,
        ) = track
        due_ns, calibration = interval
        gap_ns, reorder_ns, timeout_ns, longest_dt = limits
        if not finite(measurement):
            return track, NON_FINITE
        if stamp_ns <= 0:
            return track, ZERO_STAMP
        ahead = stamp_ns - last_ns
        if not running:
            verdict = FIRST
        elif 0 < ahead <= gap_ns:  # nearly every sample: saves the call
            verdict = USED
        else:
            verdict = judge(
                last_ns, before_ns, late, mean_dt, stamp_ns, gap_ns, reorder_ns, timeout_ns
            )
        dropping, _, _ = repeats
        if verdict == USED and (measurement == reading or dropping > 0):
            repeats, drop = sieve(repeats, stamp_ns, ahead, measurement, reading, earlier, mean_dt)
            if drop:
                verdict, late = REPEATED, 0
                if dropping == 0:  # the state learnt from such a sensor is wrong
                    state = restart(state, coefficients, design, measurement)
                    interval = (BROKEN, calibration)
        if verdict >= DUPLICATE:
            if verdict == LATE:
                late += 1
            return (
                last_ns,
                before_ns,
                late,
                dt_ns,
                mean_dt,
                coefficients,
                state,
                running,
                kept,
                reading,
                earlier,
                queue,
                repeats,
                interval,
            ), verdict
        if verdict == USED or verdict == AFTER_STRAY_STAMP:
            old_dt_ns, dt_ns = dt_ns, ahead
            since_ns = 0  # set to the previous stamp if the next one may reveal this one as a stray
            if verdict == AFTER_STRAY_STAMP:
                dt_ns, state = stamp_ns - before_ns, kept
            passed = dt_ns * 1e-9
            if verdict == AFTER_STRAY_STAMP:
                if (last_ns - before_ns) * 1e-9 <= mean_dt:
                    mean_dt = 0.0  # it came from that stamp only
            elif mean_dt == 0.0:
                mean_dt = passed
                if ahead > gap_ns:
                    since_ns, kept = last_ns, state
            elif SLOW_STREAM * passed >= mean_dt:
                mean_dt += RATE_WEIGHT * (passed - mean_dt)
            elif before_ns != 0 and old_dt_ns == last_ns - before_ns:
                mean_dt, verdict = passed, AFTER_OUTAGE  # the mean came from a gap
            else:
                waits = False
                if passed < QUEUED * mean_dt:
                    waits, queue = waited(
                        queue, state, coefficients, design, measurement, reading, passed, mean_dt
                    )
                if waits:  # it is taken as a sample after the mean time
                    dt_ns = round(1e9 * mean_dt)
                    mean_dt += RATE_WEIGHT * (passed - mean_dt)
                    passed = mean_dt
                elif before_ns != 0 and SLOW_STREAM * 1e-9 * old_dt_ns < mean_dt:
                    mean_dt = passed  # the mean came from two gaps
                else:
                    mean_dt += RATE_WEIGHT * (passed - mean_dt)
            if dt_ns != old_dt_ns:
                coefficients = prepare(design, dt_ns * 1e-9)
            if verdict == USED and passed <= longest_dt and mean_dt <= longest_dt:
                state = step(state, coefficients, design, measurement, known_input)
                if stamp_ns >= due_ns:
                    interval = calibrate(
                        interval,
                        (stamp_ns, measurement, reading, earlier, dt_ns, old_dt_ns),
                        state,
                        coefficients,
                        design,
                        known_input,
                    )
                return (
                    stamp_ns,
                    since_ns,
                    0,
                    dt_ns,
                    mean_dt,
                    coefficients,
                    state,
                    True,
                    kept,
                    measurement,
                    reading,
                    queue,
                    repeats,
                    interval,
                ), USED
            before_ns = since_ns
            if mean_dt > longest_dt:
                verdict = MISCONFIGURED
            elif verdict == USED:  # unstable if it were constant: handled like a gap
                verdict = AFTER_GAP
        elif verdict == AFTER_GAP or verdict == AFTER_OUTAGE:
            if before_ns != 0:
                # One hole, or one stamp from the far future, does not show the rate; two in a row
                # mean that it fell.
                shorter = min(ahead, last_ns - before_ns) * 1e-9
                if shorter > mean_dt:
                    mean_dt = shorter
            before_ns, kept = last_ns, state
        else:
            before_ns = 0
        # no prediction reaches this sample
        if verdict == FIRST:
            state = init(measurement, design)
        elif verdict == AFTER_GAP or verdict == AFTER_STRAY_STAMP:
            state = resume(state, coefficients, design, measurement)
        else:
            state = restart(state, coefficients, design, measurement)
        return (
            stamp_ns,
            before_ns,
            0,
            dt_ns,
            mean_dt,
            coefficients,
            state,
            True,
            kept,
            measurement,
            measurement,
            queue,
            repeats,
            (BROKEN, calibration),
        ), verdict

    def read(
        track: tuple, design: tuple, limits: tuple, measurement: Any, known_input: Any
    ) -> tuple:
        """Return (position, velocity, acceleration or nan, status) of the newest estimate."""
        _, _, _, _, mean_dt, coefficients, state, running, _, _, _, _, _, _ = track
        _, _, _, longest_dt = limits
        if not running:
            return math.nan, math.nan, math.nan, INITIALISING
        if mean_dt > longest_dt:
            return math.nan, math.nan, math.nan, STATUS_MISCONFIGURED
        return output(state, coefficients, design, measurement, known_input)

    def deviation(track: tuple, design: tuple) -> Any:
        """Return one standard deviation of position and velocity."""
        _, coefficients, state = newest(track)
        return stddev(state, coefficients, design)

    def calibrated_deviation(track: tuple, design: tuple) -> tuple[float, float]:
        """Return one standard deviation of position and velocity, the latter calibrated."""
        _, _, _, _, _, coefficients, state, _, _, _, _, _, _, (_, (scale, _, _)) = track
        return scaled_stddev(state, coefficients, design, scale)

    return TrackFunctions(
        blank, advance, read, deviation if period is None else calibrated_deviation
    )
