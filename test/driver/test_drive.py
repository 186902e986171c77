# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `pmsm` behind the guard: gaps, bad samples; plain equals compiled."""

import math

import numpy as np
import pytest
from motors import DT, MOTOR, angle_error, made, noisy

from estimator_pkg.driver import drive, guard
from estimator_pkg.driver.compiled import available, compiled
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.driver.track import make_track
from estimator_pkg.observers.contract import INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm.gains import Gains
from estimator_pkg.observers.pmsm.observer import OBSERVER
from estimator_pkg.parameters import build as build_parameters
from estimator_pkg.parameters import declared


def test_lost_batches_are_coasted_over_and_counted():
    seen = noisy(((0.2, 3000.0, 3000.0),))
    joint = Joint(OBSERVER, build_parameters(Gains, MOTOR), JointSettings(gap_max=0.001))
    kept = [k for k in range(4000) if not 1400 <= k < 1600]  # 10 ms lost
    status, angles = {}, {}
    for k in kept:
        assert joint.update(10**9 + k * 50_000, tuple(seen.samples[k].tolist()))
        status[k] = joint.estimate()[3]
        angles[k] = joint.functions.electrical(joint._track[6], joint._track[5], joint._design)[0]
    assert not joint.update(10**9 + 3999 * 50_000, tuple(seen.samples[3999].tolist()))
    assert joint.dropped() == {'duplicate': 1} and joint.events() == {'gap': 1}
    assert status[1399] == TRACKING and status[1600] == INITIALISING
    assert all(status[k] == TRACKING for k in range(2000, 4000))
    tracked = [k for k in kept if status[k] == TRACKING]
    error = angle_error(np.array([angles[k] for k in tracked]), seen.truth[tracked, 1])
    assert np.abs(error).max() < 1.5


def test_coasting_over_a_known_gap_keeps_the_relative_position():
    seen = noisy(((0.2, 3000.0, 3000.0),))
    functions = made()
    design = functions.design()
    coefficients = functions.prepare(design, DT)
    state = functions.init(tuple(seen.samples[0]), design)
    for k in range(1, 1400):
        state = functions.step(state, coefficients, design, tuple(seen.samples[k].tolist()), 0.0)
    before = functions.output(state, coefficients, design, (), 0.0)[0] - seen.truth[1399, 1] / 7.0
    state = functions.coast(
        state, coefficients, design, tuple(seen.samples[1600].tolist()), 201 * DT
    )
    for k in range(1601, 2200):
        state = functions.step(state, coefficients, design, tuple(seen.samples[k].tolist()), 0.0)
    after = functions.output(state, coefficients, design, (), 0.0)[0] - seen.truth[2199, 1] / 7.0
    assert after == pytest.approx(before, abs=0.01)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf, 1e9])
@pytest.mark.parametrize('place', range(4))
def test_a_sample_that_is_no_number_is_dropped(bad, place):
    sample = [1.0, 2.0, 3.0, 4.0]
    sample[place] = bad
    assert not made().finite(tuple(sample))
    assert made().finite((1.0, 2.0, 3.0, 4.0))


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


@pytest.mark.long
@pytest.mark.skipif(not available(), reason='Numba is not installed')
def test_plain_equals_compiled_through_the_guard():
    stamps, samples = disturbed()
    functions = made()
    batch = drive.make_drive_batch(functions)
    track = make_track(functions).blank(functions.design())
    limits = guard.limits(guard.GuardSettings(gap_max=0.001), math.inf)
    given = (batch, track, functions.design(), limits, stamps, samples)
    _, plain = drive.run(*given, fast=False)
    _, twin = drive.run(*given, fast=True)
    assert np.array_equal(plain.status, twin.status)
    assert np.array_equal(plain.reasons, twin.reasons)
    assert np.array_equal(plain.verdict, twin.verdict)
    assert np.array_equal(plain.rows, twin.rows, equal_nan=True)
    assert (plain.verdict == guard.NON_FINITE).sum() == 1
    assert (plain.verdict == guard.DUPLICATE).sum() == 1
    assert np.all(np.isnan(plain.rows[300]))
    assert {TRACKING, NOT_OBSERVABLE, INITIALISING} <= set(plain.status.tolist())


def flat(value):
    return (
        [number for item in value for number in flat(item)] if isinstance(value, tuple) else [value]
    )


def kinds(value):
    return tuple(kinds(item) for item in value) if isinstance(value, tuple) else type(value)


@pytest.mark.slow  # compiles
@pytest.mark.skipif(not available(), reason='Numba is not installed')
def test_plain_equals_compiled_per_step_in_another_structure():
    functions = made(form='paper', periods=3, scaling='power', voltage_delay=1.5, initial_flux=0.0)
    twin = compiled(functions.step)
    _, samples = disturbed()
    design = functions.design()
    coefficients = functions.prepare(design, DT)
    state = functions.init(tuple(samples[0].tolist()), design)
    for k, row in enumerate(samples[1:].tolist()):
        if not functions.finite(tuple(row)):
            continue
        after = functions.step(state, coefficients, design, tuple(row), 0.0)
        if k % 7 == 0:
            other = twin(state, coefficients, design, tuple(row), 0.0)
            assert kinds(after) == kinds(other) == kinds(state)
            assert flat(after) == flat(other)
        state = after


@pytest.mark.skipif(not available(), reason='Numba is not installed')
def test_no_live_parameter_needs_compiling():
    """A live change of seconds would lose batches: all that is live is data, not code."""
    other = {
        'relative_bandwidth': 0.2,
        'epsilon': 1e-4,
        'speed_max': 700.0,
        'k_p': 2e4,
        'k_i': 9e3,
        'k_eta': 90.0,
        'gamma': 4000.0,
        'clock_rate': 150.0,
        'second_period': 0.7,
        'dead_time_voltage': 0.2,
        'pwm_frequency': 2e4,
        'initial_flux': 2e-3,
        'flux_min': 1e-3,
        'flux_max': 4e-3,
        'emf_min': 0.2,
        'resistance_error': 0.1,
        'current_noise': 0.2,
        'speed_filter_hz': 50.0,
        'hold': 0.02,
    }
    live = {name for name, each in declared(Gains).items() if not each.structural}
    assert set(other) == live
    first = compiled(drive.make_drive_batch(made()))
    for name, value in other.items():
        assert compiled(drive.make_drive_batch(made(**{name: value}))) is first, name
    assert compiled(drive.make_drive_batch(made(form='paper'))) is not first
    types = {
        kinds(
            (
                made(**{name: value}).design(),
                made(**{name: value}).prepare(made(**{name: value}).design(), DT),
            )
        )
        for name, value in [('hold', 0.01), *other.items()]
    }
    assert len(types) == 1


# Numbers at the ends of what is admitted

GARBAGE = {'resistance': 3.0, 'inductance': 0.95, 'flux': 3.6e-5, 'pole_pairs': 18}  # not the motor


@pytest.mark.parametrize(
    'gains',
    [
        {'gamma': 0.0},
        {'form': 'paper'},
        {'form': 'paper', 'variant': 'continuous'},
        {'k_p': 1e9},
        {'k_i': 1e-6, 'form': 'paper'},
        {'k_i': 1e12},
    ],
)
@pytest.mark.parametrize('motor', [MOTOR, GARBAGE], ids=['motor', 'another motor'])
@pytest.mark.parametrize('scale', [1.0, 1e4])
def test_no_gains_and_no_motor_data_make_numbers_run_away(gains, motor, scale):
    """Sample times from 1 us to 30 ms, currents of another motor: no exception, no nan."""
    samples = noisy(((0.2, 3000.0, 3000.0),)).samples[:600] * scale
    joint = Joint(OBSERVER, build_parameters(Gains, {**motor, **gains}), JointSettings())
    stamp, random = 10**9, np.random.default_rng(1)
    times = np.where(np.arange(600) % 20 == 0, 10.0 ** random.uniform(3.0, 7.5, 600), 50_000.0)
    for sample, time in zip(samples.tolist(), times.tolist()):
        stamp += round(time)
        assert joint.update(stamp, tuple(sample))
        functions, inner = joint.functions, joint._track[6]
        *_, status = joint.estimate()
        numbers = [
            *joint.stddev(),
            *functions.electrical_stddev(inner, joint._track[5], joint._design),
        ]
        if status != NOT_OBSERVABLE:
            numbers += [
                *joint.estimate()[:2],
                *functions.electrical(inner, joint._track[5], joint._design),
            ]
        assert not any(map(math.isnan, numbers)), (numbers, status)


def test_paper_form_starts_again_when_its_numbers_ran_away():
    joint = Joint(OBSERVER, build_parameters(Gains, {**MOTOR, 'form': 'paper'}), JointSettings())
    samples = noisy(((0.2, 3000.0, 3000.0),)).samples
    for k in range(100):
        joint.update(10**9 + k * 50_000, tuple(samples[k].tolist()))
    core = joint._track[6][0]
    broken = ((*core[:3], 1e200, *core[4:]), *joint._track[6][1:])
    joint._track = (*joint._track[:6], broken, *joint._track[7:])
    for k in range(100, 4000):
        joint.update(10**9 + k * 50_000, tuple(samples[k].tolist()))
    assert joint.estimate()[3] == TRACKING
    assert joint.estimate()[1] == pytest.approx(100.0 * math.pi, rel=0.02)
