# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One number in messages of any type, live: a pose, an odometry, a list without a header."""

import math
import os
import shlex

import dds
import pytest
from bag_making import STORE
from test_every_output import live

from estimator_pkg import cli
from estimator_pkg.bags.definitions import fields_of as defined
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.joint_state import TYPE, Decoder
from estimator_pkg.nodes.message_types import fields_of
from estimator_pkg.ros.message_class import message_types, packages_with_messages

MODULE = 'estimator_pkg.nodes.executables joint_observer'
POSE = 'geometry_msgs/msg/PoseStamped'
LIST = 'std_msgs/msg/Float32MultiArray'
FLOAT = 'std_msgs/msg/Float64'
BEGIN, MS = 10**18, 1_000_000
T = STORE.types


def turned(yaw):
    half = 0.5 * yaw
    return T['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))


def pose_at(yaw):
    point = T['geometry_msgs/msg/Point'](x=1.0, y=2.0, z=3.0)
    return T['geometry_msgs/msg/Pose'](position=point, orientation=turned(yaw))


def header(stamp_ns, frame_id):
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = T['builtin_interfaces/msg/Time'](sec=sec, nanosec=nanosec)
    return T['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id)


def pose(stamp_ns, yaw, frame_id='world'):
    message = T[POSE](header=header(stamp_ns, frame_id), pose=pose_at(yaw))
    if math.isnan(yaw):  # as some trackers send a body that they do not see
        zero = T['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=0.0)
        message.pose.orientation = zero
    return bytes(STORE.serialize_cdr(message, POSE))


def faulty(make):
    """Messages with what happens to them on the way: everything that the guard knows."""
    yield from (make(BEGIN + k * 5 * MS, 0.02 * k) for k in range(200))
    yield make(BEGIN + 199 * 5 * MS, 4.0)  # a duplicate
    yield make(BEGIN + 197 * 5 * MS, 4.0)  # late
    yield make(BEGIN + 200 * 5 * MS, math.nan)
    yield make(0, 4.0)  # without a stamp
    yield make(BEGIN + 201 * 5 * MS, 4.02)[:30]  # cut off
    yield from (make(BEGIN + k * 5 * MS, 0.02 * k, 'another_frame') for k in range(260, 460))


def parameters(path, kind, field):
    path.write_text(
        '/**:\n  ros__parameters:\n    input: field\n    angle_joint: body\n'
        f'    field_type: {kind}\n    field: {field}\n    prefer: smooth\n'
    )
    return path


def bag_of(path, topic, kind, raws, publish_ns):
    with BagWriter(path) as writer:
        writer.add_topic(topic, kind)
        for k, raw in enumerate(raws):
            writer.write(topic, BEGIN + k * MS, raw, publish_ns[k])
    return path


def replayed(bag, file, out, *words):
    assert cli.main(['replay', str(bag), '--out', str(out), '--name', 'node', *words]) == 0
    with open_bag(out) as found:
        answers = [(m.log_ns, bytes(m.raw)) for m in found.messages(['/node/estimate'])]
        deviations = [bytes(m.raw) for m in found.messages(['/node/estimate_stddev'])]
    return answers, deviations


def test_live_equals_replay_to_the_byte(probe, tmp_path):
    raws = list(faulty(pose))
    file = parameters(tmp_path / 'params.yaml', POSE, 'pose.orientation.yaw')
    bag = bag_of(tmp_path / 'bag', '/angle', POSE, raws, [1] * len(raws))
    expected, deviations = replayed(bag, file, tmp_path / 'out', '--params', str(file))
    # what a user gives on the command line, without a file of the node
    words = ['--angle', '/angle:pose.orientation.yaw', '--joint', 'body', '--set', 'prefer=smooth']
    assert replayed(bag, file, tmp_path / 'again', *words) == (expected, deviations)
    assert len(expected) == len(raws) - 5
    last = Decoder().decode(expected[-1][1])
    assert last.velocities == pytest.approx((4.0,), rel=1e-3) and last.names == ('body',)
    assert last.frame_id == 'another_frame'
    topics = [f'/joint_observer/{name}' for name in ('estimate', 'estimate_stddev')]
    found = live(probe, 'angle', file, str(bag), dict.fromkeys(topics, TYPE))
    assert found[topics[0]] == [raw for _, raw in expected]
    assert found[topics[1]] == deviations


def test_doctors_command_starts_a_node_on_the_topic_that_it_examined(probe, tmp_path, capsys):
    from sensor_msgs.msg import JointState

    from estimator_pkg.ros.message_class import message_class

    raws = [pose(BEGIN + k * 5 * MS, 0.3 * math.sin(0.02 * k)) for k in range(400)]
    out = tmp_path / 'p.yaml'
    bag = bag_of(tmp_path / 'bag', '/mocap/body', POSE, raws, [1] * len(raws))
    words = ['--angle', '/mocap/body:pose.orientation.yaw', '--out', str(out)]
    assert cli.main(['doctor', str(bag), *words]) == 0
    _, words = capsys.readouterr().out.split('node: joint_observer ')
    made = []
    publisher = probe.node.create_publisher(message_class(POSE), '/mocap/body', 50)
    listener = probe.node.create_subscription(
        JointState, '/joint_observer/estimate', made.append, 50, raw=True
    )
    with dds.NodeProcess(MODULE, *shlex.split(words.replace('\\\n', ''))):
        probe.until(publisher.get_subscription_count)
        probe.until(listener.get_publisher_count)
        publisher.publish(raws[5])
        probe.until(lambda: made)
    answer = Decoder().decode(made[0])
    assert (answer.names, answer.stamp_ns) == (('joint',), BEGIN + 25 * MS)
    assert answer.positions == pytest.approx((0.3 * math.sin(0.1),), abs=1e-9)
    probe.node.destroy_publisher(publisher)
    probe.node.destroy_subscription(listener)


def test_a_number_of_a_package_of_the_machine(probe, tmp_path):
    """From an overlay, as colcon installs it: found in the ament index and by its Python path.

    Nothing here compiles messages, so the package borrows the type support of std_msgs/Float64.
    """
    from std_msgs.msg import Float64

    folder, prefix = tmp_path / 'python', tmp_path
    (folder / 'machine_msgs' / 'msg').mkdir(parents=True)
    (folder / 'machine_msgs' / '__init__.py').touch()
    (folder / 'machine_msgs' / 'msg' / '__init__.py').write_text(
        'from std_msgs.msg import Float64\n'
        'class Reading(metaclass=type(Float64)):\n'
        "    __module__ = 'machine_msgs.msg._reading'\n"
        '    @classmethod\n'
        '    def get_fields_and_field_types(cls):\n'
        "        return {'height': 'double'}\n"
    )
    index = prefix / 'share' / 'ament_index' / 'resource_index'
    for resource, text in (('packages', ''), ('rosidl_interfaces', 'msg/Reading.msg\n')):
        (index / resource).mkdir(parents=True)
        (index / resource / 'machine_msgs').write_text(text)
    overlay = {
        'AMENT_PREFIX_PATH': os.pathsep.join([str(prefix), os.environ['AMENT_PREFIX_PATH']]),
        'PYTHONPATH': os.pathsep.join([str(folder), os.environ.get('PYTHONPATH', '')]),
    }
    words = [
        'input:=field',
        'field_type:=machine_msgs/msg/Reading',
        'field:=height',
        'wrap_period:=0.0',
        'angle_joint:=lift',
    ]
    with pytest.MonkeyPatch.context() as patch:
        for name, value in overlay.items():
            patch.setenv(name, value)
        process = dds.NodeProcess(
            MODULE, *dds.ros_args(*words, remap=('__node:=own', 'angle:=/own/angle'))
        )
    with process, dds.Observer(probe, '/own', '/unused_too') as live:
        probe.node.destroy_publisher(live.publisher)
        live.publisher = probe.node.create_publisher(Float64, '/own/angle', 50)
        live.connect()
        for k in range(60):
            number = T[FLOAT](10.0 + 0.01 * k)
            live.feed([bytes(STORE.serialize_cdr(number, FLOAT))])
            probe.spin(0.005)
    (position,), (velocity,) = live.answers[-1].positions, live.answers[-1].velocities
    assert live.answers[-1].names == ('lift',)
    assert position == pytest.approx(10.59, abs=0.02) and 0.0 < velocity < 2.0


def test_stamps_of_the_publisher_where_those_of_the_header_are_zero(tmp_path):
    raws = [pose(0, 0.01 * k) for k in range(100)]
    bag = bag_of(tmp_path / 'bag', '/angle', POSE, raws, [BEGIN + 10 * k * MS for k in range(100)])
    file = parameters(tmp_path / 'params.yaml', POSE, 'pose.orientation.yaw')
    words = ['--params', str(file), '--set', 'stamp_source=publisher']
    answers, _ = replayed(bag, file, tmp_path / 'out', *words)
    last = Decoder().decode(answers[-1][1])
    assert last.stamp_ns == BEGIN + 990 * MS
    assert last.velocities == pytest.approx((1.0,), rel=1e-6)


def test_the_fields_of_every_installed_type_are_those_of_its_definition():
    count = 0
    for package in packages_with_messages():
        for name in message_types(package):
            if name in STORE.fielddefs:
                bases = {'char': 'uint8'}
                expected = {
                    field: kind._replace(base=bases.get(kind.base, kind.base))
                    for field, kind in defined(name, '')(name).items()
                }
                assert fields_of(name) == expected, name
                count += 1
    assert count > 100


WRONG = [
    ({'field': 'data'}, "needs 'field_type': set it, as in geometry_msgs/msg/PoseStamped"),
    ({'field_type': POSE}, "needs 'field': set it"),
    (
        {'field_type': 'geometry_msgs/PoseStamped', 'field': 'x'},
        f"'geometry_msgs/PoseStamped' is not a message type: write it as {POSE}",
    ),
    ({'field_type': '../etc/msg/Foo', 'field': 'x'}, 'is not a message type'),
    (
        {'field_type': 'geometry_msgs/msg/PoseStampd', 'field': 'x'},
        f"geometry_msgs has no 'geometry_msgs/msg/PoseStampd': did you mean '{POSE}'?",
    ),
    (
        {'field_type': 'geometry_msg/msg/PoseStamped', 'field': 'x'},
        "the package 'geometry_msg' is not installed, or has no messages: did you mean "
        "'geometry_msgs'? Otherwise install it, or source its workspace",
    ),
    (
        {'field_type': 'machine_of_mine/msg/Encoder', 'field': 'x'},
        "the package 'machine_of_mine' is not installed, or has no messages: install it, or "
        'source its workspace',
    ),
    (
        {'field_type': POSE, 'field': 'pose.orientatoin.yaw'},
        "geometry_msgs/msg/Pose has no field 'orientatoin': did you mean 'orientation'?",
    ),
    ({'field_type': POSE, 'field': 'header.frame_id'}, 'is a string: name a numeric field'),
    ({'field_type': POSE, 'field': 'pose.position'}, 'name one of its fields, x, y, z'),
    ({'field_type': POSE, 'field': 'pose.orientation'}, "its yaw with 'pose.orientation.yaw'"),
    ({'field_type': 'std_msgs/msg/Int16', 'field': 'data'}, "set 'counts_per_revolution'"),
    ({'field_type': LIST, 'field': 'data'}, "name an element, as in 'data[0]'"),
    ({'field_type': POSE, 'field': 'pose.'}, 'is not a field: write it as'),
]


@pytest.mark.parametrize('values, reported', WRONG)
def test_a_wrong_type_or_field_ends_the_start(values, reported, probe):
    from estimator_pkg.nodes.observer import ObserverNode
    from estimator_pkg.nodes.ros_parameters import ros_values

    with pytest.raises(UsageError) as caught:
        ObserverNode('angle', parameter_overrides=ros_values({'input': 'field', **values}))
    assert reported in str(caught.value) and '\n' not in str(caught.value)
