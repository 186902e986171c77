# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks: their signals, their bookkeeping and their reports. Nothing here is timed."""

import json
import math
import sys

import numpy as np
import pytest

from benchmarks import accuracy, replay, update
from benchmarks.__main__ import main
from benchmarks.live import rows as live
from benchmarks.signals import COUNTS, SIGNALS, Signal, constant, encoder, trapezoid
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare import timing
from estimator_pkg.evaluation.entries import Entry, at_defaults

QUANTUM = 2.0 * math.pi / COUNTS
SHORT = tuple(Signal(s.name, s.summary, s.motion, s.jitter, s.dropped) for s in SIGNALS[1:2])


# ---------------------------------------------------------------- the signals


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


def test_the_shared_set_is_the_one_agreed_on():
    peaks = {
        signal.name: np.max(np.abs(signal.samples(duration=4.0).velocity)) for signal in SIGNALS
    }
    assert peaks == pytest.approx(
        {'slow': 0.02, 'sine': 5.0, 'trapezoid': 20.0, 'fast': 200.0, 'jitter': 5.0, 'drops': 5.0},
        rel=1e-3,
    )


def test_the_trapezoid_climbs_at_its_acceleration():
    time = np.linspace(0.0, 5.0, 50001)
    position, velocity = trapezoid(20.0, 100.0, 0.8)(time)
    slope = np.abs(np.diff(velocity) / np.diff(time))
    assert np.max(slope) == pytest.approx(100.0)
    assert np.mean(slope > 1.0) == pytest.approx(0.2, abs=0.01)  # 0.4 s of every 2 s
    assert (
        np.max(np.abs(np.diff(position) - 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)))
        < 1e-6
    )


def test_jitter_and_drops_are_as_declared_and_repeatable():
    by_name = {signal.name: signal for signal in SIGNALS}
    off = np.diff(by_name['jitter'].samples(duration=20.0).stamps) * 1e-6 - 1.0
    assert 0.7 < np.max(np.abs(off)) <= 0.8  # two neighbours, each off by up to 0.4
    drops = by_name['drops'].samples(duration=20.0)
    assert len(drops.stamps) == pytest.approx(18_000, rel=0.02)
    again = by_name['drops'].samples(duration=20.0)
    assert all(np.array_equal(a, b) for a, b in zip(drops, again))
    assert not np.array_equal(drops.stamps, by_name['drops'].samples(2, 20.0).stamps)


def test_the_encoder_rounds_down_to_a_count():
    assert encoder(np.array([0.0, 1.99 * QUANTUM, -0.01 * QUANTUM, np.pi])) == pytest.approx(
        np.array([0.0, QUANTUM, -QUANTUM, -np.pi])
    )


# ---------------------------------------------------------------- accuracy


def test_accuracy_has_every_observer_on_every_signal():
    entries = [Entry('finite_difference', 'finite_difference'), Entry('pll', 'pll')]
    found = accuracy.run(entries, SHORT)
    assert [(r['observer'], r['signal'], r['tuning']) for r in found['results']] == [
        ('finite_difference', 'sine', 'defaults'),
        ('pll', 'sine', 'defaults'),
    ]
    text = accuracy.describe(found)
    assert 'finite_difference  defaults' in text


def test_accuracy_measures_the_errors_of_the_observer():
    """The finite difference of a slow constant speed has the noise that its equation gives."""
    signal = Signal('steady', '', constant(3.0))
    entry = Entry('raw', 'finite_difference', (('bandwidth_hz', 1e6), ('low_speed_bound', False)))
    found = accuracy.measure(entry, signal.samples(duration=6.0))
    # 3 rad/s is 1.96 quanta per ms: a difference shows 1 or 2 quanta, the latter in 96 %
    quanta = 3e-3 / QUANTUM
    part = quanta - math.floor(quanta)
    assert found['rms'] == pytest.approx(math.sqrt(part * (1.0 - part)) * QUANTUM * 1e3, rel=0.02)
    assert found['published'] == 1.0 and math.isnan(found['delay_s'])


def test_both_models_of_the_kalman_filter_are_compared():
    labels = [entry.label for entry in at_defaults()]
    assert {
        'hybrid_angle',
        'pll',
        'finite_difference',
        'kalman acceleration',
        'kalman velocity',
    } <= set(labels)
    assert len(set(labels)) == len(labels)


# ---------------------------------------------------------------- timing


@pytest.mark.long
def test_sides_are_interleaved_and_the_first_round_does_not_count():
    order = []

    def side(name):
        def run(number):
            order.append((name, number))
            return float(number)

        return run

    times = timing.interleave({'a': side('a'), 'b': side('b')}, 2)
    assert order == [('a', 0), ('b', 0), ('a', 1), ('b', 1), ('a', 2), ('b', 2)]
    assert times == {'a': [1.0, 2.0], 'b': [1.0, 2.0]}


def test_a_ratio_is_taken_round_by_round():
    assert timing.ratio([2.0, 40.0, 6.0], [1.0, 10.0, 3.0]) == 2.0


def test_limits_work_both_ways():
    assert timing.row('x', 2.0, 'us', limit=2.5)['ok'] is True
    assert timing.row('x', 3.0, 'us', limit=2.5)['ok'] is False
    assert timing.row('x', 3.0, 'times', limit=2.5, at_least=True)['ok'] is True
    assert timing.row('x', 3.0, 'us')['ok'] is None
    assert timing.not_run('x', 'why')['ok'] is None


# ---------------------------------------------------------------- speed


@pytest.mark.slow
def test_updates_name_every_observer_beside_filterpy():
    rows = {row['name']: row for row in update.updates(rounds=1)}
    for entry in at_defaults():
        adaptive = entry.label == 'edge_adaptive'
        assert rows[f'update {entry.label}']['limit'] == (4.0 if adaptive else 2.5)
        assert rows[f'{update.SAME_WORK} / {entry.label}']['limit'] == (None if adaptive else 10.0)
        assert rows[f'{update.BARE} / {entry.label}']['limit'] is None


@pytest.mark.long
def test_filterpy_filters_what_the_observers_get():
    """The peer does the work it is timed for: it follows the angle across its wraps."""
    pytest.importorskip('filterpy')
    signal = Signal('turning', '', constant(20.0)).samples(duration=0.145)  # just past a wrap
    stamps, angles = signal.stamps.tolist(), signal.angle.tolist()
    seen = []

    def chunk(number):
        seen.append(number)
        return stamps, angles

    peers = update._filterpy(chunk)
    peers[update.SAME_WORK](0)
    kalman = next(
        cell.cell_contents
        for cell in peers[update.SAME_WORK].__closure__
        if type(cell.cell_contents).__name__ == 'KalmanFilter'
    )
    assert seen == [0]
    assert kalman.x[1, 0] == pytest.approx(20.0, rel=0.1)


@pytest.mark.long
def test_missing_peers_are_reported_as_not_run(monkeypatch):
    monkeypatch.setitem(sys.modules, 'filterpy.kalman', None)
    monkeypatch.setitem(sys.modules, 'filterpy.common', None)
    rows = {row['name']: row for row in update.updates(rounds=1)}
    assert rows['filterpy']['value'] is None
    assert 'not installed' in rows['filterpy']['why']
    monkeypatch.setattr(update.compiled, 'available', lambda: False)
    assert [row['value'] for row in update.batches(1000, 1)] == [None]


def test_the_bag_of_the_replay_is_a_stream_of_joint_states(tmp_path):
    replay.write_bag(tmp_path / 'bag', 300)
    with open_bag(tmp_path / 'bag') as bag:
        assert bag.topics['/joint_states'].count == 300
        series = joint_series(bag, '/joint_states')
    assert len(series) == 7
    steps = np.diff(series['joint_3'].stamps_ns) * 1e-6
    assert np.all(steps > 0.0) and np.std(steps) > 0.1
    assert np.ptp(series['joint_3'].position) > 0.5


def test_a_failing_process_is_one_line():
    with pytest.raises(UserError, match='failed: ValueError: so it is'):
        replay.run_process('raise ValueError("so it is")')


def test_a_process_is_weighed():
    small = replay.run_process('pass')
    large = replay.run_process('x = bytearray(b"x") * 100_000_000')
    assert 90.0 < large.memory - small.memory < 130.0


@pytest.mark.slow
def test_replay_is_measured_beside_rosbags():
    rows = {row['name']: row for row in replay.replays(200, rounds=1)}
    assert rows['rosbags / replay without --out']['limit'] == 3.0
    assert rows['rosbags / replay with --out']['limit'] == 1.0
    assert rows['peak memory, four times the length']['value'] > 0.0


def test_reports_of_the_live_nodes_become_lines():
    cost = live._cost(
        {
            'rows': [
                {
                    'node': node,
                    'rate_hz': 1000.0,
                    'joints': 7,
                    'node_us_per_message': 300.0,
                    'null_us_per_message': 150.0,
                    'ratio': 2.0,
                    'allowed': 1.5,
                    'published': 10,
                    'answered': 10,
                }
                for node in ('joint_observer', 'switched_observer')
            ]
        }
    )
    assert [row['ok'] for row in cost] == [None, None, False, None, None, None]
    loss = live._loss(
        {
            'rows': [
                {'rate_hz': 1000.0, 'joints': 7, 'published': 5000, 'true_loss': 1, 'reported': 1},
                {
                    'rate_hz': 5000.0,
                    'joints': 7,
                    'published': 5000,
                    'true_loss': 40,
                    'reported': 39,
                },
            ]
        }
    )
    assert [(row['value'], row['ok']) for row in loss] == [(1, False), (40, None), (1, False)]


def test_start_and_latency_become_lines():
    start = live._start(
        {
            'rows': [
                {
                    'node': 'null_node',
                    'message_s': 1.0,
                    'message_ratio': 1.0,
                    'cpu_s': 0.5,
                    'cpu_ratio': 1.0,
                    'estimate_s': 1.0,
                    'estimate_ratio': 1.0,
                },
                {
                    'node': 'adaptive_observer',
                    'message_s': 1.5,
                    'message_ratio': 1.5,
                    'cpu_s': 0.7,
                    'cpu_ratio': 1.4,
                },
            ]
        }
    )
    by_name = {row['name']: row for row in start}
    assert by_name['adaptive_observer: process start to first message / null node']['value'] == 1.5
    assert by_name['adaptive_observer: process start to first estimate']['value'] is None
    assert by_name['adaptive_observer: CPU time to first message / null node']['value'] == 1.4
    assert not any('null_node' in name and '/' in name for name in by_name)
    late = live._latency(
        {
            'rows': [
                {
                    'node': 'joint_observer',
                    'median_ms': 0.3,
                    'median_ms_more': 0.1,
                    'median_ms_ratio': 1.5,
                    'late_ms': 2.0,
                    'late_ms_more': -1.0,
                    'late_ms_ratio': 0.7,
                },
                {'node': 'switched_observer'},
            ]
        }
    )
    assert [row['value'] for row in late] == [0.3, 0.1, 1.5, 2.0, -1.0, 0.7, None, None]


def test_medians_are_of_the_rounds_and_ratios_of_the_same_round(monkeypatch):
    pytest.importorskip('rclpy')
    from benchmarks.live import latency, start

    taken = iter(
        [
            {'message': 1.0, 'cpu': 0.5, 'estimate': 1.0},
            {'message': 2.0, 'cpu': 1.0},
            {'message': 4.0, 'cpu': 0.5, 'estimate': 4.0},
            {'message': 4.0, 'cpu': 2.0, 'estimate': 6.0},
        ]
    )
    monkeypatch.setattr(start, 'NODES', {'joint_observer': ()})
    monkeypatch.setattr(start, 'once', lambda name: next(taken))
    null, node = start.measure(2)['rows']
    assert node['message_s'] == 3.0 and node['message_ratio'] == 1.5
    assert node['estimate_s'] == 6.0 and node['estimate_ratio'] == 1.5
    assert node['cpu_s'] == 1.5 and node['cpu_ratio'] == 3.0
    monkeypatch.setattr(latency, 'NODES', {'joint_observer': ()})
    answers = iter([{'answered': 10, 'median_ms': m, 'late_ms': 2 * m} for m in (1, 2, 4, 2)])
    monkeypatch.setattr(latency, 'once', lambda name: next(answers))
    null, node = latency.measure(2)['rows']
    assert node['median_ms'] == 2.0 and node['median_ms_ratio'] == 1.25
    assert node['late_ms_more'] == -1.0 and node['answered'] == 20


@pytest.mark.slow
@pytest.mark.dds
def test_a_node_starts_and_answers_over_dds(monkeypatch):
    """As the benchmark does it; the numbers are not judged here."""
    monkeypatch.delenv('PYTHONSAFEPATH')  # its processes import the benchmarks of the checkout
    pytest.importorskip('rclpy')
    from benchmarks.live import latency, start

    found = start.once('joint_observer')
    assert found['cpu'] > 0.1 and 0.2 < found['message'] <= found['estimate'] < start.LONGEST
    late = latency.once('mechanical_observer', rate=200.0, seconds=2.0)
    assert late['answered'] > 100 and 0.0 < late['median_ms'] <= late['late_ms']


def test_without_ros_the_live_nodes_are_not_run(monkeypatch):
    monkeypatch.setattr(live.importlib.util, 'find_spec', lambda name: None)
    rows = live.live() + live.starts(1) + live.latencies(1)
    assert len(rows) == 4
    assert all(row['value'] is None and 'not installed' in row['why'] for row in rows)


def test_a_program_that_fails_says_why(tmp_path, monkeypatch):
    (tmp_path / 'failing_program.py').write_text('raise SystemExit("no network")')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    assert live._run('failing_program') == (None, 'no network')


# ---------------------------------------------------------------- the command


@pytest.mark.slow
def test_bench_prints_and_gives_json(tmp_path, capsys):
    out = tmp_path / 'bench.json'
    assert main(['speed', '--part', 'update', '--quick', '--json', str(out)]) == 0
    found = json.loads(out.read_text())
    assert {row['part'] for row in found['speed']['rows']} == {'update'}
    assert 'accuracy' not in found
    printed = capsys.readouterr().out
    assert 'update hybrid_angle' in printed and 'filterpy' in printed


@pytest.mark.parametrize(
    'words', [('speed', '--part', 'nonsense'), ('nonsense',), ('speed', '--messages', '0')]
)
def test_wrong_use(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_part_of_the_other_group(capsys):
    assert main(['accuracy', '--part', 'replay']) == 2
    line = capsys.readouterr().err
    assert line.startswith("python -m benchmarks: accuracy has no part 'replay': choose one of")
    assert line.count('\n') == 1
