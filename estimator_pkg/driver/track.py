"""One joint's way through guard and observer, as pure functions: the heart of the driver.

The live node calls these as ordinary Python, replay and benchmarks may compile them.
A track is a tuple; `blank` makes an empty one, `advance` takes one sample in, `read` looks at it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from estimator_pkg.driver.guard import (
    AFTER_CLOCK_JUMP,
    AFTER_GAP,
    AFTER_STRAY_STAMP,
    DUPLICATE,
    FIRST,
    LATE,
    MISCONFIGURED,
    NON_FINITE,
    USED,
    ZERO_STAMP,
    judge,
)
from estimator_pkg.observers.contract import MISCONFIGURED as STATUS_MISCONFIGURED
from estimator_pkg.observers.contract import Functions

RATE_WEIGHT = 0.02  # weight of the newest sample time in the mean


class TrackFunctions(NamedTuple):
    """`blank(design)`, `advance(...)`, `read(...)` and `deviation(...)` of one observer."""

    blank: Callable[..., tuple]
    advance: Callable[..., tuple]
    read: Callable[..., tuple]
    deviation: Callable[..., tuple[float, float]]


def make_track(functions: Functions) -> TrackFunctions:
    """The driver's functions around an observer's."""
    prepare, init, step = functions.prepare, functions.init, functions.step
    resume, output, stddev, finite = (functions.resume, functions.output, functions.stddev,
                                      functions.finite)
    nothing = functions.blank

    def blank(design: tuple) -> tuple:
        """A track that no sample has reached."""
        return (0, 0, 0, 0, 0.0, prepare(design, 1e-3), init(nothing, design), False)

    def advance(track: tuple, design: tuple, limits: tuple, stamp_ns: int, measurement: Any,
                given: Any) -> tuple[tuple, int]:
        """(track, verdict) after one sample; a dropped sample leaves the estimate alone."""
        last_ns, before_ns, late, dt_ns, mean_dt, coefficients, state, running = track
        gap_ns, reorder_ns, longest_dt = limits
        if not finite(measurement):
            return track, NON_FINITE
        if stamp_ns <= 0:
            return track, ZERO_STAMP
        if not running:
            return ((stamp_ns, 0, 0, 0, 0.0, coefficients, init(measurement, design), True),
                    FIRST)
        ahead = stamp_ns - last_ns
        if 0 < ahead <= gap_ns:  # what nearly every sample is, without the call
            verdict = USED
        else:
            verdict = judge(last_ns, before_ns, late, mean_dt, stamp_ns, gap_ns,
                            reorder_ns)
        if verdict == USED or verdict == AFTER_STRAY_STAMP:
            passed_ns = stamp_ns - (last_ns if verdict == USED else before_ns)
            if passed_ns != dt_ns:
                coefficients = prepare(design, passed_ns * 1e-9)
            if mean_dt == 0.0:
                mean_dt = passed_ns * 1e-9
            else:
                mean_dt += RATE_WEIGHT * (passed_ns * 1e-9 - mean_dt)
            if mean_dt > longest_dt:
                return ((stamp_ns, 0, 0, passed_ns, mean_dt, coefficients,
                         init(measurement, design), True), MISCONFIGURED)
            if verdict == USED:
                state = step(state, coefficients, design, measurement, given)
            else:
                state = resume(state, coefficients, design, measurement)
            return (stamp_ns, 0, 0, passed_ns, mean_dt, coefficients, state, True), verdict
        if verdict == DUPLICATE:
            return track, DUPLICATE
        if verdict == LATE:
            return ((last_ns, before_ns, late + 1, dt_ns, mean_dt, coefficients, state, True),
                    LATE)
        if verdict == AFTER_GAP:
            passed = (stamp_ns - last_ns) * 1e-9
            if mean_dt == 0.0:
                mean_dt = passed
            else:
                # a stream that became slow is learnt in a few samples, one hole hardly counts
                mean_dt += RATE_WEIGHT * (min(passed, 50.0 * mean_dt) - mean_dt)
            return ((stamp_ns, last_ns, 0, dt_ns, mean_dt, coefficients,
                     resume(state, coefficients, design, measurement), True), AFTER_GAP)
        return ((stamp_ns, 0, 0, dt_ns, mean_dt, coefficients, init(measurement, design), True),
                AFTER_CLOCK_JUMP)

    def read(track: tuple, design: tuple, limits: tuple, measurement: Any,
             given: Any) -> tuple:
        """(position, velocity, acceleration or nan, status) of the newest estimate."""
        if track[4] > limits[2]:
            return math.nan, math.nan, math.nan, STATUS_MISCONFIGURED
        return output(track[6], track[5], design, measurement, given)

    def deviation(track: tuple, design: tuple) -> tuple[float, float]:
        """One standard deviation of position and velocity."""
        return stddev(track[6], track[5], design)

    return TrackFunctions(blank, advance, read, deviation)
