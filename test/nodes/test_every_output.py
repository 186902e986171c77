# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Every output of every node is, byte for byte, what replay makes of the same messages."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import dds
import pytest
from bag_making import STORE
from own_node import in_context

from estimator_pkg import cli, streams
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Decoder, Encoder
from estimator_pkg.nodes.endpoints import get_message
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
    seconds: float = 0.8
    options: tuple[str, ...] = ()
    odd: bool = False


def words(text):
    """A set of a simulator by '--set KEY=VALUE', in words."""
    return tuple(text.split(';'))


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
        words(
            'joints=[a, b];noise=0.0005;sampling_jitter=0.0004;dropped=0.02;repeated=0.02;'
            'duplicated=0.02;outliers=0.002;outlier_size=3.13;gap_every=0.7;gap_length=0.25;'
            'burst_every=0.9;eccentricity=0.002'
        ),
        seconds=1.2,
        odd=True,
    ),
    'joint_observer': Case(
        'encoder',
        'kalman',
        'estimate estimate_stddev acceleration smoothed smoothed_stddev',
        ('observer: kalman', 'stamp_repair: regular', 'sources: [gyro]', 'source.gyro.topic: imu'),
        words(
            'joints=[a, b];noise=0.0005;dropped=0.02;duplicated=0.02;gap_every=0.7;gyro_rate=200;'
            'stamp_jitter=0.0002'
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
        seconds=2.2,  # its event is at 2 s
    ),
    'wheel_odometry': Case(
        'base',
        'wheel_odometry',
        'estimate estimate_stddev odometry',
        ('radius: [0.1]', 'track: 0.5', 'gyro_topic: imu'),
        ('stand=0.5', 'dropped=0.02', 'gyro_delay=0.004'),
        seconds=2.6,  # the gyro is used from 2 s on
    ),
    'pmsm_observer': Case(
        'pmsm',
        'pmsm',
        'estimate estimate_stddev estimate_samples flux_linkage',
        ('resistance: 0.06', 'inductance: 33.75e-6', 'flux: 1.9e-3', 'pole_pairs: 7'),
        ('publish_rate=5000', 'batch=50', 'current_noise=0.05'),
    ),
}


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
    named = ('--observer', case.observer, '--params', str(file), '--name', node)
    run('replay', bag, *named, '--out', out, *case.options)

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
            get_message(types[topic]),
            topic,
            rows.append,
            latched if topic.endswith('/gains') else 2000,
            raw=True,
        )
        for topic, rows in found.items()
    ]
    messages, inputs = read(bag)
    publishers = {
        topic: make(get_message(kind), topic, 100)
        for topic, kind in inputs.items()
        if 'ground_truth' not in topic
    }
    with in_context(file) as where:
        node = ObserverNode(kind, **where)  # in no executor: it takes each message at once
        ports = {each.topic_name: number for number, each in enumerate(node._endpoints.inputs)}
        received = node.stream.received
        sending = [each for each in node._endpoints.publishers if each.topic_name in found]
        sending += publishers.values()
        try:
            probe.until(
                lambda: (
                    node._look_around()
                    or (
                        all(each.get_publisher_count() for each in listeners)
                        and all(each.get_subscription_count() for each in sending)
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


# ---- a number in messages of any type

POSE, BEGIN, MS = 'geometry_msgs/msg/PoseStamped', 10**18, 1_000_000


def pose(stamp_ns, yaw, frame_id='world'):
    """A pose that turns; one without an orientation, as of a body that is not seen, for NaN."""
    make = STORE.types
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = make['builtin_interfaces/msg/Time'](sec=sec, nanosec=nanosec)
    seen = not math.isnan(yaw)
    turned = make['geometry_msgs/msg/Quaternion'](
        x=0.0, y=0.0, z=seen and math.sin(0.5 * yaw), w=seen and math.cos(0.5 * yaw)
    )
    body = make['geometry_msgs/msg/Pose'](
        position=make['geometry_msgs/msg/Point'](x=1.0, y=2.0, z=3.0), orientation=turned
    )
    header = make['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id)
    return bytes(STORE.serialize_cdr(make[POSE](header=header, pose=body), POSE))


def faulty():
    """Poses with what happens to them on the way: everything that the guard knows."""
    yield from (pose(BEGIN + k * 5 * MS, 0.02 * k) for k in range(200))
    yield pose(BEGIN + 199 * 5 * MS, 4.0)  # a duplicate
    yield pose(BEGIN + 197 * 5 * MS, 4.0)  # late
    yield pose(BEGIN + 200 * 5 * MS, math.nan)
    yield pose(0, 4.0)  # without a stamp
    yield pose(BEGIN + 201 * 5 * MS, 4.02)[:30]  # cut off
    yield from (pose(BEGIN + k * 5 * MS, 0.02 * k, 'another_frame') for k in range(260, 460))


def test_live_is_replay_of_a_field(probe, tmp_path):
    raws, bag, file = list(faulty()), str(tmp_path / 'bag'), tmp_path / 'params.yaml'
    with BagWriter(bag) as writer:
        writer.add_topic('/angle', POSE)
        for k, raw in enumerate(raws):
            writer.write('/angle', BEGIN + k * MS, raw, 1)
    file.write_text(
        '/**:\n  ros__parameters:\n    input: field\n    angle_joint: body\n'
        f'    field_type: {POSE}\n    field: pose.orientation.yaw\n    prefer: smooth\n'
    )
    options = (
        '--angle',
        '/angle:pose.orientation.yaw',
        '--joint',
        'body',
        '--set',
        'prefer=smooth',
    )
    made = []
    for number, given in enumerate((('--params', str(file)), options)):
        out = str(tmp_path / f'out{number}')
        run('replay', bag, *given, '--name', 'joint_observer', '--out', out)
        made.append(read(out, '/joint_observer/'))
    assert made[0] == made[1]  # with the command line of a user without a file, too
    answers, types = made[0]
    expected = {topic: [raw for name, _, raw in answers if name == topic] for topic in types}
    estimates = expected['/joint_observer/estimate']
    assert len(estimates) == len(raws) - 5
    last = Decoder().decode(estimates[-1])
    assert last.velocities == pytest.approx((4.0,), rel=1e-3)
    assert (last.names, last.frame_id) == (('body',), 'another_frame')
    found = live(probe, 'angle', file, bag, types)
    assert {topic: list(map(padded, rows)) for topic, rows in found.items()} == {
        topic: list(map(padded, rows)) for topic, rows in expected.items()
    }
