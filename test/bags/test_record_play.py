# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Record and play as processes of their own, over real DDS."""

import itertools
import json
import signal
import time

import bag_making as make
import dds
import pytest
from bag_making import START, TEXT

from estimator_pkg import cli
from estimator_pkg.bags import qos
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE, Encoder

CLI = 'estimator_pkg.cli'


def command(*words):
    return dds.NodeProcess(CLI, *map(str, words))


def raws(count, step_ns=2_000_000):
    encode = Encoder().encode
    return [encode(START + i * step_ns, 'base', ['a'], [0.01 * i]) for i in range(count)]


def listen(probe, kind, topic, profile=100):
    """What comes on a topic from now on: (when, bytes)."""
    found = []
    subscription = probe.node.create_subscription(
        kind, topic, lambda raw: found.append((time.monotonic(), raw)), profile, raw=True
    )
    return found, subscription


def best_effort(depth=100):
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def latched():
    from rclpy.qos import DurabilityPolicy, QoSProfile

    return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_record_keeps_bytes_qos_and_times(probe, tmp_path):
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    out = tmp_path / 'bag'
    text = make.text('said before anyone came')  # 32 bytes: DDS fills up to a multiple of 4
    early = probe.node.create_publisher(String, '/rp1/latched', latched())
    early.publish(text)
    topics = ['rp1/states', '/rp1/latched', '/rp1/late']
    with command('record', *topics, '--out', out, '--json', tmp_path / 'json') as process:
        process.prints('recording /rp1/latched')
        process.prints('waiting for /rp1/states')
        publisher = probe.node.create_publisher(JointState, '/rp1/states', best_effort())
        late = probe.node.create_publisher(String, '/rp1/late', 10)
        process.prints('recording /rp1/states')
        process.prints('recording /rp1/late')
        probe.until(lambda: publisher.get_subscription_count() and late.get_subscription_count())
        probe.spin(0.3)
        before = time.time_ns()
        for raw in raws(200):
            publisher.publish(raw)
            probe.spin(0.001)
        late.publish(make.text('too-late-..'))
        probe.spin(0.5)
        after = time.time_ns()
        process.signal(signal.SIGINT)
        assert process.ends() == 0, process.output
        assert 'Traceback' not in process.output
    for one in (early, publisher, late):
        probe.node.destroy_publisher(one)
    with open_bag(out) as bag:
        assert not bag.warnings
        found = list(bag.messages(['/rp1/states']))
        assert [message.raw for message in found] == raws(200)
        assert all(before < message.publish_ns <= message.log_ns < after for message in found)
        assert [message.raw for message in bag.messages(['/rp1/latched'])] == [text]
        assert [message.raw for message in bag.messages(['/rp1/late'])] == [
            make.text('too-late-..')
        ]
        assert bag.topics['/rp1/states'].qos[0].reliability.name == 'BEST_EFFORT'
        assert bag.topics['/rp1/latched'].qos[0].durability.name == 'TRANSIENT_LOCAL'
        assert bag.topics['/rp1/states'].type_hash.startswith('RIHS01_a13ee3a330')
    result = json.loads((tmp_path / 'json').read_text())
    assert result['messages'] == {'/rp1/latched': 1, '/rp1/states': 200, '/rp1/late': 1}
    assert set(result['lost'].values()) == {0}
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'json']


def test_record_follows_a_publisher_that_offers_less(probe, tmp_path):
    from std_msgs.msg import String

    reliable = probe.node.create_publisher(String, '/rp3/said', 10)
    with command('record', '/rp3/said', '--out', tmp_path / 'bag') as process:
        process.prints('recording /rp3/said')
        probe.until(lambda: reliable.get_subscription_count())
        reliable.publish(make.text('one'))
        probe.spin(0.3)
        other = probe.node.create_publisher(String, '/rp3/said', best_effort())
        process.prints('subscribing again')
        probe.until(lambda: other.get_subscription_count())
        probe.spin(0.3)
        other.publish(make.text('two'))
        probe.spin(0.3)
        process.signal(signal.SIGINT)
        assert process.ends() == 0, process.output
    for one in (reliable, other):
        probe.node.destroy_publisher(one)
    with open_bag(tmp_path / 'bag') as bag:
        assert [message.raw for message in bag.messages()] == [make.text('one'), make.text('two')]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGHUP])
def test_record_without_messages_leaves_nothing(number, tmp_path):
    with command('record', '/rp4/nobody', '--out', tmp_path / 'bag') as process:
        process.prints('waiting for /rp4/nobody')
        process.signal(number)
        assert process.ends() == 1
    assert 'nothing was recorded: no messages arrived on /rp4/nobody' in process.output
    assert 'Traceback' not in process.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ('words', 'said', 'code'),
    [
        ('record /x --out there', 'exists already', 1),
        ('record /x --out no/bag', 'does not exist', 1),
        ('record /x --out bag --duration -1', 'must be above 0', 2),
        ('record /x:c --out bag', "'/x:c' is not a valid topic name", 2),
        ('play nowhere', 'does not exist', 1),
        ('play there --rate 0', '--rate is 0: it must be above 0', 2),
        ('play json.mcap', 'has no topic to play', 1),
    ],
)
def test_what_they_cannot_do_is_one_line(words, said, code, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'there').mkdir()
    make.mcap(tmp_path / 'json.mcap', make.content(3), encoding='json')
    if 'json' in words:
        with command(*words.split()) as process:
            assert process.ends() == code
        assert said in process.output and 'Traceback' not in process.output
        return
    assert cli.main(words.split()) == code
    error = capfd.readouterr().err
    assert said in error and error.count('\n') == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ['json.mcap', 'there']


LATCHED = '/played/text'


def bag_to_play(path, states):
    """150 joint states in 0.3 s, best effort, a latched text, and what cannot be played.

    Parameters
    ----------
    states : topic, of one test alone: DDS may keep a subscription a little longer.
    """
    with BagWriter(path) as bag:
        bag.add_topic(LATCHED, TEXT, qos.profile(transient_local=True, depth=1))
        bag.add_topic(states, TYPE, qos.profile(reliable=False, depth=50))
        bag.add_topic('/own', 'own_msgs/msg/Unknown')
        bag.add_topic('/a b', TEXT)
        bag.add_topic('/json', TEXT, serialization='json')
        bag.write(LATCHED, START, make.text('hello--'))
        for topic in ('/own', '/a b', '/json'):
            bag.write(topic, START, b'\0\1\0\0')
        for i, raw in enumerate(raws(150)):
            bag.write(states, START + i * 2_000_000, raw)
    return path


def test_play_gives_bytes_timing_and_qos(probe, tmp_path):
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    topic = '/played/states'
    states, one = listen(probe, JointState, topic, best_effort())
    texts, two = listen(probe, String, LATCHED, latched())
    bag = bag_to_play(tmp_path / 'bag', topic)
    with command('play', bag, '--rate', '0.5', '--json', tmp_path / 'json') as process:
        probe.until(lambda: len(states) >= 150 and texts)
        offered = {}
        for info in probe.node.get_publishers_info_by_topic(topic):
            offered[info.topic_type] = info.qos_profile.reliability.name
        assert process.ends() == 0, process.output
    for subscription in (one, two):
        probe.node.destroy_subscription(subscription)
    assert [raw for _, raw in states] == raws(150)
    assert [raw for _, raw in texts] == [make.text('hello--')]
    assert 0.9 * 0.596 < states[-1][0] - states[0][0] < 3.0  # twice as long as in the bag
    assert offered in ({}, {TYPE: 'BEST_EFFORT'})  # it may have ended by now
    assert '/own is not played: its type own_msgs/msg/Unknown is not installed' in process.output
    assert '/a b is not played: its name is not valid in ROS 2' in process.output
    assert "/json is not played: its messages are 'json', and ROS 2 needs CDR" in process.output
    assert json.loads((tmp_path / 'json').read_text())['sent'] == {topic: 150, LATCHED: 1}


def test_play_publishes_the_time_and_loops(probe, tmp_path):
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import JointState

    clocks, states = [], []
    one = probe.node.create_subscription(
        Clock,
        '/clock',
        lambda message: clocks.append(message.clock.sec * 10**9 + message.clock.nanosec),
        1000,
    )
    topic = '/looped/states'
    two = probe.node.create_subscription(
        JointState, topic, states.append, best_effort(1000), raw=True
    )
    bag = bag_to_play(tmp_path / 'bag', topic)
    with command('play', bag, '--loop', '--clock') as process:
        probe.until(lambda: len(states) >= 350)
        process.signal(signal.SIGINT)
        assert process.ends() == 0, process.output
    assert 'Traceback' not in process.output
    for subscription in (one, two):
        probe.node.destroy_subscription(subscription)
    assert states[:310] == (raws(150) * 3)[:310]
    assert min(clocks) >= START
    assert max(clocks) < START + 350_000_000
    backwards = sum(later < earlier for earlier, later in itertools.pairwise(clocks))
    assert backwards == (len(states) - 1) // 150
    assert len(clocks) > 60  # 0.7 s at 200 Hz


def test_a_played_bag_is_recorded_again(tmp_path):
    """For a time, without names of topics."""
    topic = '/again/states'
    bag = bag_to_play(tmp_path / 'source', topic)
    with command('record', '--duration', '3', '--out', tmp_path / 'bag') as recorder:
        with command('play', bag, '--rate', '1000') as player:
            assert player.ends() == 0, player.output
        assert recorder.ends() == 0, recorder.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'source']
    with open_bag(tmp_path / 'bag') as made:
        assert [message.raw for message in made.messages([topic])] == raws(150)
