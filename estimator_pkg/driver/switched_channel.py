# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The samples of a switched system through guard and observer; see `driver.channel`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from estimator_pkg.driver.channel import advance
from estimator_pkg.observers.switched.state import (
    Coefficients,
    Design,
    OutputDeviations,
    OutputEstimates,
    State,
)
from estimator_pkg.record import record
from estimator_pkg.sensor.clock import Clock
from estimator_pkg.sensor.guard import DUPLICATE, NON_FINITE, Limits


@record
class Track:
    """What is known of a system: of its clock, and its motion."""

    clock: Clock
    coefficients: Coefficients
    state: State
    state_before_gap: State  # before the last gap, in case that stamp is a stray one


@record
class Channel:
    """One system: what its gains imply, what is known of it, what came, the newest estimate."""

    design: Design
    limits: Limits
    track: Track
    verdict: int  # on the newest sample
    counts: Annotated[list[int], 12]  # of the samples, by verdict
    stamp_ns: int  # of the newest sample that was used
    measurement: list[float]  # one number per output [rad or m]
    known_input: list[float]
    estimate: OutputEstimates
    deviation: OutputDeviations


def reset_channel(observer: Any, channel: Channel) -> None:
    """Set everything before the first sample."""
    model, track, blank = observer.model, channel.track, Clock()
    track.clock.take(blank)
    channel.measurement = [0.0] * len(model.indices)
    channel.known_input = [0.0] * len(model.probe(0.0))
    observer.prepare(track.coefficients, channel.design, 1e-3)
    observer.start(observer, track.state, channel.design, channel.measurement)


def take(
    observer: Any,
    channel: Channel,
    stamp_ns: int,
    measurement: Sequence[float],
    known_input: Sequence[float],
) -> int:
    """Take one sample and count it; return the verdict."""
    verdict = NON_FINITE
    if len(measurement) == len(observer.model.indices):
        verdict = advance(
            observer,
            channel.track,
            channel.design,
            channel.limits,
            stamp_ns,
            measurement,
            known_input,
        )
    channel.verdict = verdict
    channel.counts[verdict] += 1
    if verdict < DUPLICATE:
        channel.stamp_ns = stamp_ns
        channel.measurement[:] = measurement
        channel.known_input[:] = known_input
    return verdict


def write_estimate(observer: Any, channel: Channel) -> None:
    """Set the estimate at the last used sample."""
    observer.estimate(
        observer,
        channel.estimate,
        channel.track.state,
        channel.track.coefficients,
        channel.design,
        channel.measurement,
        channel.known_input,
    )


def write_deviation(observer: Any, channel: Channel) -> None:
    """Set one standard deviation of each output."""
    observer.deviation(
        observer,
        channel.deviation,
        channel.track.state,
        channel.track.coefficients,
        channel.design,
        1.0,
    )
