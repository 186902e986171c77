# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One drive's samples through guard and observer, as `channel` is for a single angle."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver import channel as single
from estimator_pkg.driver.channel import Frame, Track, advance
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED, Deviation, Estimate
from estimator_pkg.observers.pmsm.drive import DriveSample, Electrical, ElectricalDeviation
from estimator_pkg.record import record
from estimator_pkg.sensor.guard import AFTER_GAP, DUPLICATE, Limits
from estimator_pkg.sensor.turns import Turns

LONGEST_COAST = 10**9  # longest gap over which the angle is extrapolated [ns]


@record
class Channel:
    """One drive: what its gains imply, what is known of it, what came, and the newest estimate."""

    design: observer.Design  # type: ignore[name-defined]  # noqa: F821  (bound by `Channel.of`)
    limits: Limits
    track: Track
    turns: Turns  # not used: an electrical angle has none
    wrapped: Frame
    counted: Frame
    verdict: int  # on the newest sample
    counts: Annotated[list[int], 12]  # of the samples, by verdict
    stamp_ns: int  # of the newest sample that was used
    measurement: DriveSample  # the newest sample that was used
    taken: DriveSample  # the newest sample
    known_input: float  # 0: there is none beside the sample
    estimate: Estimate  # mechanical
    deviation: Deviation
    electrical: Electrical
    electrical_deviation: ElectricalDeviation
    speed_bound: float  # of the mechanical speed, see `observers.pmsm.drive` [rad/s]


def reset_channel(observer: Any, channel: Channel) -> None:
    """Set everything before the first sample."""
    nothing = DriveSample()
    single.use_frame(channel, channel.wrapped)
    single.reset_track(observer, channel.track, channel.design)
    observer.start(observer, channel.track.state, channel.design, nothing)


def take(
    observer: Any,
    channel: Channel,
    stamp_ns: int,
    i_alpha: float,
    i_beta: float,
    u_alpha: float,
    u_beta: float,
) -> int:
    """Take one sample [A], [V] and count it; return the verdict."""
    taken, track = channel.taken, channel.track
    taken.i_alpha, taken.i_beta, taken.u_alpha, taken.u_beta = i_alpha, i_beta, u_alpha, u_beta
    last_ns = track.clock.last_ns
    verdict = advance(observer, track, channel.design, channel.limits, stamp_ns, taken, 0.0)
    channel.verdict = verdict
    channel.counts[verdict] += 1
    if verdict < DUPLICATE:
        channel.stamp_ns = stamp_ns
        used = channel.measurement
        used.i_alpha, used.i_beta, used.u_alpha, used.u_beta = i_alpha, i_beta, u_alpha, u_beta
        if verdict == AFTER_GAP and stamp_ns - last_ns <= LONGEST_COAST:
            observer.coast(track.state, (stamp_ns - last_ns) * 1e-9)
    return verdict


def write_estimate(observer: Any, channel: Channel) -> None:
    """Set the mechanical and the electrical estimate at the last used sample."""
    out, track, design = channel.estimate, channel.track, channel.design
    observer.electrical(channel.electrical, track.state, design)
    out.position = out.velocity = out.acceleration = math.nan
    if not track.clock.running:
        out.status = INITIALISING
    elif track.clock.mean_dt > channel.limits.longest_dt:
        out.status = MISCONFIGURED
    else:
        observer.estimate(
            observer, out, track.state, track.coefficients, design, channel.measurement, 0.0
        )


def write_deviation(observer: Any, channel: Channel) -> None:
    """Set one standard deviation of each, and the bound of the speed."""
    design, track = channel.design, channel.track
    state, coefficients = track.state, track.coefficients
    observer.deviation(observer, channel.deviation, state, coefficients, design, 1.0)
    observer.electrical_deviation(channel.electrical_deviation, state, coefficients, design)
    channel.speed_bound = observer.speed_bound(state, coefficients, design)


def batch(
    observer: Any,
    channel: Channel,
    count: int,
    stamps: NDArray[np.int64],
    samples: NDArray[np.float64],
    rows: NDArray[np.float64],
    status: NDArray[np.int8],
    reasons: NDArray[np.int32],
    verdicts: NDArray[np.int8],
) -> None:
    """Take many samples.

    Parameters
    ----------
    stamps : shape (count,) [ns]. samples : shape (4 count,), rows of [A], [A], [V], [V].
    rows : shape (4 count,), rows of (angle, speed, flux linkage, valid), electrical; not changed
        where the sample is dropped, nor are `status` and `reasons`. The others: shape (count,).
    """
    out = channel.electrical
    for k in range(count):
        at = 4 * k
        verdict = take(
            observer,
            channel,
            stamps[k],
            samples[at],
            samples[at + 1],
            samples[at + 2],
            samples[at + 3],
        )
        verdicts[k] = verdict
        if verdict < DUPLICATE:
            observer.electrical(out, channel.track.state, channel.design)
            rows[at], rows[at + 1], rows[at + 2] = out.angle, out.speed, out.flux
            rows[at + 3] = out.valid
            status[k], reasons[k] = out.status, out.reasons


def trace(
    observer: Any,
    states: list[observer.State],  # type: ignore[name-defined]  # noqa: F821
    coefficients: observer.Coefficients,  # type: ignore[name-defined]  # noqa: F821
    design: observer.Design,  # type: ignore[name-defined]  # noqa: F821
    count: int,
    samples: NDArray[np.float64],
) -> None:
    """Set `states[k]` to that after sample k from the state before, for k from 1 to `count`.

    Parameters
    ----------
    samples : shape (4 count,), without the sample of `states[0]`.
    """
    sample = DriveSample()
    for k in range(count):
        at = 4 * k
        sample.i_alpha, sample.i_beta = samples[at], samples[at + 1]
        sample.u_alpha, sample.u_beta = samples[at + 2], samples[at + 3]
        states[k + 1].take(states[k])
        observer.step(observer, states[k + 1], coefficients, design, sample, 0.0)
