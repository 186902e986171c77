# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The encoder simulator as a stream and as bags, and the command that writes them."""

import filecmp
import itertools
import json
import math

import numpy as np
import pytest

from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.messages.cdr import Reader
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.parameters import build
from sim_pkg.joints.encoder import SIMULATOR, EncoderParameters
from sim_pkg.joints.profiles import make_profile
from sim_pkg.joints.sensor import random_stream
from sim_pkg.simulate import START_NS, write_bag

FAULTS = {
    'profile': 'random',
    'noise': 0.002,
    'dropped': 0.02,
    'repeated': 0.02,
    'duplicated': 0.02,
    'outliers': 0.01,
    'eccentricity': 0.01,
    'gap_every': 0.4,
    'gap_length': 0.05,
    'burst_every': 0.2,
    'burst_length': 0.15,
    'stuck_every': 0.5,
    'sampling_jitter': 0.0004,
    'stamp_jitter': 0.0002,
}


def stream(duration=1.0, seed=1, **values):
    """(topic, due_ns, decoded message) of a run that starts at 0."""
    parameters = build(EncoderParameters, values)
    for chunk in SIMULATOR.generate(parameters, duration, seed):
        for message in chunk:
            yield message.topic, message.due_ns, message.encode(START_NS)


def decoded(topic, **values):
    decoder = Decoder()
    return [decoder.decode(raw) for name, _, raw in stream(**values) if name == topic]


def simulate(*words):
    return cli.main(['simulate', *map(str, words)])


def test_measurement_and_truth_of_a_faultless_run():
    values = {'profile': 'figure_6', 'counts_per_revolution': 0, 'duration': 6.0, 'rate': 500.0}
    truth = decoded('ground_truth/joint_states', **values)
    measured = decoded('joint_states', **values)
    assert len(truth) == len(measured) == 3000
    stamps = np.arange(3000) * 2_000_000
    assert [m.stamp_ns - START_NS for m in measured] == stamps.tolist()
    assert [m.stamp_ns - START_NS for m in truth] == stamps.tolist()
    parameters = build(EncoderParameters, {'profile': 'figure_6'})
    position, velocity, _ = make_profile(parameters, np.random.default_rng(0))(stamps / 1e9)
    np.testing.assert_allclose([m.positions[0] for m in truth], position, rtol=1e-12)
    np.testing.assert_allclose([m.velocities[0] for m in truth], velocity, rtol=1e-12)
    wrapped = np.angle(np.exp(1j * position))
    np.testing.assert_allclose([m.positions[0] for m in measured], wrapped, atol=1e-9)
    assert all(m.names == ('wheel',) and m.velocities == m.efforts == () for m in measured)
    assert truth[-1].positions[0] > 100.0  # continuous: not wrapped


def test_truth_is_the_motion_at_the_stamp_whatever_happens_to_the_measurement():
    truth = decoded('ground_truth/joint_states', **FAULTS, duration=2.0)
    assert len(truth) == 2000
    stamps = np.array([m.stamp_ns - START_NS for m in truth])
    profile = make_profile(build(EncoderParameters, FAULTS), random_stream(1, 'profile', 0))
    position, velocity, _ = profile(stamps / 1e9)
    np.testing.assert_allclose([m.positions[0] for m in truth], position, atol=1e-9)
    np.testing.assert_allclose([m.velocities[0] for m in truth], velocity, atol=1e-9)
    measured = decoded('joint_states', **FAULTS, duration=2.0)
    assert {m.stamp_ns for m in measured} < {m.stamp_ns for m in truth}


def test_joints_move_apart_and_err_apart():
    values = {
        'joints': ['a', 'b', 'c'],
        'joint_ratio': -0.5,
        'noise': 0.01,
        'counts_per_revolution': 0,
        'convention': 'multi_turn',
    }
    truth = np.array([m.positions for m in decoded('ground_truth/joint_states', **values)])
    measured = decoded('joint_states', **values)
    assert measured[0].names == ('a', 'b', 'c')
    np.testing.assert_allclose(truth[:, 1:], truth[:, :1] * [-0.5, 0.25])
    error = np.array([m.positions for m in measured]) - truth
    assert np.abs(np.corrcoef(error.T) - np.eye(3)).max() < 0.15
    alone = decoded('joint_states', **{**values, 'joints': ['a']})
    assert [m.positions[0] for m in alone] == [m.positions[0] for m in measured]


def test_raw_counts_go_to_the_angle_topic():
    values = {'convention': 'raw_counts', 'counts_per_revolution': 1000, 'profile': 'constant'}
    topics = SIMULATOR.topics(build(EncoderParameters, values))
    assert [(topic.name, topic.type) for topic in topics] == [
        ('angle', 'std_msgs/msg/Int32'),
        ('ground_truth/joint_states', 'sensor_msgs/msg/JointState'),
    ]
    counts = [Reader(raw).number('i') for name, _, raw in stream(**values) if name == 'angle']
    expected = np.floor(10.0 * np.arange(1000) * 1e-3 / (2 * math.pi) * 1000) % 1000
    np.testing.assert_array_equal(counts, expected)


@pytest.mark.parametrize('values', [{}, FAULTS, {**FAULTS, 'burst_length': 0.5, 'rate': 333.3}])
def test_messages_come_in_the_order_in_which_they_are_due(values):
    parameters = build(EncoderParameters, values)
    known = {topic.name for topic in SIMULATOR.topics(parameters)}
    due = []
    for chunk in SIMULATOR.generate(parameters, 5.0, 3):
        assert {message.topic for message in chunk} <= known
        due += [message.due_ns for message in chunk]
    assert due == sorted(due)
    assert due[0] >= 0


def test_the_first_messages_do_not_depend_on_the_duration_and_time_has_no_end():
    endless, finite = (
        list(itertools.islice(stream(duration, **FAULTS), 2000)) for duration in (math.inf, 5.0)
    )
    assert len(finite) == 2000
    assert endless == finite


def test_a_bag_holds_the_stream(tmp_path):
    parameters = build(EncoderParameters, FAULTS)
    counts, written = write_bag(SIMULATOR, parameters, 2.0, 7, tmp_path / 'bag')
    with open_bag(tmp_path / 'bag') as bag:
        assert {name: (topic.type, topic.count) for name, topic in bag.topics.items()} == {
            '/joint_states': ('sensor_msgs/msg/JointState', counts['joint_states']),
            '/ground_truth/joint_states': ('sensor_msgs/msg/JointState', 2000),
        }
        written = [
            (message.topic, message.log_ns, bytes(message.raw))
            for message in bag.messages(bag.topics)
        ]
    assert written == [
        ('/' + topic, START_NS + due, raw) for topic, due, raw in stream(2.0, seed=7, **FAULTS)
    ]


def test_same_seed_same_bytes_other_seed_other_bytes(tmp_path):
    options = [word for item in FAULTS.items() for word in ('--set', '{}={}'.format(*item))]
    for folder, seed in (('one', 5), ('two', 5), ('three', 6)):
        (tmp_path / folder).mkdir()
        words = '--out', tmp_path / folder / 'bag', '--seed', seed, '--duration', 1.5
        assert simulate('encoder', *words, *options) == 0
    names = sorted(path.name for path in (tmp_path / 'one/bag').iterdir())
    assert names == ['bag_0.mcap', 'metadata.yaml']
    same = filecmp.cmpfiles(tmp_path / 'one/bag', tmp_path / 'two/bag', names, shallow=False)
    assert same == (names, [], [])
    other = filecmp.cmpfiles(tmp_path / 'one/bag', tmp_path / 'three/bag', names, shallow=False)
    assert 'bag_0.mcap' in other[1]


def test_the_command_says_what_is_in_the_bag(tmp_path, capsys):
    words = '--duration 0.5 --seed 3 --set rate=200 --set joints=[left,right]'
    result = resulted(tmp_path, 'encoder', words)
    assert '100 messages' in capsys.readouterr().out
    assert (result['seed'], result['duration']) == (3, 0.5)
    assert result['topics']['/joint_states'] == {
        'type': 'sensor_msgs/msg/JointState',
        'truth': False,
        'messages': 100,
    }
    assert result['topics']['/ground_truth/joint_states']['truth'] is True


def resulted(folder, plant, words):
    """The result of a run of the command as JSON."""
    found = folder / f'{len(list(folder.iterdir()))}.json'
    assert simulate(plant, '--out', found.with_suffix(''), '--json', found, *words.split()) == 0
    return json.loads(found.read_text())


def test_a_parameter_file_of_the_node_serves_the_command(tmp_path):
    file = tmp_path / 'file.yaml'
    file.write_text(
        'encoder_sim:\n  ros__parameters:\n    use_sim_time: true\n    rate: 50\n    seed: 9\n'
        '    duration: 2.0\n    wait_for_subscribers: 1\n    noise: 1e-3\n'
        '    qos_overrides:\n      /joint_states:\n        publisher: {reliability: reliable}\n'
    )
    for words, seed, duration, count in (
        ('', 9, 2.0, 100),
        ('--seed 4 --duration 1 --set rate=10', 4, 1.0, 10),
    ):
        result = resulted(tmp_path, 'encoder', f'--params {file} {words}')
        assert (result['seed'], result['duration']) == (seed, duration)
        assert result['topics']['/joint_states']['messages'] == count


@pytest.mark.parametrize(
    ('words', 'code', 'said'),
    [
        ('encodr', 2, "did you mean 'encoder'?"),
        ('encoder --set nois=1', 2, "did you mean 'noise'?"),
        ('encoder --set noise=-1', 2, 'outside [0, 10]'),
        ('encoder --set joints=[]', 2, 'needs at least one name'),
        ("encoder --set joints=['']", 2, 'no empty one'),
        ('encoder --set joints=[a,a]', 2, 'twice'),
        ('encoder --set joints=[a,b] --set convention=raw_counts', 2, 'one joint'),
        ('dc_motor --set convention=raw_counts', 2, 'not one of signed'),
        ('encoder --duration 0', 2, 'duration'),
        ('encoder --duration nan', 2, 'duration'),
        ('encoder --duration inf', 2, 'duration'),
        ('encoder --seed -1', 2, 'seed'),
        ('encoder --params missing.yaml', 1, 'missing.yaml'),
    ],
)
def test_wrong_use_is_one_line_and_leaves_nothing(tmp_path, capsys, words, code, said):
    assert simulate(*words.split(), '--out', tmp_path / 'bag') == code
    error = capsys.readouterr().err
    assert said in error
    assert error.count('\n') == 1
    assert list(tmp_path.iterdir()) == []
