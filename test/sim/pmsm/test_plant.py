# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The motor simulator: exact plant, inverter, sensors, controller, profiles, repeatability."""

import math
from copy import copy
from pathlib import Path

import numpy as np
import pytest
import yaml
from drive_status import judge
from motors import Motor
from scipy.integrate import solve_ivp

from estimator_pkg.engine import calls
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.pmsm.observer import Gains
from estimator_pkg.parameters import build, declared
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.inverter import dead_time_error
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.plant import electric, move, resisting
from sim_pkg.pmsm.profiles import NAMES, Profile, named

RPM = math.pi / 30.0
PLANT = PmsmParameters(viscous=1e-5).plant()
SERVO = Path(__file__).parents[3] / 'config' / 'pmsm_motor_servo_400w.yaml'


def fine(current, voltage, theta, speed, load, plant, time):
    """The plant by a solver that knows nothing of the closed form."""
    resistance, inductance, flux = plant.resistance, plant.inductance, plant.flux
    poles, inertia = plant.poles, plant.inertia

    def slope(_, s):
        i = complex(s[0], s[1])
        e = 1j * poles * s[3] * flux * np.exp(1j * s[2])
        d = (voltage - resistance * i - e) / inductance
        t = 1.5 * poles * flux * (i * np.exp(-1j * s[2])).imag
        return [d.real, d.imag, poles * s[3], (t - resisting(s[3], load, plant)) / inertia]

    s = solve_ivp(
        slope, (0.0, time), [current.real, current.imag, theta, speed], rtol=1e-11, atol=1e-12
    ).y[:, -1]
    return complex(s[0], s[1]), s[2], s[3]


def test_the_current_is_exact_at_constant_speed():
    stiff = copy(PLANT)
    stiff.inertia = 1e9
    for time in (1e-6, 5e-5, 1e-3):
        exact = fine(2.0 - 1.0j, 5.0 + 3.0j, 0.4, 600.0, 0.0, stiff, time)[0]
        ours = electric(2.0 - 1.0j, 5.0 + 3.0j, 0.4, 7 * 600.0, stiff, time)
        assert abs(ours - exact) < 1e-7


def test_motion_is_of_second_order():
    start = (2.0 - 15.0j, 5.0 + 3.0j, 0.4, 300.0, 0.01)

    def error(parts):
        current, voltage, theta, speed, load = start
        for _ in range(parts):
            current, theta, speed = move(current, voltage, theta, speed, load, PLANT, 1e-4 / parts)
        exact = fine(*start, PLANT, 1e-4)
        return np.array([abs(current - exact[0]), abs(theta - exact[1]), abs(speed - exact[2])])

    assert np.all(error(2) < [1e-2, 1e-4, 1e-2])
    assert np.all(error(8) < error(2) / 8.0)


def test_a_load_does_not_drive_a_rotor_at_rest():
    current, theta, speed = 0j, 0.3, 0.0
    for _ in range(1000):
        current, theta, speed = move(current, 0j, theta, speed, 0.05, PLANT, 5e-5)
    assert speed == 0.0 and theta == 0.3


def test_dead_time_takes_from_each_phase_against_its_current():
    # i_a > 0 > i_b, i_c: 4/3 of V_dc t_d/T along a
    assert dead_time_error(5.0 + 0j, 24.0, 0.02) == pytest.approx(24.0 * 0.02 * 4.0 / 3.0)


@pytest.mark.parametrize('name', NAMES)
def test_profiles_are_continuous_and_consistent(name):
    profile = named(name, 6000.0, 1.0)
    times = np.linspace(0.0, 2.3, 23001)
    motion = profile.at(times)
    assert np.abs(np.diff(motion.speed)).max() < 1e-4 * 2e4 + 1e-9
    middle = 0.5 * (motion.speed[1:] + motion.speed[:-1]) * 1e-4
    assert np.abs(np.diff(motion.angle) - middle).max() < 1e-3
    assert np.abs(motion.speed).max() == pytest.approx(6000.0 * RPM, rel=1e-3)
    if name == 'reversal':
        assert motion.speed.min() == pytest.approx(-6000.0 * RPM, rel=1e-3)
    if name == 'standstill':
        assert (motion.speed == 0.0).sum() > 4000


def test_bad_profiles_and_parameters_are_refused():
    with pytest.raises(UsageError):
        named('p2', 1.0, 1.0)
    with pytest.raises(UsageError):
        Profile([(0.0, 1.0, 2.0)])
    with pytest.raises(UsageError, match='back-EMF'):
        PmsmParameters(speed_rpm=20000.0)
    with pytest.raises(UsageError, match='dead_time'):
        PmsmParameters(dead_time=1e-5, sample_rate=100000.0, speed_rpm=10.0)
    for one in declared(PmsmParameters).values():
        assert one.description and one.structural


def test_the_controller_follows_p1():
    record = Drive(PmsmParameters()).run(14000)
    speed, wanted = record.truth[:, 0], record.truth[:, 4]
    assert np.abs(speed - wanted).max() < 100.0 * RPM
    assert np.sqrt(np.mean((speed - wanted) ** 2)) < 40.0 * RPM
    assert np.abs(record.truth[:, 3]).max() < 20.0


def test_one_seed_gives_one_run_in_whatever_chunks():
    parameters = PmsmParameters(current_noise=0.1, dead_time=1e-6, voltage_delay=1)
    whole = Drive(parameters, 7).run(700)
    drive = Drive(parameters, 7)
    parts = [drive.run(size) for size in (1, 199, 333, 167)]
    assert np.array_equal(whole.samples, np.concatenate([part.samples for part in parts]))
    assert np.array_equal(whole.truth, np.concatenate([part.truth for part in parts]))
    other = Drive(parameters, 8).run(700)
    assert not np.array_equal(whole.samples, other.samples)


@pytest.mark.skipif(not calls.available(), reason='no engine was built')
def test_plain_and_compiled_are_equal(monkeypatch):
    parameters = PmsmParameters(current_noise=0.1, dead_time=1e-6)
    compiled = Drive(parameters, 3).run(600)
    monkeypatch.setattr(calls, 'load', lambda: (None, ''))
    plain = Drive(parameters, 3).run(600)
    np.testing.assert_array_equal(compiled.truth, plain.truth)
    np.testing.assert_array_equal(compiled.samples, plain.samples)


def test_the_reported_voltage_is_the_one_of_the_interval():
    """Kirchhoff over one period, for each delay; -1 lags, 1 and 2 lead."""
    for delay in (-1, 0, 1, 2):
        parameters = PmsmParameters(adc_bits=0, voltage_delay=delay)
        record = Drive(parameters).run(400)
        reported = record.samples[:, 2] + 1j * record.samples[:, 3]
        current = record.samples[:, 0] + 1j * record.samples[:, 1]
        k = np.arange(100, 300)
        theta, speed = record.truth[k, 1], record.truth[k, 0]
        middle = theta + 0.5 * 7 * speed * parameters.period
        emf = 1j * 7 * speed * 1.9e-3 * np.exp(1j * middle)
        u = (
            33.75e-6 * (current[k + 1] - current[k]) / parameters.period
            + 0.06 * 0.5 * (current[k] + current[k + 1])
            + emf
        )
        assert np.abs(reported[k + 1 - delay] - u).max() < 0.05


def test_the_servo_of_the_configuration_runs_and_is_tracked():
    """Another size of motor with the same tuning: half a reversal."""
    with open(SERVO, encoding='utf-8') as file:
        nodes = yaml.safe_load(file)
    parameters = build(PmsmParameters, nodes['pmsm_sim']['ros__parameters'])
    gains = build(Gains, nodes['pmsm_observer']['ros__parameters'])
    profile = Profile([(0.1, 3000.0, 3000.0), (0.15, 3000.0, -3000.0), (0.1, -3000.0, -3000.0)])
    record = Drive(parameters, 1, profile=profile).run(7000)
    assert np.abs(record.truth[:, 0] - record.truth[:, 4]).max() < 150.0 * RPM
    found = judge(Motor(gains), record)
    assert found.wrong == 0.0 and found.withheld < 40.0 and found.tracking > 290.0
