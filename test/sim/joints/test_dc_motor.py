# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator dc_motor: physics, voltages, effort."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.parameters import build
from sim_pkg.joints.dc_motor import SIMULATOR, Motor, MotorParameters
from sim_pkg.joints.driven import advance

MOTION, TRUTH = 'joint_states', 'ground_truth/joint_states'


def run(duration, seed=1, **values):
    """(stamps [ns], angles, efforts, true angles, true velocities)."""
    decode = Decoder().decode
    rows = {MOTION: [], TRUTH: []}
    for chunk in SIMULATOR.generate(build(MotorParameters, values), duration, seed):
        for message in chunk:
            rows[message.topic].append(decode(message.encode(10**18)))
    assert [m.stamp_ns for m in rows[MOTION]] == [m.stamp_ns for m in rows[TRUTH]]
    return (
        np.array([m.stamp_ns for m in rows[MOTION]]),
        np.array([m.positions[0] for m in rows[MOTION]]),
        np.array([m.efforts[0] for m in rows[MOTION]]),
        np.array([m.positions[0] for m in rows[TRUTH]]),
        np.array([m.velocities[0] for m in rows[TRUTH]]),
    )


def test_the_motion_is_that_of_the_equation():
    stamps, angles, efforts, q, w = run(1.0, voltage='sines', load=0.3)
    a = np.array([[0.0, 1.0, 0.0], [-5.0, -2.0, 1.0], [0.0, 0.0, 0.0]])
    step, x = expm(1e-3 * a), np.zeros(3)
    for u in efforts[1:]:
        x[2] = 30.0 * u + 15.0
        x = step @ x
    assert q[-1] == pytest.approx(x[0], abs=1e-9)
    assert w[-1] == pytest.approx(x[1], abs=1e-9)


@pytest.mark.long
def test_the_effort_acted_since_the_sample_before():
    _, _, efforts, q, w = run(2.0, hold=0.05)
    changes = np.flatnonzero(np.diff(efforts))
    assert len(changes) > 20 and np.all((changes % 50) == 0)
    steps = np.diff(w) / 1e-3
    wanted = (0.6 * efforts[1:] - 0.04 * w[:-1] - 0.1 * q[:-1]) / 0.02
    assert np.abs(steps - wanted).max() < 0.01 * np.abs(wanted).max()
    assert np.std(run(200.0, rate=10.0)[2]) == pytest.approx(5.0, rel=0.1)


def test_coulomb_friction_stops_and_holds():
    motor = Motor(build(MotorParameters, {'coulomb': 0.2, 'stiffness': 0.0}), 1)
    q, w = advance(motor, 0.0, 3.0, 2.0, 0.0)
    assert w == 0.0
    # 3 rad/s against 0.2 N m and 0.04 N m s: rest after J/b log(1 + b w / F)
    stopped = 0.5 * math.log1p(0.04 * 3.0 / 0.2)
    assert q == pytest.approx(3.0 * 0.5 - 0.2 / 0.04 * stopped, abs=0.01)
    assert advance(motor, q, 0.0, 1e-3, 0.3)[1] == 0.0  # 0.18 N m do not move it
    assert advance(motor, q, 0.0, 1e-3, 0.5)[1] > 0.0
