# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The Kalman filter: against a textbook one, from the first samples, for hours, at any noise."""

import math
import shutil
import textwrap
from pathlib import Path

import numpy as np
import pytest
from engine_build import build
from hypothesis import given, settings
from hypothesis import strategies as st
from observer_cases import make, stamps, wrapped
from scipy.linalg import solve_discrete_are
from test_frequency_response import transition

import estimator_pkg
from estimator_pkg.engine.calls import Memory
from estimator_pkg.estimate import TRACKING
from estimator_pkg.observers.angle.kalman import Kalman
from estimator_pkg.observers.maths import covariance
from estimator_pkg.observers.maths.covariance import PRIOR_ACCELERATION, Covariance, steady_gains

DT = 1e-3
MODELS = {2: {'model': 'constant_velocity'}, 3: {}}
DENSITY = {2: 'acceleration_psd', 3: 'jerk_psd'}
orders = pytest.mark.parametrize('order', [2, 3])
ENTRIES = {2: ('p00', 'p01', 'p11'), 3: ('p00', 'p01', 'p02', 'p11', 'p12', 'p22')}
PRIOR = {2: 0.0, 3: PRIOR_ACCELERATION}


def upper(p, order):
    """The upper triangle of P or Q."""
    return [getattr(p, name) for name in ENTRIES[order]]


def of_line(order, dt):
    """P after two samples."""
    p = Covariance()
    covariance.set_line(p, dt, PRIOR[order])
    return p


def of_noise(order, density, dt):
    """Q."""
    q = Covariance()
    covariance.set_noise(q, order, density, dt)
    return q


def process_noise(order, dt):
    """The integral of F(s) G G' F(s)' over dt, by Gauss quadrature (exact for polynomials)."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    total = np.zeros((order, order))
    for node, weight in zip(nodes, weights):
        column = transition(order, 0.5 * dt * (node + 1.0))[:, -1]
        total += 0.5 * dt * weight * np.outer(column, column)
    return total


def textbook(at, measured, order, density, variance):
    """Velocities of a filter written with matrices, started without knowledge; no wrapping."""
    x = np.zeros(order)
    x[0] = measured[0]
    p = np.diag([variance, 1e12 * variance, 1e18 * variance][:order])
    velocities = [0.0]
    for i in range(1, len(at)):
        dt = (at[i] - at[i - 1]) * 1e-9
        f = transition(order, dt)
        x = f @ x
        p = f @ p @ f.T + density * process_noise(order, dt)
        gain = p[:, 0] / (p[0, 0] + variance)
        x = x + gain * (measured[i] - x[0])
        keep = np.eye(order) - np.outer(gain, np.eye(order)[0])
        p = keep @ p @ keep.T + variance * np.outer(gain, gain)
        velocities.append(x[1])
    return np.array(velocities)


@pytest.mark.long
@orders
def test_equals_a_textbook_filter_with_jittered_stamps(order):
    at = stamps(1500, DT, 3e-4)
    t = (at - at[0]) * 1e-9
    measured = 3.0 * np.sin(5.0 * t) + 9.0 * t + np.random.default_rng(1).normal(0.0, 1e-3, len(t))
    density = {2: 5.0, 3: 2e3}[order]
    joint = make(
        'kalman',
        {**MODELS[order], DENSITY[order]: density, 'noise': 1e-3, 'low_speed_bound': False},
    )
    out = joint.run(at, wrapped(measured))
    expected = textbook(at, measured, order, density, 1e-6)
    np.testing.assert_allclose(out.velocity[30:], expected[30:], atol=2e-3)  # the priors differ
    np.testing.assert_allclose(out.velocity[200:], expected[200:], atol=1e-6)


@pytest.mark.parametrize('speed', [-300.0, -10.0, 0.0, 10.0, 300.0])
@orders
def test_speed_is_right_from_the_second_sample_on(order, speed):
    """At 100 Hz, from any angle: 300 rad/s are 3 rad per sample."""
    for start in np.arange(72) * math.radians(5.0):
        joint = make('kalman', MODELS[order])
        for i in range(40):
            joint.update(10**9 + i * 10**7, wrapped(start + speed * i * 1e-2).item())
            if i > 0:
                assert joint.estimate()[1] == pytest.approx(speed, abs=1e-6)
        assert joint.estimate()[3] == TRACKING


@orders
def test_after_a_gap_the_kept_speed_tells_the_turn(order):
    """4 rad per sample: two samples alone would say -2.28."""
    joint = make('kalman', MODELS[order])
    for i in range(600):  # run up from rest
        joint.update(
            10**9 + i * 10**7, wrapped(0.5 * min(i, 400) ** 2 * 1e-2 + 4.0 * max(i - 400, 0)).item()
        )
    assert joint.estimate()[1] == pytest.approx(400.0, rel=1e-3)
    for i in range(640, 700):
        joint.update(10**9 + i * 10**7, wrapped(800.0 + 4.0 * (i - 400)).item())
        assert joint.estimate()[1] == pytest.approx(400.0, rel=1e-3)


MANY = """
    from estimator_pkg.observers.maths.covariance import Covariance, update

    def many(p: Covariance, q: Covariance, dt: float, prior: float, count: int) -> float:
        of_s = 0.0
        for _ in range(count):
            K1, K2, of_s = update(p, q, dt, 1.0, prior)
        return 1.0 - of_s
"""


@pytest.mark.long
@pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')
@orders
def test_an_hour_at_10_khz_ends_at_the_riccati_solution(order, tmp_path):
    (tmp_path / 'estimator_pkg').symlink_to(Path(estimator_pkg.__file__).parent)
    (tmp_path / 'updates.py').write_text(textwrap.dedent(MANY))
    _, library = build(tmp_path, ('updates', 'many', {}, 'many'))
    p, added, dt = Memory(Covariance), Memory(Covariance), 1e-4
    # per noise variance: slow, usual for an hour, nearly no filtering
    for density, count in ((1e3, 300_000), (1e9, 36_000_000), (1e15, 300_000)):
        of_line(order, dt).write(p.array[0])
        of_noise(order, density, dt).write(added.array[0])
        gain = library.many(p.pointer, added.pointer, dt, PRIOR[order], count)
        f = transition(order, 1.0)
        q = process_noise(order, 1.0) * density * dt ** (2 * order - 1)
        c = np.eye(order)[:1]
        prior = solve_discrete_are(f.T, c.T, q, np.eye(1))
        after = prior - np.outer(prior[0], prior[0]) / (prior[0, 0] + 1.0)
        rows, columns = np.triu_indices(order)
        scale = dt ** -(rows + columns).astype(float)
        found = upper(Covariance.read(p.array[0]), order)
        np.testing.assert_allclose(found, after[rows, columns] * scale, rtol=2e-4)
        assert gain == pytest.approx(after[0, 0], rel=2e-4)


@pytest.mark.long
@settings(max_examples=150, deadline=None)
@given(
    st.floats(-3.0, 25.0),
    st.lists(st.floats(-6.0, 1.0), min_size=30, max_size=120),
    st.sampled_from([2, 3]),
)
def test_covariance_stays_positive_whatever_the_sample_times(exponent, times, order):
    """Sample times from 1 us to 10 s in one run, process noise from none to all."""
    p = of_line(order, 10.0 ** times[0])
    for time in times[1:]:
        dt = 10.0**time
        *_, left = covariance.update(p, of_noise(order, 10.0**exponent, dt), dt, 1.0, PRIOR[order])
        assert all(math.isfinite(value) for value in upper(p, order))
        assert 0.0 < left <= 1.0 and p.p00 <= 1.0
        full = np.zeros((order, order))
        full[np.triu_indices(order)] = upper(p, order)
        full += np.triu(full, 1).T
        deviations = np.sqrt(np.diag(full))
        assert np.linalg.eigvalsh(full / np.outer(deviations, deviations))[0] > -1e-6


def test_a_burst_before_the_stream_does_no_harm():
    """Two samples 1 us apart, then 1 kHz: the first difference says nothing."""
    for order in (2, 3):
        joint = make('kalman', MODELS[order])
        random = np.random.default_rng(1)
        for i, time in enumerate([0.0, 1e-6, *(np.arange(1, 1500) * 1e-3)]):
            joint.update(
                10**9 + round(time * 1e9), wrapped(3.0 * time + random.normal(0.0, 1e-3)).item()
            )
            if i > 300:
                assert joint.estimate()[1] == pytest.approx(3.0, abs=0.5)
                assert joint.estimate()[3] == TRACKING


@orders
@pytest.mark.parametrize('rate', [1.0, 2.0, 30.0])
@pytest.mark.parametrize('noise', [None, 1e-9])
def test_readings_without_noise_leave_the_filter_stable(order, rate, noise):
    """A prediction a billion times vaguer than a reading: at 2 Hz it was 1e84 rad/s off."""
    t = np.arange(400) / rate
    t[1::2] += 0.3 / rate
    at = 10**9 + np.rint(t * 1e9).astype(np.int64)
    slow = 2.0 * np.pi * rate / 100.0
    for angle, velocity in ((0.01 * t, 0.01), (np.sin(slow * t), slow * np.cos(slow * t))):
        found = make('kalman', {**MODELS[order], 'noise': noise}, wrap_period=0.0).run(at, angle)
        error = np.abs(found.velocity - velocity)[20:]
        assert np.all(error < 0.05 * np.max(np.abs(velocity)))


@given(st.floats(-2.0, 8.0))
def test_steady_gains_of_constant_velocity_are_those_it_converges_to(exponent):
    density, dt = 10.0**exponent, 0.02
    p, q = of_line(2, dt), of_noise(2, density, dt)
    for _ in range(2_000):
        covariance.update(p, q, dt, 1.0, 0.0)
    assert steady_gains(density, dt) == pytest.approx((p.p00, p.p01 * dt), rel=1e-9)


def noise_gains_of(order, *gains):
    """Those of a filter with these gains at DT, after its second sample."""
    core, coefficients, design = Kalman.Core(), Kalman.Coefficients(), Kalman.Design()
    core.started, coefficients.dt, design.order = True, DT, order
    core.p.p00, core.p.p01, core.p.p02 = gains
    return Kalman.noise_gains(core, coefficients, design)


def test_noise_gains_of_unstable_gains_are_those_after_the_third_sample():
    """A first sample time that is far too long leaves such gains for some samples."""
    for alpha, beta, gamma in ((1.0, 2.2, 0.5), (0.6, 3.3, 0.5), (0.3, 0.1, 0.9)):
        gain = alpha, beta / DT, gamma / DT**2
        expected = (alpha, pytest.approx((2.0 - 6.0 * beta * (1.0 - beta)) / DT**2), 6.0)
        assert noise_gains_of(3, *gain) == expected
        if gamma == 0.5:
            assert noise_gains_of(2, *gain) == expected


# The noise that is not given


@orders
def test_noise_not_given_costs_little(order):
    t = np.arange(8000) * DT
    truth = 4.0 * np.cos(2.0 * math.pi * t) * 2.0 * math.pi
    for noise in (1e-4, 3e-3):
        measured = wrapped(
            4.0 * np.sin(2.0 * math.pi * t) + np.random.default_rng(5).normal(0.0, noise, len(t))
        )
        rms = []
        for given_noise in ({'noise': noise}, {}):
            out = make('kalman', {**MODELS[order], **given_noise}).run(stamps(8000), measured)
            rms.append(np.sqrt(np.mean((out.velocity - truth)[1000:] ** 2)))
        assert rms[1] < 1.1 * rms[0]
