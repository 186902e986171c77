# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of every kind are read alike; what is wrong with one is said in a line."""

import shutil
import sqlite3
from pathlib import Path

import bag_making as make
import numpy as np
import pytest
from bag_making import OTHER, STATES, TEXT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from estimator_pkg.bags.reader import open_bag
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


@pytest.mark.parametrize(
    'path', sorted(RECORDINGS.glob('*/*/metadata.yaml')), ids=lambda path: path.parent.name
)
def test_the_recordings_are_read_as_rosbags_reads_them(path):
    with open_bag(path.parent) as bag:
        counts = {topic.name: topic.count for topic in bag.topics.values()}
        found = [(message.topic, message.log_ns, message.raw) for message in bag.messages()]
        assert not bag.warnings
    with AnyReader([path.parent]) as reader:
        assert counts == {name: topic.msgcount for name, topic in reader.topics.items()}
        expected = [
            (connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages()
        ]
    assert [time for _, time, _ in found] == [time for _, time, _ in expected]
    assert sorted(found) == sorted(expected)  # versions of rosbags differ at equal times


# ---------------------------------------------------------------- order and times


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


@pytest.mark.parametrize('kind', ['mcap zstd', 'sqlite3'])
def test_files_of_a_split_bag_that_overlap_come_in_log_order(kind, tmp_path):
    messages = make.content()
    shuffled = messages[::3] + messages[1::3] + messages[2::3]
    found = read(make.split(tmp_path / 'bag', shuffled, make.KINDS[kind]))
    assert sorted(found) == sorted(messages)
    assert kind == 'sqlite3' or [item[1] for item in found] == [item[1] for item in messages]


@pytest.mark.parametrize('kind, at', [('mcap folder', 2**63), ('sqlite3', -5)])
def test_a_time_that_cannot_be_is_read_and_written(kind, at, tmp_path):
    content = make.content(4)
    topic, _, *rest = content[2]
    content[2] = (topic, at, *rest)
    path = make.KINDS[kind](tmp_path / 'bag', content)
    assert sorted(raw for _, _, raw in read(path)) == sorted(raw for _, _, raw in content)
    make.ours(tmp_path / 'new', [(OTHER, *rest) for _, *rest in read(path)])
    assert max(0, min(at, 2**63 - 1)) in {log_ns for _, log_ns, _ in read(tmp_path / 'new')}


def test_the_time_of_publishing_is_that_of_recording_if_a_recorder_knows_none(tmp_path):
    path = make.mcap(tmp_path / 'none.mcap', make.content(3), publish_ns=0)
    with open_bag(path) as bag:
        assert all(message.publish_ns == message.log_ns for message in bag.messages())


# ---------------------------------------------------------------- damage


@pytest.mark.long
@pytest.mark.parametrize(
    'kind', ['mcap zstd', 'mcap lz4', 'mcap small chunks', 'mcap without chunks']
)
def test_a_cut_off_file_gives_what_is_there_and_says_so(kind, tmp_path, capsys):
    messages = make.content(200)
    whole = make.KINDS[kind](tmp_path / 'bag', messages).read_bytes()
    file = tmp_path / 'cut.mcap'
    most = 0
    for part in np.linspace(0.02, 0.98, 13):
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
            assert said.count('ends early') == said.count('\n') == 1 and '`mcap recover' in said
        most = max(most, len(found))
    assert most > 100


def metadata(text):
    return lambda path: (path / 'metadata.yaml').write_text(text)


def unlisted(path):
    (path / 'metadata.yaml').unlink()


def without(name):
    return lambda path: (path / name).unlink()


def file_of_another_name(path):
    next(path.glob('*.mcap')).rename(path / 'other_0.mcap')


def of_file(change):
    """Change the bytes of an MCAP file; `change` also gets the place of its first chunk."""

    def damage(path):
        with open(path, 'rb') as stream:
            index = make_reader(stream).get_summary().chunk_indexes[0]
        raw = bytearray(path.read_bytes())
        change(raw, index)
        path.write_bytes(raw)

    return damage


def wrong_place(raw, chunk):
    """The summary names another place for the chunk."""
    at = raw.rindex(chunk.chunk_start_offset.to_bytes(8, 'little'))
    raw[at : at + 8] = (2**63).to_bytes(8, 'little')


def flipped_bit(raw, chunk):
    raw[raw.index(make.content()[20][2]) + 30] ^= 255


def sqlite(command, *values):
    def damage(path):
        with sqlite3.connect(next(path.glob('*.db3'))) as base:
            base.execute(command, values)
        base.close()

    return damage


PACKED = 'sqlite3, messages compressed'
OF_TWO = 'update messages set data = ? where id in (2, 3)'
DAMAGES = {  # kind, damage, messages that are left, warning
    'no metadata, ours': ('ours', unlisted, slice(None), 'no metadata.yaml'),
    'no metadata, split': ('mcap split', unlisted, slice(None), 'no metadata.yaml'),
    'no metadata, split database': ('sqlite3 split', unlisted, slice(None), 'no metadata.yaml'),
    'no metadata, packed messages': (PACKED, unlisted, slice(None), 'no metadata.yaml'),
    'no metadata, packed file': (
        'sqlite3, file compressed', unlisted, slice(None), 'no metadata.yaml'
    ),
    'wrong metadata': ('sqlite3 split', metadata('}{'), slice(None), 'is not valid metadata'),
    'renamed file': ('mcap folder', file_of_another_name, slice(None), ''),
    'missing file': ('mcap split', without('bag_1.mcap'), [*range(23), *range(46, 67)],
                     'bag_1.mcap, listed in metadata.yaml, is missing'),
    'empty file': ('mcap split', lambda path: (path / 'bag_2.mcap').write_bytes(b''), slice(46),
                   'bag_2.mcap is empty (0 bytes): name another file; it is skipped'),
    'place of the chunk': ('mcap zstd', of_file(wrong_place), slice(0), 'is damaged'),
    'flipped bit': ('mcap plain', of_file(flipped_bit), slice(0), 'wrong checksum'),
    'text': ('sqlite3', sqlite(OF_TWO, 'text'), [0, *range(3, 67)], 'messages are not bytes'),
    'number': ('sqlite3', sqlite(OF_TWO, 5), [0, *range(3, 67)], 'messages are not bytes'),
    'frame': (PACKED, sqlite(OF_TWO, b'\x28\xb5\x2f\xfd' + b'\xff' * 9), [0, *range(3, 67)],
              'cannot be unpacked'),
}  # fmt: skip


@pytest.mark.parametrize('name', DAMAGES)
def test_what_is_whole_in_a_damaged_bag_is_read(name, tmp_path, capsys):
    kind, damage, left, said = DAMAGES[name]
    messages = make.content()
    path = make.KINDS[kind](tmp_path / 'bag', messages)
    damage(path)
    rows = np.arange(len(messages))[left]
    assert read(path) == [messages[row] for row in rows]
    printed = capsys.readouterr().err
    assert printed.count('\n') == printed.count(said) == 1 if said else not printed


@pytest.mark.parametrize('log', ['bag.db3-wal', 'bag.db3-journal'])
def test_a_database_that_was_not_closed_says_how_to_complete_it(log, tmp_path):
    folder = make.rosbags(tmp_path / 'bag', make.content(9))
    (folder / log).write_bytes(b'x')
    with pytest.raises(UserError, match=f'{log} has a part of it: complete it with `sqlite3 FILE'):
        open_bag(folder)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_no_damage_gives_a_traceback(data, tmp_path):
    source = RECORDINGS / 'simulated/trapezoid_raw_counts/trapezoid_raw_counts_0.mcap'
    kind = data.draw(st.sampled_from(['recording', 'plain', 'database']))
    if kind == 'plain':
        source = make.KINDS['mcap plain'](tmp_path / 'plain', make.content(20))
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


@pytest.mark.parametrize(
    'paths', ['', '[]', '5', '[..]', '[True]', '[[]]', '{a: b}', '"a\\0b"', '[' * 3000, '\xff']
)
def test_no_metadata_keep_a_bag_from_being_read(paths, tmp_path, capsys):
    text = f'rosbag2_bagfile_information: {{relative_file_paths: {paths}}}'
    messages = make.content(4)
    path = make.ours(tmp_path / 'bag', messages)
    (path / 'metadata.yaml').write_text(text, encoding='latin-1')
    with open_bag(path) as bag:
        assert [message.raw for message in bag.messages()] == [raw for *_, raw in messages]
        assert bag.listing() and bag.topics[STATES].count == 4
    said = capsys.readouterr().err
    assert said.count('is not valid metadata') == said.count('\n') <= 1


# ---------------------------------------------------------------- paths, and what is no bag


@pytest.mark.parametrize('name', ['d%41', 'a?mode=memory', "ä %20#'"])
@pytest.mark.parametrize('kind', ['sqlite3', 'mcap folder'])
def test_a_path_means_itself_alone(kind, name, tmp_path, capsys):
    """In a URI %41 is A: dA is another bag."""
    mine = make.content(4)
    for folder, messages in ((name, mine), ('dA', make.content(9))):
        made = make.KINDS[kind](tmp_path / 'bag', messages)
        (tmp_path / folder).mkdir()
        shutil.move(made, tmp_path / folder / made.name)
    assert read(tmp_path / name / made.name) == mine
    assert capsys.readouterr().err == ''


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


def test_wrong_bags_are_refused_in_one_line(tmp_path, monkeypatch):
    for path, text in wrong_bags(tmp_path):
        with pytest.raises(UserError) as caught:
            open_bag(path)
        assert text in str(caught.value), path
        assert str(path) in str(caught.value)
        assert '\n' not in str(caught.value)
    path = make.ours(tmp_path / 'bag', make.content(3))

    def denied(*_, **__):
        raise PermissionError(13, 'Permission denied', str(path))

    monkeypatch.setattr(Path, 'open', denied)
    with pytest.raises(UserError, match=r'cannot read .*Permission denied'):
        open_bag(path)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['/nope'], r"no topic '/nope': it has /chatter \(std_msgs/msg/String, 2 messages\), /e"),
        (['joint_states'], r"'joint_states' \(did you mean '/joint_states'\?\)"),
        ([OTHER, [TYPE]], f"'{OTHER}' of .* is {TEXT}, not {TYPE}"),
        (['/empty'], 'has 0 messages'),
        (['/json'], "'json', and ROS 2 needs CDR"),
    ],
)
def test_require_says_what_is_there(words, said, tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for name, kind in ((STATES, TYPE), (OTHER, TEXT), ('/empty', TEXT)):
            writer.add_topic(name, kind)
        writer.add_topic('/json', 'a/msg/B', serialization='json')
        for topic, log_ns, raw in make.content(5):
            writer.write(topic, log_ns, raw)
    with open_bag(tmp_path / 'bag') as bag:
        assert bag.require(STATES, [TYPE]).count == 5
        with pytest.raises(UserError, match=said):
            bag.require(*words)


@pytest.mark.parametrize('command', ['doctor', 'evaluate', 'replay'])
def test_an_empty_bag_says_how_many_messages_it_has(command, tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(STATES, TYPE)
    assert main([command, str(tmp_path / 'bag')]) == 1
    assert '(sensor_msgs/msg/JointState, 0 messages)' in capsys.readouterr().err
