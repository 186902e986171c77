# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What the adaptive observer says of its parameters: deviations, trust, knocks, gravity."""

import math

import numpy as np
import pytest
from servos import excited, feed, joint, named, servo

from estimator_pkg.driver.adaptive import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.identified import load as load_file
from estimator_pkg.driver.identified import save
from estimator_pkg.observers.adaptive.evidence import (
    EVIDENCE_BLOCKS,
    MERGING_BLOCKS,
    Evidence,
    judge,
)
from estimator_pkg.observers.adaptive.observer import Adaptive
from estimator_pkg.observers.adaptive.state import LearningSums

TRUE = {'b/J': 2.0, 'k/J': 5.0, 'Kv/J': 30.0}
DT = 2e-3


def coloured(count, seed, size, time):
    """Gaussian noise of this size that forgets with this time constant [s]."""
    random, keep = np.random.default_rng(seed), math.exp(-DT / time)
    values, value = np.zeros(count), 0.0
    for k, new in enumerate(random.normal(size=count).tolist()):
        value = keep * value + math.sqrt(1.0 - keep * keep) * new
        values[k] = size * value
    return values


def learnt(seed, disturbance=0.0, noise=0.0, counts=0, seconds=24.0, **gains):
    """A joint that has seen a servo with a disturbing input, noise or an encoder."""
    count = round(seconds / DT)
    u = excited(count, hold=100, seed=seed + 100)
    pushed = coloured(count, seed, disturbance, 0.05) if disturbance else 0.0
    angles, velocity = servo(2.0, 5.0, 30.0, u + pushed, DT)
    random = np.random.default_rng(seed)
    if noise:
        angles = angles + noise * random.normal(size=len(angles))
    if counts:
        quantum = 2.0 * math.pi / counts
        angles = quantum * np.round(angles / quantum + random.uniform())
        gains['quantum'] = quantum
    made = joint(0.0, **{'known': ('b1=0',), **gains})
    out, _ = feed(made, angles, u, DT)
    return made, out, velocity


def scores(seeds, **case):
    """Errors in standard deviations, shape (seeds, 3)."""
    rows = []
    for seed in seeds:
        found = named(learnt(seed, **case)[0])
        rows.append(
            [(found[name].value - true) / found[name].stddev for name, true in TRUE.items()]
        )
    return np.array(rows)


@pytest.mark.long
@pytest.mark.parametrize(
    'case',
    [
        {'disturbance': 0.3, 'seconds': 12.0},
        pytest.param({'counts': 256}, marks=pytest.mark.slow),
        pytest.param({'noise': 2e-2}, marks=pytest.mark.slow),
    ],
    ids=['torque', '8 bit', 'noise'],
)
def test_standard_deviations_cover_the_errors_and_are_not_far_above(case):
    """A disturbance of 50 ms is correlated over 25 samples: independent errors would say a fifth
    of what is found.
    """
    rms = np.sqrt(np.mean(np.square(scores(range(8), **case)), axis=0))
    assert np.all(rms < 1.6) and np.all(rms > 0.3)


@pytest.mark.parametrize(
    'case',
    [{'noise': 1e-3}, {'disturbance': 1.0}, {'counts': 256}],
    ids=['noise', 'torque', '8 bit'],
)
@pytest.mark.long
def test_standard_deviation_of_the_velocity(case):
    """What the model lacks counts: a disturbing torque makes a slow innovation, not a noisy one."""
    errors, sigmas = [], []
    for seed in range(4):
        _, out, velocity = learnt(seed, seconds=8.0, **case)
        errors.append((out.velocity - velocity)[2000:])
        sigmas.append(out.velocity_stddev[2000:])
    ratio = np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(sigmas)))
    assert 0.5 < ratio < 1.5


def test_trusted_with_a_good_model_and_not_before_enough_was_seen():
    made, _, _ = learnt(1, counts=4096, seconds=1.0)
    said = made.report()
    assert not said.trusted and 'too little was learnt' in said.reason
    assert all(math.isinf(item.stddev) for item in said.parameters if item.name in TRUE)
    made, _, _ = learnt(1, counts=4096)
    said = made.report()
    assert said.trusted and said.why_not == '' and said.explained > 0.99
    for name, true in TRUE.items():
        item = named(made)[name]
        assert item.trusted and abs(item.value - true) < 3.0 * item.stddev < 0.01 * true


@pytest.mark.long
def test_what_the_model_lacks_ends_the_trust():
    """A constant load moves k/J by a third, and no deviation says so: the misfit does."""
    u = excited(12000, hold=100)
    angles, _ = servo(2.0, 5.0, 30.0, u, DT, load=50.0)
    made = joint(0.0, known=('b1=0',))
    feed(made, angles, u, DT)
    said = made.report()
    assert abs(named(made)['k/J'].value - 5.0) > 1.0
    assert not said.trusted and not named(made)['k/J'].trusted
    made = joint(0.0, known=('b1=0',), load=True)
    feed(made, angles, u, DT)
    assert made.report().trusted
    assert named(made)['load/J'].value == pytest.approx(50.0, rel=5e-3)


@pytest.mark.long
def test_a_bound_that_the_data_contradict_is_in_the_deviation():
    made, _, _ = learnt(1, counts=4096, bounds=('b/J>=2.5',))
    found = named(made)['b/J']
    assert found.value == pytest.approx(2.5) and found.stddev == pytest.approx(0.5, rel=0.02)
    assert not found.trusted and 'b/J' in made.report().why_not
    assert named(made)['Kv/J'].trusted


def test_a_wrong_sign_of_the_input_is_not_trusted():
    u = excited(12000, hold=100)
    angles, _ = servo(2.0, 5.0, 30.0, u, DT)
    made = joint(0.0, known=('b1=0',), torque_constant=0.6)
    feed(made, angles, -u, DT)
    assert 'right sign' in made.report().why_not


def pendulum(u, push=0.0):
    """(angle, velocity) of q'' = 20 u - 0.5 q' - 25 sin q + push at 1 ms; push [rad/s^2] acts at
    10 to 10.05 s.
    """
    q, w, h, rows = 0.0, 0.0, 1e-3, [(0.0, 0.0)]
    for k, value in enumerate((20.0 * u).tolist()):
        given = value + (push if 10000 <= k < 10050 else 0.0)
        k1 = given - 0.5 * w - 25.0 * math.sin(q)
        k2 = given - 0.5 * (w + 0.5 * h * k1) - 25.0 * math.sin(q + 0.5 * h * w)
        q, w = q + h * w + 0.5 * h * h * k1, w + h * k2
        rows.append((q, w))
    return np.array(rows).T


@pytest.mark.long
def test_gravity_is_a_known_regressor_over_the_whole_circle():
    u = excited(15000, hold=300, size=1.5)
    angles, velocity = pendulum(u)
    assert np.ptp(angles) > math.pi
    wrapped = (angles + math.pi) % (2.0 * math.pi) - math.pi
    made = joint(gravity=True, known=('b1=0', 'k/J=0'), torque_constant=1.0)
    out, _ = feed(made, wrapped, u)
    found = named(made)
    for name, true in (('Kv/J', 20.0), ('b/J', 0.5), ('mgl/J', 25.0), ('J', 0.05), ('mgl', 1.25)):
        assert found[name].value == pytest.approx(true, rel=3e-3)
    assert made.report().trusted
    assert np.abs(out.velocity - velocity)[8000:].max() < 0.01 * np.std(velocity)
    linear = joint(known=('b1=0',))
    feed(linear, wrapped, u)
    assert not linear.report().trusted and not any(
        item.trusted for item in linear.report().parameters if item.stddev > 0.0
    )


@pytest.mark.long
def test_a_knock_is_not_learnt_from():
    u = excited(15000, hold=300, size=1.5)
    pushed, _ = pendulum(u, push=300.0)
    errors = {}
    for knock in (5.0, 0.0):
        made = joint(gravity=True, known=('b1=0', 'k/J=0'), knock=knock)
        feed(made, pushed[:10200], u[:10199])
        errors[knock] = abs(named(made)['Kv/J'].value - 20.0)
        if knock:
            assert 'knock' in made.report().reason
    assert errors[5.0] < 0.1 < 1.0 < errors[0.0]


@pytest.mark.long
def test_nothing_is_learnt_below_a_speed():
    u = excited(15000, hold=300, size=1.5)
    angles, velocity = pendulum(u)
    adapted = []
    for above in (1.0, 1e3):
        made = joint(gravity=True, known=('b1=0', 'k/J=0'), moving_above=above)
        feed(made, angles, u)
        adapted.append(made.report().adapted)
    assert 2.0 < adapted[0] < 12.0 and adapted[1] == 0.0


def test_blocks_merge_and_forget():
    random = np.random.default_rng(1)
    rows = random.normal(size=(4000, 2))
    targets = rows @ (3.0, -1.0) + 0.1 * random.normal(size=4000)
    whole, forgetting = Evidence(100.0), Evidence(100.0, memory=1.0)
    matrix, vector = np.zeros((2, 2)), np.zeros(2)
    for k, (psi, target) in enumerate(zip(rows, targets)):
        matrix, vector = matrix + np.outer(psi, psi), vector + psi * target
        sums = LearningSums()
        sums.matrix, sums.vector = matrix, vector
        sums.count, sums.of_e, sums.of_bend = k + 1.0, 0.01 * (k + 1.0), 10.0 * (k + 1.0)
        whole.look(0.01 * (k + 1), sums)
        forgetting.look(0.01 * (k + 1), sums)
    assert EVIDENCE_BLOCKS <= len(whole.blocks) < MERGING_BLOCKS and whole.length > whole.shortest
    assert len(forgetting.blocks) <= 16
    zero = np.zeros(2)
    said = judge(whole, np.linalg.solve(matrix, vector), zero, zero, 0.01, 9.0)
    # independent errors: the jackknife is the textbook's formula
    assert np.sqrt(np.diag(said.covariance)) == pytest.approx(
        0.1 * np.sqrt(np.diag(np.linalg.inv(matrix))), rel=0.5
    )
    assert said.noise_only and np.all(said.hidden == 0.0)
    assert judge(Evidence(100.0), zero, zero, zero, 0.01, 9.0) is None
    whole.look(0.0, sums)
    assert not whole.blocks


@pytest.mark.long
def test_saved_parameters_keep_their_deviation_and_doubt(tmp_path):
    """Frozen on what was not trusted, a joint does not present it as good."""
    path, u = str(tmp_path / 'motor.yaml'), excited(12000, hold=100)

    def fed(angles, saved=None, **values):
        values = {'known': ('b1=0',), 'wrap_period': 0.0, **values}
        bank = AdaptiveBank(AdaptiveConfiguration(Adaptive, values, saved=saved))
        for k, angle in enumerate(angles.tolist()):
            bank.take(10**18 + k * 2_000_000, ('a',), (angle,), (float(u[k - 1]) if k else 0.0,))
        return bank, bank.reports()['a']

    for load, trusted in ((0.0, True), (50.0, False)):
        angles, _ = servo(2.0, 5.0, 30.0, u, DT, load=load)
        bank, before = fed(angles)
        assert before.trusted == trusted
        save(path, bank)
        _, said = fed(angles[:3000], load_file(path), adapt=False)
        assert said.phase == 'FROZEN' and said.trusted == trusted
        found = {item.name: item.stddev for item in said.parameters}
        assert found == pytest.approx({item.name: item.stddev for item in before.parameters})
        assert trusted or 'not trusted when' in said.why_not
