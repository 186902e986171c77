# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``base``: a base on wheels with encoders and a gyro; its wheels may slip.

The base drives and turns by smooth functions of time, and stands at the start. Its angles are the
integrals of the wheels' speeds, and its pose that of its twist, both with steps of 2 ms or less.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from estimator_pkg.errors import UsageError
from estimator_pkg.messages import odometry
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH, JointStates, in_order, sizes, told
from sim_pkg.contract import Message, Simulator, Topic
from sim_pkg.joints.second import GYRO, imu
from sim_pkg.joints.sensor import (
    RAW_COUNTS,
    SECOND,
    AngleSensor,
    Line,
    SensorParameters,
    random_stream,
)

TRUE_BASE = Topic('ground_truth/odometry', odometry.TYPE, truth=True)
CHUNK = 16  # samples made at a time
FINEST = 2e-3  # longest integration step [s]
DIFFERENTIAL, SKID, ACKERMANN = 'differential', 'skid', 'ackermann'
WHEELS = {
    DIFFERENTIAL: ('wheel_left_joint', 'wheel_right_joint'),
    SKID: ('wheel_left_joint', 'wheel_right_joint', 'rear_left_joint', 'rear_right_joint'),
    ACKERMANN: ('wheel_left_joint', 'wheel_right_joint', 'steering_joint'),
}


@dataclass(frozen=True)
class BaseParameters(SensorParameters):
    """The parameters of the simulator."""

    rate: float = structural(100.0, unit='Hz', range=(0.01, 1e5), description='samples per second')
    base: str = structural(
        DIFFERENTIAL,
        choices=(DIFFERENTIAL, SKID, ACKERMANN),
        description='two wheels, four wheels that skid, or two rear wheels and a steering joint',
    )
    radius: float = structural(
        0.1, unit='m', range=(1e-3, 10.0), description='radius of the wheels'
    )
    radius_difference: float = structural(
        0.0,
        range=(-0.5, 0.5),
        description='right wheels larger than radius by half of this, left ones smaller; relative',
    )
    track: float = structural(
        0.5, unit='m', range=(1e-2, 10.0), description='distance of left and right wheels'
    )
    slip_factor: float = structural(
        1.0, range=(0.1, 10.0), description='effective over geometric track, of skid steering'
    )
    wheelbase: float = structural(
        0.6, unit='m', range=(1e-2, 10.0), description='distance of the axles of a steered base'
    )
    speed: float = structural(
        0.8, unit='m/s', range=(-10.0, 10.0), description='mean speed of driving'
    )
    turn: float = structural(
        0.6, unit='rad/s', range=(0.0, 10.0), description='amplitude of the yaw rate'
    )
    turn_mean: float = structural(
        0.0, unit='rad/s', range=(-10.0, 10.0), description='mean yaw rate of driving'
    )
    stand: float = structural(
        2.0, unit='s', range=(0.0, 1e6), description='time at standstill at the start'
    )
    loop: float = structural(
        0.0,
        unit='m',
        range=(0.0, 1e4),
        description='length of the circles that it drives, one to the left and one to the right '
        'with a standstill before, between and after, instead of wandering; 0: none',
    )
    slip: float = structural(
        0.0,
        unit='m/s',
        range=(-10.0, 10.0),
        description='by how much the right wheels turn faster than the ground in a slip; 0: never',
    )
    slip_every: float = structural(
        8.0, unit='s', range=(0.1, 1e6), description='time from one slip to the next'
    )
    slip_length: float = structural(
        1.0, unit='s', range=(1e-3, 1e6), description='how long a slip lasts'
    )
    travel_noise: float = structural(
        0.0,
        unit='m',
        range=(0.0, 1.0),
        description='standard deviation of the distance of a wheel on 1 m of ground; it grows with '
        'the root of the distance',
    )
    gyro_noise: float = structural(
        0.005,
        unit='rad/s',
        range=(0.0, 10.0),
        description='standard deviation of each value of the gyro',
    )
    gyro_bias: float = structural(
        0.02, unit='rad/s', range=(-10.0, 10.0), description='bias of the gyro'
    )
    gyro_delay: float = structural(
        0.0, unit='s', range=(0.0, 1.0), description='stamps of the gyro are this much late'
    )

    def __post_init__(self) -> None:
        """Check what a range cannot express; raise UsageError."""
        super().__post_init__()
        if self.loop > 0.0 and self.speed == 0.0:
            raise UsageError("'loop' needs a speed: set 'speed' to other than 0")
        if self.convention == RAW_COUNTS:
            raise UsageError("convention 'raw_counts' carries one joint: choose another one")


class Plant:
    """The base: pose, and angles of its wheels, integrated from the start."""

    def __init__(self, parameters: BaseParameters, seed: int) -> None:
        self._p = parameters
        self._random = random_stream(seed, 'travel')
        self._time = 0.0
        self.pose = np.zeros(3)  # x [m], y [m], yaw [rad]
        self._travelled = np.zeros(2)  # by left and right wheels, as they turn [m]

    def twist(self, t: float) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] at t [s]."""
        p, driven = self._p, t - self._p.stand
        if driven <= 0.0:
            return 0.0, 0.0
        if p.loop > 0.0:
            length = p.loop / abs(p.speed)  # [s]
            number, since = divmod(driven, length + p.stand)
            if number > 1 or since > length:
                return 0.0, 0.0
            v = 2.0 * p.speed * math.sin(math.pi * since / length) ** 2
            return v, (1.0 - 2.0 * number) * 2.0 * math.pi * abs(v) / p.loop
        begun = 1.0 - math.exp(-driven * driven)  # smooth
        v = p.speed * begun * (1.0 + 0.25 * math.sin(0.7 * driven))
        w = begun * (
            p.turn_mean + p.turn * (0.7 * math.sin(0.9 * driven) + 0.3 * math.sin(2.3 * driven))
        )
        if p.base == ACKERMANN:  # it turns only as it drives
            w *= v / p.speed if p.speed else 0.0
        return v, w

    def slip(self, t: float) -> float:
        """Return by how much the right wheels turn faster than the ground at t [s], in m/s."""
        p = self._p
        within = (t - p.stand) % p.slip_every - 0.5 * p.slip_every
        if p.slip == 0.0 or t < p.stand or not 0.0 <= within < p.slip_length:
            return 0.0
        return p.slip * math.sin(math.pi * within / p.slip_length) ** 2

    def sides(self, t: float) -> tuple[float, float]:
        """Return what left and right wheels travel as they turn [m/s]."""
        (v, w), half = self.twist(t), 0.5 * self._p.track * self._p.slip_factor
        return v - w * half, v + w * half + self.slip(t)

    def go(self, t: float) -> None:
        """Integrate up to t [s], with Simpson's rule."""
        parts = max(1, math.ceil((t - self._time) / FINEST))
        h = (t - self._time) / parts
        for _ in range(parts):
            ends = [self._time + part * h for part in (0.0, 0.5, 1.0)]
            (v0, w0), (v1, w1), (v2, w2) = map(self.twist, ends)
            yaw = self.pose[2]
            middle = yaw + h * (5.0 * w0 + 8.0 * w1 - w2) / 24.0
            last = yaw + h * (w0 + 4.0 * w1 + w2) / 6.0
            self.pose[0] += (
                h * (v0 * math.cos(yaw) + 4.0 * v1 * math.cos(middle) + v2 * math.cos(last)) / 6.0
            )
            self.pose[1] += (
                h * (v0 * math.sin(yaw) + 4.0 * v1 * math.sin(middle) + v2 * math.sin(last)) / 6.0
            )
            self.pose[2] = last
            s0, s1, s2 = map(np.array, map(self.sides, ends))
            moved = h * (s0 + 4.0 * s1 + s2) / 6.0
            if self._p.travel_noise > 0.0:
                noise = self._random.standard_normal(2)
                moved = moved + self._p.travel_noise * np.sqrt(np.abs(moved)) * noise
            self._travelled += moved
            self._time = ends[2]

    def joints(self) -> tuple[list[float], list[float]]:
        """Return positions and velocities of the joints [rad, rad/s]."""
        p = self._p
        sides = self.sides(self._time)
        radii = [p.radius * (1.0 + sign * 0.5 * p.radius_difference) for sign in (-1.0, 1.0)]
        angles = [each / radius for each, radius in zip(self._travelled.tolist(), radii)]
        speeds = [each / radius for each, radius in zip(sides, radii)]
        if p.base == SKID:
            return angles * 2, speeds * 2
        if p.base == DIFFERENTIAL:
            return angles, speeds
        steering = [
            math.atan2(p.wheelbase * w, v) if v > 0.0 else 0.0
            for v, w in (self.twist(self._time + part) for part in (-1e-4, 0.0, 1e-4))
        ]
        return [*angles, steering[1]], [*speeds, (steering[2] - steering[0]) / 2e-4]


def generate(parameters: BaseParameters, duration: float, seed: int) -> Iterator[list[Message]]:
    """Yield chunks of messages; see `sim_pkg.contract`.

    The gyro is read in the middle between two readings of the wheels. The truth is that at the time
    of each reading of the wheels.
    """
    return in_order(_chunks(parameters, sizes(duration, parameters.rate, CHUNK), seed))


def _chunks(
    parameters: BaseParameters, counts: Iterator[int], seed: int
) -> Iterator[tuple[list[Message], int]]:
    p, plant, line = parameters, Plant(parameters, seed), Line(parameters, seed)
    names = WHEELS[p.base]
    sensors = [AngleSensor(p, seed, joint) for joint in range(len(names))]
    noise = random_stream(seed, 'gyro')
    offsets = random_stream(seed, 'offset').uniform(-math.pi, math.pi, len(names))
    if p.base == ACKERMANN:  # its steering is calibrated: no mean error
        offsets[2] = math.pi / p.counts_per_revolution if p.counts_per_revolution else 0.0
    measured, true = JointStates(MEASURED, names), JointStates(TRUTH, names)
    late, half = round(p.gyro_delay * SECOND), round(0.5 * p.period * SECOND)
    for count in counts:
        samples = line.carry(count)
        messages: list[Message] = []
        positions, velocities = np.empty((count, len(names))), np.empty((count, len(names)))
        for k, (taken, stamp, _, _) in enumerate(samples.rows()):
            if taken >= half:
                at = taken - half
                rate = plant.twist(at / SECOND)[1] + p.gyro_bias
                rate += p.gyro_noise * noise.standard_normal()
                messages.append(
                    Message(at, GYRO.name, partial(imu, at + late, rate, frame_id='base_link'))
                )
            plant.go(taken / SECOND)
            positions[k], velocities[k] = plant.joints()
            v, w = plant.twist(taken / SECOND)
            pose = tuple(plant.pose.tolist())
            messages.append(
                Message(taken, TRUE_BASE.name, partial(_odometry, stamp, pose, (v, 0.0, w)))
            )
        positions += offsets
        readings = np.column_stack([each.read(at) for each, at in zip(sensors, positions.T)])
        motions = zip(positions.tolist(), velocities.tolist())
        messages = [
            *told(measured, true, samples, readings.tolist(), [()] * count, motions),
            *messages,
        ]
        yield messages, samples.horizon_ns - half


def _odometry(
    stamp_ns: int, pose: tuple[float, ...], twist: tuple[float, ...], start_ns: int
) -> bytes:
    exact, frames = ((0.0,) * 3,) * 3, ('odom', 'base_link')
    return odometry.encode(start_ns + stamp_ns, frames, pose, exact, twist, exact)


SIMULATOR = Simulator(
    name='base',
    summary='a base on wheels with encoders and a gyro; its wheels may slip',
    parameters=BaseParameters,
    topics=lambda p: (MEASURED, GYRO, TRUTH, TRUE_BASE),
    generate=generate,
)
