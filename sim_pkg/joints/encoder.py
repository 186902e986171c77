# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``encoder``: joints that follow a profile, measured by encoders with faults."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.messages.cdr import Writer
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH, JointStates, in_order, sizes, told
from sim_pkg.contract import Message, Simulator, Topic
from sim_pkg.joints.profiles import ProfileParameters, make_profile
from sim_pkg.joints.second import GYRO, MOTOR, Play, SecondParameters, SecondSensors
from sim_pkg.joints.sensor import (
    RAW_COUNTS,
    SECOND,
    AngleSensor,
    Line,
    SensorParameters,
    random_stream,
)

COUNTS = Topic('angle', 'std_msgs/msg/Int32')
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


def generate(parameters: EncoderParameters, duration: float, seed: int) -> Iterator[list[Message]]:
    """Yield chunks of `CHUNK` samples: measurement and truth (see `sim_pkg.contract`).

    The truth is the continuous position and velocity at the time of the measurement's stamp, for
    every sample, also for those that do not arrive.
    """
    return in_order(_chunks(parameters, sizes(duration, parameters.rate, CHUNK), seed))


def _chunks(
    parameters: EncoderParameters, counts: Iterator[int], seed: int
) -> Iterator[tuple[list[Message], int]]:
    p, joints = parameters, range(len(parameters.joints))
    motors = [
        make_profile(p, random_stream(seed, 'profile', joint), ratio=p.joint_ratio**joint)
        for joint in joints
    ]
    shafts = [Play(motor, 0.0 if joint else p.backlash) for joint, motor in enumerate(motors)]
    sensors, line = [AngleSensor(p, seed, joint) for joint in joints], Line(p, seed)
    second = SecondSensors(p, p.counts_per_revolution, p.joints[0], motors[0], seed)
    measured = Counts(COUNTS, ()) if p.convention == RAW_COUNTS else JointStates(MEASURED, p.joints)
    true = JointStates(TRUTH, p.joints)
    for count in counts:
        samples = line.carry(count)
        times = samples.taken_ns / SECOND, samples.stamp_ns / SECOND
        taken, stamped = zip(*(shaft.motions(*times) for shaft in shafts))
        readings = np.array([sensor.read(at) for sensor, (at, _) in zip(sensors, taken)]).T
        motions = np.array(stamped).transpose(2, 1, 0)
        messages = [
            *second.messages(samples, taken[0][1]),
            *told(measured, true, samples, readings.tolist(), [()] * count, motions.tolist()),
        ]
        yield messages, samples.horizon_ns


class Counts(JointStates):
    """Makes messages of one count; an Int32 carries no stamp."""

    def message(
        self,
        due_ns: int,
        stamp_ns: int,
        positions: Sequence[float],
        velocities: Sequence[float] = (),
        efforts: Sequence[float] = (),
    ) -> Message:
        """Return a message with the only position."""
        writer = Writer()
        writer.numbers('i', (int(positions[0]),))
        return Message(due_ns, COUNTS.name, lambda start_ns: bytes(writer.raw))


SIMULATOR = Simulator(
    name='encoder',
    summary='joints that follow a profile, measured by encoders with faults',
    parameters=EncoderParameters,
    topics=topics,
    generate=generate,
)
