# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Second sensors of a joint: a gyro on the link, and the encoder of its motor, with backlash."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator_pkg.messages.cdr import Writer
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.parameters import structural
from sim_pkg.chunks import JointStates
from sim_pkg.contract import Message, Topic
from sim_pkg.joints.profiles import Profile
from sim_pkg.joints.sensor import SECOND, SIGNED, TURN, Floats, Samples, random_stream, written

GYRO = Topic('imu', 'sensor_msgs/msg/Imu')
MOTOR = Topic('motor/joint_states', JOINT_STATE)


@dataclass(frozen=True)
class SecondParameters:
    """Second sensors of the first joint; by default there is none."""

    gyro_rate: float = structural(
        0.0,
        unit='Hz',
        range=(0.0, 1e5),
        description='values per second of a gyro on the first joint, on the topic imu; at most '
        'one with each sample; 0: no gyro',
    )
    gyro_noise: float = structural(
        0.005, unit='rad/s', range=(0.0, 10.0), description='standard deviation of its white noise'
    )
    gyro_bias: float = structural(
        0.03, unit='rad/s', range=(-10.0, 10.0), description='constant error of the gyro'
    )
    gyro_delay: float = structural(
        0.0, unit='s', range=(0.0, 1.0), description='delay of its stamps and of its messages'
    )
    motor_ratio: float = structural(
        0.0,
        range=(-1e4, 1e4),
        description="turns of the first joint's motor per turn of the joint; its encoder, with "
        'the same resolution, is on the topic motor/joint_states; 0: no such encoder',
    )
    backlash: float = structural(
        0.0,
        unit='rad',
        range=(0.0, 1.0),
        description='play of the first joint: the profile moves its motor, the joint follows',
    )


class Play:
    """A shaft that follows its motor with play, without inertia.

    Parameters
    ----------
    motor : its motion. backlash : [rad].
    """

    def __init__(self, motor: Profile, backlash: float) -> None:
        self._motor, self._half = motor, 0.5 * backlash
        self._at = 0.0

    def motions(self, *times: Floats) -> list[tuple[Floats, Floats]]:
        """Return position and velocity at times of a chunk of samples [s], each of shape (n,).

        The first ones are those of sampling.
        """
        found = [self._motor(each)[:2] for each in times]
        if not self._half:
            return found
        before = np.empty(len(times[0]))
        for k, angle in enumerate(found[0][0].tolist()):
            before[k] = self._at
            self._at = min(max(self._at, angle - self._half), angle + self._half)
        followed = [np.clip(before, q - self._half, q + self._half) for q, _ in found]
        return [(q, np.where(q != before, w, 0.0)) for q, (_, w) in zip(followed, found)]


class SecondSensors:
    """The gyro and the encoder of the motor, as messages."""

    def __init__(
        self, parameters: SecondParameters, counts: int, joint: str, motor: Profile, seed: int
    ) -> None:
        self._p, self._counts, self._motor = parameters, counts, motor
        self._noise = random_stream(seed, 'gyro')
        self._tick, self._turned = -1.0, JointStates(MOTOR, (joint,))

    def messages(self, samples: Samples, speed: Floats) -> Iterator[Message]:
        """Yield the messages of a chunk of samples; speed of the joint [rad/s], shape (n,)."""
        p, taken = self._p, samples.taken_ns / SECOND
        if p.gyro_rate > 0.0:
            ticks = np.floor(taken * p.gyro_rate + 1e-6)
            values = speed - p.gyro_bias + p.gyro_noise * self._noise.standard_normal(len(speed))
            for k in np.flatnonzero(np.diff(ticks, prepend=self._tick) > 0.0).tolist():
                stamp = int(samples.taken_ns[k]) + round(p.gyro_delay * SECOND)
                yield Message(stamp, GYRO.name, partial(imu, stamp, float(values[k])))
            self._tick = ticks[-1]
        if p.motor_ratio != 0.0:
            angle, counts = p.motor_ratio * self._motor(taken)[0], self._counts
            angle = written(np.floor(angle * counts / TURN) if counts else angle, counts, SIGNED)
            for stamp, reading in zip(samples.taken_ns.tolist(), angle.tolist()):
                yield self._turned.message(stamp, stamp, (reading,))


def imu(stamp_ns: int, rate: float, start_ns: int, frame_id: str = '') -> bytes:
    """Encode a sensor_msgs/Imu with a rate about z, without orientation and acceleration."""
    writer = Writer()
    writer.numbers('i', ((start_ns + stamp_ns) // SECOND,))
    writer.numbers('I', ((start_ns + stamp_ns) % SECOND,))
    writer.text(frame_id)
    unknown, exact = (-1.0, *[0.0] * 8), (0.0,) * 9
    writer.numbers('d', (0.0, 0.0, 0.0, 1.0, *unknown, 0.0, 0.0, rate, *exact, 0.0, 0.0, 0.0))
    writer.numbers('d', unknown)
    return bytes(writer.raw)
