# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A signal ends a command, which keeps what it has; none is lost, and none gives a traceback."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import dds
import pytest
from bag_making import STATES, opened_by_others

from estimator_pkg import cli

FAULTS = Path(__file__).resolve().parents[2] / 'bags' / 'simulated' / 'random_with_faults'


@pytest.fixture(scope='module')
def long_bag(tmp_path_factory):
    """Long enough to be interrupted, and too short to be compiled for."""
    path = tmp_path_factory.mktemp('signals') / 'long'
    assert cli.main(['simulate', 'encoder', '--duration', '40', '--out', str(path)]) == 0
    return path


@pytest.mark.parametrize(
    ('words', 'number', 'said'),
    [
        ('simulate encoder --duration 100000', signal.SIGINT, 'interrupted: 100000 s were'),
        ('replay BAG --observer kalman', signal.SIGHUP, 'interrupted: the rest of the bag'),
    ],
)
def test_a_bag_is_finished_with_what_it_has(words, number, said, long_bag, tmp_path):
    words = [str(long_bag) if word == 'BAG' else word for word in words.split()]
    out = ['--out', str(tmp_path / 'bag'), '--json', str(tmp_path / 'j')]
    with dds.NodeProcess('estimator_pkg.cli', *words, *out) as process:
        assert dds.until(
            lambda: (
                not process.alive
                or any(file.stat().st_size > 100_000 for file in tmp_path.glob('.bag.*/*'))
            )
        )
        process.signal(number)
        process.signal(signal.SIGTERM)  # a launcher may send several
        assert process.ends() == 128 + number, process.output
    assert said in process.output and 'Traceback' not in process.output
    assert sorted(each.name for each in tmp_path.iterdir()) == ['bag', 'j']
    found = opened_by_others(tmp_path / 'bag')
    topics = {topic for topic, _, _ in found}
    assert len(found) > 1000 and STATES in topics
    assert words[0] == 'simulate' or '/joint_observer/estimate' in topics


def test_evaluate_writes_the_bags_that_it_has(tmp_path):
    for name in range(16):
        shutil.copytree(FAULTS, tmp_path / 'bags' / f'b{name:02}')
    page = tmp_path / 'page.html'
    words = [str(tmp_path / 'bags'), '--observer', 'pll', '--html', str(page)]
    with dds.NodeProcess('estimator_pkg.cli', 'evaluate', *words) as process:
        process.prints('bags/b00')
        process.signal(signal.SIGTERM)
        assert process.ends() == 128 + signal.SIGTERM, process.output
    assert 'interrupted' in process.output and 'Traceback' not in process.output
    assert 'page.html' in process.output and '/bags/b00' in page.read_text()
    assert sorted(each.name for each in tmp_path.iterdir()) == ['bags', 'page.html']


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
    words = shlex.split('-m estimator_pkg.cli simulate encoder --duration 100000 --out')
    process = subprocess.Popen(
        [sys.executable, *words, str(tmp_path / 'bag')],
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
