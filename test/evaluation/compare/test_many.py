# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Folders of bags, some of which say nothing: left out with a warning, the others judged."""

import html
import json
import math
import shutil

import pytest
from joint_bags import write_bag

from estimator_pkg.cli import main


def swing(path, seconds, rate=500.0):
    """A joint that swings at 1 Hz, with its truth."""
    stamps = [round(k / rate * 1e9) for k in range(1, int(seconds * rate))]
    angles = [-0.8 * math.cos(2e-9 * math.pi * stamp) for stamp in stamps]
    speeds = [1.6 * math.pi * math.sin(2e-9 * math.pi * stamp) for stamp in stamps]
    read = [(s, ('a',), [math.floor(y * 652.0) / 652.0], ()) for s, y in zip(stamps, angles)]
    true = [(s, ('a',), [y], [v]) for s, y, v in zip(stamps, angles, speeds)]
    write_bag(path, {'/joint_states': read, '/ground_truth/joint_states': true})


@pytest.fixture
def mixed(tmp_path):
    """A folder with a good bag, one too short to say anything, and one that is none."""
    folder = tmp_path / 'mixed'
    folder.mkdir()
    swing(folder / 'good', 2.0)
    swing(folder / 'short', 0.012)
    (folder / 'torn').mkdir()
    (folder / 'torn' / 'metadata.yaml').write_text('torn: [')
    return folder


@pytest.mark.long
def test_bags_of_a_folder_that_say_nothing_are_left_out(mixed, tmp_path, capsys):
    result, page = tmp_path / 'result.json', tmp_path / 'page.html'
    words = f'{mixed} --observer pll --jobs 2 --json {result}'.split()
    assert main(['evaluate', *words, '--html', str(page)]) == 0
    warned = capsys.readouterr().err.splitlines()
    bad = [str(mixed / 'short'), str(mixed / 'torn')]
    assert [line.split()[1] for line in warned if 'is skipped' in line] == bad
    found = json.loads(result.read_text())
    assert list(found['bags']) == [str(mixed / 'good')]
    assert list(found['left_out']) == bad
    assert 'no valid estimate' in found['left_out'][str(mixed / 'short')]
    assert all(why in html.unescape(page.read_text()) for why in found['left_out'].values())


def test_a_bag_that_was_named_is_judged_or_the_command_fails(mixed, tmp_path, capsys):
    words = ['--observer', 'pll', '--json', str(tmp_path / 'result.json')]
    assert main(['evaluate', str(mixed), str(mixed / 'torn'), *words]) == 1
    assert main(['evaluate', str(mixed), str(mixed / 'short'), *words]) == 1
    for name in ('good', 'short'):
        shutil.rmtree(mixed / name)
    assert main(['evaluate', str(mixed), *words]) == 1
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].endswith(f'{mixed}: none of the bags in it can be evaluated (reasons above)')
    assert not (tmp_path / 'result.json').exists()
