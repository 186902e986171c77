# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `pmsm`: tuning, convergence, honesty, rates, noise and delay."""

import dataclasses
import math

import numpy as np
import pytest
from drive_status import run_log, track
from motors import (
    DT,
    MOTOR,
    RATE,
    RESTING,
    RPM,
    STEADY,
    angle_error,
    estimates,
    made,
    noisy,
    record,
)

from estimator_pkg.circle import Circle
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import MISCONFIGURED, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.observers.pmsm.observer import Gains, Pmsm
from estimator_pkg.observers.pmsm.state import Coefficients, Design, Watch
from estimator_pkg.observers.pmsm.watch import (
    ALIASING,
    CURRENTS_STUCK,
    FLUX_RANGE,
    INCONSISTENT,
    LOW_EMF,
    MISALIGNED,
    NO_VOLTAGE,
    SEARCHING,
    begin_watch,
    describe,
    look,
)
from estimator_pkg.parameters import build as build_parameters
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.profiles import P1, Profile
from sim_pkg.reproduce.pmsm.motor import core_of, signals

# ---- tuning ----------------------------------------------------------------------------------


def test_default_gains_are_those_of_the_paper():
    found = made().design
    assert found.k_p == pytest.approx(2.18e4, rel=5e-3)
    assert found.k_i == pytest.approx(9.34e3, rel=1e-3)
    assert found.k_eta == pytest.approx(95.7, rel=1e-3)
    assert found.gamma == pytest.approx(4582.0, rel=1e-3)


def test_the_same_motor_in_other_units_behaves_the_same():
    """Voltage and flux times ten, current times two: R, L times five. Nothing else to tune."""
    samples = noisy(STEADY).samples
    other = samples * np.array([2.0, 2.0, 10.0, 10.0])
    first = estimates(made(), samples)
    second = estimates(made(resistance=0.3, inductance=5 * 33.75e-6, flux=1.9e-2), other)
    assert np.array_equal(first[0], second[0])
    tracked = first[0] == TRACKING
    assert np.allclose(first[2][tracked, :2], second[2][tracked, :2], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize('missing', ['resistance', 'inductance', 'flux', 'pole_pairs'])
@pytest.mark.parametrize('value', [None, 0, -1])
def test_incomplete_motor_data_is_refused_by_name(missing, value):
    with pytest.raises(UsageError, match=missing):
        made(**{missing: value})
    with pytest.raises(UsageError, match=missing):
        Pmsm.design(dataclasses.replace(Gains(**MOTOR), **{missing: value}), Circle(0.0))


@pytest.mark.parametrize(
    'gains, said', [({'epsilon': 0.05}, 'epsilon'), ({'clock_rate': 4000.0}, 'clock_rate')]
)
def test_gains_that_cannot_work_are_refused(gains, said):
    with pytest.raises(UsageError, match=said):
        made(**gains)


def test_a_rate_below_two_samples_per_turn_is_refused_with_the_limit():
    design = made(speed_max=6000.0 * RPM).design
    assert Pmsm.limits(design, 1.0 / 2000.0) is None
    assert 'sample at 1400 Hz' in Pmsm.limits(design, 1.0 / 1000.0)
    joint = DriveJoint(
        Pmsm, build_parameters(Gains, {**MOTOR, 'speed_max': 6000.0 * RPM}), JointSettings()
    )
    for k in range(100):
        joint.update(10**9 + k * 10**6, (0.0, 0.0, 0.0, 0.0))
    assert joint.estimate()[3] == MISCONFIGURED and '1400 Hz' in joint.why()


# ---- convergence -----------------------------------------------------------------------------


@pytest.mark.parametrize('variant', ['identifier', 'hybrid', 'continuous'])
@pytest.mark.parametrize('rpm', [3000.0, -3000.0])
def test_a_spinning_motor_is_found_within_20_ms(variant, rpm):
    seen = noisy(((0.06, rpm, rpm),))
    status, _, rows, *_ = estimates(made(variant=variant), seen.samples)
    assert np.argmax(status == TRACKING) < 400
    assert np.all(status[400:] == TRACKING)
    assert np.abs(angle_error(rows[400:, 0], seen.truth[401:, 1])).max() < 1.5
    assert np.abs(rows[400:, 1] / (7.0 * seen.truth[401:, 0]) - 1.0).max() < 0.02
    assert rows[-1, 2] == pytest.approx(1.9e-3, rel=0.01)


@pytest.mark.parametrize('flux', [0.9e-3, 4.0e-3])
def test_a_wrong_nominal_flux_is_corrected(flux):
    seen = noisy(((0.15, 3000.0, 3000.0),))
    status, _, rows, *_ = estimates(made(flux=flux), seen.samples)
    assert status[-1] == TRACKING
    assert rows[-1, 2] == pytest.approx(1.9e-3, rel=0.03)
    tracked = status == TRACKING
    assert np.abs(angle_error(rows[tracked, 0], seen.truth[1:][tracked, 1])).max() < 10.0


@pytest.mark.parametrize('rpm, seconds, first', [(3000.0, 0.08, 1200), (1714.2857, 0.06, 800)])
def test_an_unknown_flux_is_identified_and_the_frame_starts_aligned(rpm, seconds, first):
    """Also at one turn per tick, where the slow loop alone would take 20 ms more."""
    seen = noisy(((seconds, rpm, rpm),))
    status, _, rows, *_ = estimates(made(initial_flux=0.0), seen.samples)
    assert status[-1] == TRACKING and 0 < np.argmax(status == TRACKING) < first
    assert rows[-1, 2] == pytest.approx(1.9e-3, rel=0.01)


def test_power_invariant_vectors_give_the_same_estimates():
    samples = noisy(STEADY).samples
    first = estimates(made(), samples)
    second = estimates(made(scaling='power'), samples * math.sqrt(1.5))
    tracked = first[0] == TRACKING
    assert np.array_equal(first[0], second[0])
    assert np.allclose(first[2][tracked], second[2][tracked], rtol=1e-9)


@pytest.mark.parametrize('delay', [0.25, 0.75, 1.0, 1.25, 2.0])
def test_a_voltage_reported_early_is_delayed(delay):
    seen = record(((0.06, 6000.0, 6000.0),))
    samples, early, count = seen.samples.copy(), math.floor(delay), len(seen.samples)
    voltage = np.vstack((samples[early:, 2:], samples[-1 - early :, 2:]))
    part = delay - early
    samples[:, 2:] = (1.0 - part) * voltage[:count] + part * voltage[1 : count + 1]
    status, _, right, *_ = estimates(made(voltage_delay=delay), samples)
    assert status[-1] == TRACKING
    assert abs(np.mean(angle_error(right[-200:, 0], seen.truth[-200:, 1]))) < 0.5
    wrong = estimates(made(), samples)[2]
    late = np.mean(angle_error(wrong[-200:, 0], seen.truth[-200:, 1]))
    assert late == pytest.approx(delay * 12.6, abs=1.5)  # omega Ts


@pytest.mark.long
@pytest.mark.parametrize('every', [1, 4, 10])
def test_it_works_from_2_to_20_khz(every):
    """Decimated as a drive would: current at the edges, mean voltage between them."""
    seen = noisy(P1)
    count = len(seen.samples) // every
    mean = seen.samples[1 : (count - 1) * every + 1, 2:].reshape(count - 1, every, 2).mean(axis=1)
    samples = np.column_stack((seen.samples[every : count * every : every, :2], mean))
    truth = seen.truth[every : count * every : every]
    status, _, rows, *_ = estimates(made(every * DT), samples)
    tracked = status == TRACKING
    assert tracked.sum() * every * DT > 0.63
    error = np.abs(angle_error(rows[tracked, 0], truth[1:][tracked, 1]))
    assert error.max() < 3.0


@pytest.mark.long
@pytest.mark.parametrize('sign, seed', [(1.0, 1), (-1.0, 2)])
def test_once_beyond_half_a_turn_per_sample_nothing_is_said_until_the_rotor_has_stood(sign, seed):
    """There every sample is that of a rotor that turns the other way: the mean voltage too."""
    seen = record(
        (
            (0.1, sign * 3000.0, sign * 3000.0),
            (0.2, sign * 3000.0, sign * 6000.0),
            (0.2, sign * 6000.0, sign * 6000.0),
            (0.2, sign * 6000.0, 0.0),
            (0.1, 0.0, 0.0),
            (0.2, 0.0, sign * 3000.0),
            (0.2, sign * 3000.0, sign * 3000.0),
        ),
        seed,
        current_noise=0.1,
    )
    mean = seen.samples[1:23981, 2:].reshape(1199, 20, 2).mean(axis=1)
    samples = np.column_stack((seen.samples[20:24000:20, :2][:1199], mean))
    status, reasons, rows, *_ = estimates(made(20 * DT), samples)
    speed = seen.truth[20:24000:20, 0][1:1199]
    beyond = slice(int(np.argmax(np.abs(speed) * 7.0 > 1.1 * math.pi / (20 * DT))), 600)
    assert beyond.start < 250
    assert np.all(status[beyond] == NOT_OBSERVABLE) and np.all(reasons[beyond] & ALIASING)
    tracked = status == TRACKING
    assert tracked[:100].any() and tracked[-150:].all()
    assert np.abs(rows[tracked, 1] / (7.0 * speed[tracked]) - 1.0).max() < 0.1
    assert 'sample rate' in describe(ALIASING)


# ---- honesty ---------------------------------------------------------------------------------


def test_at_rest_nothing_but_a_bound_is_given():
    seen = noisy(RESTING)
    motor = made()
    status, reasons, rows = estimates(motor, seen.samples)
    assert np.all(status == NOT_OBSERVABLE)
    assert np.all(np.isnan(rows[:, :2])) and np.all(rows[:, 3] == 0.0)
    assert np.all(reasons[10:] & (LOW_EMF | SEARCHING) == LOW_EMF | SEARCHING)
    assert 100.0 * RPM < motor.speed_bound() < 500.0 * RPM
    assert motor.stddev()[1] == pytest.approx(motor.speed_bound() / math.sqrt(3.0))


def test_while_not_observable_the_flux_is_frozen_and_the_registers_are_cleared():
    stop = noisy(((0.05, 3000.0, 3000.0), (0.05, 3000.0, 0.0), (0.1, 0.0, 0.0)))
    motor = made()
    motor.start(stop.samples[0])
    blind, state = [], motor.state
    for row in stop.samples[1:].tolist():
        motor.step(row)
        if motor.reasons & LOW_EMF:
            blind.append((state.core.x, state.ticks.count, state.out.speed))
    xs, ticks, speeds = np.array(blind[40:]).T
    assert len(xs) > 2000
    assert np.all(xs == xs[0])
    assert xs[0] == pytest.approx(526.3, rel=0.05)
    assert np.all(ticks[200:] == 0)
    assert np.all(speeds == 0.0)


def test_the_speed_bound_holds():
    seen = noisy(((0.05, 0.0, 0.0), (0.4, 0.0, 400.0)))
    motor = made()
    motor.start(seen.samples[0])
    checked = 0
    for k, row in enumerate(seen.samples[1:].tolist(), 1):
        motor.step(row)
        bound = motor.speed_bound()
        if bound < math.inf:
            assert abs(seen.truth[k, 0]) <= bound
            checked += 1
    assert checked > 3000


def test_currents_that_do_not_change_while_the_rotor_turns_are_not_used():
    """A driver repeats its last message for 0.02 s; afterwards the rotor is found again."""
    samples = noisy(((0.1, 3000.0, 3000.0),)).samples.copy()
    samples[600:1000, :2] = samples[600, :2]
    status, reasons, *_ = estimates(made(), samples)
    assert status[598] == TRACKING and np.all(status[1500:] == TRACKING)
    assert np.all(status[810:999] == NOT_OBSERVABLE)
    assert np.all(reasons[810:999] & CURRENTS_STUCK)


def test_a_wrong_resistance_out_of_all_proportion_is_seen():
    """At 20 A and ten times R the flux leaves its range: never flagged as tracking."""
    seen = record(((0.2, 1500.0, 1500.0),), load_constant=0.3)
    status, reasons, *_ = estimates(
        made(resistance=0.6, inductance=33.75e-6, epsilon=5e-5), seen.samples
    )
    assert not np.any(status == TRACKING)
    assert np.any(reasons & FLUX_RANGE) or np.any(reasons & LOW_EMF)


def white(motor, rpm, seconds):
    """Errors of angle [rad] and speed [rad/s] with white noise at constant speed."""
    times = np.arange(round(seconds * RATE) + 1) / RATE
    omega = rpm * RPM * 7
    exact = signals(times, profile=Profile([(seconds, rpm, rpm)]))
    half = 0.5 * omega * DT
    mean = exact.voltage * np.exp(-1j * half) * math.sin(half) / half
    noise = 0.1 * np.random.default_rng(5).standard_normal((len(times), 2))
    samples = np.column_stack(
        (exact.current.real + noise[:, 0], exact.current.imag + noise[:, 1], mean.real, mean.imag)
    )
    track(motor, samples[0], omega)
    log = run_log(motor, samples)
    motor.state.out.speed = omega  # the low-pass is settled, as the watch
    for row in samples[1:4001].tolist():
        motor.step(row)
    angle = np.angle(np.exp(1j * (log.angle - exact.theta[1:])))
    late = slice(4000, None)
    return angle[late], (log.speed - omega)[late]


@pytest.mark.long
@pytest.mark.parametrize(
    'rpm, gains',
    [
        (500.0, {'speed_filter_hz': 100.0}),
        (4000.0, {'current_noise': None}),
        (2000.0, {'speed_filter_hz': 1000.0}),
        (6000.0, {'speed_filter_hz': 300.0}),
        (6000.0, {'speed_filter_hz': 0.0}),
        (2000.0, {'speed_filter_hz': 100.0, 'relative_bandwidth': 0.3, 'k_eta': 300.0}),
    ],
)
def test_the_standard_deviations_are_those_of_the_errors(rpm, gains):
    motor = made(**{'current_noise': 0.1, **gains})
    angle, speed = white(motor, rpm, 1.5)
    of_angle, of_speed, _ = motor.electrical_stddev()
    assert motor.stddev() == (of_angle / 7.0, of_speed / 7.0)
    assert np.std(angle) == pytest.approx(of_angle, rel=0.12)
    assert np.std(speed) == pytest.approx(of_speed, rel=0.1)


@pytest.mark.parametrize('corner', [100.0, 1000.0])
def test_the_declared_delay_is_that_of_the_speed_on_a_ramp(corner):
    """(true speed - estimate) / acceleration in the middle of a straight ramp, without noise."""
    motor = made(speed_filter_hz=corner)
    profile = Profile([(0.2, 2000.0, 6000.0)], smooth=False)
    seen = Drive(PmsmParameters(adc_bits=0), profile=profile).run(4000)
    rows = estimates(motor, seen.samples)[2]
    lag = (seen.truth[1:, 0] - rows[:, 1] / 7.0)[2000:3500]
    rise = np.gradient(seen.truth[1:, 0], DT)[2000:3500]
    measured = float(np.mean(lag) / np.mean(rise))
    assert measured == pytest.approx(Pmsm.group_delay(motor.design, DT), rel=0.06)


def test_the_low_pass_on_the_speed_has_two_poles_and_its_corner_where_it_is_said():
    """Without noise the frame's speed follows the true one; what is left is the low-pass."""
    made_of = made(speed_filter_hz=100.0).coefficients
    first = np.array([[made_of.f11, made_of.f12], [made_of.f21, made_of.f22]])
    second = np.eye(2)
    at = np.exp(2j * math.pi * np.array([20.0, 100.0, 1000.0]) * DT)
    # off = velocity - speed obeys (off, slope)+ = A (off, slope); velocity = speed + off
    gain = []
    for z in at:
        drive = (second - first) @ [1.0, 0.0]
        gain.append(abs(np.linalg.solve(z * second - first, z * drive)[0]))
    assert gain[1] == pytest.approx(math.sqrt(0.5), rel=0.01)
    assert 1.0 < gain[0] < 1.05 and gain[2] < 0.02


def looked(**changes):
    """Reasons after 75 ms of one and the same signal: converged at 2000 rad/s but for `changes`."""
    signal = {
        'event': 0,
        'h': -2000j * 1.9e-3,
        'speed': 2000.0,
        'turning': 2000.0,
        'before_current': 1.1j,
        'current': 1j,
        'voltage': 4j,
        'x': 1.0 / 1.9e-3,
        'known_power': 1e-4,
        **changes,
    }
    core, acting = core_of(0j, signal['h'], 1.0 + 0j, signal['before_current']), DriveSample()
    core.x = signal['x']
    acting.i_alpha, acting.i_beta = signal['current'].real, signal['current'].imag
    acting.u_alpha, acting.u_beta = signal['voltage'].real, signal['voltage'].imag
    limits, design, watch = Coefficients(), Design(), Watch()
    limits.fast, limits.slow, limits.memory = 0.05, 0.01, 0.002
    limits.window, limits.dt, limits.known_power = 5e-3, DT, signal['known_power']
    limits.emf_of_noise, limits.fastest = 5.0 * math.sqrt(0.1), 0.85 * math.pi / DT
    design.robust, design.emf_min, design.drop = True, 0.14, 0.024
    design.xi_low, design.xi_high = 200.0, 1300.0
    begin_watch(watch, 1e-4)
    seen = signal['event'], abs(signal['h']), signal['speed'], signal['turning'], 0.0
    for _ in range(1500):
        look(watch, limits, design, core, acting, *seen)
    return watch.reasons


@pytest.mark.parametrize(
    'changes, reasons',
    [
        ({}, 0),
        ({'x': -1.0 / 1.9e-3, 'speed': -2000.0, 'turning': -2000.0}, 0),
        ({'h': 0.1j}, LOW_EMF | SEARCHING | MISALIGNED),
        ({'h': 3.8j}, MISALIGNED),
        ({'h': -3.8j * np.exp(1j * math.radians(9.0))}, MISALIGNED),
        ({'h': -3.8j * np.exp(1j * math.radians(7.0))}, 0),
        ({'speed': 2300.0}, INCONSISTENT),
        ({'speed': -2000.0}, INCONSISTENT),
        ({'speed': 2050.0}, 0),
        ({'x': 1400.0}, FLUX_RANGE),
        ({'x': 100.0}, FLUX_RANGE),
        ({'x': 6000.0}, FLUX_RANGE | SEARCHING),
        ({'voltage': 0j}, NO_VOLTAGE | SEARCHING),
        ({'before_current': 1j}, CURRENTS_STUCK | SEARCHING),
        ({'before_current': 0j, 'current': 0j}, 0),  # no load
        ({'before_current': 1j, 'turning': 0.0}, INCONSISTENT),  # at rest
        ({'current': 200.0 + 0j}, LOW_EMF | SEARCHING),  # the resistance may falsify all of it
        ({'known_power': 10.0}, LOW_EMF | SEARCHING),  # noise
        ({'turning': 60000.0, 'speed': 60000.0}, ALIASING),
        ({'speed': 60000.0}, INCONSISTENT),
        ({'event': 16}, 16),
        # once lost, twice the back-EMF is needed
        ({'h': -0.2j, 'speed': 105.0, 'turning': 105.0, 'current': 0j}, LOW_EMF | SEARCHING),
        ({'h': -0.3j, 'speed': 158.0, 'turning': 158.0, 'current': 0j}, 0),
    ],
)
def test_each_residual_gives_its_reason(changes, reasons):
    assert looked(**changes) == reasons
    assert (describe(reasons) == '') == (reasons == 0)
