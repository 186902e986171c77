# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks: their signals, their bookkeeping and their reports. Nothing here is timed."""

import contextlib
import json
import math
import subprocess
import sys

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks import accuracy, live, replay, timing, update
from benchmarks.__main__ import main
from benchmarks.signals import COUNTS, SIGNALS, Signal, constant, encoder, trapezoid
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.errors import UserError
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
    found = accuracy.run(None, entries, SHORT)
    assert [(row['observer'], row['stream']) for row in found] == [
        ('finite_difference', 'sine'),
        ('pll', 'sine'),
    ]
    text = accuracy.describe(found)
    assert 'sine: 5 rad/s sine at 2 Hz' in text
    line = next(line for line in text.splitlines() if line.startswith('sine  '))
    assert line.split()[1:4] == ['0.193,', '3.21', 'ms,'] and line.count('%') == 2


def test_without_recordings_the_signals_are_printed_and_the_reason(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(accuracy, 'run', lambda bags: accuracy.recorded.rows(bags) if bags else [])
    rows, lacking = accuracy.part(tmp_path)
    assert rows == [] and lacking.startswith(f'recordings: not run: {tmp_path} contains no bag')


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
        assert rows[f'{update.FILTERPY} / {entry.label}']['limit'] == (None if adaptive else 10.0)
    assert rows['one reading smoothed']['limit'] == 10.0


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

    side = update._filterpy(chunk)[update.FILTERPY]
    side(0)
    kalman = next(
        cell.cell_contents
        for cell in side.__closure__
        if type(cell.cell_contents).__name__ == 'KalmanFilter'
    )
    assert seen == [0]
    assert kalman.x[1, 0] == pytest.approx(20.0, rel=0.1)


@pytest.mark.long
def test_missing_peers_are_reported_as_not_run(monkeypatch):
    monkeypatch.setitem(sys.modules, 'filterpy.kalman', None)
    monkeypatch.setitem(sys.modules, 'filterpy.common', None)
    rows = {row['name']: row for row in update.updates(rounds=1)}
    assert rows[update.FILTERPY]['value'] is None
    assert 'not installed' in rows[update.FILTERPY]['why']


def test_without_the_engine_batches_are_not_run(monkeypatch):
    monkeypatch.setattr('estimator_pkg.driver.joint.functions_of', lambda module: None)
    (row,) = update.batches(1000, 1)
    assert row['value'] is None and 'C compiler' in row['why']


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


def test_results_of_the_live_nodes_become_rows():
    item = {
        'rate_hz': 1000.0,
        'joints': 7,
        'node_us_per_message': 300.0,
        'null_us_per_message': 150.0,
        'ratio': 2.0,
        'allowed': 1.5,
        'published': 10,
        'answered': 10,
    }
    for node, met in (('joint_observer', False), ('switched_observer', None)):
        assert [row['ok'] for row in live.costs({'node': node, **item})] == [None, None, met]
    lost = {'joints': 7, 'published': 5000}
    few = live.losses({'rate_hz': 1000.0, 'true_loss': 1, 'reported': 1, **lost})
    many = live.losses({'rate_hz': 5000.0, 'true_loss': 40, 'reported': 39, **lost})
    found = [(row['value'], row['ok']) for row in [*few, *many]]
    assert found == [(1, False), (40, None), (1, False)]


@pytest.mark.parametrize('deaf', ['null_node', 'joint_observer'])
def test_a_listener_that_is_late_is_a_line_and_not_a_division_by_zero(deaf, monkeypatch):
    """Under load a listener may be connected when the stream has ended."""
    pytest.importorskip('rclpy')
    from benchmarks.live import cost

    class Child:
        pid = 0

        def __init__(self, *words):
            self.words, self.stdout = words, self

        def readline(self):
            return 'listening'

        def send_signal(self, number):
            pass

    @contextlib.contextmanager
    def process(*words, domain=1):
        yield Child(*words)

    def result(child):
        count = 0 if any(deaf in str(word) for word in child.words) else 100
        return {'published': 100, 'answered': count, 'received': count}

    monkeypatch.setattr(cost, 'process', process)
    monkeypatch.setattr(cost, 'observer', process)
    monkeypatch.setattr(cost, 'result', result)
    monkeypatch.setattr(cost, 'free_domain', lambda: 1)
    monkeypatch.setattr(cost, 'cpu', lambda meter: 1.0)
    monkeypatch.setattr(cost.psutil, 'Process', lambda pid: None)
    monkeypatch.setattr(cost.time, 'sleep', lambda seconds: None)
    (row,) = live.costs(cost.measure())
    assert row['value'] is None and row['name'].startswith('joint_observer, CPU per message')
    assert row['why'].endswith(deaf.replace('null_node', 'the null node'))
    assert 'not run' in command.describe([row])


@pytest.mark.parametrize(
    ('program', 'why'), [('', 'ended without a result'), ('input()', 'did not end within 1 s')]
)
def test_a_process_without_a_result_is_one_line(program, why):
    from benchmarks.live.processes import result

    words = [sys.executable, '-c', program]
    streams = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE, 'text': True}
    with subprocess.Popen(words, **streams) as child:
        child.stdin, kept = None, child.stdin  # communicate would close it
        with pytest.raises(UserError, match=why):
            result(child, timeout=1.0)
        kept.close()
        child.kill()


def test_medians_are_of_the_rounds_and_ratios_of_the_same_round(monkeypatch):
    pytest.importorskip('rclpy')
    from benchmarks.live import timing as live_timing

    taken = iter(
        [
            {'message': 1.0, 'cpu': 0.5, 'estimate': 1.0},
            {'message': 2.0, 'cpu': 1.0},
            {'message': 4.0, 'cpu': 0.5, 'estimate': 4.0},
            {'message': 4.0, 'cpu': 2.0, 'estimate': 6.0},
        ]
    )
    monkeypatch.setattr(live_timing, 'NODES', {'joint_observer': ()})

    def once(name):
        return next(taken)

    rows = {row['name']: row['value'] for row in live_timing.rows(once, live_timing.START, 2)}
    name = 'joint_observer: process start to first'
    assert rows[f'{name} message'] == 3.0 and rows[f'{name} message / null node'] == 1.5
    assert rows[f'{name} estimate'] == 6.0 and rows[f'{name} estimate / null node'] == 1.5
    cpu = 'joint_observer: CPU time to first message'
    assert rows[cpu] == 1.5 and rows[f'{cpu} / null node'] == 3.0
    taken = iter([{'median_ms': 1.0}, {}])
    assert [row['value'] for row in live_timing.rows(once, live_timing.LATENCY, 1)] == [
        1.0,
        None,
        None,
        None,
    ]


@pytest.mark.slow
@pytest.mark.dds
def test_a_node_starts_and_answers_over_dds(monkeypatch):
    """As the benchmark does it; the numbers are not judged here."""
    monkeypatch.delenv('PYTHONSAFEPATH')  # its processes import the benchmarks of the checkout
    pytest.importorskip('rclpy')
    from benchmarks.live import timing as live_timing

    found = live_timing.start('joint_observer')
    assert found['cpu'] > 0.1
    assert 0.2 < found['message'] <= found['estimate'] < live_timing.LONGEST
    late = live_timing.latency('mechanical_observer', rate=200.0, seconds=2.0)
    assert late['answered'] > 100 and 0.0 < late['median_ms'] <= late['late_ms']


def test_without_ros_the_part_says_what_it_lacks(monkeypatch, capsys):
    monkeypatch.setattr(live.importlib.util, 'find_spec', lambda name: None)
    assert main(['--part', 'live']) == 1
    assert capsys.readouterr().err == 'python -m benchmarks: rclpy is not installed\n'


# ---------------------------------------------------------------- the command


def test_parts_print_and_give_json_and_one_that_cannot_run_says_why(tmp_path, capsys, monkeypatch):
    row = timing.row('x / y', 3.0, 'times', limit=2.0)

    def refuses(parsed):
        raise UserError('no network')

    monkeypatch.setattr(
        command, 'PARTS', {'speed': lambda parsed: command._rows(parsed, [row]), 'live': refuses}
    )
    out = tmp_path / 'bench.json'
    assert main(['--json', str(out)]) == 0
    found = json.loads(out.read_text())
    assert found['speed'] == [row] and 'live' not in found
    printed = capsys.readouterr().out
    assert 'requirement not met: x / y' in printed and 'live: not run: no network\n' in printed
    assert main(['--part', 'live']) == 1
    assert capsys.readouterr().err == 'python -m benchmarks: no network\n'


@pytest.mark.parametrize(
    'words', [('--part', 'nonsense'), ('nonsense',), ('--part', 'accuracy', '--draws', '-1')]
)
def test_wrong_use(words, capsys):
    try:
        code = main(words)
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
