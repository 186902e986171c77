# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A mechanism's samples through guard and observer; see `driver.channel`, for a single angle."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.channel import advance
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED
from estimator_pkg.models.mechanics import Vector
from estimator_pkg.observers.mechanism.algebra import is_finite
from estimator_pkg.observers.mechanism.core import MechanismEstimate
from estimator_pkg.observers.mechanism.state import Coefficients, Design, State
from estimator_pkg.record import record
from estimator_pkg.sensor.clock import Clock
from estimator_pkg.sensor.guard import DUPLICATE, NON_FINITE, Limits


@record
class Track:
    """What is known of a mechanism: of its clock, and its motion."""

    clock: Clock
    coefficients: Coefficients
    state: State
    state_before_gap: State  # before the last gap, in case that stamp is a stray one


@record
class Channel:
    """One mechanism: what its gains imply, what is known of it, what came, the newest estimate."""

    design: Design
    limits: Limits
    track: Track
    verdict: int  # on the newest sample
    counts: Annotated[list[int], 12]  # of the samples, by verdict
    stamp_ns: int  # of the newest sample that was used
    measurement: Vector  # the newest positions, used or not [rad or m]
    known_input: Vector  # since the last sample
    estimate: MechanismEstimate


def reset_channel(observer: Any, channel: Channel) -> None:
    """Set everything before the first sample."""
    blank = Clock()
    channel.track.clock.take(blank)
    observer.prepare(channel.track.coefficients, channel.design, 1e-3)


def take(observer: Any, channel: Channel, stamp_ns: int) -> int:
    """Take the sample in `measurement` and `known_input`, and count it; return the verdict."""
    verdict = NON_FINITE
    if is_finite(observer.model.JOINTS, channel.measurement):
        verdict = advance(
            observer,
            channel.track,
            channel.design,
            channel.limits,
            stamp_ns,
            channel.measurement,
            channel.known_input,
        )
    channel.verdict = verdict
    channel.counts[verdict] += 1
    if verdict < DUPLICATE:
        channel.stamp_ns = stamp_ns
    return verdict


def write_estimate(observer: Any, channel: Channel) -> None:
    """Set the estimate at the last used sample; positions and velocities only if there is one."""
    out, track = channel.estimate, channel.track
    if not track.clock.running:
        out.status = INITIALISING
    elif track.clock.mean_dt > channel.limits.longest_dt:
        out.status = MISCONFIGURED
    else:
        state = track.state
        observer.estimate(
            observer,
            out,
            state,
            track.coefficients,
            channel.design,
            state.before,
            channel.known_input,
        )


def batch(
    observer: Any,
    channel: Channel,
    count: int,
    stamps: NDArray[np.int64],
    measurements: NDArray[np.float64],
    inputs: NDArray[np.float64],
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    status: NDArray[np.int8],
    verdicts: NDArray[np.int8],
) -> None:
    """Take `count` samples.

    Parameters
    ----------
    measurements, positions, velocities : shape (count, n), flat. Where a sample was not used, or
        gave no estimate, the row of the results stays.
    inputs : shape (count, max(1, m)), flat.
    """
    n, m = observer.model.JOINTS, max(1, observer.model.INPUTS)
    out = channel.estimate
    for k in range(count):
        for i in range(n):
            channel.measurement[i] = measurements[k * n + i]
        for i in range(m):
            channel.known_input[i] = inputs[k * m + i]
        verdicts[k] = take(observer, channel, stamps[k])
        write_estimate(observer, channel)
        status[k] = out.status
        if verdicts[k] < DUPLICATE and out.status != MISCONFIGURED:
            for i in range(n):
                positions[k * n + i] = out.position[i]
                velocities[k * n + i] = out.velocity[i]
