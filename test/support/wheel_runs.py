# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated bases through the stream of `wheel_odometry`."""

from typing import NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore

from estimator_pkg.bags.definitions import fields_of
from estimator_pkg.messages.field import Field
from estimator_pkg.parameters import build
from estimator_pkg.streams.wheels import WheelStream
from sim_pkg.mechanisms import base

QUANTUM = 2.0 * np.pi / 4096
STORE = get_typestore(Stores.ROS2_JAZZY)
IMU = fields_of('sensor_msgs/msg/Imu', '')
START = 10**18
PLANE = [0, 1, 5]
SKID = {
    'wheels_left': ['wheel_left_joint', 'rear_left_joint'],
    'wheels_right': ['wheel_right_joint', 'rear_right_joint'],
}


class Odometry(NamedTuple):
    """Pose and twist in the plane, x, y and yaw, with their covariances, shape (3, 3)."""

    stamp_ns: int
    pose: np.ndarray
    pose_covariance: np.ndarray
    twist: np.ndarray
    twist_covariance: np.ndarray


def decode(raw):
    """Return the `Odometry` of CDR bytes."""
    message = STORE.deserialize_cdr(raw, 'nav_msgs/msg/Odometry')
    stamp, (pose, twist) = message.header.stamp, (message.pose, message.twist)
    at, turned = pose.pose.position, pose.pose.orientation
    return Odometry(
        stamp.sec * 10**9 + stamp.nanosec,
        np.array([at.x, at.y, 2.0 * np.arctan2(turned.z, turned.w)]),
        pose.covariance.reshape(6, 6)[np.ix_(PLANE, PLANE)],
        np.array([twist.twist.linear.x, twist.twist.linear.y, twist.twist.angular.z]),
        twist.covariance.reshape(6, 6)[np.ix_(PLANE, PLANE)],
    )


class Run(NamedTuple):
    """Rows of answered messages: estimates (n, 3) and covariances (n, 3, 3), and the truth."""

    time: np.ndarray
    pose: np.ndarray
    pose_covariance: np.ndarray
    twist: np.ndarray
    twist_covariance: np.ndarray
    true_pose: np.ndarray
    true_twist: np.ndarray
    stream: WheelStream
    notices: list


def messages(plant, duration, seed):
    """Every message of a simulated base as (topic, time [ns], CDR bytes)."""
    for chunk in base.generate(build(base.BaseParameters, plant), duration, seed):
        for message in chunk:
            yield message.topic, START + message.due_ns, message.encode(START)


def made(plant=None, **values):
    """A stream for a simulated base; `plant` : its parameters, of which it knows the nominal."""
    plant = plant or {}
    values = {'radius': [0.1], 'track': 0.5, 'quantum': QUANTUM, **values}
    if plant.get('base') == base.SKID:
        values = {**SKID, **values}
    if plant.get('base') == base.ACKERMANN:
        values = {'steering': 'steering_joint', 'wheelbase': 0.6, **values}
    stream = WheelStream.of(values)
    if values.get('gyro_topic'):
        kind = 'sensor_msgs/msg/Imu'
        stream.read_field(Field(IMU, kind, 'angular_velocity.z'), 1)
    return stream


def run(plant, duration, seed, stream):
    """Run a simulated base; returns a `Run`."""
    found, truth, notices = [], {}, []
    for topic, at_ns, raw in messages(plant, duration, seed):
        if topic == base.TRUE_BASE.name:
            true = decode(raw)
            truth[true.stamp_ns] = true
        elif topic == base.MEASURED.name or (topic == base.GYRO.name and len(stream.inputs) > 1):
            for answer in stream.feed(int(topic == base.GYRO.name), raw, at_ns):
                if 2 in answer:
                    found.append(decode(answer[2]))
            notices += stream.notices()
    rows = [each for each in found if each.stamp_ns in truth]
    true = [truth[each.stamp_ns] for each in rows]
    return Run(
        np.array([(each.stamp_ns - START) * 1e-9 for each in rows]),
        *(
            np.array([getattr(each, name) for each in rows])
            for name in ('pose', 'pose_covariance', 'twist', 'twist_covariance')
        ),
        np.array([each.pose for each in true]),
        np.array([each.twist for each in true]),
        stream,
        notices,
    )


def covered(result, after=3.0):
    """Fraction of the yaw rates within 1.96 of their standard deviations, after a time [s]."""
    rows = result.time > after
    error = result.twist[rows, 2] - result.true_twist[rows, 2]
    return float(np.mean(np.abs(error) < 1.96 * np.sqrt(result.twist_covariance[rows, 2, 2])))


def nees(result):
    """Squared error of the last pose, normalised by its covariance."""
    error = result.pose[-1] - result.true_pose[-1]
    error[2] = (error[2] + np.pi) % (2.0 * np.pi) - np.pi
    return float(error @ np.linalg.solve(result.pose_covariance[-1], error))
