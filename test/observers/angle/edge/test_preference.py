# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`prefer` of edge_adaptive: its range, its interval, and the filter that it publishes."""

import math

import numpy as np
import pytest

from benchmarks.signals import FURTHER, SIGNALS, SKIPPED, START_NS, encoder
from estimator_pkg.evaluation.delay import delay
from estimator_pkg.evaluation.entries import Entry

BY_NAME = {signal.name: signal for signal in SIGNALS + FURTHER}
QUANTUM = 2.0 * math.pi / 4096


def preferring(prefer):
    return Entry(prefer, 'edge_adaptive', (('prefer', prefer),))


# noise and delay with smooth and with fast, over those of balanced: at least or at most
@pytest.mark.long
@pytest.mark.parametrize(
    ('name', 'draws', 'quiet', 'loud'), [('sine', 4, 0.75, 1.4), ('trapezoid', 8, 0.92, 1.1)]
)
def test_the_preference_spans_a_range(name, draws, quiet, loud):
    noise, lag = {}, {}
    for prefer in ('smooth', 'balanced', 'fast'):
        noise[prefer], lag[prefer] = noise_and_delay(prefer, BY_NAME[name], draws)
    assert noise['smooth'] <= quiet * noise['balanced']
    assert noise['fast'] >= loud * noise['balanced']
    if name == 'sine':  # the other is late by a tenth of a sample
        assert lag['smooth'] >= 1.8 * lag['balanced']
        assert lag['fast'] <= 0.7 * lag['balanced']


def noise_and_delay(prefer, signal, draws):
    """Spread of the estimates of one instant with the counter at many angles, and their delay."""
    steps = (np.arange(round(3.0 * signal.rate)) + 1.0) / signal.rate
    position, velocity = signal.motion(steps)
    joint, found = preferring(prefer).joint(quantum=signal.quantum), []
    for number in range(draws):
        random = np.random.default_rng(number)
        angle = position + random.uniform(0.0, 2.0 * np.pi)
        angle = angle + random.normal(0.0, signal.noise, len(position))
        joint.reset()
        stamps = np.rint(1e9 * steps).astype(np.int64) + START_NS
        found.append(joint.run(stamps, encoder(angle, signal.counts)).velocity[steps >= SKIPPED])
    late = steps >= SKIPPED
    spread = np.sqrt(np.mean(np.var(found, axis=0, ddof=1)))
    return spread, delay(steps[late], np.mean(found, axis=0), velocity[late])


@pytest.mark.parametrize('prefer', ['smooth', 'fast'])
def test_the_interval_is_as_honest_as_that_of_balanced(prefer):
    for name in ('noise', '100 Hz'):
        samples = BY_NAME[name].drawn(3, 4.0)
        out = preferring(prefer).joint(quantum=QUANTUM).run(samples.stamps, samples.angle)
        counted = samples.stamps - samples.stamps[0] >= 1e9
        error = np.abs(out.velocity - samples.velocity)[counted]
        covered = float(np.mean(error <= 1.96 * out.velocity_stddev[counted]))
        assert covered >= 0.92, name


def test_a_change_while_it_runs_leaves_the_first_filter_alone():
    samples = BY_NAME['sine'].drawn(1, 1.5)
    straight = preferring('balanced').joint(quantum=QUANTUM).run(samples.stamps, samples.angle)
    joint = preferring('balanced').joint(quantum=QUANTUM)
    parts = []
    for prefer, part in (
        ('balanced', slice(500)),
        ('fast', slice(500, 900)),
        ('balanced', slice(900, None)),
    ):
        joint.set_gains(preferring(prefer).joint(quantum=QUANTUM).gains)
        parts.append(joint.run(samples.stamps[part], samples.angle[part]).velocity)
    found = np.concatenate(parts)
    other = slice(502, 900)
    assert np.mean(found[other] != straight.velocity[other]) > 0.9
    assert np.max(np.abs(found - straight.velocity)) < 0.5
    for part in (slice(500), slice(901, None)):
        np.testing.assert_array_equal(found[part], straight.velocity[part])
