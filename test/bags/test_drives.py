# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated drives in bags: simulate, replay, evaluate, and two-sided bounds on the small ones."""

import math
from pathlib import Path

import numpy as np
import pytest
from answers import estimated

from benchmarks.accuracy import judge
from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.joint_state import Decoder
from sim_pkg.pmsm.simulator import SIMULATOR, PmsmSimulatorParameters

ROOT = Path(__file__).resolve().parents[2]
BAGS = ROOT / 'bags' / 'simulated'
PARAMS = ['--params', str(ROOT / 'config' / 'pmsm_observer.yaml')]
# bag: rms and largest error of the speed [rad/s], of the electrical angle [deg], and the part of
# the time in which an estimate is published: at least this, by at most 0.05 more
BOUNDS = {
    'drive_startup': (0.79, 1.60, 0.256, 1.03, 0.50),
    'drive_profile': (1.16, 3.19, 0.20, 0.546, 0.94),
    'drive_reversal': (0.62, 1.60, 0.288, 1.44, 0.85),
}


def simulate(out, *words, duration=0.2):
    assert (
        cli.main(['simulate', 'pmsm', '--out', str(out), '--duration', str(duration), *words]) == 0
    )


def settings(**values):
    return [word for name, value in values.items() for word in ('--set', f'{name}={value}')]


def states(bag, topic):
    decode = Decoder().decode
    return [decode(bytes(message.raw)) for message in bag.messages([topic])]


def rows(bag, topic):
    batches = [drive_samples.decode(bytes(message.raw)) for message in bag.messages([topic])]
    return (
        np.concatenate([batch.stamps_ns for batch in batches]),
        np.concatenate([batch.values for batch in batches]),
    )


def replay(bag, out, *words, params=PARAMS, code=0):
    assert cli.main(['replay', str(bag), *params, '--out', str(out), *words]) == code
    return open_bag(out)


@pytest.mark.parametrize('name', BOUNDS)
def test_small_bags_stay_within_two_sided_bounds(name, tmp_path):
    with replay(BAGS / name, tmp_path / 'out') as bag:
        true = {state.stamp_ns: state for state in states(bag, '/ground_truth/joint_states')}
        found = states(bag, '/pmsm_observer/estimate')
        batches = bag.topics['/drive_samples'].count
    pairs = [(state, true[state.stamp_ns]) for state in found if estimated(state)]
    assert all(state.names == ('motor', 'motor_electrical') for state, _ in pairs)
    speed = np.array([state.velocities[0] - truth.velocities[0] for state, truth in pairs])
    angle = np.degrees(
        [
            math.remainder(state.positions[1] - truth.positions[1], math.tau)
            for state, truth in pairs
        ]
    )
    *limits, part = BOUNDS[name]
    measured = [
        np.sqrt(np.mean(speed**2)),
        np.abs(speed).max(),
        np.sqrt(np.mean(angle**2)),
        np.abs(angle).max(),
    ]
    for value, limit, what in zip(measured, limits, ('rms', 'max', 'angle rms', 'angle max')):
        assert judge(float(value), limit) == '', what
    assert part <= len(pairs) / batches < part + 0.05


def test_a_slower_rate_publishes_means_of_the_voltage(tmp_path):
    simulate(tmp_path / 'all', '--seed', '3')
    simulate(tmp_path / 'some', '--seed', '3', *settings(publish_rate=5000, batch=50))
    with open_bag(tmp_path / 'all') as one, open_bag(tmp_path / 'some') as other:
        (stamps, fine), (few, coarse) = rows(one, '/drive_samples'), rows(other, '/drive_samples')
    assert np.array_equal(few, stamps[::4])
    assert np.array_equal(coarse[:, :2], fine[::4, :2])
    means = fine[1:3997, 2:].reshape(-1, 4, 2).mean(axis=1)
    assert np.allclose(coarse[1:, 2:], means, atol=1e-12)


@pytest.mark.long
def test_single_samples_and_phases_give_the_same_estimates_as_batches(tmp_path):
    common = settings(sample_rate=5000, current_hz=300, profile='constant', speed_rpm=2000)
    simulate(tmp_path / 'batches', *common)
    simulate(tmp_path / 'single', *common, *settings(publish='single'))
    simulate(tmp_path / 'phases', *common, *settings(publish='single', phase_values='true'))
    found = {}
    vectors = settings(input='current_voltage')
    for name, words in (
        ('batches', []),
        ('single', vectors),
        ('phases', [*vectors, *settings(frame='abc')]),
    ):
        with replay(tmp_path / name, tmp_path / f'{name}_out', *words) as bag:
            found[name] = {
                state.stamp_ns: state for state in states(bag, '/pmsm_observer/estimate')
            }
    assert len(found['single']) == len(found['phases']) == 1000
    last = max(found['batches'])
    assert estimated(found['batches'][last])
    for stamp, state in found['batches'].items():
        for other in ('single', 'phases'):
            one = found[other][stamp]
            assert one.names == state.names
            assert one.velocities == pytest.approx(state.velocities, rel=1e-9, nan_ok=True)
            assert one.positions == pytest.approx(state.positions, abs=1e-9, nan_ok=True)


def test_replay_finds_the_input_and_names_the_joint(tmp_path):
    simulate(tmp_path / 'bag', *settings(profile='constant'))
    words = [*settings(joint='hub'), '--name', 'mine']
    with replay(tmp_path / 'bag', tmp_path / 'out', *words) as bag:
        assert states(bag, '/mine/estimate')[-1].names == ('hub', 'hub_electrical')
        stddev = states(bag, '/mine/estimate_stddev')[-1]
        assert stddev.names == ('hub', 'hub_electrical')
        assert stddev.positions[1] == pytest.approx(7.0 * stddev.positions[0])
        flux = [vector3.decode(bytes(m.raw)) for m in bag.messages(['/mine/flux_linkage'])]
        assert flux[-1].x == pytest.approx(1.9e-3, rel=0.02) and 0.0 < flux[-1].y < 1e-4


def test_time_has_no_end_and_the_first_messages_do_not_depend_on_it():
    parameters = PmsmSimulatorParameters(overtaken=0.3, repeated=0.3)
    chunks = SIMULATOR.generate(parameters, math.inf, 5)
    endless = [message for _ in range(5) for message in next(chunks)]
    finite = [message for chunk in SIMULATOR.generate(parameters, 0.03, 5) for message in chunk]
    assert [m.due_ns for m in endless] == sorted(m.due_ns for m in endless)
    due = [(m.due_ns, m.topic, m.encode(10**18)) for m in finite if m.due_ns < 29_000_000]
    assert len(due) >= 8
    assert due == [(m.due_ns, m.topic, m.encode(10**18)) for m in endless[: len(due)]]
