# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Topics that no command can read: other serialisations, malformed messages. One line, exit 1."""

import math
import sqlite3
from functools import partial

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
COMMANDS = (  # all that read a bag but play, which needs a ROS graph
    'replay',
    f'replay --angle {STATES}:position[0]',
    'evaluate --observer pll',
    'evaluate --observer adaptive',
    'tune --observer pll --out OUT',
    'identify --out OUT',
)


def refused(words, path, capsys):
    """The one line that a command says before it ends with 1."""
    command, *rest = words.split()
    out = f'{path.parent}/out.yaml'
    rest = [out if word == 'OUT' else word for word in rest]
    assert cli.main([command, str(path), *rest]) == 1, words
    said = capsys.readouterr().err
    assert said.count('\n') == 1 and 'Traceback' not in said, (words, said)
    return said


def bag_of(path, topics, bad=(), part=1.0):
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


def foreign(path, kind='a.B', encoding='cdr', schema=('', b''), raws=(b'{"data": 1}',) * 50):
    """An MCAP file of another recorder, with one topic."""
    with open(path.with_suffix('.mcap'), 'wb') as stream:
        writer = make.McapWriter(stream)
        writer.start('', 'a test')
        channel = writer.register_channel('/angle', encoding, writer.register_schema(kind, *schema))
        for number, raw in enumerate(raws):
            now = START + number * 4_000_000
            writer.add_message(channel, now, raw, now)
        writer.finish()
    return path.with_suffix('.mcap')


def in_sqlite(path):
    make.rosbags(path, make.content())
    with sqlite3.connect(next(path.glob('*.db3'))) as base:
        base.execute("update topics set serialization_format = 'wrong_format'")
    base.close()
    return path


FEW = ('doctor', 'replay')
BAGS = {  # what makes it, what each of the commands says of it
    'mcap': (
        lambda path: make.mcap(path.with_suffix('.mcap'), make.content(), encoding='wrong_format'),
        f"topic '{STATES}' of PATH cannot be read: its messages are 'wrong_format', and ROS 2 need",
        COMMANDS,
    ),
    'sqlite': (in_sqlite, "its messages are 'wrong_format', and ROS 2 needs CDR", COMMANDS[:2]),
    'malformed': (
        lambda path: bag_of(path, JOINTS, [STATES]),
        f"no message of '{STATES}' of PATH can be read: all {COUNT} are malformed",
        COMMANDS,
    ),
    **{
        encoding: (
            partial(foreign, kind=kind, encoding=encoding),
            f"its messages are '{encoding}', and ROS 2 needs CDR",
            FEW,
        )
        for kind, encoding in (('a.B', 'json'), ('sensor_msgs/JointState', 'ros1'))
    },
}


@pytest.mark.parametrize('name', BAGS)
def test_a_bag_that_cannot_be_read_is_one_line_and_exit_1(name, tmp_path, capsys):
    made, expected, commands = BAGS[name]
    path = made(tmp_path / 'bag')
    for words in commands:
        said = refused(words, path, capsys)
        assert expected.replace('PATH', str(path)) in said, words
        if name == 'malformed' and words.startswith('replay'):
            assert said.endswith('malformed: message is too short\n')
    assert [each.stem for each in tmp_path.iterdir()] == ['bag']


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
    said = refused(words, path, capsys)
    assert f"no message of '{bad}' of {path} can be read: all {COUNT} are malformed" in said


def test_some_malformed_messages_are_counted_aloud(tmp_path, capsys):
    path = bag_of(tmp_path / 'bag', JOINTS, [STATES, TRUTH], part=0.1)
    assert cli.main(['replay', str(path)]) == 0
    assert 'malformed 6' in capsys.readouterr().out
    assert cli.main(['evaluate', str(path), '--observer', 'pll']) == 0
    said = capsys.readouterr().err
    assert f"6 of {COUNT} messages of '{STATES}' of {path} are malformed and are skipped" in said
    assert f"6 of {COUNT} messages of '{TRUTH}' of {path} are malformed and are skipped" in said


@pytest.mark.parametrize('schema', [('ros2msg', b'float64 data\n'), ('', b'')])
def test_a_type_without_msg_in_its_name_is_read(schema, tmp_path, capsys):
    kind = 'std_msgs/msg/Float64'
    number = make.STORE.types[kind]
    raws = [
        bytes(make.STORE.serialize_cdr(number(data=math.sin(0.02 * i)), kind)) for i in range(300)
    ]
    bag = foreign(tmp_path / 'bag', 'std_msgs/Float64', 'cdr', schema, raws)
    assert cli.main(['replay', str(bag), '--angle', '/angle:data']) == 0
    capsys.readouterr()
    assert '--angle /angle:data' in refused('doctor', bag, capsys)


def test_joint_states_without_positions_say_so(tmp_path, capsys):
    encode = Encoder().encode
    speeds = {STATES: (TYPE, lambda i: encode(START + i * 10**7, '', ['a'], [], [0.1 * i]))}
    bag = bag_of(tmp_path / 'bag', speeds)
    for command, said in (
        ('doctor', f'{STATES} has velocities but no positions'),
        ('evaluate', f'{STATES} has velocities but no positions'),
        ('replay', 'observers need positions, not velocities'),
    ):
        assert said in refused(command, bag, capsys)
