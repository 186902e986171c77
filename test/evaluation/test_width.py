# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What evaluate, doctor and tune print fits 80 columns, and no number is broken."""

from pathlib import Path

import pytest

from estimator_pkg.cli import main
from estimator_pkg.evaluation.text import markdown, table, wrapped

WIDTH = 80  # columns, as the documents promise
BAGS = Path(__file__).resolve().parents[2] / 'bags'
YAW = '/vicon/Group466CF/Group466CF/pose:pose.orientation.yaw'


def narrow(text):
    """Lines that do not fit; one word may, such as a path."""
    return [line for line in text.splitlines() if len(line) > WIDTH and ' ' in line.strip()]


def commands(bag, words, out):
    yield ['evaluate', bag, *words, *(['--observer', 'kalman', '--observer', 'pll'])]
    yield ['doctor', bag, *words]
    few = '--trials', '2', '--out', str(out)
    yield ['tune', bag, *words, '--observer', 'hybrid_angle', *few]


@pytest.mark.long
@pytest.mark.parametrize(
    'bag, words',
    [('dfki_simple_pendulum/system_identification_300hz', ()), ('vicon/yawbag', ('--angle', YAW))],
)
def test_every_line_fits(bag, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for command in commands(str(BAGS / bag), words, 'gains.yaml'):
        assert main(command) in ((0, 1) if command[0] == 'doctor' else (0,))  # 1: a check FAILs
        assert narrow(capsys.readouterr().out) == []
    text = Path('gains.yaml').read_text()
    assert [line for line in narrow(text) if line.startswith('#')] == []


def test_a_sentence_is_wrapped_between_words():
    text = '  joint: the truth is 1.02 +- 0.05 ms later ' + 'than the positions ' * 5
    lines = wrapped(text, 40)
    assert max(map(len, lines)) <= 40 and ' '.join(' '.join(lines).split()) == text.strip()
    assert lines[0].startswith('  j') and lines[1].startswith('    ')
    assert wrapped('x' * 100, 40) == ['x' * 100]
    assert wrapped('') == ['']


@pytest.mark.parametrize('form', [table, markdown])
def test_a_column_without_a_value_is_left_out(form):
    shown = form(('name', 'rms', 'delay'), [('-', '0.1', '-'), ('-', '-', '-')])
    assert 'rms' in shown and 'delay' not in shown
