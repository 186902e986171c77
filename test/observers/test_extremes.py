# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers of an angle at the ends of what is admitted: gains, circles, sample times, speeds."""

import math

import numpy as np
import pytest
from observer_cases import UNTUNED, angle_observers, drawn_gains, make

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import MISCONFIGURED
from estimator_pkg.observers.angle.hybrid import robust
from estimator_pkg.observers.angle.hybrid.design import Coefficients
from estimator_pkg.observers.angle.hybrid.observer import Gains, HybridAngle
from estimator_pkg.parameters import build

NAMES = [name for name in angle_observers() if name not in UNTUNED]
DRAWS, SAMPLES = 150, 40


def drawn_stream(random):
    """(stamps [ns], readings, period): even, jittered, or from 1 us to 1 s in one stream."""
    dt = 10.0 ** random.uniform(-4.3, -1.0)
    times = {
        0: np.full(SAMPLES, dt),
        1: dt * random.uniform(0.7, 1.3, SAMPLES),
        2: 10.0 ** random.uniform(-6.0, 0.0, SAMPLES),
    }[int(random.integers(3))]
    at = 10**18 + np.cumsum(np.rint(times * 1e9)).astype(np.int64)
    t = (at - at[0]) * 1e-9
    period = float(random.choice([0.0, 1e-3, 2.0 * math.pi, 360.0, 1e6]))
    y = random.choice([0.0, 1e-6, 1.0, 300.0, 1e4]) * t + random.normal(
        0.0, random.choice([1e-12, 1e-3, 0.1]), SAMPLES
    )
    return at, y % period if period > 0.0 else y, period


@pytest.mark.parametrize('name', NAMES)
def test_no_admitted_gains_break_an_observer_on_any_stream(name):
    """Refused in words, or finite to the last number: no exception, no nan."""
    random, ran = np.random.default_rng(20), 0
    observer = observers.find(name)
    for _ in range(DRAWS):
        at, readings, period = drawn_stream(random)
        gains = drawn_gains(observer.gains, random)
        try:
            built = build(observer.gains, gains)
            joint = Joint(observer, built, JointSettings(wrap_period=period))
        except UsageError:
            continue
        ran += 1
        for stamp, reading in zip(at.tolist(), readings.tolist()):
            joint.update(stamp, reading)
            position, velocity, acceleration, status = joint.estimate()
            if status != MISCONFIGURED:
                numbers = [position, velocity, *joint.stddev()]
                if observer.gives_acceleration(built):
                    numbers.append(acceleration)
                assert all(map(math.isfinite, numbers)), (gains, numbers)
        joint.group_delay(joint.mean_dt)
    assert ran > DRAWS // 8


@pytest.mark.long
@pytest.mark.parametrize('model', ['constant_velocity', 'constant_acceleration'])
@pytest.mark.parametrize('bandwidth_hz', [60.0, pytest.param(300.0, marks=pytest.mark.slow), 1e5])
def test_kalman_beyond_nyquist_has_its_deviation_from_the_first_samples_on(model, bandwidth_hz):
    """Against noise alone, 2000 starts. The gains of the third sample, if they stayed, would make
    the observer unstable.
    """
    joint = make(
        'kalman',
        {'model': model, 'bandwidth_hz': bandwidth_hz, 'noise': 1e-3, 'low_speed_bound': False},
    )
    random, errors, said = np.random.default_rng(2), [], []
    for _ in range(2000):
        joint.reset()
        velocities = []
        for i, noise in enumerate(random.normal(0.0, 1e-3, 8).tolist()):
            joint.update(10**9 + i * 10**7, noise)
            velocities.append(joint.estimate()[1])
            if len(said) < 8:
                said.append(joint.stddev()[1])
        errors.append(velocities)
    found = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(found[1:] < 1.1 * np.array(said[1:]))
    assert np.all(said[4:] > 0.9 * found[4:])
    np.testing.assert_allclose(said[5:], found[5:], rtol=0.12)  # before, a start may add to it
    assert math.isfinite(joint.group_delay(0.01))


@pytest.mark.parametrize(
    'order, k',
    [
        (2, (6.0, 5.0)),
        (2, (1.0, 5.0)),
        (3, (4.0, 5.0, 2.0)),
        (3, (2.0, 5.0, 2.0)),
        (3, (3.0, 3.0, 1.0)),
    ],
)
def test_a_slow_hybrid_loop_at_a_high_rate_has_the_gains_of_its_design(order, k):
    """One hour's time constant at 20 kHz: T l1, T^2 l2, T^3 l3 to eight digits."""
    epsilon, dt = 3600.0, 5e-5
    gains = dict(zip(('k1', 'k2', 'k3'), k))
    found = sampled(hybrid_design(order=order, epsilon=epsilon, **gains), dt)
    assert found.alpha / dt == pytest.approx(k[0] / epsilon, rel=1e-7)
    for power, rate in enumerate((found.beta, found.gamma)[: order - 1], 2):
        assert rate == pytest.approx(dt * k[power - 1] / epsilon**power, rel=1e-6)


def hybrid_design(**gains):
    return HybridAngle.design(build(Gains, gains), Circle())


def sampled(design, dt):
    coefficients = Coefficients()
    robust.prepare(coefficients, design, dt)
    return coefficients


def test_general_poles_and_the_triple_one_agree():
    design, general = hybrid_design(bandwidth_hz=20.0), hybrid_design(bandwidth_hz=20.0)
    general.triple = False
    for dt in (1e-5, 1e-3, 0.02, 1.0):
        one, other = sampled(design, dt), sampled(general, dt)
        for name in Coefficients.fields:
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9), name


@pytest.mark.parametrize(
    'gains',
    [
        {'order': 2, 'k1': 1e-6},
        {'order': 2, 'k1': 1e6, 'k2': 0.1},
        {'k1': 1.0001, 'k2': 1.0},
        {'form': 'paper', 'k1': 1e-3},
    ],
)
def test_hybrid_gains_that_never_settle_are_refused(gains):
    with pytest.raises(UsageError, match=r'k1 = .*hardly damped'):
        make('hybrid_angle', gains)


def test_paper_form_beyond_its_limit_has_a_finite_deviation():
    """One sample time so long that Algorithm 1 would be unstable at it, and no noise at all."""
    joint = make('hybrid_angle', {'form': 'paper', 'bandwidth_hz': 20.0})
    for i in range(100):
        joint.update(10**9 + i * 10**6, 0.0)
    assert joint.update(10**9 + 102 * 10**6, 0.0)  # 3 ms, 2.3 ms are the limit
    assert joint.events() == {'gap': 1}
    assert all(0.0 < sigma < math.inf for sigma in joint.stddev())
