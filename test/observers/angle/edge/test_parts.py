# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The pieces of the edge-aware adaptive observer."""

import math

import numpy as np
import pytest

from estimator_pkg.observers.angle.edge import bandwidth as edge_bandwidth
from estimator_pkg.observers.angle.edge import constants as edge_constants
from estimator_pkg.observers.angle.edge import covariance as edge_covariance
from estimator_pkg.observers.angle.edge import observer as edge_observer
from estimator_pkg.observers.angle.edge import start as edge_start
from estimator_pkg.observers.angle.edge.bandwidth import VelocityRandomWalk
from estimator_pkg.observers.angle.edge.interval import within
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.sensor import noise as edge_sensor
from estimator_pkg.sensor import quantum as edge_quantum
from estimator_pkg.sensor.noise import Sensor

Q = 1.0


@pytest.mark.parametrize(
    'e, half',
    [(0.0, 1.0), (0.5, 0.2), (-3.0, 0.5), (2.0, 5.0), (3.9, 0.4), (1.0, 1e-4), (-0.3, 1e-2)],
)
def test_within_is_the_truncated_gaussian(e, half):
    from scipy import stats  # takes half a second to import

    sigma = 0.7
    mean, ratio = within(e, half, sigma)
    exact = stats.truncnorm((e - half) / sigma, (e + half) / sigma, scale=sigma)
    assert mean == pytest.approx(exact.mean(), abs=1e-6 * sigma)
    assert ratio == pytest.approx(exact.var() / sigma**2, rel=1e-2, abs=1e-6)


@pytest.mark.parametrize('e, half', [(9.0, 1.0), (30.0, 0.01), (-40.0, 3.0)])
def test_far_in_the_tail_the_mean_is_at_the_near_end(e, half):
    mean, ratio = within(e, half, 1.0)
    near = abs(e) - half
    assert near < abs(mean) < min(near + 1.01 / near, abs(e) + half)
    assert 0.0 < ratio < 1.2 / near**2


def made(record, *values, **fields):
    """A record with these values, in their order or by name."""
    new = record()
    for name, value in (*zip(record.fields, values), *fields.items()):
        setattr(new, name, value)
    return new


def values(record):
    """The values of a record of numbers."""
    return tuple(getattr(record, name) for name in type(record).fields)


def begun_sensor(quantum):
    sensor = Sensor()
    edge_sensor.begin_sensor(sensor, quantum)
    return sensor


def sensed(angles, dts=None, quantum=0.01):
    sensor, steps = begun_sensor(quantum), edge_quantum.Steps()
    edge_quantum.begin_steps(steps)
    for i in range(1, len(angles)):
        step = angles[i] - angles[i - 1]
        if step != 0.0:
            edge_quantum.search_quantum(steps, step, abs(angles[i]), quantum, sensor)
        dt, found = 1e-3 if dts is None else dts[i], edge_quantum.quantum_of(steps, quantum)
        edge_sensor.follow_sensor(sensor, step, dt, found, False)
    return sensor, steps


def test_scatter_is_the_noise_whatever_the_motion_and_the_sample_times():
    random = np.random.default_rng(3)
    dts = random.uniform(0.6e-3, 1.4e-3, 4000)
    t = np.cumsum(dts)
    noise = 0.05
    scatters = [
        sensed(
            (5.0 * t * t + noise * random.normal(size=4000))[k : k + 200], dts[k : k + 200], 1e-3
        )[0].noise_bound
        for k in range(0, 3800, 200)
    ]
    assert math.sqrt(np.mean(scatters)) == pytest.approx(noise, rel=0.1)


def test_quantisation_is_never_taken_for_noise():
    for speed in np.linspace(0.01, 40.0, 57):
        angles = np.floor(speed * np.arange(500) * 1e-3 / 0.01) * 0.01
        sensor, _ = sensed(angles)
        assert math.sqrt(sensor.noise) < 0.0004


def test_no_constant_speed_looks_like_a_vibration():
    """However the speed beats with the sampling, and at creep, from any phase."""
    quantum = 0.01
    for counts in (*np.linspace(0.003, 1.0, 41), 1.2, 2.0 / 3.0, 7.334, 130.67):
        for phase in (0.0, 0.37):
            angles = np.floor(counts * np.arange(300) + phase) * quantum
            for count in (20, 100, 300):
                assert edge_sensor.vibration(sensed(angles[:count], quantum=quantum)[0]) == 0.0


def sways(deviations):
    """The mean of `update_velocity_walk` after each of the deviations."""
    sway, means = VelocityRandomWalk(), []
    for ahead in deviations:
        edge_bandwidth.update_velocity_walk(sway, ahead, math.inf, True)
        means.append(sway.mean)
    return np.array(means)


@pytest.mark.parametrize('counts', [0.004, 0.07, 0.25, 1.0 / 3.0, 0.4, 0.5, 0.63, 0.93, 1.02, 7.34])
def test_a_constant_speed_does_not_sway(counts):
    """However it beats with the sampling; the mean is that of edge_adaptive_theory.md."""
    moved = np.diff(np.floor(counts * np.arange(6001) + 0.123))
    means = sways(moved - counts)
    beside = abs(counts - round(counts))
    assert np.mean(means[600:]) == pytest.approx(-max(0.0, 3.0 * beside - 1.0), abs=0.01)
    assert np.max(means) < 1.0 / 6.0


def test_noise_does_not_sway_and_a_speed_that_goes_at_random_does():
    random = np.random.default_rng(5)
    noise = sways(np.diff(0.3 * random.normal(size=50_000)))
    assert np.mean(noise) == pytest.approx(-0.09, rel=0.05)
    assert np.max(noise) < 2.0 * 0.09
    kept = 0.95  # the speed forgets, lest it run away; a filter that lags sees the like
    speed = np.zeros(50_000)
    steps = 0.3 * random.normal(size=len(speed))
    for k in range(1, len(speed)):
        speed[k] = kept * speed[k - 1] + steps[k]
    assert np.mean(sways(speed)) == pytest.approx(0.09 * kept / (1.0 + kept), rel=0.1)
    assert sways([1.0, 1.0, 1.0, 1e6])[-1] < sways([1.0, 1.0, 1.0])[-1]  # lasting is no sway
    for last, mean in ((-1e9, -4.0 / 32.0), (1e9, 4.0 / 32.0)):
        sway = made(VelocityRandomWalk, last=last, before=1.0)
        edge_bandwidth.update_velocity_walk(sway, 1.0, 4.0, True)
        assert sway.mean == mean


def test_a_measurement_far_finer_than_the_prediction_leaves_a_covariance():
    """Known to 1e-10 of a deviation of 1e5: what rounding leaves must be one still."""
    for r in (1e-10, 1e-14, 1e-20):
        p = made(Covariance, 1e10, 1e13, 1e16, 1e16, 1e19, 1e22)
        edge_covariance.correct_covariance(p, r, 0.0)
        assert 0.0 < p.p00 <= r * (1.0 + 1e-12)
        assert p.p11 * p.p00 >= p.p01 * p.p01 * (1.0 - 1e-12)
        assert p.p22 * p.p00 >= p.p02 * p.p02 * (1.0 - 1e-12)


def begun_state(design, reading=7.0):
    state = edge_observer.State()
    edge_observer.start(edge_observer, state, design, reading)
    return state


@pytest.mark.parametrize('part, starts', [(0.68, False), (0.72, True)])
def test_a_shaft_of_which_less_than_a_cell_is_known_may_start(part, starts):
    def stirs(first=False, **sensor):
        state = begun_state(made(edge_observer.Design, quantum=Q))
        state.p.p00, state.p.p11, state.p.p22 = part * Q * Q / 12.0, 1.0, 1.0
        state.reading.rested, state.reading.first = 1.0, first
        for name, value in sensor.items():
            setattr(state.sensor, name, value)
        edge_observer.doubt_velocity_after_rest(state, 1e-3)
        return state.uncertainty.edges_to_settle == edge_start.FIRST_EDGE

    assert stirs() is starts
    assert stirs(first=True)  # the first of all
    assert not stirs(first=True, noise=1.01 * edge_constants.NOISY_ABOVE * Q * Q)
