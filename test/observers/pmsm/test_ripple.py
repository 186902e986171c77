# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Errors of the current sensors: the standard deviation of `pmsm` includes the ripple."""

import numpy as np
import pytest
from motors import made, record

from estimator_pkg.estimate import TRACKING

STEADY, RAMP = (0.2, 3000.0, 3000.0), (0.1, 3000.0, 5000.0)


def offset(currents):
    """5 % of 18 A on phase a, in alpha."""
    currents[:, 0] += 2.0 / 3.0 * 0.9


def unequal(currents):
    """Phase a 20 % too large: alpha is 2/3 of it less a third of the others."""
    currents[:, 0] *= 1.0 + 2.0 / 3.0 * 0.2


def exact(currents):
    """The right currents."""


def judged(fault, segments):
    """(ripple, reported deviation) of electrical speed and (the same) of angle, while it tracks."""
    seen = record(segments, current_noise=0.01, load_constant=0.03)
    samples = seen.samples.copy()
    fault(samples[:, :2])
    motor = made()
    motor.start(samples[0])
    rows = []
    for k, sample in enumerate(samples[1:].tolist(), 1):
        motor.step(sample)
        angle, speed, _, _, status, _ = motor.electrical()
        if k > 2400 and k % 7 == 0:
            assert status == TRACKING
            of_angle, of_speed, _ = motor.electrical_stddev()
            true_speed, true_angle = 7.0 * seen.truth[k, 0], seen.truth[k, 1]
            off = np.angle(np.exp(1j * (angle - true_angle)))
            rows.append((speed - true_speed, of_speed, off, of_angle))
    errors, reported = np.std(rows, axis=0), np.sqrt(np.mean(np.square(rows), axis=0))
    return errors[0], reported[1], errors[2], reported[3]


@pytest.mark.parametrize('fault', [offset, unequal])
def test_stddev_includes_the_ripple_of_a_current_sensor(fault):
    error, reported, angle_error, of_angle = judged(fault, (STEADY,))
    assert error > 4.0
    assert 0.6 < reported / error < 1.4
    assert 0.6 < of_angle / angle_error < 1.4


def test_without_errors_of_the_sensors_the_ripple_adds_nothing(monkeypatch):
    reported = judged(exact, (STEADY, RAMP))[1]
    monkeypatch.setattr('estimator_pkg.observers.pmsm.observer.ripple_variances', lambda *_: (0, 0))
    assert reported < 1.05 * judged(exact, (STEADY, RAMP))[1]
