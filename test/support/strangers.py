# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A driver and its consumers as others write them: plain rclpy, in processes of their own.

    python strangers.py driver CASE...       # publishes until it is interrupted
    python strangers.py consumers CASE...    # prints every message as one line of JSON

CASE is TOPIC,RELIABILITY,DURABILITY,RATE,VELOCITY for the driver, and TOPIC,RELIABILITY,DURABILITY,
DEPTH for a consumer. Nothing here is of this package.
"""

import json
import math
import sys
import threading
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

NAMES = [
    'shoulder_pan_joint',
    'shoulder_lift_joint',
    'elbow_joint',
    'wrist_1_joint',
    'wrist_2_joint',
    'wrist_3_joint',
]
DRIFT = [0.3, -0.2, 0.1, 0.0, -0.3, 0.4]  # [rad/s] at most, of a slow sine
SLOW, SWING, PACE = 2.0 * math.pi * 0.01, 0.3, 2.0 * math.pi * 0.2  # [rad/s, rad, rad/s]
TURN = 100 * 10**9  # [ns] after which both sines repeat


def motion(stamp_ns):
    """The positions and velocities of all joints at a stamp."""
    t = stamp_ns % TURN * 1e-9
    found = []
    for joint, drift in enumerate(DRIFT):
        slow, phase = SLOW * t, PACE * t + joint
        position = drift / SLOW * math.sin(slow) + SWING * math.sin(phase)
        found.append((position, drift * math.cos(slow) + SWING * PACE * math.cos(phase)))
    return [each[0] for each in found], [each[1] for each in found]


def efforts(count):
    """The efforts in the message number `count` of a driver: they carry its number."""
    return [count + 0.125 * joint for joint in range(len(NAMES))]


def profile(reliability, durability, depth):
    return QoSProfile(
        depth=depth,
        reliability=getattr(ReliabilityPolicy, reliability.upper()),
        durability=getattr(DurabilityPolicy, durability.upper()),
    )


def drive(node, topic, reliability, durability, rate, velocity):
    publisher = node.create_publisher(JointState, topic, profile(reliability, durability, 10))
    message, count = JointState(name=NAMES), 0
    message.header.frame_id = 'base_link'
    due = time.monotonic()
    while rclpy.ok():
        message.header.stamp = node.get_clock().now().to_msg()
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        message.position = motion(stamp)[0]
        message.velocity = [math.nan] * len(NAMES) if velocity == 'nan' else []
        message.effort = efforts(count)
        try:
            publisher.publish(message)
        except Exception:
            if rclpy.ok():
                raise
            return
        count += 1
        due = max(due + 1.0 / rate, time.monotonic() - 0.1)
        time.sleep(max(0.0, due - time.monotonic()))


def listen(node, case):
    topic, reliability, durability, depth = case.split(',')

    def came(message):
        stamp = message.header.stamp
        line = [
            case,
            stamp.sec * 10**9 + stamp.nanosec,
            message.header.frame_id,
            list(message.name),
            list(message.position),
            list(message.velocity),
            list(message.effort),
        ]
        print(json.dumps(line), flush=True)

    node.create_subscription(JointState, topic, came, profile(reliability, durability, int(depth)))


def main(role, *cases):
    rclpy.init()
    node = Node(role)
    try:
        if role == 'consumers':
            for case in cases:
                listen(node, case)
            print(json.dumps(['ready']), flush=True)
        else:
            for topic, reliability, durability, rate, velocity in (c.split(',') for c in cases):
                words = node, topic, reliability, durability, float(rate), velocity
                threading.Thread(target=drive, args=words).start()
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main(*sys.argv[1:])
