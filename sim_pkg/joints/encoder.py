# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``encoder``: joints that follow a profile, measured by encoders with faults."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.messages.cdr import Writer
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.parameters import structural
from sim_pkg.chunks import JointStates, in_order, sizes
from sim_pkg.contract import Message, Simulator, Topic
from sim_pkg.joints.profiles import Profile, ProfileParameters, make_profile
from sim_pkg.joints.second import GYRO, MOTOR, Play, SecondParameters, SecondSensors
from sim_pkg.joints.sensor import (
    RAW_COUNTS,
    SECOND,
    AngleSensor,
    Floats,
    Line,
    SensorParameters,
    Whole,
    random_stream,
)

MEASURED = Topic('joint_states', JOINT_STATE)
COUNTS = Topic('angle', 'std_msgs/msg/Int32')
TRUTH = Topic('ground_truth/joint_states', JOINT_STATE, truth=True)

CHUNK = 64  # samples made at a time: few, so that none is published late


@dataclass(frozen=True)
class EncoderParameters(ProfileParameters, SensorParameters, SecondParameters):
    """The parameters of the simulator."""

    joints: tuple[str, ...] = structural(
        ('wheel',), description='names of the joints; each has its own sensor'
    )
    joint_ratio: float = structural(
        0.8,
        range=(-10.0, 10.0),
        description='the motion of each further joint over that of the joint before it',
    )

    def __post_init__(self) -> None:
        """Check what a range cannot express; raise UsageError."""
        super().__post_init__()
        if not self.joints or not all(self.joints):
            raise UsageError("parameter 'joints' needs at least one name, and no empty one")
        if len(set(self.joints)) < len(self.joints):
            raise UsageError("parameter 'joints' names a joint twice: give each a different name")
        if self.convention == RAW_COUNTS and len(self.joints) > 1:
            raise UsageError(
                f"convention 'raw_counts' carries one joint, but 'joints' names "
                f'{len(self.joints)}: name one, or choose another convention'
            )


def topics(parameters: EncoderParameters) -> tuple[Topic, ...]:
    """Return the topics: measurement, second sensors and truth."""
    return (
        COUNTS if parameters.convention == RAW_COUNTS else MEASURED,
        *((GYRO,) if parameters.gyro_rate > 0.0 else ()),
        *((MOTOR,) if parameters.motor_ratio != 0.0 else ()),
        TRUTH,
    )


class Shaft:
    """One joint: its motion and its sensor."""

    def __init__(self, parameters: EncoderParameters, seed: int, joint: int) -> None:
        self.motor: Profile = make_profile(
            parameters, random_stream(seed, 'profile', joint), ratio=parameters.joint_ratio**joint
        )
        self.play = Play(self.motor, parameters.backlash if joint == 0 else 0.0)
        self.sensor = AngleSensor(parameters, seed, joint)


def generate(parameters: EncoderParameters, duration: float, seed: int) -> Iterator[list[Message]]:
    """Yield chunks of `CHUNK` samples: measurement and truth (see `sim_pkg.contract`).

    The truth is the continuous position and velocity at the time of the measurement's stamp, for
    every sample, also for those that do not arrive.
    """
    return in_order(_chunks(parameters, sizes(duration, parameters.rate, CHUNK), seed))


def _chunks(
    parameters: EncoderParameters, counts: Iterator[int], seed: int
) -> Iterator[tuple[list[Message], int]]:
    shafts = [Shaft(parameters, seed, joint) for joint in range(len(parameters.joints))]
    line, p = Line(parameters, seed), parameters
    second = SecondSensors(p, p.counts_per_revolution, p.joints[0], shafts[0].motor, seed)
    measured, true = JointStates(MEASURED, p.joints), JointStates(TRUTH, p.joints)
    for count in counts:
        samples = line.carry(count)
        taken, stamped = _seconds(samples.taken_ns), _seconds(samples.stamp_ns)
        moved = [tuple(shaft.play.motions(taken, stamped)) for shaft in shafts]
        readings = np.array([shaft.sensor.read(at[0]) for shaft, (at, _) in zip(shafts, moved)]).T
        motions = np.array([at_stamp for _, at_stamp in moved]).transpose(2, 1, 0)
        messages = list(second.messages(samples, moved[0][0][1]))
        for stamp, taken_ns, due, copies, reading, (position, velocity) in zip(
            samples.stamp_ns.tolist(),
            samples.taken_ns.tolist(),
            samples.due_ns.tolist(),
            samples.copies.tolist(),
            readings.tolist(),
            motions.tolist(),
        ):
            if p.convention == RAW_COUNTS:
                message = Message(due, COUNTS.name, partial(_count, reading[0]))
            else:
                message = measured.message(due, stamp, reading)
            messages += [message] * copies
            messages.append(true.message(taken_ns, stamp, position, velocity))
        yield messages, samples.horizon_ns


def _seconds(nanoseconds: Whole) -> Floats:
    return nanoseconds.astype(np.float64) / SECOND


def _count(reading: float, start_ns: int) -> bytes:
    """Encode one count; an Int32 carries no stamp."""
    writer = Writer()
    writer.numbers('i', (int(reading),))
    return bytes(writer.raw)


SIMULATOR = Simulator(
    name='encoder',
    summary='joints that follow a profile, measured by encoders with faults',
    parameters=EncoderParameters,
    topics=topics,
    generate=generate,
)
