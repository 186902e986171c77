# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The ranking without truth agrees with the truth, and its failures are recognised."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import ranking
from benchmarks.columns import Column
from benchmarks.motions import FAILURES, MOTIONS, TURN, sampled
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.ranking.ranking import at_reference, rank
from estimator_pkg.evaluation.reference import motion as reference_motion
from estimator_pkg.evaluation.reference.motion import motion

BAGS = Path(__file__).resolve().parents[3] / 'bags'
SAMPLE = ('bursts of 28 Hz, 2157 counts', 'reaches at 100 Hz', 'sines to 5 Hz, noise of 3 mrad')
FEW = [
    Entry(f'{name} {hz:g}', name, (('bandwidth_hz', hz),))
    for name in ('pll', 'kalman')
    for hz in (4.0, 16.0, 64.0)
]
SIX = [Entry(name, name) for name in angle_observers()]


def column(name):
    return Column(name, sampled(name), 0.0)


def ranked(name, entries, **settings):
    one = column(name)
    found = motion(one.samples.stamps, one.samples.angle, TURN)
    estimates = {
        entry.label: at_reference(found, *ranking.estimates(entry, one)) for entry in entries
    }
    return rank(estimates, found, 'edge_adaptive', **settings), found


@pytest.mark.long
def test_a_sample_of_motions_is_ranked_as_by_truth():
    entries = [*SIX, *FEW]
    outcomes = [ranking.judge(ranking.Case('simulated', column(name)), entries) for name in SAMPLE]
    found = ranking.summary(outcomes)
    assert found['tau'] >= 0.98
    assert found['regret_worst'] <= 1.05 and found['choice_worst'] <= 1.05
    assert found['wrong'] == 0 and 25 <= found['declared'] <= 40
    # the choice matters: the worst of the six is far worse than the best
    assert min(each.tau for each in outcomes) >= 0.9


@pytest.mark.long
def test_without_the_recovered_vibration_the_wrong_one_is_best(monkeypatch):
    """Two answers and the question; with the user's number, one answer."""
    name, entries = SAMPLE[0], [SIX[0], Entry('kalman', 'kalman')]
    asked, found = ranked(name, entries)
    assert found.vibrates and asked.best == 'edge_adaptive' and asked.other == 'kalman'
    assert 26.0 <= asked.question_hz <= 32.0
    hz = f'{asked.question_hz:.0f}'
    question = f'kalman is best if the {hz} Hz are sensor noise, edge_adaptive if they are motion'
    assert f'{question}: answer with --motion-hz.' in asked.sentences()
    assert asked.pairs[0].sign == 0
    moving, _ = ranked(name, entries, motion_hz=30.0)
    assert moving.best == 'edge_adaptive' and moving.other == ''
    still, _ = ranked(name, entries, motion_hz=2.0)
    assert still.best == 'kalman' and still.other == '' and still.pairs[0].sign == 1
    monkeypatch.setattr(reference_motion, 'needed', lambda smoothed: False)
    plain, _ = ranked(name, entries)
    assert plain.best == 'kalman'


def failures(kind, quick):
    """Names of the failures of a kind; all but the first few are slow."""
    names = [name for name in FAILURES if name.startswith(kind)]
    return [
        name if number < quick else pytest.param(name, marks=pytest.mark.slow)
        for number, name in enumerate(names)
    ]


@pytest.mark.parametrize('name', failures('constant', 2))
def test_constant_speed_is_recognised(name):
    samples = sampled(name)
    found = motion(samples.stamps, samples.angle, TURN)
    assert found.constant
    assert found.velocity == pytest.approx(samples.velocity[0], abs=2e-3)
    verdict = rank({'a': found.velocity, 'b': found.velocity + 0.1}, found)
    assert verdict.best == 'a' and verdict.pairs[0].sign == 1 and not verdict.tunable
    assert 'moves at a constant' in verdict.cautions[0]


def test_a_slow_motion_within_the_noise_is_not_taken_for_constant_speed():
    time = np.arange(6000) / 500.0
    stamps = np.rint(time * 1e9).astype(np.int64) + 10**18
    random = np.random.default_rng(4)
    swing = 3e-3 * np.sin(2.0 * np.pi * 0.7 * time)
    for size, constant in ((0.0, True), (1.0, False)):
        readings = 2.0 * time + size * swing + random.normal(0.0, 1e-3, len(time))
        assert motion(stamps, np.mod(readings, TURN), TURN).constant is constant


@pytest.mark.parametrize('name', failures('sticks', 1))
def test_a_sensor_that_sticks_is_recognised(name):
    samples = sampled(name)
    found = motion(samples.stamps, samples.angle, TURN)
    every = FAILURES[name][1].sticks
    assert 0.5 * 12.0 / every[1] <= len(found.fresh.stuck) <= 12.0 / every[1]
    assert all(length == pytest.approx(every[0], abs=0.01) for _, length in found.fresh.stuck)
    verdict = rank({'a': found.velocity}, found)
    assert 'the sensor sticks' in verdict.cautions[0]
    good = found.firm
    truth = at_reference(found, samples.stamps, samples.velocity)
    assert np.sqrt(np.mean((found.velocity - truth)[good] ** 2)) < 0.05


@pytest.mark.slow
def test_no_other_motion_sticks_or_is_constant():
    for name in MOTIONS:
        samples = sampled(name)
        found = motion(samples.stamps, samples.angle, TURN)
        assert not found.fresh.stuck and not found.constant, name


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_every_series_with_truth():
    """What docs/doctor.md promises; its table is compared by test_figures."""
    outcomes = ranking.run(list(ranking.cases(BAGS)))
    groups = {group: ranking.summary(each) for group, each in ranking.groups(outcomes).items()}
    usual = groups['all three']
    assert usual['series'] >= 60 and usual['tau'] >= 0.98
    assert usual['regret'] <= 1.005 and usual['regret_90'] <= 1.05 and usual['regret_worst'] <= 1.2
    for who in ('choice', 'doctor'):
        assert usual[f'{who}_90'] <= 1.02 and usual[f'{who}_worst'] <= 1.1
    assert usual['wrong'] <= 0.02 * usual['declared'] and usual['declared'] >= 700
    assert groups['constant speed']['wrong'] == 0
    assert groups['hum']['regret_worst'] > 5.0  # a failure that only the user's number prevents
    assert groups['hum, --motion-hz 2']['regret_worst'] <= 1.02
