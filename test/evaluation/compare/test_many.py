# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Folders of bags, some of which say nothing: left out with a warning, the others judged."""

import html
import json
import math
import shutil

import pytest

from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.cli import main
from estimator_pkg.messages.joint_state import TYPE, Encoder

pytest.importorskip('optuna', reason='not run: Optuna is not installed')


def write_bag(path, seconds, rate=500.0):
    """A joint that swings at 1 Hz, with its truth."""
    states, true = Encoder(), Encoder()
    with BagWriter(path) as bag:
        for topic in ('/joint_states', '/ground_truth/joint_states'):
            bag.add_topic(topic, TYPE)
        for k in range(1, int(seconds * rate)):
            turned = 2.0 * math.pi * k / rate
            stamp, angle = round(k / rate * 1e9), -0.8 * math.cos(turned)
            read = math.floor(angle * 652.0) / 652.0
            bag.write('/joint_states', stamp, states.encode(stamp, '', ('a',), [read]))
            bag.write(
                '/ground_truth/joint_states',
                stamp,
                true.encode(stamp, '', ('a',), [angle], [0.8 * 2.0 * math.pi * math.sin(turned)]),
            )


@pytest.fixture
def mixed(tmp_path):
    """A folder with a good bag, one too short to say anything, and one that is none."""
    folder = tmp_path / 'mixed'
    folder.mkdir()
    write_bag(folder / 'good', 2.0)
    write_bag(folder / 'short', 0.012)
    (folder / 'torn').mkdir()
    (folder / 'torn' / 'metadata.yaml').write_text('torn: [')
    return folder


@pytest.mark.long
@pytest.mark.parametrize('jobs', ['1', '2'])
def test_bags_of_a_folder_that_say_nothing_are_left_out(mixed, tmp_path, capsys, jobs):
    result, page = tmp_path / 'result.json', tmp_path / 'page.html'
    words = f'{mixed} --observer pll --jobs {jobs} --json {result}'.split()
    assert main(['evaluate', *words, '--html', str(page)]) == 0
    warned = capsys.readouterr().err.splitlines()
    bad = [str(mixed / 'short'), str(mixed / 'torn')]
    assert [line.split()[1] for line in warned if 'is skipped' in line] == bad
    found = json.loads(result.read_text())
    assert list(found['bags']) == [str(mixed / 'good')]
    assert list(found['left_out']) == bad
    assert 'no valid estimate' in found['left_out'][str(mixed / 'short')]
    assert all(html.escape(why) in page.read_text() for why in found['left_out'].values())
    assert main(['tune', *words, '--trials', '8', '--out', str(tmp_path / 'gains.yaml')]) == 0
    found = json.loads(result.read_text())
    assert found['tuned'][0]['bags'] == [str(mixed / 'good')]
    assert list(found['left_out']) == [str(mixed / 'torn')]
    (short,) = (note for note in found['notes'] if str(mixed / 'short') in note)
    assert 'too few for tuning' in short


def test_a_bag_that_was_named_is_judged_or_the_command_fails(mixed, tmp_path, capsys):
    words = ['--observer', 'pll', '--out', str(tmp_path / 'gains.yaml')]
    short = str(mixed / 'short')
    assert main(['tune', str(mixed), str(mixed / 'torn'), *words]) == 1
    assert main(['evaluate', str(mixed), short, '--observer', 'pll']) == 1
    for name in ('good', 'short'):
        shutil.rmtree(mixed / name)
    assert main(['tune', str(mixed), *words]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].endswith(f'{mixed}: none of the bags in it can be evaluated (reasons above)')
    assert not (tmp_path / 'gains.yaml').exists()
