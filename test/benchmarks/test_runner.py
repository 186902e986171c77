# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks: their signals, their runner, their rows and their command. Nothing is timed."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import estimator_pkg
from benchmarks import __main__ as command
from benchmarks import accuracy, live, replay, timing, update
from benchmarks.__main__ import main
from benchmarks.columns import of_signal
from benchmarks.runner import printed, result
from benchmarks.signals import COUNTS, SIGNALS, Signal, constant
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.entries import Entry, at_defaults

ROOT = Path(__file__).resolve().parents[2]
QUANTUM = 2.0 * math.pi / COUNTS


@pytest.mark.parametrize('signal', SIGNALS, ids=lambda signal: signal.name)
def test_velocity_is_the_derivative_of_what_the_encoder_reads(signal):
    samples = signal.samples(duration=4.0)
    seconds = (samples.stamps - samples.stamps[0]) * 1e-9
    assert np.all((samples.angle >= -np.pi) & (samples.angle < np.pi))
    turned = np.unwrap(samples.angle) - samples.angle[0]
    travelled = np.concatenate(
        [[0.0], np.cumsum(0.5 * (samples.velocity[1:] + samples.velocity[:-1]) * np.diff(seconds))]
    )
    assert np.max(np.abs(turned - travelled)) < 2.1 * QUANTUM


def test_accuracy_has_every_observer_on_every_signal():
    entries = [Entry('finite_difference', 'finite_difference'), Entry('pll', 'pll')]
    rows = accuracy.run([of_signal(SIGNALS[1], 11.0)], entries)
    assert [(row['observer'], row['stream']) for row in rows] == [
        ('finite_difference', 'sine'),
        ('pll', 'sine'),
    ]
    text = printed(accuracy.describe(rows))
    assert 'sine: 5 rad/s sine at 2 Hz' in text
    line = next(line for line in text.splitlines() if line.startswith('sine  '))
    assert line.split()[1:4] == ['0.193,', '3.21', 'ms,'] and line.count('%') == 2
    rows[1]['delay_s'] = None  # as JSON has a nan
    header, first, second = accuracy.as_csv(rows).splitlines()
    assert header == (ROOT / 'benchmarks/results/accuracy.csv').read_text().partition('\n')[0]
    assert re.fullmatch(r'sine,finite_difference,0\.193,3\.21,\d+,', first)
    assert re.fullmatch(r'sine,pll,[\d.]+,,\d+,', second)


def test_a_result_has_the_errors_of_the_observer():
    """The finite difference of a slow constant speed has the noise that its equation gives."""
    column = of_signal(Signal('steady', '', constant(3.0)), 6.0)
    entry = Entry('raw', 'finite_difference', (('bandwidth_hz', 1e6), ('low_speed_bound', False)))
    found = result(column, entry)
    # 3 rad/s is 1.96 quanta per ms: a difference shows 1 or 2 quanta, the latter in 96 %
    quanta = 3e-3 / QUANTUM
    part = quanta - math.floor(quanta)
    assert found['rms'] == pytest.approx(math.sqrt(part * (1.0 - part)) * QUANTUM * 1e3, rel=0.02)
    assert found['published'] == 1.0 and math.isnan(found['delay_s'])


def test_limits_work_both_ways():
    assert timing.row('x', 2.0, 'us', limit=2.5)['ok'] is True
    assert timing.row('x', 3.0, 'us', limit=2.5)['ok'] is False
    assert timing.row('x', 3.0, 'times', limit=2.5, at_least=True)['ok'] is True
    assert timing.row('x', 3.0, 'us')['ok'] is None
    assert timing.not_run('x', 'why')['ok'] is None
    assert timing.ratio([2.0, 40.0, 6.0], [1.0, 10.0, 3.0]) == 2.0  # round by round
    times = {'mine': [2.0, 3.0], 'peer': [40.0, 30.0]}
    rows = timing.compared('of', times, lambda t: 1.0 / t, '1/s', 'peer', {'mine': 20.0})
    assert [row['name'] for row in rows] == ['of mine', 'peer / mine', 'of peer']
    assert rows[0]['value'] == 0.5 and rows[1]['value'] == 15.0 and rows[1]['ok'] is False


@pytest.mark.long
def test_missing_peers_are_reported_as_not_run(monkeypatch):
    monkeypatch.setitem(sys.modules, 'filterpy.kalman', None)
    monkeypatch.setitem(sys.modules, 'filterpy.common', None)
    rows = {row['name']: row for row in update.updates(rounds=1)}
    assert {f'update {entry.label}' for entry in at_defaults()} <= rows.keys()
    row = rows[f'update {update.FILTERPY}']
    assert row['value'] is None and 'not installed' in row['why']


def test_what_is_measured_is_the_installed_package():
    """`python -m benchmarks` finds the checkout first, whose package has no engine."""
    found = f'sys.path.insert(0, {str(ROOT)!r}); import benchmarks, estimator_pkg as found'
    code = f'import sys; {found}; print(found.__file__)'
    words = [sys.executable, '-c', code]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == estimator_pkg.__file__
    with pytest.raises(UserError, match=re.escape(f'ValueError: {estimator_pkg.__file__}')):
        replay.run_process('import estimator_pkg as found; raise ValueError(found.__file__)')


@pytest.mark.slow
def test_replay_is_measured_beside_rosbags():
    rows = {row['name']: row for row in replay.replays(200, rounds=1)}
    assert rows['rosbags / replay without --out']['limit'] == 3.0
    assert rows['rosbags / replay with --out']['limit'] == 0.4
    assert rows['peak memory with --out, 200 messages']['value'] > 0.0


@pytest.mark.slow
@pytest.mark.dds
def test_a_node_starts_and_answers_over_dds(monkeypatch):
    """As the benchmark does it; the numbers are not judged here."""
    monkeypatch.delenv('PYTHONSAFEPATH')  # its processes import the benchmarks of the checkout
    pytest.importorskip('rclpy')
    for name in ('null_joints', 'joint_observer'):
        assert 0.2 < live.start(name)['estimate'] < live.LONGEST
    for name in ('mechanical_observer', 'pmsm_observer', 'pmsm_observer, batches'):
        names = [name, live.NULL[live.kind_of(name)]]
        for late in live.measure(names, rate=50.0, seconds=2.0).values():
            assert late['answered'] > 50 and 0.0 < late['median_ms'] <= late['late_ms']
            assert late['cpu'] > 0.0
    assert [row['ok'] for row in live.losses(200.0, 7)] == [True]


def test_without_ros_the_part_says_what_it_lacks(monkeypatch, capsys):
    monkeypatch.setattr(live.importlib.util, 'find_spec', lambda name: None)
    assert main(['--part', 'live']) == 1
    assert capsys.readouterr().err == 'python -m benchmarks: rclpy is not installed\n'


def test_parts_print_and_give_json_and_one_that_cannot_run_says_why(tmp_path, capsys, monkeypatch):
    row = timing.row('x / y', 3.0, 'times', limit=2.0)

    def refuses(parsed):
        raise UserError('no network')

    monkeypatch.setattr(
        command, 'PARTS', {'speed': lambda parsed: timing.part([row]), 'live': refuses}
    )
    out = tmp_path / 'bench.json'
    assert main(['--json', str(out)]) == 0
    found = json.loads(out.read_text())
    assert found['speed'] == [row] and 'live' not in found
    printed = capsys.readouterr().out
    assert 'requirement not met: x / y' in printed and 'live: not run: no network\n' in printed
    assert main(['--part', 'live']) == 1
    assert capsys.readouterr().err == 'python -m benchmarks: no network\n'


@pytest.mark.parametrize('words', [('--part', 'nonsense'), ('--part', 'held-out')])
def test_wrong_use(words, capsys):
    try:
        code = main(words)
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
