# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What commands write: only what the user named, whole or not at all."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg import whole_file
from estimator_pkg.cli import main

BAG = Path(__file__).resolve().parent.parent / 'bags' / 'simulated' / 'random_with_faults'
SHORT = ['--observer', 'pll']


def evaluate(*words):
    return main(['evaluate', str(BAG), *SHORT, *map(str, words)])


@pytest.mark.long
def test_a_page_overwrites_no_data(tmp_path, capsys):
    mine = {
        name: tmp_path / name
        for name in ('r.npz', 'r.png', 'r.json', '.r.html.part', '.r.npz.part')
    }
    for path in mine.values():
        path.write_text('mine')
    assert evaluate('--html', tmp_path / 'r.html') == 0
    assert all(path.read_text() == 'mine' for path in mine.values())
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*mine, 'r.html'])
    assert '(numpy.load)' not in (tmp_path / 'r.html').read_text()


@pytest.mark.long
def test_the_data_are_written_where_they_are_requested(tmp_path, capsys):
    assert evaluate('--data', tmp_path / 'numbers') == 0  # without a page, with any name
    with np.load(tmp_path / 'numbers') as data:
        assert any(name.endswith('/velocity') for name in data)
    assert [path.name for path in tmp_path.iterdir()] == ['numbers']
    assert f'data: {tmp_path / "numbers"}' in capsys.readouterr().out
    assert evaluate('--html', tmp_path / 'out.npz') == 0  # it does not overwrite itself
    assert (tmp_path / 'out.npz').read_text().startswith('<!DOCTYPE html>')
    assert evaluate('--data', tmp_path / 'no' / 'numbers') == 1
    assert 'does not exist' in capsys.readouterr().err


@pytest.mark.skipif(not os.path.exists('/dev/full'), reason='not run: no /dev/full here')
def test_a_full_disk_is_reported_with_the_file(monkeypatch, tmp_path, capsys):
    assert main(['list', 'pll', '--json', '/dev/full']) == 1
    assert (
        capsys.readouterr().err == 'velocity_estimator list: /dev/full: No space left on device\n'
    )

    def full(self, text, encoding):
        os.write(os.open('/dev/full', os.O_WRONLY), text.encode())

    monkeypatch.setattr(Path, 'write_text', full)
    path = tmp_path / 'list.json'
    assert main(['list', 'pll', '--json', str(path)]) == 1
    said = capsys.readouterr().err
    assert said == f'velocity_estimator list: {path}: No space left on device\n'
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('words', 'options'),
    [
        (['evaluate', 'BAG', '--html', 'X', '--json', 'X'], '--html and --json'),
        (['evaluate', 'BAG', '--data', 'X', '--json', './X'], '--data and --json'),
        (['replay', 'BAG', '--out', 'X', '--json', 'sub/../X'], '--out and --json'),
        (['record', '/x', '--out', 'X', '--json', 'link'], '--out and --json'),
    ],
)
def test_two_outputs_with_one_name_are_a_usage_error(words, options, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'sub').mkdir()
    (tmp_path / 'link').symlink_to('X')
    assert main([str(BAG) if word == 'BAG' else word for word in words]) == 2
    said = capsys.readouterr().err
    assert f'{options} name the same file' in said and said.count('\n') == 1
    assert not (tmp_path / 'X').exists()


@pytest.mark.parametrize(
    'words',
    [
        ['evaluate', 'B', '--html', 'B/B_0.mcap'],
        ['evaluate', 'B', 'B/B_0.mcap', '--data', 'B/B_0.mcap'],
        ['tune', 'B', '--observer', 'pll', '--out', 'B/metadata.yaml'],
        ['evaluate', 'B/B_0.mcap', '--json', 'hard'],
        ['evaluate', 'B/B_0.mcap', '--html', 'link'],
        ['replay', 'B', '--observer', 'pll', '--out', 'B/new'],
        ['evaluate', 'B/B_0.mcap', '--data', 'B/B_1.mcap'],
        ['tune', 'B', '--observer', 'pll', '--out', 'B/x.db3'],
        ['evaluate', 'alone/B_0.mcap', '--html', 'alone/metadata.yaml'],
    ],
)
def test_no_output_changes_the_bag_that_is_read(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(['simulate', 'encoder', '--duration', '0.1', '--out', 'B']) == 0
    Path('alone').mkdir()
    for name in ('hard', 'alone/B_0.mcap'):
        os.link('B/B_0.mcap', name)
    Path('link').symlink_to('B/metadata.yaml')
    before = {file: file.read_bytes() for file in Path('.').rglob('*') if file.is_file()}
    capsys.readouterr()
    assert main(words) == 2
    said = capsys.readouterr().err
    assert 'would change the input' in said and said.count('\n') == 1
    assert {file: file.read_bytes() for file in Path('.').rglob('*') if file.is_file()} == before


def test_a_new_bag_may_stand_next_to_one_without_metadata(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['simulate', 'encoder', '--duration', '0.1', '--out', 'B']) == 0
    os.unlink('B/metadata.yaml')
    assert main(['replay', 'B/B_0.mcap', '--observer', 'pll', '--out', 'B/new.mcap']) == 0


@pytest.mark.parametrize('option', ['html', 'data', 'json'])
@pytest.mark.parametrize('name', ['metadata.yaml', 'x.mcap', 'x.db3', 'x.db3-wal', 'x.mcap.zstd'])
def test_no_output_overwrites_a_file_of_any_bag(option, name, tmp_path, capsys):
    path = tmp_path / name
    path.write_text('mine')
    assert evaluate(f'--{option}', path) == 1
    assert capsys.readouterr().err.endswith(f'{path} is a file of a bag: name another file\n')
    assert path.read_text() == 'mine'


@pytest.mark.parametrize(
    'words',
    [
        ['replay', ''],
        ['replay', 'BAG', '--out', ''],
        ['list', '--json', ''],
        ['replay', 'BAG', '--joint', ''],
        ['evaluate', 'BAG', '--estimate', ''],
        ['watch', ''],
    ],
)
def test_an_empty_name_is_a_usage_error(words, tmp_path, monkeypatch, capsys):
    """As of a variable that a shell does not know; the empty path is the folder here."""
    monkeypatch.chdir(tmp_path)
    assert main([str(BAG) if word == 'BAG' else word for word in words]) == 2
    said = capsys.readouterr().err
    assert 'is empty: give a name\n' in said and said.count('\n') == 1


@pytest.mark.long
def test_a_closed_stderr_stops_no_command(tmp_path):
    bag = BAG.parent / 'sine_12bit'
    command = f'{sys.executable} -m estimator_pkg.cli evaluate {bag} --json - 2>&-'
    done = subprocess.run(['sh', '-c', command], stdout=subprocess.PIPE, cwd=tmp_path)
    assert done.returncode == 0 and done.stdout


def test_a_file_is_replaced_as_a_whole(tmp_path):
    path = tmp_path / 'file'
    path.write_text('before')
    with pytest.raises(KeyError), whole_file.replacing(path) as beside:
        beside.write_text('half')
        raise KeyError
    assert path.read_text() == 'before'
    assert list(tmp_path.iterdir()) == [path]
    with whole_file.replacing(path) as one, whole_file.replacing(path) as other:
        assert one != other  # two commands at once
    whole_file.write_text(path, 'after')
    assert path.read_text() == 'after'


def test_links_and_devices_stay_what_they_are(tmp_path):
    (tmp_path / 'file').write_text('before')
    link = tmp_path / 'link'
    link.symlink_to('file')
    whole_file.write_text(link, 'after')
    assert link.is_symlink() and (tmp_path / 'file').read_text() == 'after'
    whole_file.write_text('/dev/null', 'gone')
    assert stat.S_ISCHR(os.stat('/dev/null').st_mode)
    whole_file.write_text(tmp_path / 'new', '')
    os.umask(mask := os.umask(0))
    assert stat.S_IMODE((tmp_path / 'new').stat().st_mode) == 0o666 & ~mask
