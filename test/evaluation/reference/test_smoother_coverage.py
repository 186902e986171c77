# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The off-line reference says truly what it may be wrong by: at creep, at speed, on recordings.

Run as a program it prints the numbers of docs/stamps_and_quantisation.md.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.evaluation.compare.truth import truth
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.reference.smoother import pieces
from estimator_pkg.evaluation.reference.smoother.cells import site
from estimator_pkg.evaluation.reference.smoother.noise import Cells
from estimator_pkg.evaluation.reference.smoother.pieces import Piece
from estimator_pkg.evaluation.reference.smoother.smoother import smooth

BAGS = Path(__file__).resolve().parents[3] / 'bags'
TURN = 2.0 * math.pi
QUANTUM, STEP, COUNT = TURN / 4096.0, 1e-3, 10_000
MEMORY = 0.5  # of the speed [s]
SPEEDS = (0.02, 0.1, 0.5, 2.0, 10.0, 60.0)  # rms [quanta per sample]
ENDS = 200


def wandering(seed, speed):
    """(position, velocity): v'' = -2 v'/T - v/T^2 + white jerk, of the rms `speed` [rad/s]."""
    random = np.random.default_rng(seed)
    fine = STEP / 4
    jerk = (
        2.0
        * speed
        * math.sqrt(1.0 / MEMORY**3)
        / math.sqrt(fine)
        * random.standard_normal(4 * COUNT)
    )
    v, a = speed * random.standard_normal(), speed / MEMORY * random.standard_normal()
    velocity = np.empty(4 * COUNT)
    for k in range(4 * COUNT):
        velocity[k] = v
        a += fine * (-2.0 / MEMORY * a - v / MEMORY**2 + jerk[k])
        v += fine * a
    steps = 0.5 * fine * (velocity[1:] + velocity[:-1])
    position = np.concatenate([[0.0], np.cumsum(steps)])
    return position[::4], velocity[::4]


def held(speed, noise, seeds):
    """(rms error, its sigma, part within 95 %, of these) over draws of quantised readings."""
    squares, reported, within = [], [], []
    for seed in seeds:
        position, velocity = wandering(seed, speed * QUANTUM / STEP)
        random = np.random.default_rng(seed + 1000)
        blurred = position + noise * QUANTUM * random.standard_normal(COUNT)
        readings = np.round((blurred + random.uniform(0.0, QUANTUM)) / QUANTUM) * QUANTUM
        stamps = np.arange(COUNT) * round(STEP * 1e9) + 10**9
        found = smooth(stamps, readings, 0.0)
        inner = found.firm & (np.arange(COUNT) >= ENDS) & (np.arange(COUNT) < COUNT - ENDS)
        error, stddev = (found.velocity - velocity)[inner], found.velocity_stddev[inner]
        squares.append(np.mean(error**2))
        reported.append(found.uncertainty**2)
        within.append(np.mean(np.abs(error) <= 1.96 * stddev))
    return math.sqrt(np.mean(squares)), math.sqrt(np.mean(reported)), float(np.mean(within))


@pytest.mark.long
@pytest.mark.parametrize('speed', [0.02, 0.5, 60.0])
@pytest.mark.parametrize('noise', [0.0, 0.3])
def test_it_covers_what_it_promises_and_no_more(speed, noise):
    rms, reported, within = held(speed, noise, range(2))
    assert 0.90 <= within <= 0.99
    assert 0.75 <= reported / rms <= 1.35


def test_a_count_that_stays_may_hide_a_creep():
    """Three seconds of motion, then a creep of less than a count."""
    time = np.arange(COUNT) * STEP
    speed = np.where(time < 3.0, np.sin(TURN * time / 3.0) * (time < 3.0), 0.0)
    hidden = 0.4 * QUANTUM * np.sin(TURN * np.maximum(time - 3.0, 0.0) / 3.5)
    position = np.cumsum(speed) * STEP + hidden
    found = smooth(
        np.arange(COUNT) * round(STEP * 1e9) + 10**9, np.round(position / QUANTUM) * QUANTUM, 0.0
    )
    later = (time > 4.0) & (time < 9.0)
    error = np.gradient(position, STEP) - found.velocity
    assert np.mean(np.abs(error) <= 1.96 * found.velocity_stddev, where=later) > 0.9
    assert np.max(found.velocity_stddev[later]) < 0.05


@pytest.mark.parametrize('turns', [0.0, 4.0])
def test_a_reading_that_hardly_changes_says_nothing(turns):
    readings = np.floor(np.linspace(0.0, turns, COUNT) * 8.0) * TURN / 8.0
    found = smooth(np.arange(COUNT) * round(STEP * 1e9) + 10**9, readings, TURN)
    assert found.uncertainty == math.inf
    assert found.changes == int(8.0 * turns)


RECORDED = [
    ('dfki_simple_pendulum/gravity_compensation_1000hz', 'pendulum'),
    ('dfki_simple_pendulum/energy_shaping_200hz', 'pendulum'),
    ('dfki_simple_pendulum/sac_200hz_multiturn', 'pendulum'),
    ('dfki_simple_pendulum/system_identification_300hz', 'pendulum'),
    ('dfki_double_pendulum/trajectory_665hz', 'shoulder'),
    ('dfki_double_pendulum/trajectory_665hz', 'elbow'),
]


def against_the_drive(name, joint):
    """(error against the drive's velocity without the drive's own noise, sigma) [rad/s]."""
    path = str(BAGS / name)
    with open_bag(path) as bag:
        measured = joint_series(bag, '/joint_states')
        true = truth(bag, path, measured, Options(correct_reference=True))
    found = smooth(measured[joint].stamps_ns, measured[joint].position, TURN)
    drive = true.series[joint]
    start = found.stamps[0]
    time, at = (found.stamps - start) * 1e-9, (drive.stamps_ns - start) * 1e-9
    firm = time[found.firm]
    inside = (at >= firm[0]) & (at <= firm[-1])
    error = np.interp(at[inside], time, found.velocity) - drive.velocity[inside]
    own = np.mean(error**2) - true.references[joint].noise ** 2
    return math.sqrt(max(own, 0.0)), found.uncertainty


@pytest.mark.long
@pytest.mark.parametrize('name, joint', RECORDED)
def test_on_recordings(name, joint):
    """Their chatter of less than a count is not followed, but reported."""
    error, reported = against_the_drive(name, joint)
    assert 0.6 * error <= reported <= 1.7 * error


# ---------------------------------------------------------------- the parts


@pytest.mark.long
@pytest.mark.parametrize(
    'mean, variance, noise',
    [(0.0, 1.0, 0.1), (0.7, 0.01, 0.0), (-3.0, 0.5, 0.2), (40.0, 1.0, 0.05), (0.2, 1e-4, 0.01)],
)
def test_a_site_gives_the_moments_of_a_gaussian_in_a_cell(mean, variance, noise):
    half = 0.5
    low, high = mean - 60.0 * math.sqrt(variance), mean + 60.0 * math.sqrt(variance)
    at = np.linspace(min(low, -1.0), max(high, 1.0), 400_001)
    from scipy.special import log_ndtr
    from scipy.stats import norm

    if noise:
        logs = norm.logpdf(at, mean, math.sqrt(variance)) + np.where(
            np.abs(at) < 20.0,
            np.log(
                np.maximum(norm.cdf((half - at) / noise) - norm.cdf((-half - at) / noise), 1e-300)
            ),
            log_ndtr((half - np.abs(at)) / noise),
        )
    else:
        logs = np.where(np.abs(at) <= half, norm.logpdf(at, mean, math.sqrt(variance)), -np.inf)
    top = np.max(logs)
    weight = np.exp(logs - top)
    total = np.sum(weight)
    centre = np.sum(weight * at) / total
    scatter = np.sum(weight * (at - centre) ** 2) / total
    precision, pull, log_z = site(mean, variance, half, noise)
    left = 1.0 / (1.0 / variance + precision)
    assert left == pytest.approx(scatter, rel=2e-2)
    assert left * (mean / variance + pull) == pytest.approx(centre, abs=0.02 * math.sqrt(scatter))
    assert log_z == pytest.approx(top + math.log(total * (at[1] - at[0])), abs=0.02)


@pytest.mark.long
def test_the_probability_of_cells_is_that_of_drawing_them(monkeypatch):
    """Four readings of a coarse counter against draws of the motion."""
    monkeypatch.setattr(pieces, 'SPEED_STEPS', 1.0)
    random = np.random.default_rng(0)
    steps = np.array([0.0, 1.0, 1.0, 1.0])
    log_z, one = (
        Cells(Piece(np.arange(4), steps, np.array(cells)), 1.0).probability(0.1, 1.0)
        for cells in ((0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0))
    )
    # the start is open (its prior is the same for both), so the ratio of both is drawn
    draws = 1_000_000
    x = np.zeros((draws, 3))
    x[:, 0] = random.uniform(-0.5, 0.5, draws)
    x[:, 1] = random.uniform(-4.0, 4.0, draws)
    x[:, 2] = random.uniform(-6.0, 6.0, draws)
    root = np.linalg.cholesky(
        np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1.0]])
    )
    seen = [np.zeros(draws, int)]
    for _ in range(3):
        x = x @ np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.5, 1.0, 1.0]])
        x += random.standard_normal((draws, 3)) @ root.T
        seen.append(np.rint(x[:, 0] + 0.1 * random.standard_normal(draws)).astype(int))
    ours = np.mean((seen[1] == 0) & (seen[2] == 1) & (seen[3] == 1))
    other = np.mean((seen[1] == 0) & (seen[2] == 0) & (seen[3] == 1))
    assert log_z - one == pytest.approx(math.log(ours / other), abs=0.1)


def table():
    """The table of the documentation."""
    lines = [
        '| speed [counts per sample] | noise [counts] | rms error / speed | reported / error | '
        'within 95 % |',
        '|---|---|---|---|---|',
    ]
    for speed in SPEEDS:
        for noise in (0.0, 0.3):
            rms, reported, within = held(speed, noise, range(5))
            lines.append(
                f'| {speed:g} | {noise:g} | {rms / speed / QUANTUM * STEP:.2%} | '
                f'{reported / rms:.2f} | {within:.1%} |'
            )
    lines += ['', '| recording | joint | error [rad/s] | reported [rad/s] |', '|---|---|---|---|']
    for name, joint in RECORDED:
        error, reported = against_the_drive(name, joint)
        lines.append(f'| {name.split("/")[1]} | {joint} | {error:.3f} | {reported:.3f} |')
    return '\n'.join(lines)


if __name__ == '__main__':
    print(table())
