# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Topics that no command can read: other serialisations, malformed messages. One line, exit 1."""

import math
import shlex
import sqlite3

import bag_making as make
import pytest
from bag_making import START, STATES

from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.joint_state import TYPE, Encoder

TRUTH = '/ground_truth/joint_states'
COUNT = 60


def commands(path, tmp_path):
    """Every command that reads a bag, but play, which needs a ROS graph."""
    out = ['--out', f'{tmp_path}/out.yaml']
    return [
        ['replay', path],
        ['replay', path, '--angle', f'{STATES}:position[0]'],
        ['evaluate', path, '--observer', 'pll'],
        ['evaluate', path, '--observer', 'adaptive'],
        ['tune', path, '--observer', 'pll', *out],
        ['identify', path, *out],
    ]


def refused(words, capsys):
    """The one line that a command says before it ends with 1."""
    assert cli.main([str(word) for word in words]) == 1, words
    printed, said = capsys.readouterr()
    assert said.count('\n') == 1 and 'Traceback' not in said, (words, said)
    return said


def in_mcap(path):
    return make.mcap(path.with_suffix('.mcap'), make.content(), encoding='wrong_format')


def in_sqlite(path):
    make.rosbags(path, make.content())
    with sqlite3.connect(next(path.glob('*.db3'))) as base:
        base.execute("update topics set serialization_format = 'wrong_format'")
    base.close()
    return path


DECLARED = {'mcap': in_mcap, 'sqlite': in_sqlite}


@pytest.mark.parametrize('where', DECLARED)
def test_another_serialisation_is_never_decoded_as_cdr(where, tmp_path, capsys):
    path = DECLARED[where](tmp_path / 'bag')
    for words in commands(path, tmp_path):
        said = refused(words, capsys)
        assert f"topic '{STATES}' of {path}" in said, words
        assert "its messages are 'wrong_format', and ROS 2 needs CDR" in said, words


def test_replay_copies_other_serialisations_as_they_are(tmp_path):
    path = make.ours(tmp_path / 'bag', make.content())
    with BagWriter(tmp_path / 'both') as writer, open_bag(path) as bag:
        writer.add_topic(STATES, TYPE)
        writer.add_topic('/json', 'a/msg/B', serialization='json')
        for message in bag.messages([STATES]):
            writer.write(STATES, message.log_ns, message.raw)
        writer.write('/json', START, b'{"a": 1}')
    assert cli.main(['replay', str(tmp_path / 'both'), '--out', str(tmp_path / 'out')]) == 0
    with open_bag(tmp_path / 'out') as bag:
        assert bag.topics['/json'].serialization == 'json'
        assert [message.raw for message in bag.messages(['/json'])] == [b'{"a": 1}']


# ---------------------------------------------------------------- malformed messages


def bag_of(path, topics, bad, part=1.0):
    """Topics by name -> (type, bytes by number); the first `part` of those in `bad` are rubbish."""
    with BagWriter(path) as bag:
        for name, (kind, _) in topics.items():
            bag.add_topic(name, kind)
        for i in range(COUNT):
            for name, (_, raw) in topics.items():
                rubbish = name in bad and i < part * COUNT
                bag.write(name, START + i * 10**7, b'\0\1\0\0\xff' if rubbish else raw(i))
    return path


def state(i, velocity=None):
    effort = [0.1] if velocity is None else []
    return Encoder().encode(
        START + i * 10**7, '', ['a'], [0.01 * i], [] if velocity is None else [velocity], effort
    )


JOINTS = {
    STATES: (TYPE, state),
    TRUTH: (TYPE, lambda i: state(i, 1.0)),
    '/effort_command': (TYPE, state),
}


def test_every_message_malformed_is_exit_1(tmp_path, capsys):
    path = bag_of(tmp_path / 'bag', JOINTS, [STATES])
    for words in commands(path, tmp_path):
        said = refused(words, capsys)
        assert f"no message of '{STATES}' of {path} can be read: all {COUNT} are malformed" in said
        assert words[0] != 'replay' or said.endswith('malformed: message is too short\n')
    assert [each.name for each in tmp_path.iterdir()] == ['bag']


def vector(i):
    return vector3.encode(START + i * 10**7, '', 1.0, 0.0)


CURRENT_VOLTAGE = {'/current': (vector3.TYPE, vector), '/voltage': (vector3.TYPE, vector)}
PMSM = (
    'replay --observer pmsm --set resistance=0.5 --set inductance=1e-3 --set flux=0.01 '
    '--set pole_pairs=4'
)


@pytest.mark.parametrize(
    ('topics', 'bad', 'words'),
    [
        (JOINTS, TRUTH, 'evaluate --observer pll'),
        (
            JOINTS,
            '/effort_command',
            'replay --observer geso --set joints=[a] --set input=effort_command',
        ),
        # estimates could be judged without it, but its absence would not be noticed
        ({**JOINTS, '/joint_observer/estimate': JOINTS[TRUTH]}, STATES, 'evaluate'),
        (CURRENT_VOLTAGE, '/current', PMSM),
        ({'/drive_samples': (drive_samples.TYPE, vector)}, '/drive_samples', PMSM),
    ],
)
def test_one_topic_of_several_wholly_malformed(topics, bad, words, tmp_path, capsys):
    path = bag_of(tmp_path / 'bag', topics, [bad])
    command, *rest = shlex.split(words)
    said = refused([command, path, *rest], capsys)
    assert f"no message of '{bad}' of {path} can be read: all {COUNT} are malformed" in said


def test_some_malformed_messages_are_counted_aloud(tmp_path, capsys):
    path = bag_of(tmp_path / 'bag', JOINTS, [STATES, TRUTH], part=0.1)
    assert cli.main(['replay', str(path)]) == 0
    assert 'malformed 6' in capsys.readouterr().out
    assert cli.main(['evaluate', str(path), '--observer', 'pll']) == 0
    said = capsys.readouterr().err
    assert f"6 of {COUNT} messages of '{STATES}' of {path} are malformed and are skipped" in said
    assert f"6 of {COUNT} messages of '{TRUTH}' of {path} are malformed and are skipped" in said


# ---------------------------------------------------------------- recorders of others


def recorded(path, kind, encoding, schema, raws):
    """An MCAP file of another recorder, with one topic."""
    with open(path, 'wb') as stream:
        writer = make.McapWriter(stream)
        writer.start('', 'a test')
        channel = writer.register_channel('/angle', encoding, writer.register_schema(kind, *schema))
        for number, raw in enumerate(raws):
            now = START + number * 4_000_000
            writer.add_message(channel, now, raw, now)
        writer.finish()
    return str(path)


@pytest.mark.parametrize('schema', [('ros2msg', b'float64 data\n'), ('', b'')])
def test_a_type_without_msg_in_its_name_is_read(schema, tmp_path, capsys):
    kind = 'std_msgs/msg/Float64'
    number = make.STORE.types[kind]
    raws = [
        bytes(make.STORE.serialize_cdr(number(data=math.sin(0.02 * i)), kind)) for i in range(300)
    ]
    bag = recorded(tmp_path / 'bag.mcap', 'std_msgs/Float64', 'cdr', schema, raws)
    assert cli.main(['replay', bag, '--angle', '/angle:data']) == 0
    capsys.readouterr()
    assert '--angle /angle:data' in refused(['doctor', bag], capsys)


@pytest.mark.parametrize(
    'kind, encoding', [('a.B', 'json'), ('a.B', 'protobuf'), ('sensor_msgs/JointState', 'ros1')]
)
def test_a_file_of_another_format_is_refused_at_once(kind, encoding, tmp_path, capsys):
    bag = recorded(tmp_path / 'bag.mcap', kind, encoding, ('', b''), [b'{"data": 1}'] * 50)
    for words in (['doctor', bag], ['replay', bag]):
        assert f"its messages are '{encoding}', and ROS 2 needs CDR" in refused(words, capsys)


def test_joint_states_without_positions_say_so(tmp_path, capsys):
    bag = bag_of(tmp_path / 'bag', {STATES: (TYPE, speeds)}, ())
    for command in ('doctor', 'evaluate'):
        assert f'{STATES} has velocities but no positions' in refused([command, bag], capsys)
    assert cli.main(['replay', str(bag)]) == 1
    assert 'observers need positions, not velocities' in capsys.readouterr().err


def speeds(i):
    return Encoder().encode(START + i * 10**7, '', ['a'], [], [0.1 * i])
