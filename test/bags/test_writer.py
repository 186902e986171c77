# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags that are written: whole or not at all, and as other tools want them."""

import random
import subprocess
import sys

import bag_making as make
import pytest
import yaml
from bag_making import OTHER, START, STATES, STORE, TEXT
from mcap.reader import NonSeekingReader, make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_types_from_msg

from estimator_pkg.bags import qos
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.errors import UserError
from estimator_pkg.messages.joint_state import TYPE

HASH = 'RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e'  # as Jazzy has it


def messages_of(path):
    with open_bag(path) as bag:
        return [
            (message.topic, message.log_ns, message.publish_ns, message.raw)
            for message in bag.messages()
        ]


def test_other_tools_find_no_fault(tmp_path, monkeypatch):
    """They read every message, by the index and without it, from one chunk and from several."""
    messages = make.content(300)
    assert make.opened_by_others(make.ours(tmp_path / 'one', messages)) == messages
    monkeypatch.setattr('estimator_pkg.bags.writer.CHUNK_SIZE', 3000)
    path = make.ours(tmp_path / 'bag', messages[::-1]) / 'bag_0.mcap'
    with open(path, 'rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        found = [(channel.topic, m.log_time, m.data) for _, channel, m in reader.iter_messages()]
        assert sorted(found) == sorted(messages)
        assert reader.get_header().profile == 'ros2'
        inside = yaml.safe_load(next(reader.iter_metadata()).metadata['serialized_metadata'])
    first, last = messages[0][1], messages[-1][1]
    count = summary.statistics.message_count
    assert count == inside['message_count'] == len(messages)
    assert inside['starting_time'] == {'nanoseconds_since_epoch': first}
    assert inside['duration'] == {'nanoseconds': last - first}
    assert summary.statistics.message_start_time == first
    assert summary.statistics.message_end_time == last
    assert len(summary.chunk_indexes) > 10
    assert all(index.compression == 'zstd' for index in summary.chunk_indexes)
    with open(path, 'rb') as stream:  # in the order of the file, without any index
        assert len(list(NonSeekingReader(stream, validate_crcs=True).iter_messages())) == 400


def test_metadata_are_those_of_jazzy(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(STATES, TYPE, qos.profile(reliable=False, depth=50))
        bag.add_topic('/latched', TEXT, qos.profile(transient_local=True, depth=1))
        bag.write(STATES, START, make.content(1)[0][2], START - 5)
        bag.write(STATES, START + 7, make.content(1)[0][2])
    information = yaml.safe_load((tmp_path / 'bag/metadata.yaml').read_text())[
        'rosbag2_bagfile_information'
    ]
    extent = {
        'message_count': 2,
        'starting_time': {'nanoseconds_since_epoch': START},
        'duration': {'nanoseconds': 7},
    }
    expected = {
        'version': 9,
        'storage_identifier': 'mcap',
        'relative_file_paths': ['bag_0.mcap'],
        **extent,
        'files': [{'path': 'bag_0.mcap', **extent}],
    }
    assert {name: information[name] for name in expected} == expected
    state, latched = (item['topic_metadata'] for item in information['topics_with_message_count'])
    assert state['type_description_hash'] == HASH
    assert state['offered_qos_profiles'][0]['reliability'] == 'best_effort'
    assert state['offered_qos_profiles'][0]['depth'] == 50
    assert latched['offered_qos_profiles'][0]['durability'] == 'transient_local'
    with open_bag(tmp_path / 'bag') as bag:
        assert bag.topics[STATES].qos == (qos.profile(reliable=False, depth=50),)
        assert bag.topics[STATES].type_hash == HASH
        assert [(message.log_ns, message.publish_ns) for message in bag.messages()] == [
            (START, START - 5),
            (START + 7, START + 7),
        ]


def test_a_file_alone_carries_hash_qos_and_definition(tmp_path):
    path = make.ours(tmp_path / 'alone.mcap', make.content(3))
    assert path.is_file()
    assert list(tmp_path.iterdir()) == [path]
    with open_bag(path) as bag:
        topic = bag.topics[STATES]
    assert topic.type_hash == HASH
    assert topic.qos == (qos.profile(),)
    known = get_types_from_msg(topic.definition, TYPE)
    assert known[TYPE] == STORE.fielddefs[TYPE]
    assert {'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'} < set(known)


def test_a_bag_without_messages_is_a_bag(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(STATES, TYPE)
    with Reader(tmp_path / 'bag') as reader:
        assert [item.topic for item in reader.connections] == [STATES]
    with open_bag(tmp_path / 'bag') as bag:
        assert bag.count == 0


@pytest.mark.parametrize('error', [ValueError, KeyboardInterrupt, SystemExit])
def test_an_error_or_interrupt_half_way_leaves_nothing(error, tmp_path):
    with pytest.raises(error), BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic(STATES, TYPE)
        bag.write(STATES, START, b'x')
        bag.flush()
        raise error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
def test_a_recording_is_kept_whatever_goes_wrong(name, tmp_path, capsys):
    path = tmp_path / name
    with pytest.raises(KeyError), BagWriter(path, keep=True) as bag:
        bag.add_topic(STATES, TYPE)
        bag.write(STATES, START, b'x')
        raise KeyError
    assert f'{path} contains the messages written so far; to' in capsys.readouterr().err
    assert [raw for *_, raw in messages_of(path)] == [b'x']
    with pytest.raises(KeyError), BagWriter(tmp_path / f'empty_{name}', keep=True) as bag:
        bag.add_topic(STATES, TYPE)
        raise KeyError
    assert list(tmp_path.iterdir()) == [path]


def test_a_recording_is_kept_when_the_disk_is_full(tmp_path, capsys):
    path = tmp_path / 'bag'
    with (
        make.no_file_above(3_000_000),
        pytest.raises(UserError, match=f'{path} cannot be written: File too large'),
        BagWriter(path, keep=True) as bag,
    ):
        bag.add_topic(OTHER, TEXT)
        for i in range(9000):
            bag.write(OTHER, START + i, random.randbytes(1000))
    assert capsys.readouterr().err.startswith(f'{path} contains the messages written so far; to')
    assert 1500 < len(messages_of(path)) < 3000


def test_what_is_there_is_never_overwritten(tmp_path):
    path = tmp_path / 'bag'
    path.write_text('mine')
    with pytest.raises(UserError, match='exists already'):
        BagWriter(path)
    assert path.read_text() == 'mine'
    dangling = tmp_path / 'link'
    dangling.symlink_to(tmp_path / 'nowhere')
    with pytest.raises(UserError, match='exists already'):
        BagWriter(dangling)
    # what appears while the bag is being written is kept, too
    for name in ('late', 'late.mcap'):
        late = tmp_path / name
        with pytest.raises(UserError, match='cannot be written'), BagWriter(late) as bag:
            bag.add_topic(STATES, TYPE)
            late.write_text('mine')
        assert late.read_text() == 'mine'
    assert not [item for item in tmp_path.iterdir() if item.name.startswith('.')]


@pytest.mark.parametrize(
    'name, said',
    [
        ('nowhere/bag', 'does not exist'),
        ('/proc/bag', 'cannot be written'),
        *((name, 'bags are written as MCAP') for name in ('bag.db3', 'bag.bag', 'b.mcap.zstd')),
    ],
)
def test_places_that_cannot_be_written_are_refused_at_once(name, said, tmp_path):
    with pytest.raises(UserError, match=said):
        BagWriter(tmp_path / name)


CRASHING = """
import os, sys
from estimator_pkg.bags.writer import BagWriter
bag = BagWriter(sys.argv[1], keep=True)
bag.add_topic('/chatter', 'std_msgs/msg/String')
for i in range(100):
    bag.write('/chatter', 10**18 + i, b'\\0\\1\\0\\0' + bytes([i]))
bag.flush()
bag.write('/chatter', 10**18 + 101, b'not yet on the disk')
os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
def test_a_crashed_recording_can_be_read(name, tmp_path, capsys):
    path = tmp_path / name
    done = subprocess.run([sys.executable, '-c', CRASHING, str(path)], timeout=60, check=False)
    assert done.returncode == -9
    assert [raw[4:] for _, _, _, raw in messages_of(path)] == [bytes([i]) for i in range(100)]
    assert f'{path.name}' in capsys.readouterr().err
