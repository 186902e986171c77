# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Measured frequency response of each observer, against its closed form in discrete time.

The closed forms are derived here once more, from the continuous design and textbook algebra alone:
poles from zeros of polynomials, gains by pole placement or from the Riccati equation. Nothing of
the observers' own arithmetic is used.
"""

import cmath
import math

import numpy as np
import pytest
from observer_cases import angle_observers
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

from estimator_pkg import observers
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.parameters import build

DT = 1e-3
BANDWIDTHS = (5.0, 20.0, 60.0)  # Hz
FRACTIONS = (0.002, 0.01, 0.03, 0.07, 0.15, 0.25, 0.4)  # of the Nyquist frequency
AMPLITUDE = 1e-3  # rad: linear at small signal
GAIN, PHASE = 0.01, math.radians(0.5)  # asked: 5 % and 3 degrees
NOT_LINEAR = {'edge_adaptive', 'super_twisting'}  # have no frequency response


def transition(order, dt):
    return np.array(
        [
            [dt ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(order)]
            for i in range(order)
        ]
    )


def from_gain(gain, dt):
    """y -> velocity, as a function of z, of x = F x + K (y - C F x)."""
    order = len(gain)
    keep = np.eye(order) - np.outer(gain, np.eye(order)[0])
    matrix = keep @ transition(order, dt)
    return lambda z: np.linalg.solve(z * np.eye(order) - matrix, z * np.asarray(gain, complex))[1]


def placed(poles, dt):
    """The gain that gives the error (1 - K C) F these poles in z (Ackermann's formula)."""
    order = len(poles)
    f = transition(order, dt)
    c = np.eye(order)[0]
    seen = np.array([c @ np.linalg.matrix_power(f, i) for i in range(order)])
    wanted = sum(
        a * np.linalg.matrix_power(f, order - i) for i, a in enumerate(np.real(np.poly(poles)))
    )
    return np.linalg.solve(f, wanted @ np.linalg.solve(seen, np.eye(order)[-1]))


def kalman_gain(order, density, variance, dt):
    """The steady gain, by Van Loan's integral and the Riccati equation (scaled by dt)."""
    a = np.diag(np.ones(order - 1), 1)
    block = np.zeros((2 * order, 2 * order))
    block[:order, :order] = -a
    block[order - 1, 2 * order - 1] = 1.0
    block[order:, order:] = a.T
    whole = expm(block)  # of dt = 1
    f = whole[order:, order:].T
    q = f @ whole[:order, order:] * density * dt ** (2 * order - 1) / variance
    c = np.eye(order)[:1]
    p = solve_discrete_are(f.T, c.T, q, np.eye(1))
    gain = p[:, 0] / (p[0, 0] + 1.0)
    return gain / dt ** np.arange(order)


def design_frequency(numerator, denominator, bandwidth_hz):
    """Factor on s that puts the -3 dB frequency of numerator/denominator at `bandwidth_hz`."""

    def excess(w):
        return abs(np.polyval(numerator, 1j * w) / np.polyval(denominator, 1j * w)) - math.sqrt(0.5)

    return 2.0 * math.pi * bandwidth_hz / brentq(excess, 1e-3, 1e3)


def scaled(denominator, factor):
    """The zeros of a polynomial whose variable is s/factor."""
    return np.roots(denominator) * factor


def finite_difference(bandwidth_hz, dt):
    kept = math.exp(-design_frequency([1.0], [1.0, 1.0], bandwidth_hz) * dt)
    return lambda z: (1.0 - kept) / dt * (1.0 - 1.0 / z) / (1.0 - kept / z)


def matched(numerator, denominator):
    def of(bandwidth_hz, dt):
        poles = scaled(denominator, design_frequency(numerator, denominator, bandwidth_hz))
        return from_gain(placed(np.exp(poles * dt), dt), dt)

    return of


def paper(bandwidth_hz, dt):
    rate = design_frequency([5.0], [1.0, 6.0, 5.0], bandwidth_hz)  # 1/epsilon
    return from_gain([6.0 * rate * dt, 5.0 * rate**2 * dt], dt)


def kalman_of_bandwidth(order):
    numerator, denominator = (
        ([1.0], [1.0, math.sqrt(2.0), 1.0]) if order == 2 else ([2.0, 1.0], [1.0, 2.0, 2.0, 1.0])
    )

    def of(bandwidth_hz, dt):
        radius = design_frequency(numerator, denominator, bandwidth_hz)
        return from_gain(kalman_gain(order, radius ** (2 * order) * dt, 1.0, dt), dt)

    return of


def kalman_of_density(order, density, noise, quantum):
    def of(bandwidth_hz, dt):
        return from_gain(kalman_gain(order, density, noise**2 + quantum**2 / 12.0, dt), dt)

    return of


CV = {'model': 'constant_velocity'}
TRIPLE = ([3.0, 1.0], [1.0, 3.0, 3.0, 1.0])
# observer -> (gains, closed form (bandwidth_hz, dt) -> (z -> V/Y), does it follow bandwidth_hz?)
CASES = {
    'finite_difference': [({}, finite_difference)],
    'pll': [
        ({}, matched([1.0], [1.0, 2.0, 1.0])),
        ({'damping': 0.5}, matched([1.0], [1.0, 1.0, 1.0])),
        ({'damping': 3.0}, matched([1.0], [1.0, 6.0, 1.0])),
    ],
    'kalman': [
        ({}, kalman_of_bandwidth(3)),
        (CV, kalman_of_bandwidth(2)),
        (
            {'bandwidth_hz': None, 'noise': 2e-4, 'quantum': 1e-3},
            kalman_of_density(3, 1e3, 2e-4, 1e-3),
        ),
        (
            {**CV, 'bandwidth_hz': None, 'noise': 2e-4, 'acceleration_psd': 0.5},
            kalman_of_density(2, 0.5, 2e-4, 0.0),
        ),
    ],
    'hybrid_angle': [
        ({}, matched(*TRIPLE)),
        ({'order': 2}, matched([5.0], [1.0, 6.0, 5.0])),
        ({'order': 2, 'k1': 1.0, 'k2': 1.0}, matched([1.0], [1.0, 1.0, 1.0])),
        ({'k1': 4.0, 'k2': 6.0, 'k3': 4.0}, matched([6.0, 4.0], [1.0, 4.0, 6.0, 4.0])),
        ({'form': 'paper'}, paper),
        ({'injection': 'sin'}, matched(*TRIPLE)),
        ({'injection': 'tan', 'order': 2}, matched([5.0], [1.0, 6.0, 5.0])),
        ({'injection': 'sat'}, matched(*TRIPLE)),
    ],
}


def bandwidths(gains):
    if gains.get('bandwidth_hz', 0) is None:
        return (None,)
    if gains.get('form') == 'paper':
        return tuple(min(bandwidth, 40.0) for bandwidth in BANDWIDTHS)  # unstable above 45 Hz
    return BANDWIDTHS


ROWS = [
    (name, gains, form, bandwidth)
    for name, cases in CASES.items()
    for gains, form in cases
    for bandwidth in bandwidths(gains)
]


def joint_of(name, gains, bandwidth):
    observer = observers.find(name)
    values = dict(gains)
    if bandwidth is not None:
        values['bandwidth_hz'] = bandwidth
    return Joint(observer, build(observer.gains, values), JointSettings())


def measured(joint, frequency_hz, settle, dt):
    """True velocity -> estimated velocity at this frequency, a complex number."""
    w = 2.0 * math.pi * frequency_hz
    # whole samples, at least two periods and enough of them to fit
    used = max(400, math.ceil(2.0 / (frequency_hz * dt)))
    count = math.ceil(settle / dt) + used
    t = np.arange(count) * dt
    joint.reset()
    out = joint.run(10**9 + np.rint(t * 1e9).astype(np.int64), AMPLITUDE * np.sin(w * t))
    t, velocity = t[-used:], out.velocity[-used:]
    basis = np.column_stack((np.exp(1j * w * t).real, np.exp(1j * w * t).imag, np.ones(used)))
    (cosine, sine, _), *_ = np.linalg.lstsq(basis, velocity, rcond=None)
    return complex(cosine, -sine) / (AMPLITUDE * w)  # the true velocity is A w cos(w t)


def test_every_linear_observer_has_its_closed_form_here():
    assert set(angle_observers()) - NOT_LINEAR == set(CASES)


@pytest.mark.long
@pytest.mark.parametrize('name, gains, form, bandwidth', ROWS)
def test_response_is_the_closed_form(name, gains, form, bandwidth):
    closed = form(bandwidth, DT)
    joint = joint_of(name, gains, bandwidth)
    settle = 20.0 / (2.0 * math.pi * (bandwidth or 20.0))
    for fraction in FRACTIONS:
        frequency = fraction * 0.5 / DT * 1.0013  # readings never repeat
        w = 2.0 * math.pi * frequency
        expected = closed(cmath.exp(1j * w * DT)) / (1j * w)
        got = measured(joint, frequency, settle, DT)
        assert abs(abs(got / expected) - 1.0) < GAIN, (fraction, got, expected)
        assert abs(cmath.phase(got / expected)) < PHASE, (fraction, got, expected)


@pytest.mark.parametrize('name, gains, form, bandwidth', ROWS)
def test_group_delay_is_the_slope_of_the_phase(name, gains, form, bandwidth):
    joint = joint_of(name, gains, bandwidth)
    closed = form(bandwidth, DT)
    w = 2.0 * math.pi * 1e-2 * (bandwidth or 20.0)
    lag = -cmath.phase(closed(cmath.exp(1j * w * DT)) / (1j * w)) / w
    one_hundredth = 1e-2 / (2.0 * math.pi * (bandwidth or 20.0))
    assert abs(joint.group_delay(DT) - lag) < one_hundredth
