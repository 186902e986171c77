# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The demonstration as a newcomer runs it: processes over real DDS, a bag, a plot, a clean end."""

import io
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from rich.console import Console

from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.nodes.watching import Joint
from estimator_pkg.observers import DEFAULT
from estimator_pkg.ros import domain
from estimator_pkg.ros.domain import free_domain
from sim_pkg.demo import command, live

pytestmark = pytest.mark.dds


def start(tmp_path, *words):
    environment = {
        **os.environ,
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_DOMAIN_ID': str(free_domain()),
        'PYTHONUNBUFFERED': '1',
    }
    return subprocess.Popen(
        [sys.executable, '-m', 'estimator_pkg.cli', 'demo', *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=tmp_path,
        env=environment,
    )


def test_a_domain_is_reserved_for_the_process_that_got_it(monkeypatch):
    monkeypatch.setattr(domain, '_reserved', [])  # they are free again after the test
    got = [free_domain() for _ in range(15)]
    program = 'from estimator_pkg.ros.domain import *; print([free_domain() for _ in range(15)])'
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert len({*got, *json.loads(done.stdout)}) == 30


def descendants(process):
    return psutil.Process(process.pid).children(recursive=True)


def test_shows_records_and_judges(tmp_path):
    process = start(tmp_path, '--duration', '3', '--json', 'result.json')
    text, _ = process.communicate(timeout=60)
    assert process.returncode == 0, text
    result = json.loads((tmp_path / 'result.json').read_text())
    for word in (r't \d', 'wheel .*tracking', 'true', 'difference', 'estimate'):
        assert len(re.findall(rf'(?m)^{word}', text)) >= 3, word
    end = text[text.rindex('\nbag ') :]
    assert ['plot', result['plot']] in [each.split() for each in end.splitlines()]
    assert f'Verdict: {DEFAULT} has an error of' in end and 'times smaller than' in end
    said, _, following = end.split('Verdict')[1].partition('\nNext:\n')
    assert max(map(len, said.splitlines())) <= 80
    assert f' doctor {result["bag"]} --out my_robot.yaml\n' in following
    assert (tmp_path / result['plot']).read_bytes()[:4] == b'\x89PNG'
    with open_bag(tmp_path / result['bag']) as bag:
        counts = {name: topic.count for name, topic in bag.topics.items()}
    assert set(counts) == {
        '/joint_states',
        '/ground_truth/joint_states',
        '/joint_observer/estimate',
        '/joint_observer/estimate_stddev',
    }
    assert min(counts.values()) > 1000  # about three seconds at 500 Hz
    rms = {
        line.split()[0]: float(line.split()[2])
        for line in text.splitlines()
        if line.startswith(('finite_difference ', '/joint_observer/estimate '))
    }
    assert rms['/joint_observer/estimate'] < 0.6 * rms['finite_difference']


@pytest.mark.parametrize(
    'installed, front',
    [
        ('on the path', []),
        ('not activated', ['.venv/bin/']),
        ('ros', ['ros2', 'run', 'velocity_estimator', '']),
    ],
)
@pytest.mark.parametrize('bag', [command.EXAMPLE, Path('demo_output/a run')])
def test_the_end_shows_what_to_type_next(bag, installed, front, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if bag == command.EXAMPLE:
        bag.mkdir(parents=True)
    if installed != 'ros':
        (tmp_path / '.venv/bin').mkdir(parents=True)
        (tmp_path / '.venv/bin/joint_observer').touch()
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / '.venv'))
    found = '.venv/bin/joint_observer' if installed == 'on the path' else None
    monkeypatch.setattr('shutil.which', lambda name: found)
    *before, last = front or ['']
    lines = [shlex.split(line, comments=True) for line in command.following(bag) if '#' not in line]
    assert [line[: len(before)] for line in lines] == [before] * 3
    doctor, node, play = (line[len(before) :] for line in lines)
    program = f'{last}velocity_estimator'
    assert doctor == [program, 'doctor', str(bag), '--out', 'my_robot.yaml']
    assert node[:3] == [f'{last}joint_observer', '--ros-args', '--params-file']
    assert play[:3] == [program, 'play', str(bag)]


@pytest.mark.parametrize(
    'number, after',
    [(signal.SIGINT, 0.0), (signal.SIGTERM, 3.0)],  # the first while it imports
)
def test_an_interrupt_ends_every_process(tmp_path, number, after):
    process = start(tmp_path, '--duration', '30')
    while 'numpy' not in Path(f'/proc/{process.pid}/maps').read_text():
        time.sleep(0.01)
    time.sleep(after)
    children = descendants(process)
    process.send_signal(number)
    text, _ = process.communicate(timeout=30)
    assert process.returncode == 128 + number, text
    assert 'Traceback' not in text and 'Exception' not in text
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive
    assert not [each for each in psutil.process_iter(['cwd']) if each.info['cwd'] == str(tmp_path)]


def test_an_interrupt_leaves_no_process_that_has_just_begun(monkeypatch, tmp_path):
    """The signal comes while the process is made: six of 40 early interrupts left one."""
    begun = []

    def popen(*words, **named):
        begun.append(made(*words, **named))
        os.kill(os.getpid(), signal.SIGINT)
        return begun[-1]

    made = subprocess.Popen
    monkeypatch.setenv('ROS_DOMAIN_ID', os.environ.get('ROS_DOMAIN_ID', '0'))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setattr(subprocess, 'Popen', popen)
    assert cli.main(['demo', '--out', str(tmp_path)]) == 130
    assert [process.poll() is None for process in begun] == [False]


def test_an_interrupt_of_the_evaluation_is_an_interrupt(monkeypatch, tmp_path, capsys):
    def interrupted(words):
        return cli.guarded(lambda: os.kill(os.getpid(), signal.SIGTERM), 'evaluate')

    monkeypatch.setenv('ROS_DOMAIN_ID', os.environ.get('ROS_DOMAIN_ID', '0'))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setattr(command, '_watch', lambda *_: 1)
    monkeypatch.setattr(command, 'velocity_estimator', interrupted)
    assert cli.main(['demo', '--out', str(tmp_path)]) == 128 + signal.SIGTERM
    assert 'plot' not in capsys.readouterr().out  # there is none


@pytest.mark.parametrize(
    'option, value', [('--duration', '-3'), ('--observer', 'nope'), ('--observer', 'pmsm')]
)
def test_what_cannot_run_is_a_usage_error(option, value, tmp_path, capsys):
    assert cli.main(['demo', option, value, '--out', str(tmp_path / 'out')]) == 2
    said = capsys.readouterr()
    assert value in said.err and said.err.count('\n') == 1
    assert not said.out and not any(tmp_path.iterdir())


def test_the_table_fits_a_terminal():
    shown = Console(file=io.StringIO(), width=80)
    watching = SimpleNamespace(joints={'wheel': Joint()}, count=400)
    shown.print(live.picture(live.Moment(2.0, 3.0, 2.5), watching, 1.0))
    text = shown.file.getvalue()
    assert '+0.500' in text and '+1.000' in text and 'nan' not in text
    assert max(map(len, text.splitlines())) <= 80
