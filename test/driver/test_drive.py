# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `pmsm` behind the guard: gaps, bad samples; plain equals the engine."""

import math
from unittest import mock

import numpy as np
import pytest
from motors import DT, MOTOR, angle_error, made, noisy, values

from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.engine.calls import functions_of
from estimator_pkg.estimate import INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm.observer import Gains, Pmsm
from estimator_pkg.observers.pmsm.state import State
from estimator_pkg.parameters import build as build_parameters
from estimator_pkg.parameters import declared

NO_ENGINE = functions_of(Pmsm) is None
needs_engine = pytest.mark.skipif(NO_ENGINE, reason='installed without a C compiler')
plainly = mock.patch('estimator_pkg.driver.joint.functions_of', lambda module: None)


def joint_of(gap_max=0.2, **gains):
    settings = JointSettings(gap_max=gap_max)
    return DriveJoint(Pmsm, build_parameters(Gains, {**MOTOR, **gains}), settings)


def test_lost_batches_are_coasted_over_and_counted():
    seen = noisy(((0.2, 3000.0, 3000.0),))
    joint = joint_of(gap_max=0.001)
    kept = [k for k in range(4000) if not 1400 <= k < 1600]  # 10 ms lost
    status, angles = {}, {}
    for k in kept:
        assert joint.update(10**9 + k * 50_000, tuple(seen.samples[k].tolist()))
        status[k] = joint.estimate()[3]
        angles[k] = joint.electrical()[0]
    assert not joint.update(10**9 + 3999 * 50_000, tuple(seen.samples[3999].tolist()))
    assert joint.dropped() == {'duplicate': 1} and joint.events() == {'gap': 1}
    assert status[1399] == TRACKING and status[1600] == INITIALISING
    assert all(status[k] == TRACKING for k in range(2000, 4000))
    tracked = [k for k in kept if status[k] == TRACKING]
    error = angle_error(np.array([angles[k] for k in tracked]), seen.truth[tracked, 1])
    assert np.abs(error).max() < 1.5


def test_coasting_over_a_known_gap_keeps_the_relative_position():
    seen = noisy(((0.2, 3000.0, 3000.0),))
    motor = made()
    motor.start(seen.samples[0])
    for k in range(1, 1400):
        motor.step(seen.samples[k])
    before = motor.estimate()[0] - seen.truth[1399, 1] / 7.0
    motor.resume(seen.samples[1600])
    Pmsm.coast(motor.state, 201 * DT)
    for k in range(1601, 2200):
        motor.step(seen.samples[k])
    after = motor.estimate()[0] - seen.truth[2199, 1] / 7.0
    assert after == pytest.approx(before, abs=0.01)


def disturbed():
    """(stamps, samples): start-up, stop, start backwards; a gap, a duplicate, a bad sample."""
    samples = noisy(
        ((0.03, 3000.0, 3000.0), (0.03, 3000.0, 0.0), (0.02, 0.0, 0.0), (0.04, 0.0, -3000.0))
    ).samples.copy()
    samples[300, 1] = math.nan
    stamps = 10**9 + np.arange(len(samples)) * 50_000
    stamps[1000:] += 5_000_000
    stamps[1200] = stamps[1199]
    return stamps, samples


FORMS = [
    {},
    {'form': 'paper', 'periods': 3, 'scaling': 'power', 'voltage_delay': 1.5, 'initial_flux': 0.0},
    {'variant': 'continuous', 'speed_filter_hz': 0.0, 'dead_time_voltage': 0.1},
    {'variant': 'hybrid', 'periods': 16, 'voltage_delay': 8.0},
]


@needs_engine
@pytest.mark.parametrize('gains', FORMS)
def test_plain_equals_the_engine_through_the_guard(gains):
    stamps, samples = disturbed()
    with plainly:
        plain = joint_of(0.001, **gains)
    twin, said = joint_of(0.001, **gains), set()
    assert plain.compiled is None and twin.compiled is not None
    for at in range(0, len(stamps), 700):
        part = slice(at, at + 700)
        found, other = (each.take(stamps[part], samples[part]) for each in (plain, twin))
        for name in found._fields:
            assert np.array_equal(getattr(found, name), getattr(other, name), equal_nan=True), name
        for joint in (plain, twin):
            joint.set_gains(
                build_parameters(
                    Gains, {**MOTOR, **gains, 'relative_bandwidth': 0.1286 + 1e-6 * at}
                )
            )
        for name in ('estimate', 'electrical', 'stddev', 'electrical_stddev', 'samples', 'why'):
            one, two = (repr(getattr(joint, name)()) for joint in (plain, twin))
            assert one == two, name
        said |= set(found.status.tolist())
    assert said >= {TRACKING, NOT_OBSERVABLE, INITIALISING}
    verdicts = plain.samples()['dropped']
    assert verdicts == {'duplicate': 1, 'non_finite': 1} and plain.events() == {'gap': 1}
    assert values_of(plain.state) == values_of(twin.state)


def values_of(record):
    return [
        values_of(value) if hasattr(type(value), 'fields') else value for value in values(record)
    ]


def test_a_start_sets_every_number():
    motor = made()
    motor.start((1.0, 2.0, 3.0, 4.0))
    poisoned = np.frombuffer(b'\xff' * State.dtype.itemsize, State.dtype)
    other = State.read(poisoned[0])
    Pmsm.start(Pmsm, other, motor.design, motor.sample)
    assert values_of(other) == values_of(motor.state)


def test_every_live_parameter_is_in_the_design():
    """A live change keeps the state, so that it must have the same form."""
    live = {name for name, each in declared(Gains).items() if not each.structural}
    other = {
        'relative_bandwidth': 0.2,
        'epsilon': 1e-4,
        'speed_max': 700.0,
        'k_eta': 90.0,
        'clock_rate': 150.0,
        'dead_time_voltage': 0.2,
        'initial_flux': 2e-3,
        'emf_min': 0.2,
        'current_noise': 0.2,
        'speed_filter_hz': 50.0,
    }
    assert set(other) == live
    assert all(repr(made(**{key: other[key]}).design) != repr(made().design) for key in other)


# Numbers at the ends of what is admitted

GARBAGE = {'resistance': 3.0, 'inductance': 0.95, 'flux': 3.6e-5, 'pole_pairs': 18}  # not the motor


@pytest.mark.parametrize(
    'gains',
    [
        {'relative_bandwidth': 1.0},
        {'form': 'paper'},
        {'form': 'paper', 'variant': 'continuous'},
        {'epsilon': 1e-6},
        {'epsilon': 9e-4, 'form': 'paper'},
    ],
)
@pytest.mark.parametrize('motor', [MOTOR, GARBAGE], ids=['motor', 'another motor'])
@pytest.mark.parametrize('scale', [1.0, 1e4])
def test_no_gains_and_no_motor_data_make_numbers_run_away(gains, motor, scale):
    """Sample times from 1 us to 30 ms, currents of another motor: no exception, no nan."""
    samples = noisy(((0.2, 3000.0, 3000.0),)).samples[:600] * scale
    joint = joint_of(**{**motor, **gains})
    stamp, random = 10**9, np.random.default_rng(1)
    times = np.where(np.arange(600) % 20 == 0, 10.0 ** random.uniform(3.0, 7.5, 600), 50_000.0)
    for sample, time in zip(samples.tolist(), times.tolist()):
        stamp += round(time)
        assert joint.update(stamp, tuple(sample))
        *_, status = joint.estimate()
        numbers = [*joint.stddev(), *joint.electrical_stddev()]
        if status != NOT_OBSERVABLE:
            numbers += [*joint.estimate()[:2], *joint.electrical()]
        assert not any(map(math.isnan, numbers)), (numbers, status)


def test_paper_form_starts_again_when_its_numbers_ran_away():
    joint = joint_of(form='paper')
    samples = noisy(((0.2, 3000.0, 3000.0),)).samples
    for k in range(100):
        joint.update(10**9 + k * 50_000, tuple(samples[k].tolist()))
    with joint._changing() as channel:
        channel.track.state.core.x = 1e200
    for k in range(100, 4000):
        joint.update(10**9 + k * 50_000, tuple(samples[k].tolist()))
    assert joint.estimate()[3] == TRACKING
    assert joint.estimate()[1] == pytest.approx(100.0 * math.pi, rel=0.02)
