# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of every kind are read alike; what is wrong with one is said in a line."""

import shutil
import sqlite3
from pathlib import Path

import bag_making as make
import numpy as np
import pytest
import yaml
from bag_making import OTHER, STATES, TEXT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import SeekingReader, make_reader
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader

from estimator_pkg.bags.reader import natural, open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.errors import UserError
from estimator_pkg.messages.joint_state import TYPE

RECORDINGS = Path(__file__).parents[2] / 'bags'


def read(path, topics=None):
    with open_bag(path) as bag:
        return [(message.topic, message.log_ns, message.raw) for message in bag.messages(topics)]


@pytest.mark.parametrize('kind', make.KINDS)
def test_every_kind_gives_the_same_messages(kind, tmp_path, capsys):
    messages = make.content()
    path = make.KINDS[kind](tmp_path / 'bag', messages)
    assert read(path) == messages
    assert read(path, [OTHER]) == [item for item in messages if item[0] == OTHER]
    with open_bag(path) as bag:
        assert {topic.name: (topic.type, topic.count) for topic in bag.topics.values()} == {
            STATES: (TYPE, 50),
            OTHER: (TEXT, 17),
        }
        assert not bag.warnings
    assert capsys.readouterr().err == ''


@pytest.mark.parametrize('kind', ['mcap folder', 'sqlite3'])
def test_a_single_file_of_a_folder_is_a_bag(kind, tmp_path):
    messages = make.content()
    folder = make.KINDS[kind](tmp_path / 'bag', messages)
    (file,) = (file for file in folder.iterdir() if file.suffix in ('.mcap', '.db3'))
    assert read(file) == messages


def test_files_without_metadata_are_read_by_number_whatever_their_names(tmp_path):
    """A digit may be one that int() does not take, such as a superscript."""
    names = ['bag_9.db3', 'bag_10.db3', 'bag².db3', 'bag³_2.db3']
    assert sorted(map(Path, reversed(names)), key=natural) == list(map(Path, names))
    folder = make.KINDS['mcap folder'](tmp_path / 'bag', make.content())
    (folder / 'metadata.yaml').unlink()
    (file,) = folder.iterdir()
    file.rename(folder / 'bag².mcap')
    assert read(folder) == make.content()


@pytest.mark.parametrize(
    'path', sorted(RECORDINGS.glob('*/*/metadata.yaml')), ids=lambda path: path.parent.name
)
def test_the_recordings_are_read_as_rosbags_reads_them(path):
    listed = yaml.safe_load(path.read_text())['rosbag2_bagfile_information']
    counts = {
        item['topic_metadata']['name']: item['message_count']
        for item in listed['topics_with_message_count']
    }
    with open_bag(path.parent) as bag:
        assert {topic.name: topic.count for topic in bag.topics.values()} == counts
        found = [(message.topic, message.log_ns, message.raw) for message in bag.messages()]
        assert not bag.warnings
    with AnyReader([path.parent]) as reader:
        expected = [
            (connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages()
        ]
    assert [time for _, time, _ in found] == [time for _, time, _ in expected]
    assert sorted(found) == sorted(expected)  # versions of rosbags differ at equal times


def test_recordings_fit_into_six_megabytes():
    assert sum(file.stat().st_size for file in RECORDINGS.rglob('*') if file.is_file()) < 6e6


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    offsets=st.lists(st.integers(0, 60), min_size=1, max_size=60), chunk_size=st.integers(1, 3000)
)
def test_overlapping_chunks_come_in_log_order(offsets, chunk_size, tmp_path):
    messages = [(OTHER, make.START + offset, make.text(str(i))) for i, offset in enumerate(offsets)]
    path = make.mcap(tmp_path / 'bag.mcap', messages, chunk_size=chunk_size)
    found = read(path)
    assert [item[1] for item in found] == sorted(item[1] for item in messages)
    assert sorted(found) == sorted(messages)


def test_chunks_that_overlap_a_little_are_not_gathered(tmp_path):
    # each chunk reaches a little into the next, as with a recorder of several threads
    messages = [(OTHER, make.START + i + 25 * (i % 2), make.text(f'{i:100}')) for i in range(1000)]
    path = make.mcap(tmp_path / 'bag.mcap', messages, chunk_size=1400)
    with open_bag(path) as bag:
        sizes = [len(block) for _, block in bag.blocks()]
    assert sum(sizes) == 1000
    assert max(sizes) < 80


@pytest.mark.parametrize('lacks', ['its last entry', 'a message that another entry repeats'])
def test_an_index_that_lacks_messages_loses_none(lacks, tmp_path):
    messages = make.content()
    path = make.mcap(tmp_path / 'bag.mcap', messages)
    with open(path, 'rb') as stream:
        (chunk,) = make_reader(stream).get_summary().chunk_indexes
    raw = bytearray(path.read_bytes())
    at = min(chunk.message_index_offsets.values())
    length = int.from_bytes(raw[at + 11 : at + 15], 'little')
    if lacks == 'its last entry':
        raw[at + 11 : at + 15] = (length - 16).to_bytes(4, 'little')
    else:
        raw[at + 15 + 8 : at + 15 + 16] = raw[at + 15 + 24 : at + 15 + 32]
    path.write_bytes(raw)
    assert read(path) == messages


def test_files_of_a_split_bag_that_overlap_come_in_log_order(tmp_path):
    messages = make.content()
    shuffled = messages[::3] + messages[1::3] + messages[2::3]
    for name, part in (('mcap zstd', 'mcap'), ('sqlite3', 'sqlite3')):
        path = make.split(tmp_path / part, shuffled, make.KINDS[name])
        found = read(path)
        assert sorted(found) == sorted(messages)
        if part == 'mcap':
            assert [item[1] for item in found] == [item[1] for item in messages]


@pytest.mark.parametrize('kind, at', [('mcap folder', 2**63), ('sqlite3', -5)])
def test_a_time_that_cannot_be_is_read_and_written(kind, at, tmp_path):
    """It ended with a traceback when the new bag was written."""
    content = make.content(4)
    topic, _, *rest = content[2]
    content[2] = (topic, at, *rest)
    path = make.KINDS[kind](tmp_path / 'bag', content)
    assert sorted(raw for _, _, raw in read(path)) == sorted(raw for _, _, raw in content)
    with BagWriter(tmp_path / 'new') as new:
        new.add_topic('/all', 'std_msgs/msg/String')
        for _, log_ns, raw in read(path):
            new.write('/all', log_ns, raw)
    wrong = max(0, min(at, 2**63 - 1))
    assert wrong in {log_ns for _, log_ns, _ in read(tmp_path / 'new')}


def test_both_times_are_kept(tmp_path):
    path = make.mcap(tmp_path / 'bag.mcap', make.content(3), publish_ns=make.START - 77)
    with open_bag(path) as bag:
        assert {message.publish_ns for message in bag.messages()} == {make.START - 77}
    # a recorder that knows no publish time leaves it 0
    path = make.mcap(tmp_path / 'none.mcap', make.content(3), publish_ns=0)
    with open_bag(path) as bag:
        assert all(message.publish_ns == message.log_ns for message in bag.messages())


@pytest.mark.long
@pytest.mark.parametrize(
    'kind', ['mcap zstd', 'mcap plain', 'mcap lz4', 'mcap small chunks', 'mcap without chunks']
)
def test_a_cut_off_file_gives_what_is_there_and_says_so(kind, tmp_path, capsys):
    messages = make.content(200)
    whole = make.KINDS[kind](tmp_path / 'bag', messages).read_bytes()
    file = tmp_path / 'cut.mcap'
    most = 0
    for part in np.linspace(0.02, 0.98, 25):
        file.write_bytes(whole[: int(part * len(whole))])
        capsys.readouterr()
        try:
            found = read(file)
        except UserError as error:
            assert 'ends before its first message' in str(error)
            continue
        assert found == messages[: len(found)]
        if len(found) < len(messages):
            said = capsys.readouterr().err
            assert said.count('ends early') == said.count('\n') == 1
            assert '`mcap recover' in said and '.recover | sqlite3' in said
        most = max(most, len(found))
    assert most > 100


@pytest.mark.parametrize(
    'kind',
    [
        'ours',
        'mcap split',
        'sqlite3 split',
        'sqlite3, messages compressed',
        'sqlite3, file compressed',
    ],
)
def test_a_folder_whose_recorder_crashed_is_read(kind, tmp_path, capsys):
    messages = make.content()
    folder = make.KINDS[kind](tmp_path / 'bag', messages)
    (folder / 'metadata.yaml').unlink()
    assert read(folder) == messages
    assert 'no metadata.yaml' in capsys.readouterr().err
    (folder / 'metadata.yaml').write_text('}{')
    assert read(folder) == messages
    assert 'is not valid metadata' in capsys.readouterr().err


def test_a_database_with_a_log_or_a_journal_is_finished_first(tmp_path, capsys):
    messages = make.content(200)
    folder = make.rosbags(tmp_path / 'bag', messages)
    base = sqlite3.connect(folder / 'bag.db3')
    base.execute('pragma journal_mode = wal')
    base.execute(
        'insert into messages(topic_id, timestamp, data) values (1, ?, ?)',
        (make.START + 10**12, make.text('in the log')),
    )
    base.commit()
    shutil.copytree(folder, tmp_path / 'crashed')  # the log is still next to it
    base.close()
    found = read(tmp_path / 'crashed')
    assert found[:-1] == messages
    assert found[-1][1:] == (make.START + 10**12, make.text('in the log'))
    assert 'was not closed: it is read with bag.db3-wal' in capsys.readouterr().err

    base = sqlite3.connect(folder / 'bag.db3', isolation_level=None)
    base.execute('pragma journal_mode = delete')
    base.execute('pragma cache_size = 1')
    base.execute('begin')
    base.execute("update messages set data = x'00010000ff'")  # half of it is on the disk
    shutil.copytree(folder, tmp_path / 'half')
    base.close()
    assert list((tmp_path / 'half').glob('*-journal'))
    assert read(tmp_path / 'half') == found


def test_a_damaged_chunk_is_left_out_with_a_warning(tmp_path, capsys):
    messages = make.content()
    path = make.mcap(
        tmp_path / 'bag.mcap', messages, compression=CompressionType.NONE, chunk_size=600
    )
    raw = bytearray(path.read_bytes())
    hit = raw.index(messages[20][2]) + 30
    raw[hit] ^= 255
    path.write_bytes(raw)
    found = read(path)
    assert 0 < len(found) < len(messages)
    assert set(found) < set(messages)
    assert 'wrong checksum' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('kind', 'data', 'said'),
    [
        ('sqlite3', 'text', 'messages are not bytes'),
        ('sqlite3', 5, 'messages are not bytes'),
        ('sqlite3, messages compressed', b'\0' * 20, 'cannot be unpacked'),
    ],
)
def test_messages_that_are_damaged_are_left_out(kind, data, said, tmp_path, capsys):
    path = make.KINDS[kind](tmp_path / 'bag', make.content(9))
    with sqlite3.connect(next(path.glob('*.db3'))) as base:
        base.execute('update messages set data = ? where id in (2, 3)', (data,))
        base.execute('update topics set id = 2000000000000 where id = 1')
        base.execute('update messages set topic_id = 2000000000000 where topic_id = 1')
    base.close()
    with open_bag(path) as bag:
        assert len(list(bag.messages())) == bag.count - 2
    assert capsys.readouterr().err.count(said) == 1


@pytest.mark.parametrize(
    ('damage', 'left'),
    [
        ({'message_index_length': 2**50}, 40),
        ({'chunk_start_offset': 2**63}, 0),
        ({'uncompressed_size': 100}, 0),
    ],
)
def test_damaged_places_and_sizes_of_chunks(damage, left, tmp_path, monkeypatch, capsys):
    path = make.mcap(tmp_path / 'a.mcap', make.content(30))
    summarised = SeekingReader.get_summary

    def damaged(reader):
        summary = summarised(reader)
        for index in summary.chunk_indexes:
            for name, value in damage.items():
                setattr(index, name, value)
        return summary

    monkeypatch.setattr(SeekingReader, 'get_summary', damaged)
    assert len(read(path)) == left
    assert ('is damaged' in capsys.readouterr().err) == (not left)


def test_an_index_that_leads_out_of_the_chunk(tmp_path):
    path = make.mcap(tmp_path / 'a.mcap', make.content(30), compression=CompressionType.NONE)
    with open(path, 'rb') as stream:
        at = make_reader(stream).get_summary().chunk_indexes[0].chunk_start_offset
    raw = bytearray(path.read_bytes())
    index = at + 9 + int.from_bytes(raw[at + 1 : at + 9], 'little')  # behind the chunk
    assert raw[index] == Opcode.MESSAGE_INDEX
    raw[index + 23 : index + 31] = (2**63 - 1).to_bytes(8, 'little')  # of the first message
    path.write_bytes(raw)
    with open_bag(path) as bag:
        assert len(list(bag.messages())) == bag.count


@pytest.mark.long
@pytest.mark.parametrize('name', ['d%41', 'a#b', 'a?mode=memory', 'a%', 'ä %20', "a'b", '%2e%2e'])
@pytest.mark.parametrize(
    'kind', ['sqlite3', 'sqlite3, file compressed', 'mcap folder', 'mcap zstd']
)
def test_a_path_means_itself_alone(kind, name, tmp_path, capsys):
    """In a URI %41 is A: dA is another bag."""
    mine = make.content(4)
    for folder, messages in ((name, mine), ('dA', make.content(9))):
        made = make.KINDS[kind](tmp_path / 'bag', messages)
        (tmp_path / folder).mkdir()
        shutil.move(made, tmp_path / folder / made.name)
    path = tmp_path / name / made.name
    assert read(path) == mine
    for file in [path] if path.is_file() else path.glob('*.[md][cb]*'):
        alone = shutil.copy(file, tmp_path / name / f'{name}{file.suffix}')
        found = read(alone)
        assert found and set(found) <= set(mine)
    assert capsys.readouterr().err == ''


def information(**changes):
    return {'relative_file_paths': ['bag_0.mcap'], 'topics_with_message_count': [], **changes}


def about(**changes):
    return [
        {
            'topic_metadata': {
                'name': '/x',
                'type': TEXT,
                'serialization_format': 'cdr',
                **changes,
            },
            'message_count': 1,
        }
    ]


STRANGE = [None, True, 5, 1.5, [], {}, ['a'], '']
BREAKS_THE_PARSER = [
    '[' * 20000,
    'a: ' + '1' * 6000,
    'a: 2020-99-99',
    '\0',
    'a: &a [*a, *a]',
    '? [a, b]\n: c',
    '\xff',
]


@pytest.mark.long
@pytest.mark.parametrize(
    'content',
    [
        *({'rosbag2_bagfile_information': each} for each in STRANGE),
        *STRANGE,
        *(
            information(relative_file_paths=each)
            for each in [None, True, 5, [], {}, '', [True], [None], [[]], ['..'], ['a\0b']]
        ),
        *(information(topics_with_message_count=each) for each in STRANGE),
        *(information(topics_with_message_count=[each]) for each in STRANGE),
        *(information(topics_with_message_count=[{'topic_metadata': each}]) for each in STRANGE),
        *(
            information(topics_with_message_count=about(**{key: each}))
            for each in STRANGE
            for key in ('name', 'type', 'offered_qos_profiles', 'type_description_hash')
        ),
        *(information(compression_mode=each) for each in STRANGE),
        *BREAKS_THE_PARSER,
    ],
    ids=lambda content: str(content).replace('\0', '0')[:60],
)
@pytest.mark.parametrize('bare', [True, False])
def test_no_metadata_keep_a_bag_from_being_read(content, bare, tmp_path, capsys):
    messages = make.content(4)
    path = make.ours(tmp_path / 'bag', messages)
    if bare and isinstance(content, dict) and 'rosbag2_bagfile_information' not in content:
        content = {'rosbag2_bagfile_information': content}
    text = content if content in BREAKS_THE_PARSER else yaml.safe_dump(content)
    (path / 'metadata.yaml').write_text(text, encoding='latin-1')
    assert read(path) == messages
    assert capsys.readouterr().err.count('is not valid metadata') <= 1
    with open_bag(path) as bag:
        assert bag.listing() and bag.topics[STATES].count == 4
    assert 'Traceback' not in capsys.readouterr().err


def test_messages_compressed_otherwise_are_refused(tmp_path):
    path = make.KINDS['sqlite3, messages compressed'](tmp_path / 'bag', make.content(4))
    file = path / 'metadata.yaml'
    file.write_text(file.read_text().replace('compression_format: zstd', 'compression_format: xz'))
    with pytest.raises(UserError, match="compressed with 'xz', but only zstd is supported"):
        open_bag(path)


def test_a_renamed_folder_is_read(tmp_path, capsys):
    messages = make.content()
    path = make.ours(tmp_path / 'bag', messages)
    next(path.glob('*.mcap')).rename(path / 'other_0.mcap')
    assert read(path.rename(tmp_path / 'other')) == messages
    assert capsys.readouterr().err == ''


def test_a_missing_file_of_a_split_bag_is_named(tmp_path, capsys):
    messages = make.content()
    path = make.KINDS['mcap split'](tmp_path / 'bag', messages)
    (path / 'bag_1.mcap').unlink()
    found = read(path)
    assert len(messages) == 67  # 23 in each file
    assert found == messages[:23] + messages[46:]
    assert 'bag_1.mcap, listed in metadata.yaml, is missing' in capsys.readouterr().err
    (path / 'bag_2.mcap').write_bytes(b'')
    read(path)
    assert (
        'bag_2.mcap is empty (0 bytes): name another file; it is skipped' in capsys.readouterr().err
    )


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_no_damage_gives_a_traceback(data, tmp_path):
    source = RECORDINGS / 'simulated/trapezoid_raw_counts/trapezoid_raw_counts_0.mcap'
    kind = data.draw(st.sampled_from(['recording', 'plain', 'database']))
    if kind == 'plain':
        source = make.mcap(
            tmp_path / 'plain.mcap', make.content(20), compression=CompressionType.NONE
        )
    elif kind == 'database':
        source = tmp_path / 'sqlite' / 'sqlite.db3'
        if not source.exists():
            make.rosbags(source.parent, make.content(300))
    raw = bytearray(source.read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path / 'damaged'
    file.write_bytes(raw)
    try:
        with open_bag(file) as bag:
            for _ in bag.messages():
                pass
    except UserError as error:
        assert '\n' not in str(error)


def wrong_bags(tmp_path):
    """(path, what its error says)."""
    messages = make.content(5)
    empty_folder = tmp_path / 'folder'
    empty_folder.mkdir()
    files = {
        'empty.mcap': b'',
        'empty.db3': b'',
        'text.mcap': b'hello world',
        'text.db3': b'hi',
        'old.bag': b'#ROSBAG V2.0\n',
        'a#%41.db3': b'SQLite format 3\0' + bytes(100),  # named as the user knows it, not quoted
    }
    for name, raw in files.items():
        (tmp_path / name).write_bytes(raw)
    cut = make.rosbags(tmp_path / 'sqlite', messages)
    (database,) = cut.glob('*.db3')
    (tmp_path / 'cut.db3').write_bytes(database.read_bytes()[:9000])
    for link, target in (('one', 'other'), ('other', 'one'), ('gone.mcap', 'nowhere')):
        (tmp_path / link).symlink_to(tmp_path / target)
    linked = tmp_path / 'linked'
    linked.mkdir()
    (linked / 'a.mcap').symlink_to('a.mcap')
    lonely = make.ours(tmp_path / 'lonely', messages)
    next(lonely.glob('*.mcap')).unlink()
    return [
        (tmp_path / 'xyz', 'does not exist: check the path'),
        (tmp_path / 'lonly', "does not exist: did you mean 'lonely'?"),
        (tmp_path / 'one', 'is a link to itself'),
        (tmp_path / 'gone.mcap', f'is a link to {tmp_path}/nowhere, which does not exist'),
        (linked, 'a.mcap: it is a link to itself'),
        (empty_folder, 'is not a bag: it has no'),
        (tmp_path / 'empty.mcap', 'is empty (0 bytes)'),
        (tmp_path / 'empty.db3', 'is empty (0 bytes)'),
        (tmp_path / 'text.mcap', 'is not a bag: it is neither MCAP nor sqlite3'),
        (tmp_path / 'text.db3', 'is not a bag'),
        (tmp_path / 'old.bag', 'is a bag of ROS 1'),
        (tmp_path / 'a#%41.db3', 'cannot be read as a bag'),
        (tmp_path / 'cut.db3', '`sqlite3 FILE .recover | sqlite3 NEW` (.db3)'),
        (lonely, 'listed in metadata.yaml, is missing'),
    ]


def test_wrong_bags_are_refused_in_one_line(tmp_path):
    for path, text in wrong_bags(tmp_path):
        with pytest.raises(UserError) as caught:
            open_bag(path)
        assert text in str(caught.value), path
        assert str(path) in str(caught.value)
        assert '\n' not in str(caught.value)


def test_an_unreadable_file_is_refused(tmp_path, monkeypatch):
    path = make.ours(tmp_path / 'bag', make.content(3))

    def denied(*_, **__):
        raise PermissionError(13, 'Permission denied', str(path))

    monkeypatch.setattr(Path, 'open', denied)
    with pytest.raises(UserError, match=r'cannot read .*Permission denied'):
        open_bag(path)


def test_require_says_what_is_there(tmp_path):
    path = make.ours(tmp_path / 'bag', make.content(5))
    with open_bag(path) as bag:
        assert bag.require(STATES, [TYPE]).count == 5
        with pytest.raises(
            UserError,
            match=r"no topic '/nope': it has /chatter \(std_msgs/msg/"
            r'String, 2 messages\), /joint_states \(',
        ):
            bag.require('/nope')
        with pytest.raises(UserError, match=r"'joint_states' \(did you mean '/joint_states'\?\)"):
            bag.require('joint_states')
        with pytest.raises(UserError, match=f"'{OTHER}' of .* is {TEXT}, not {TYPE}"):
            bag.require(OTHER, [TYPE])


def test_topics_without_messages_are_known(tmp_path):

    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(STATES, TYPE)
    with open_bag(tmp_path / 'bag') as bag:
        with pytest.raises(UserError, match='has 0 messages'):
            bag.require(STATES, [TYPE])
        assert list(bag.messages()) == []


@pytest.mark.parametrize('command', ['doctor', 'evaluate', 'replay'])
def test_an_empty_bag_says_how_many_messages_it_has(command, tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(STATES, TYPE)
    assert main([command, str(tmp_path / 'bag')]) == 1
    assert '(sensor_msgs/msg/JointState, 0 messages)' in capsys.readouterr().err


def test_messages_that_are_not_of_ros_2_are_refused(tmp_path):
    path = make.mcap(tmp_path / 'bag.mcap', make.content(5), encoding='json')
    with open_bag(path) as bag, pytest.raises(UserError, match="'json', and ROS 2 needs CDR"):
        bag.require(STATES)


def test_a_copy_of_a_bag_under_another_name_is_read(tmp_path):
    path = make.ours(tmp_path / 'bag', make.content(5))
    shutil.move(path, tmp_path / 'renamed')
    assert read(tmp_path / 'renamed') == make.content(5)
