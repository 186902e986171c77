# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a crash leaves is never deleted by another writer, and becomes a bag again."""

import os
import resource
import shlex
import shutil
import signal
import sqlite3
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import bag_making as make
import dds
import numpy as np
import pytest
from bag_making import OTHER, START, STATES, TEXT
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from estimator_pkg import cli
from estimator_pkg.bags import writer as writer_module
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.messages.joint_state import TYPE

FAULTS = Path(__file__).resolve().parents[2] / 'bags' / 'simulated' / 'random_with_faults'
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


def crash(path):
    """A recorder of `path` is killed; the folder that it leaves."""
    done = subprocess.run([sys.executable, '-c', CRASHING, str(path)], timeout=60, check=False)
    assert done.returncode == -9 and not path.exists()
    (left,) = (each for each in path.parent.iterdir() if each.name.endswith('.part'))
    return left


def read(path):
    with open_bag(path) as bag:
        assert not bag.warnings
        return [(message.topic, message.log_ns, message.raw) for message in bag.messages()]


def opened_by_others(path):
    """The bag as rosbags reads it; the mcap library finds no fault in its file."""
    for file in path.glob('*.mcap'):
        with open(file, 'rb') as stream:
            count = len(list(make_reader(stream, validate_crcs=True).iter_messages()))
    with AnyReader([path]) as reader:
        found = [
            (connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages()
        ]
    assert len(found) == count
    return found


def recovered(path, out, capsys):
    assert cli.main(['record', '--recover', str(path), '--out', str(out)]) == 0
    said = capsys.readouterr()
    assert 'which you may delete now' in said.out
    assert path.exists()
    return opened_by_others(out)


@pytest.mark.parametrize('name', ['bag', 'bag.mcap', 'a [b] $c', 'a.b'])
def test_a_crashed_recording_is_named_and_recovered(name, tmp_path, capsys):
    path = tmp_path / name
    left = crash(path)
    with BagWriter(path) as bag:  # the next one to the same place
        bag.add_topic(OTHER, TEXT)
        bag.write(OTHER, START, b'x')
    said = capsys.readouterr().err
    assert f'{left} contains an incomplete {path}, whose process was killed' in said
    assert 'velocity_estimator record --recover ' in said and said.count('\n') == 1
    words = said.split('`')[1].replace(' BAG', f" '{tmp_path / 'again'}'")
    done = subprocess.run(
        words.replace('velocity_estimator', f'{sys.executable} -m estimator_pkg.cli', 1),
        shell=True,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert [raw[4:] for _, _, raw in opened_by_others(tmp_path / 'again')] == [
        bytes([i]) for i in range(100)
    ]


def test_nobody_deletes_what_another_one_made(tmp_path, capsys, monkeypatch):
    """The same process number in a container, and the same random name."""
    path = tmp_path / 'bag'
    left = crash(path)
    before = {file.name: file.read_bytes() for file in left.iterdir()}
    token = left.name.split('.')[2]
    others = iter([token, token, 'abcd'])
    monkeypatch.setattr(writer_module.secrets, 'token_hex', lambda count: next(others))
    monkeypatch.setattr(os, 'getpid', lambda: int(token, 16))
    with pytest.raises(KeyError), BagWriter(path) as bag:
        bag.add_topic(OTHER, TEXT)
        bag.write(OTHER, START, b'x')
        raise KeyError
    assert {file.name: file.read_bytes() for file in left.iterdir()} == before
    assert list(tmp_path.iterdir()) == [left]


def test_a_recorder_that_lives_is_no_crash(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as one:
        one.add_topic(OTHER, TEXT)
        one.write(OTHER, START, b'x')
        one.flush()
        assert writer_module.crashed(tmp_path / 'bag') == []
        (folder,) = tmp_path.iterdir()
        assert cli.main(['record', '--recover', str(folder), '--out', str(tmp_path / 'x')]) == 1
        assert 'is still being written' in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ['bag']


def test_folders_of_other_bags_are_not_taken_for_ones_own(tmp_path):
    for name in (
        '.bag.other.12ab.part',
        '.bags.12ab.part',
        '.bag.12ab.partly',
        '.bag.xyz.part',
        '.bag.12ab.part',
        '.bag.4711.part',
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'bag_0.mcap').write_bytes(b'x')
    assert [each.name for each in writer_module.crashed(tmp_path / 'bag')] == [
        '.bag.12ab.part',
        '.bag.4711.part',
    ]


@pytest.mark.parametrize(
    'kind',
    [
        'ours',
        'mcap zstd',
        'mcap plain',
        'mcap lz4',
        'mcap small chunks',
        'mcap without chunks',
        'mcap folder',
    ],
)
@pytest.mark.parametrize('part', [pytest.param(0.4, marks=pytest.mark.slow), 0.7, 0.98])
def test_a_torn_mcap_comes_out_with_all_complete_messages(kind, part, tmp_path, capsys):
    messages = make.content(4000)
    path = make.KINDS[kind](tmp_path / 'bag', messages)
    (file,) = path.glob('*.mcap') if path.is_dir() else [path]
    whole = file.read_bytes()
    os.truncate(file, int(part * len(whole)))
    if path.is_dir():
        (path / 'metadata.yaml').unlink()
    found = recovered(path, tmp_path / 'out', capsys)
    assert found and found == messages[: len(found)]
    if kind in ('mcap plain', 'mcap without chunks'):
        missing = [raw for topic, _, raw in messages[len(found) :] if topic == STATES]
        assert not any(raw in whole[: int(part * len(whole))] for raw in missing)
    with open_bag(tmp_path / 'out') as bag:
        assert bag.topics[STATES].type_hash and bag.topics[STATES].definition


def database(path, messages):
    bag = make.rosbags(path, messages)
    (bag / 'metadata.yaml').unlink()
    return next(bag.glob('*.db3'))


def test_a_crafted_database_takes_no_more_memory(tmp_path):
    """A page that is in no table has a row of a terabyte, continued by one page for ever."""
    messages = make.content(30)
    file = database(tmp_path / 'bag', messages)
    raw = bytearray(file.read_bytes())
    size = int.from_bytes(raw[16:18], 'big')
    again = (len(raw) // size + 2).to_bytes(4, 'big')  # number of the page that follows itself
    row = bytes([0xC0, 0x80, 0x80, 0x80, 0x80, 0, 1])  # 2**41 bytes, row 1
    leaf = bytes([13, 0, 0, 0, 1, 0, 0, 0, 0, 100]).ljust(100, b'\0') + row
    raw += (leaf + size * again)[:size] + again.ljust(size, b'\0')
    raw[28:32] = (len(raw) // size).to_bytes(4, 'big')
    file.write_bytes(raw)
    words = ['record', '--recover', str(file), '--out', str(tmp_path / 'out')]
    done = subprocess.run(
        [sys.executable, '-m', 'estimator_pkg.cli', *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30)),
    )
    assert done.returncode == 0, done.stderr
    assert opened_by_others(tmp_path / 'out') == messages


def test_a_torn_database_is_refused_in_one_line(tmp_path, capsys):
    file = database(tmp_path / 'the bag', make.content(3000))
    os.truncate(file, int(0.3 * file.stat().st_size))
    for words in (['replay', file], ['record', '--recover', file, '--out', tmp_path / 'out']):
        assert cli.main([*map(str, words)]) == 1
        line = capsys.readouterr().err
        assert line.count('\n') == 1 and 'malformed' in line
    assert not (tmp_path / 'out').exists()


def test_a_database_with_a_log_or_a_journal_is_finished_first(tmp_path, capsys):
    messages = make.content(200)
    file = database(tmp_path / 'bag', messages)
    base = sqlite3.connect(file)
    base.execute('pragma journal_mode = wal')
    base.execute(
        'insert into messages(topic_id, timestamp, data) values (1, ?, ?)',
        (START + 10**12, make.text('in the log')),
    )
    base.commit()
    shutil.copytree(tmp_path / 'bag', tmp_path / 'crashed')  # the log is still beside it
    base.close()
    with open_bag(tmp_path / 'crashed') as bag:
        assert bag.count == len(messages) + 1
    assert 'was not closed: it is read with bag.db3-wal' in capsys.readouterr().err
    found = recovered(tmp_path / 'crashed', tmp_path / 'out', capsys)
    assert found[:-1] == messages and found[-1][1:] == (START + 10**12, make.text('in the log'))

    base = sqlite3.connect(file, isolation_level=None)
    base.execute('pragma journal_mode = delete')
    base.execute('pragma cache_size = 1')
    base.execute('begin')
    base.execute("update messages set data = x'00010000ff'")  # half of it is on the disk
    shutil.copytree(tmp_path / 'bag', tmp_path / 'half')
    base.close()
    assert list((tmp_path / 'half').glob('*-journal'))
    assert recovered(tmp_path / 'half', tmp_path / 'again', capsys) == messages + found[-1:]


def test_split_and_compressed_bags_are_recovered(tmp_path, capsys):
    messages = make.content()
    for kind in (
        'mcap split',
        'sqlite3 split',
        'sqlite3, messages compressed',
        'sqlite3, file compressed',
    ):
        path = make.KINDS[kind](tmp_path / f'{kind}', messages)
        (path / 'metadata.yaml').unlink()
        assert recovered(path, tmp_path / f'out {kind}', capsys) == messages


@pytest.mark.parametrize(
    ('make_it', 'said'),
    [
        (lambda path: None, 'does not exist'),
        (lambda path: path.mkdir(), 'no .mcap or .db3 files'),
        (lambda path: path.write_bytes(b''), 'is empty (0 bytes)'),
        (lambda path: path.write_bytes(b'hello'), 'is not a bag'),
        (
            lambda path: path.write_bytes(b'SQLite format 3\0' + bytes(5000)),
            'cannot be read as a bag',
        ),
    ],
)
def test_what_cannot_be_recovered_is_one_line(make_it, said, tmp_path, capsys):
    make_it(tmp_path / 'left')
    assert (
        cli.main(['record', '--recover', str(tmp_path / 'left'), '--out', str(tmp_path / 'out')])
        == 1
    )
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / 'out').exists()
    assert cli.main(['record', '/x', '--recover', 'y', '--out', str(tmp_path / 'out')]) == 2


def test_no_damage_of_a_database_gives_a_traceback(tmp_path, capsys):
    messages = make.content(300)
    whole = database(tmp_path / 'bag', messages).read_bytes()
    random = np.random.default_rng(1)
    for number in range(25):
        raw = bytearray(whole)
        for at in random.integers(0, len(raw), 20).tolist():
            raw[at] = int(random.integers(256))
        file = tmp_path / f'{number}.db3'
        file.write_bytes(raw)
        out = tmp_path / f'out{number}'
        code = cli.main(['record', '--recover', str(file), '--out', str(out)])
        assert code == 0 or (code == 1 and not out.exists())
        if code == 0:
            with open_bag(out) as bag:
                assert len(list(bag.messages())) == bag.count > 0


# ---------------------------------------------------------------- no hard links


@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
@pytest.mark.parametrize('number', [1, 95, 38])
def test_no_hard_links_are_needed(name, number, tmp_path, monkeypatch):
    def refused(*_, **__):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, 'link', refused)
    messages = make.content(20)
    assert read(make.ours(tmp_path / name, messages)) == messages
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_folders_are_moved_where_none_can_be_replaced(tmp_path, monkeypatch):
    def refused(*_):
        raise OSError(39, os.strerror(39))

    monkeypatch.setattr(os, 'replace', refused)
    messages = make.content(20)
    assert read(make.ours(tmp_path / 'bag', messages)) == messages
    assert [each.name for each in tmp_path.iterdir()] == ['bag']


@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
def test_what_cannot_be_moved_is_kept(name, tmp_path, monkeypatch, capsys):
    def refused(*_):
        raise OSError(5, os.strerror(5))

    monkeypatch.setattr(os, 'replace', refused)
    monkeypatch.setattr(os, 'rename', refused)
    with (
        pytest.raises(Exception, match='Input/output error'),
        BagWriter(tmp_path / name, keep=True) as bag,
    ):
        bag.add_topic(OTHER, TEXT)
        bag.write(OTHER, START, b'x')
    monkeypatch.undo()
    (left,) = tmp_path.iterdir()  # nothing stands in the place of the bag
    assert f'{left} contains the messages written so far' in capsys.readouterr().err
    assert [raw for _, _, raw in read(next(left.glob('*.mcap')))] == [b'x']


# ---------------------------------------------------------------- signals


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_simulate_ends_with_what_it_has(number, tmp_path):
    with dds.NodeProcess(
        *shlex.split('estimator_pkg.cli simulate encoder --duration 100000'),
        '--out',
        str(tmp_path / 'bag'),
        '--json',
        str(tmp_path / 'j'),
    ) as process:
        assert dds.until(
            lambda: any(file.stat().st_size > 100_000 for file in tmp_path.glob('.bag.*/*'))
        )
        process.signal(number)
        process.signal(signal.SIGTERM)  # a launcher may send several
        assert process.ends() == 128 + number, process.output
    assert 'interrupted: 100000 s were requested' in process.output
    assert sorted(each.name for each in tmp_path.iterdir()) == ['bag', 'j']
    assert len(opened_by_others(tmp_path / 'bag')) > 1000


@pytest.fixture(scope='module')
def long_bag(tmp_path_factory):
    """Long enough to be interrupted, and too short to be compiled for."""
    path = tmp_path_factory.mktemp('signals') / 'long'
    assert cli.main(['simulate', 'encoder', '--duration', '300', '--out', str(path)]) == 0
    return path


@pytest.mark.parametrize(
    'number', [signal.SIGINT, signal.SIGHUP, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_replay_ends_with_what_it_has(number, long_bag, tmp_path):
    with dds.NodeProcess(
        'estimator_pkg.cli',
        'replay',
        str(long_bag),
        '--observer',
        'kalman',
        '--out',
        str(tmp_path / 'out'),
    ) as process:
        assert dds.until(
            lambda: (
                not process.alive
                or any(file.stat().st_size > 100_000 for file in tmp_path.glob('.out.*/*'))
            )
        )
        process.signal(number)
        assert process.ends() == 128 + number, process.output
    assert 'interrupted' in process.output and 'Traceback' not in process.output
    assert [each.name for each in tmp_path.iterdir()] == ['out']
    topics = {topic for topic, _, _ in opened_by_others(tmp_path / 'out')}
    assert '/joint_observer/estimate' in topics and STATES in topics


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP])
def test_evaluate_writes_the_bags_that_it_has(number, tmp_path):
    for name in range(40):
        shutil.copytree(FAULTS, tmp_path / 'bags' / f'b{name:02}')
    page = tmp_path / 'page.html'
    with dds.NodeProcess(
        'estimator_pkg.cli',
        'evaluate',
        str(tmp_path / 'bags'),
        '--observer',
        'pll',
        '--html',
        str(page),
        '--json',
        str(tmp_path / 'j'),
    ) as process:
        process.prints('bags/b00')
        process.signal(number)
        assert process.ends() == 128 + number, process.output
    assert 'interrupted' in process.output and 'Traceback' not in process.output
    assert 'page.html' in process.output and '/bags/b00' in page.read_text()
    assert sorted(each.name for each in tmp_path.iterdir()) == ['bags', 'j', 'page.html']


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize(
    'words',
    [
        ['evaluate', 'BAG', '--observer', 'all', '--html', 'OUT'],
        ['tune', 'BAG', '--observer', 'pll', '--out', 'OUT'],
        ['identify', 'BAG', '--out', 'OUT'],
    ],
)
def test_nothing_is_left_of_what_had_nothing(number, words, long_bag, tmp_path):
    at = {'BAG': str(long_bag), 'OUT': str(tmp_path / 'out')}
    with dds.NodeProcess('estimator_pkg.cli', *(at.get(word, word) for word in words)) as process:
        time.sleep(1.0)
        process.signal(number)
        assert process.ends() in (128 + number, -number, 1), process.output
    assert 'Traceback' not in process.output
    assert list(tmp_path.iterdir()) == []


LOST = {
    'a callback of a weak reference': """
class Thing: pass
thing = Thing()
seen = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGHUP))
del thing
""",
    '__del__': """
class Thing:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGHUP)
Thing()
""",
    'an import that catches everything': """
sys.path.insert(0, '.')
import greedy
""",
    'an except that catches everything': """
import contextlib
with contextlib.suppress(BaseException):
    os.kill(os.getpid(), signal.SIGHUP)
""",
}
GREEDY = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGHUP)
except BaseException:
    pass
"""


@pytest.mark.parametrize('lost', LOST)
def test_an_interrupt_that_would_be_lost_comes_again(lost, tmp_path):
    """What is raised in these places is dropped by Python or by a library."""
    (tmp_path / 'greedy.py').write_text(GREEDY)
    body = textwrap.indent(LOST[lost] + 'time.sleep(20.0)', '    ')
    script = (
        'import os, signal, sys, time, weakref\n'
        'from estimator_pkg import cli\n'
        f"def work():\n{body}\nsys.exit(cli.guarded(work, 'here'))"
    )
    ended = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=15, cwd=tmp_path
    )
    assert (ended.returncode, ended.stderr) == (128 + signal.SIGHUP, 'here: interrupted\n')


def test_nohup_keeps_a_command_running(tmp_path):
    script = (
        'import os, signal, sys\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n'
        'from estimator_pkg import cli, interrupts\n'
        'with interrupts.handled():\n'
        '    os.kill(os.getpid(), signal.SIGHUP)\n'
        '    sys.exit(interrupts.came())'
    )
    assert subprocess.run([sys.executable, '-c', script], timeout=60, check=False).returncode == 0


def test_a_terminal_that_goes_away_takes_nothing_along(tmp_path):
    """Output to a terminal that was closed fails; the bag is finished all the same."""
    import pty

    master, slave = pty.openpty()
    process = subprocess.Popen(
        [
            sys.executable,
            *shlex.split('-m estimator_pkg.cli simulate encoder --duration 100000'),
            '--out',
            str(tmp_path / 'bag'),
        ],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    )
    os.close(slave)
    assert dds.until(
        lambda: any(file.stat().st_size > 100_000 for file in tmp_path.glob('.bag.*/*'))
    )
    os.close(master)
    process.send_signal(signal.SIGHUP)
    assert process.wait(60) == 128 + signal.SIGHUP
    assert len(opened_by_others(tmp_path / 'bag')) > 1000
    assert TYPE
