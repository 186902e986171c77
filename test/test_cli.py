# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The command line itself: where its output goes, and what it says when it cannot."""

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from estimator_pkg import cli, destination, registry
from estimator_pkg.cli import main
from estimator_pkg.errors import UserError

ROOT = Path(__file__).resolve().parent.parent
COMMAND = [sys.executable, '-m', 'estimator_pkg.cli']


def run(words, stdout, buffered=True):
    """(exit code, stderr); whether Python buffers its output decides when a write fails."""
    environment = {**os.environ, 'PYTHONUNBUFFERED': '' if buffered else '1'}
    done = subprocess.run(
        [*COMMAND, *words],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        timeout=60,
        check=False,
    )
    return done.returncode, done.stderr


@pytest.mark.long
@pytest.mark.parametrize('buffered', [True, False])
@pytest.mark.parametrize('words', [[], ['list', 'pll']])
def test_a_reader_that_went_away_is_no_error(words, buffered):
    reading, writing = os.pipe()
    os.close(reading)
    assert run(words, writing, buffered) == (1, '')
    os.close(writing)


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists('/dev/full'), reason='not run: no /dev/full here')
def test_a_full_disk_is_one_line():
    with open('/dev/full', 'w') as full:
        code, said = run(['list', 'pll'], full)
    assert code == 1
    assert said == 'velocity_estimator list: output: No space left on device\n'


def test_json_on_stdout_is_json_alone(capsys):
    assert main(['list', 'pll', '--json', '-']) == 0
    out, err = capsys.readouterr()
    assert 'bandwidth_hz' in json.loads(out)['observers']['pll']['parameters']
    assert 'pll:' in err


@pytest.mark.parametrize(('name', 'said'), [('', 'is a folder'), ('nowhere/a', 'does not exist')])
def test_where_json_cannot_go_is_said_before_the_work(name, said, tmp_path, capsys):
    assert main(['list', '--json', str(tmp_path / name)]) == 1
    out, err = capsys.readouterr()
    assert said in err and err.count('\n') == 1 and not out


def test_a_destination_that_may_not_be_written(tmp_path, monkeypatch):
    destination.check(tmp_path / 'new')
    monkeypatch.setattr(os, 'access', lambda path, mode: path != tmp_path)  # root may all
    with pytest.raises(UserError, match='is not writable'):
        destination.check(tmp_path / 'new')


@pytest.mark.parametrize('name', registry.names(registry.COMMANDS))
def test_every_help_has_examples_that_parse(name, capsys):
    command = registry.find(registry.COMMANDS, name)
    assert len(command.examples) >= 2
    parser = cli.parser_of(command, f'velocity_estimator {name}')
    shown = parser.format_help()
    assert max(map(len, shown.splitlines())) <= 80
    for words, meaning in command.examples:
        parser.parse_args(shlex.split(words))
        assert meaning in shown
        assert all((ROOT / word).exists() for word in words.split() if word.startswith('bags/'))
    lines = shown[shown.index('examples:') :].replace('\\\n', '').splitlines()
    assert [
        shlex.split(line)[2:] for line in lines if line.startswith('  velocity_estimator ')
    ] == [shlex.split(words) for words, _ in command.examples]


def test_the_overview_names_every_command_in_80_columns(capsys):
    assert main(['--help']) == 0
    lines = capsys.readouterr().out.splitlines()
    named = {line.split()[0] for line in lines if line.startswith('  ')}
    assert named == set(registry.names(registry.COMMANDS))
    assert max(map(len, lines)) <= 80


def test_ctrl_c_while_the_program_is_imported_ends_it_without_a_traceback():
    script = (
        'import os, signal, sys\n'
        'class Finder:\n'
        '    def find_spec(self, name, *_):\n'
        '        if name == "estimator_pkg.cli":\n'
        '            os.kill(os.getpid(), signal.SIGINT)\n'
        'sys.meta_path.insert(0, Finder())\n'
        'from estimator_pkg.__main__ import main\n'
        'main()\n'
    )
    done = subprocess.run([sys.executable, '-c', script, 'list'], text=True, capture_output=True)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, '', '')
