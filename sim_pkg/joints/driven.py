# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints as streams of messages: angle and effort of a joint that an input drives, and the truth.

The drive takes a new input at each sample and keeps it constant until the next. A measurement
carries the angle at its stamp and, as its effort, the input since the previous sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.models.motion import move
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH, JointStates, in_order, sizes, told
from sim_pkg.contract import Message, Topic, check_rate
from sim_pkg.joints.sensor import (
    MULTI_TURN,
    SECOND,
    SIGNED,
    UNSIGNED,
    AngleSensor,
    Line,
    SensorParameters,
)

EVENTS = Topic('switch_event', JOINT_STATE)
CHUNK = 64  # samples made at a time
SUBSTEP = 1e-3  # longest integration step [s]
PART = 0.2  # longest integration step over the fastest time constant


@dataclass(frozen=True)
class DrivenParameters(SensorParameters):
    """Parameters that all driven joints share."""

    joint: str = structural('joint', description='name of the joint')
    start: float = structural(0.0, unit='rad', range=(-1e3, 1e3), description='angle at the start')
    convention: str = structural(  # not raw_counts: they carry no effort
        SIGNED,
        choices=(SIGNED, UNSIGNED, MULTI_TURN),
        description='wrap convention of the angle: [-pi, pi), [0, 2 pi), or multi-turn',
    )

    def __post_init__(self) -> None:
        """Check what a range cannot express; raise UsageError."""
        super().__post_init__()
        if not self.joint:
            raise UsageError("parameter 'joint' must not be empty: set a joint name")
        check_rate(self.fastest)

    @property
    def fastest(self) -> float:
        """An upper bound of the joint's rates [1/s]."""
        raise NotImplementedError


class Plant:
    """A joint: its acceleration, its input, its events."""

    def input(self, t: float) -> float:
        """Return the input that the drive applies from t [s] on."""
        raise NotImplementedError

    def acceleration(self, q: float, v: float, u: float) -> float:
        """Return q'' [rad/s^2]."""
        raise NotImplementedError

    def stick(self, q: float, before: float, w: float, u: float) -> float:
        """Return the velocity [rad/s] after a step w, corrected for Coulomb friction."""
        return w

    def event(self, first: float, last: float) -> tuple[float, str] | None:
        """Return (time [s], mode) of the first event with first < time <= last, else None."""
        return None

    def begin(self, t: float) -> None:
        """Start the mode that the event at t [s] switches to."""


def advance(
    plant: Plant, q: float, w: float, duration: float, u: float, longest: float = SUBSTEP
) -> tuple[float, float]:
    """Return (q, w) after `duration` [s] at constant input, in steps of up to `longest` [s]."""
    count = max(1, math.ceil(duration / longest - 1e-9))
    for _ in range(count):
        before = w
        q, w = move(plant, q, w, u, duration / count, 1)
        w = plant.stick(q, before, w, u)
    return q, w


def stream(
    plant: Plant, parameters: DrivenParameters, duration: float, seed: int
) -> Iterator[list[Message]]:
    """Yield chunks of messages (see `sim_pkg.contract`); the truth is that at the stamp."""
    return in_order(_chunks(plant, parameters, sizes(duration, parameters.rate, CHUNK), seed))


def _chunks(
    plant: Plant, parameters: DrivenParameters, counts: Iterator[int], seed: int
) -> Iterator[tuple[list[Message], int]]:
    sensor, line = AngleSensor(parameters, seed), Line(parameters, seed)
    measured, true = (JointStates(each, (parameters.joint,)) for each in (MEASURED, TRUTH))
    q, w, last, u = parameters.start, 0.0, 0.0, 0.0
    longest = min(SUBSTEP, PART / max(parameters.fastest, 1e-9))
    for count in counts:
        samples = line.carry(count)
        angles, efforts, motions = [], [], []
        messages: list[Message] = []
        for taken_ns, stamp_ns, _, _ in samples.rows():
            taken = taken_ns / SECOND
            event = plant.event(last, taken)
            if event is not None:
                at, mode = event
                if at > last:
                    q, w = advance(plant, q, w, at - last, u, longest)
                    last = at
                plant.begin(at)
                at_ns = round(at * SECOND)
                messages.append(JointStates(EVENTS, (mode,)).message(at_ns, at_ns, ()))
            if taken > last:
                q, w = advance(plant, q, w, taken - last, u, longest)
            ahead = (stamp_ns - taken_ns) / SECOND  # not 0 if stamps are wrong
            angles.append(q)
            efforts.append((u,))
            motions.append(((q + ahead * w,), (w,)))
            last, u = taken, plant.input(taken)
        readings = sensor.read(np.array(angles))[:, None].tolist()
        messages += told(measured, true, samples, readings, efforts, motions)
        yield messages, samples.horizon_ns
