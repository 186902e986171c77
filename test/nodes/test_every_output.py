# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Every output of every node is, byte for byte, what replay makes of the same messages."""

from __future__ import annotations

import math
import time
from contextlib import contextmanager
from importlib import import_module
from typing import NamedTuple

import dds
import pytest

from estimator_pkg import cli, streams
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Decoder, Encoder
from estimator_pkg.nodes.observer import ObserverNode

STREAMS = {stream.NODE: stream for stream in streams.every()}


class Case(NamedTuple):
    """A node, the simulator that feeds it, and the outputs of its stream.

    odd : what no simulator makes follows, see `odd_messages`.
    """

    plant: str
    observer: str
    outputs: str
    parameters: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    seconds: float = 1.5
    options: tuple[str, ...] = ()
    odd: bool = False


CASES = {
    'joint_observer with faults': Case(
        'encoder',
        'hybrid_angle',
        'estimate estimate_stddev acceleration',
        (
            'observer: hybrid_angle',
            'quantum: 0.0015339',
            'per_joint.b: {bandwidth_hz: 100, unwrap: true}',
        ),
        (
            'joints=[a, b]',
            'noise=0.0005',
            'sampling_jitter=0.0004',
            'dropped=0.02',
            'repeated=0.02',
            'duplicated=0.02',
            'outliers=0.002',
            'outlier_size=3.13',
            'gap_every=0.7',
            'gap_length=0.25',
            'burst_every=0.9',
            'eccentricity=0.002',
        ),
        seconds=2.0,
        odd=True,
    ),
    'joint_observer': Case(
        'encoder',
        'kalman',
        'estimate estimate_stddev acceleration smoothed smoothed_stddev',
        ('observer: kalman', 'stamp_repair: regular', 'sources: [gyro]', 'source.gyro.topic: imu'),
        (
            'joints=[a, b]',
            'noise=0.0005',
            'dropped=0.02',
            'duplicated=0.02',
            'gap_every=0.7',
            'gyro_rate=200',
            'stamp_jitter=0.0002',
        ),
        options=('--smoothed',),
    ),
    'mechanical_observer': Case(
        'cart_pendulum',
        'ehgo',
        'estimate estimate_stddev gains',
        ('observer: ehgo', 'model: cart_pendulum'),
    ),
    'adaptive_observer': Case(
        'dc_motor', 'adaptive', 'estimate estimate_stddev identified_parameters'
    ),
    'switched_observer': Case(
        'gripper',
        'switched',
        'estimate estimate_stddev discrete_state acceleration',
        words=('rate=400',),
        seconds=2.5,  # its event is at 2 s
    ),
    'wheel_odometry': Case(
        'base',
        'wheel_odometry',
        'estimate estimate_stddev odometry',
        ('radius: [0.1]', 'track: 0.5', 'gyro_topic: imu'),
        ('stand=0.5', 'dropped=0.02', 'gyro_delay=0.004'),
        seconds=4.0,  # the gyro is used from 2 s on
    ),
    'pmsm_observer': Case(
        'pmsm',
        'pmsm',
        'estimate estimate_stddev estimate_samples flux_linkage',
        ('resistance: 0.06', 'inductance: 33.75e-6', 'flux: 1.9e-3', 'pole_pairs: 7'),
        ('publish_rate=5000', 'batch=50', 'current_noise=0.05'),
    ),
}


@contextmanager
def in_context(file):
    """Arguments for a node on its own context, which reads a parameter file as ROS does."""
    import rclpy

    context = rclpy.Context()
    rclpy.init(args=dds.ros_args(file=file), context=context, domain_id=dds.DOMAIN)
    try:
        yield {'context': context}
    finally:
        rclpy.try_shutdown(context=context)


def message_class(name):
    """The class of a type as in 'sensor_msgs/msg/JointState'."""
    package, _, kind = name.split('/')
    return getattr(import_module(f'{package}.msg'), kind)


def read(path, prefix=''):
    """(messages in order as (topic, log_ns, bytes), types) of the topics that begin so."""
    with open_bag(path) as bag:
        types = {
            topic.name: topic.type for topic in bag.topics.values() if topic.name.startswith(prefix)
        }
        return [
            (message.topic, message.log_ns, bytes(message.raw)) for message in bag.messages(types)
        ], types


def run(*words):
    """Run a command of the package, which must succeed."""
    assert cli.main(list(words)) == 0


def padded(raw):
    """A message as DDS carries it: its length is a multiple of four."""
    return bytes(raw) + bytes(-len(raw) % 4)


def odd_messages(raw):
    """Bad values and stamps, joints that come and go, a clock that jumps back."""
    stamp, encode = Decoder().decode(raw).stamp_ns, Encoder().encode

    def at(milliseconds, names, positions):
        return encode(stamp + milliseconds * 1_000_000, 'tool', names, positions)

    yield from (
        at(1, ['a', 'b'], [math.nan, 1.0]),
        at(2, ['b', 'a'], [1.0, math.inf]),
        at(2, ['a', 'b'], [1.0, 1.0]),
        at(1, ['a', 'b'], [1.0, 1.0]),
        at(3, [], []),
        at(3, ['a', 'b'], [1.0]),
        encode(0, '', ['a'], [1.0]),
        at(10**9, ['a'], [1.0]),
        at(4, ['a'], [1.001]),
    )
    for i in range(300):
        yield at(5 + i, ['c', 'a'], [0.001 * i, 1.0 + 0.002 * i])
    for i in range(300):  # the bag loops
        yield at(i - 5000, ['b'], [0.003 * i])


def with_odd_messages(bag, path):
    """Write a bag with the measurements of `bag` and `odd_messages` after them; return its path."""
    with open_bag(bag) as found, BagWriter(path) as writer:
        writer.add_topic('/joint_states', TYPE)
        for message in found.messages(['/joint_states']):
            last, raw = message.log_ns, bytes(message.raw)
            writer.write('/joint_states', last, raw)
        for i, message in enumerate(odd_messages(raw), 1):
            writer.write('/joint_states', last + i * 1_000_000, message)
    return str(path)


@pytest.mark.parametrize('name', CASES)
def test_live_is_replay(name, probe, tmp_path):
    case, node = CASES[name], name.partition(' ')[0]
    file = tmp_path / 'params.yaml'
    lines = ''.join(f'\n    {line}' for line in case.parameters) or ' {}'
    file.write_text(f'{node}:\n  ros__parameters:{lines}\n')
    bag, out = str(tmp_path / 'bag'), str(tmp_path / 'out')
    sets = [part for word in case.words for part in ('--set', word)]
    run('simulate', case.plant, '--out', bag, '--duration', str(case.seconds), *sets)
    if case.odd:
        bag = with_odd_messages(bag, tmp_path / 'odd')
    run(
        'replay',
        bag,
        '--observer',
        case.observer,
        '--params',
        str(file),
        '--name',
        node,
        '--out',
        out,
        *case.options,
    )

    made, types = read(out, f'/{node}/')
    expected = {topic: [raw for name, _, raw in made if name == topic] for topic in types}
    assert {topic.split('/')[-1] for topic in expected} == set(case.outputs.split())
    assert all(expected.values())
    found = live(probe, STREAMS[node], file, bag, types)
    for topic in expected:
        assert [padded(raw) for raw in found[topic]] == [padded(raw) for raw in expected[topic]], (
            topic
        )


def live(probe, kind, file, bag, types):
    """The bytes that a node in this process publishes on these topics for the messages of a bag."""
    from rclpy.qos import DurabilityPolicy, QoSProfile

    found = {topic: [] for topic in types}
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    hear, make = probe.node.create_subscription, probe.node.create_publisher
    listeners = [
        hear(
            message_class(types[topic]),
            topic,
            rows.append,
            latched if topic.endswith('/gains') else 2000,
            raw=True,
        )
        for topic, rows in found.items()
    ]
    messages, inputs = read(bag)
    publishers = {
        topic: make(message_class(kind), topic, 100)
        for topic, kind in inputs.items()
        if 'ground_truth' not in topic
    }
    with in_context(file) as where:
        node = ObserverNode(kind, **where)  # in no executor: it takes each message at once
        ports = {each.topic_name: number for number, each in enumerate(node._endpoints.inputs)}
        received = node.stream.received
        try:
            probe.until(
                lambda: (
                    node._look_around()
                    or (
                        all(each.get_publisher_count() for each in listeners)
                        and all(each.get_subscription_count() for each in publishers.values())
                    )
                )
            )
            for topic, _, raw in messages:
                if topic in publishers:
                    port, before = ports[topic], received[ports[topic]]
                    publishers[topic].publish(raw)
                    taken = node._endpoints.inputs[port].drain
                    assert dds.until(
                        lambda taken=taken, port=port, before=before: (
                            taken() and received[port] > before
                        ),
                        lambda: time.sleep(1e-4),
                    )
                    for _ in listeners:  # each may have an answer
                        probe.executor.spin_once(timeout_sec=0.0)
            node._look_around()
            probe.spin(0.5)
        finally:
            node.destroy_node()
            for each in listeners:
                probe.node.destroy_subscription(each)
            for each in publishers.values():
                probe.node.destroy_publisher(each)
    return found
