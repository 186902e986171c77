# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The standard deviation beside an estimate: right at constant speed, measured in motion.

    PYTHONPATH=test/support python test/observers/angle/test_stddev.py

prints the table of docs/evidence.md: what the 95 % interval covers in motion. A test compares both.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from observer_cases import label, make, stamps, tunable_variants, variants, wrapped
from test_frequency_response import CASES, DT, bandwidths, joint_of

from estimator_pkg.estimate import TRACKING

TABLE = Path(__file__).parents[3] / 'docs' / 'evidence.md'
NOISE = 1e-3


def constant(t):
    return 3.0 * t, np.full(len(t), 3.0)


def slow_sine(t):
    w = 2.0 * math.pi
    return np.sin(w * t), w * np.cos(w * t)


def fast_sine(t):
    w = 10.0 * math.pi
    return 0.2 * np.sin(w * t), 0.2 * w * np.cos(w * t)


def trapezoid(t):
    """+-10 rad/s, with 100 rad/s^2 between: a period of 1 s."""
    velocity = np.clip(40.0 * np.abs((t - 0.125) % 1.0 - 0.5) * 2.5 - 25.0, -10.0, 10.0)
    return np.cumsum(velocity) * (t[1] - t[0]), velocity


def covered(name, gains, profile, seed, count=40_000):
    """Part of the tracked samples whose 95 % interval holds the true velocity, and their number."""
    t = np.arange(count) * DT
    position, velocity = profile(t)
    joint = make(name, gains)
    measured = position + np.random.default_rng(seed).normal(0.0, NOISE, count)
    out = joint.run(stamps(count, DT), wrapped(measured))
    tracked = out.status == TRACKING
    error = np.abs(out.velocity - velocity)[tracked]
    return float(np.mean(error < 1.96 * out.velocity_stddev[tracked])), int(tracked.sum())


def few_counts(name, gains, counts, speed):
    """The errors [rad/s] and what sigma covers at a constant speed, `counts` per turn, 1 kHz."""
    quantum, count = 2.0 * math.pi / counts, 2000
    read = wrapped(np.floor((speed * DT * np.arange(count) + 0.1) / quantum) * quantum)
    out = make(name, gains).run(stamps(count, DT), read)
    error = np.abs(out.velocity - speed)[count // 2 :]
    return error, np.mean(error < 1.96 * out.velocity_stddev[count // 2 :])


# their errors last from edge to edge
LEAST_OF_FEW = {'kalman': 0.5, 'super_twisting': 0.35, 'hybrid_angle': 0.55}


@pytest.mark.parametrize('counts', [4, 6])
@pytest.mark.parametrize('speed', [20.0, 200.0])
@pytest.mark.parametrize('variant', variants(), ids=label)
def test_an_edge_further_than_an_eighth_of_a_turn_is_no_outlier(variant, speed, counts):
    """The interval of hybrid_angle never covered the speed of such a sensor, at 20 rad/s."""
    name, gains = variant
    _, part = few_counts(name, gains, counts, speed)
    assert part > LEAST_OF_FEW.get(name, 0.8)


@pytest.mark.parametrize('counts', [4, 7])
def test_the_hybrid_observer_follows_few_counts_that_it_is_told(counts):
    """It held its speed at each edge before, and was wrong by 370 to 520 rad/s."""
    error, _ = few_counts('hybrid_angle', {'quantum': 2.0 * math.pi / counts}, counts, 200.0)
    assert np.sqrt(np.mean(error * error)) < 50.0


@pytest.mark.parametrize(
    'variant',
    [
        variant
        for variant in tunable_variants()
        if variant[0] in ('finite_difference', 'hybrid_angle', 'pll')
    ],
    ids=label,
)
def test_noise_that_is_estimated_is_steady_and_follows_a_change(variant):
    """White noise, twice as large from sample 8000 on: the standard deviation scatters by 2 to 3 %
    before, and has followed within 800 samples, by a quarter too much at most.
    """
    count = 10_000
    noise = np.random.default_rng(3).normal(0.0, NOISE, count)
    noise[8000:] *= 2.0
    measured = 3e-3 * np.arange(count) + noise
    sigma = make(*variant).run(stamps(count, 1e-3), wrapped(measured)).velocity_stddev
    before = sigma[2000:8000]
    assert np.std(before) < 0.04 * np.mean(before)
    assert 1.1 < sigma[8100] / np.mean(before) < 1.5
    assert 1.75 < sigma[8800] / np.mean(before) < 2.6


@pytest.mark.parametrize(
    'name, gains, form, bandwidth',
    [
        (name, gains, form, bandwidths(gains)[-1])
        for name, cases in CASES.items()
        for gains, form in cases
    ],
)
def test_velocity_stddev_is_the_power_of_the_response_to_white_noise(name, gains, form, bandwidth):
    """Parseval: the variance is the mean of |V/Y|^2 over the unit circle."""
    closed = form(bandwidth, DT)
    points = np.exp(2j * math.pi * (np.arange(2000) + 0.5) / 2000)
    expected = math.sqrt(np.mean([abs(closed(z)) ** 2 for z in points]))
    noise = gains.get('noise', NOISE)
    joint = joint_of(name, {**gains, 'noise': noise}, bandwidth)
    joint.run(stamps(2000, DT), np.zeros(2000))
    joint.update(joint.stamp_ns + 10**6, 1e-9)  # a change, so that no low-speed bound stands
    white = math.hypot(noise, gains.get('quantum', 0.0) / math.sqrt(12.0))
    assert joint.stddev()[1] == pytest.approx(expected * white, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize('variant', tunable_variants(), ids=label)
def test_position_stddev_covers(variant):
    name, gains = variant
    joint = make(name, {**gains, 'noise': NOISE})
    count = 40_000
    measured = 1.0 + np.random.default_rng(5).normal(0.0, NOISE, count)
    out = joint.run(stamps(count, DT), measured)
    tracked = out.status == TRACKING
    inside = np.abs(out.position[tracked] - 1.0) < 1.96 * out.position_stddev[tracked]
    assert 0.93 <= np.mean(inside) <= 0.97


MOTIONS = {
    'constant 3 rad/s': constant,
    'sine 1 rad, 1 Hz': slow_sine,
    'sine 0.2 rad, 5 Hz': fast_sine,
    'trapezoid 10 rad/s, 100 rad/s^2': trapezoid,
}


def measured_row(variant):
    name, gains = variant
    return [covered(name, gains, profile, seed=1, count=10_000)[0] for profile in MOTIONS.values()]


def table():
    rows = [f'| observer | {" | ".join(MOTIONS)} |', '|---' * (len(MOTIONS) + 1) + '|']
    for variant in variants():
        cells = ' | '.join(f'{100.0 * part:.1f} %' for part in measured_row(variant))
        rows.append(f'| {described(variant)} | {cells} |')
    return '\n'.join(rows)


def described(variant):
    name, gains = variant
    return ', '.join((f'`{name}`', *(f'{key}: {value}' for key, value in gains.items())))


@pytest.mark.long
@pytest.mark.parametrize('variant', variants(), ids=label)
def test_table_of_coverage_is_current(variant):
    lines = [
        line
        for line in TABLE.read_text().splitlines()
        if line.startswith(f'| {described(variant)} |')
    ]
    assert len(lines) == 1, (
        'PYTHONPATH=test/support python test/observers/angle/test_stddev.py prints it'
    )
    written = [float(number) / 100.0 for number in re.findall(r'([\d.]+) %', lines[0])]
    assert written == pytest.approx(measured_row(variant), abs=0.02)


if __name__ == '__main__':
    print(table())
