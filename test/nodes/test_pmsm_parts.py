# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What makes up pmsm_observer, without ROS: pairs, order of batches, parameter files."""

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motors import steady

from estimator_pkg import observers
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.driver.pairs import CURRENT, VOLTAGE, CurrentsAndVoltages, Phases
from estimator_pkg.estimate import MISCONFIGURED, TRACKING
from estimator_pkg.messages import vector3
from estimator_pkg.observers.maths.clarke import phases
from estimator_pkg.streams.drive import DriveStream
from sim_pkg.pmsm.simulator import PmsmSimulatorParameters, Source

ROOT = Path(__file__).resolve().parents[2]
BEGIN = 1_700_000_000_000_000_000
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}


def joint(**values):
    observer = observers.find('pmsm')
    gains, settings = Configuration(observer, {**MOTOR, **values}).for_joint('')
    return DriveJoint(observer, gains, settings)


@lru_cache
def batches(count, rows=50, **values):
    source = Source(
        PmsmSimulatorParameters(**{'publish_rate': 5000.0, 'profile': 'constant', **values}), 1
    )
    found = [source.take(rows) for _ in range(count)]
    return [(batch.stamps_ns + BEGIN, batch.values) for batch in found]


@pytest.fixture(scope='module')
def twenty():
    return batches(20)


# ---- order of batches --------------------------------------------------------------------------


@pytest.mark.long
def test_a_repeated_batch_does_nothing_however_long_it_is():
    one, other = joint(), joint()
    for batch in batches(12, rows=700):  # 140 ms each: longer than the reorder window
        one.take(*batch)
        other.take(*batch)
        repeated = other.take(*batch)
        assert np.isnan(repeated.rows).all()
    assert other.dropped() == {'duplicate': 12 * 700} and not other.events()
    assert repr(other.estimate()) == repr(one.estimate())


def test_stamps_that_contradict_the_sample_period_are_misconfigured_until_they_fit():
    made, of = batches(4), joint()
    motor = DriveJoint(of.observer, of.gains, of.settings, sample_period=1e-3)
    found = motor.take(*made[0])
    assert np.isnan(found.rows).all() and motor.dropped() == {'misconfigured': 50}
    assert motor.why() == (
        'sample_period is 0.001 s, but the stamps are 0.0002 s apart: correct sample_period'
    )
    assert math.isnan(motor.estimate()[1]) and motor.estimate()[3] == MISCONFIGURED
    stamps, values = made[1]
    motor.take(stamps[:2], values[:2])  # two stamps decide nothing
    assert motor.dropped() == {'misconfigured': 52}
    stamps = BEGIN + np.arange(50) * 1_009_000  # within a hundredth
    assert np.isfinite(motor.take(stamps, values).rows[-1]).all() and motor.misfit == ''
    assert motor.dropped() == {'misconfigured': 52}
    assert len(motor.take(stamps[:0], values[:0]).rows) == 0


def test_overtaken_batches_are_late_and_three_in_a_row_are_a_clock_that_jumped():
    made = batches(30)
    motor = joint()
    for index in (*range(20), 22, 20, 23, 21, 24):
        motor.take(*made[index])
    assert motor.dropped() == {'late': 100} and motor.events() == {'gap': 1}
    for index in (18, 19, 17):
        motor.take(*made[index])
    assert motor.dropped() == {'duplicate': 150, 'late': 100}  # known again: no jump
    fresh = [(stamps - 60_000_000 + 7, values) for stamps, values in made[:3]]
    fresh = [(stamps + 200_000_000, values) for stamps, values in fresh]
    for batch in fresh[:2]:
        motor.take(*batch)
    assert motor.dropped()['late'] == 200
    motor.take(*fresh[2])
    assert motor.events()['clock_jump'] == 1 and motor.dropped()['late'] == 200


def test_a_bag_that_loops_starts_again():
    made = batches(60)
    motor = joint()
    for batch in (*made, *made):
        motor.take(*batch)
    assert motor.events() == {'clock_jump': 1} and motor.dropped() == {}
    assert motor.estimate()[3] == TRACKING


def test_a_lost_batch_is_a_gap_whatever_the_rate():
    for rate in (2000.0, 20000.0):
        motor = joint()
        for index, batch in enumerate(batches(60, rows=int(rate / 200), publish_rate=rate)):
            if index != 40:
                motor.take(*batch)
        assert motor.events() == {'gap': 1}
        assert motor.estimate()[3] == TRACKING


@pytest.mark.long
@given(st.lists(st.tuples(st.integers(0, 19), st.integers(0, 50), st.integers(0, 50)), max_size=30))
def test_whatever_order_batches_come_in_every_row_is_counted(twenty, pieces):
    motor = joint()
    total = 0
    for index, low, high in pieces:
        stamps, values = twenty[index]
        out = motor.take(stamps[low:high], values[low:high])
        total += len(out.verdict)
    assert motor.received == total == motor.used + sum(motor.dropped().values())


def test_why_names_what_hinders_and_the_bound_of_the_speed():
    motor = joint()
    for batch in batches(30, speed_rpm=20.0, current_noise=0.05):
        motor.take(*batch)
    assert motor.why().startswith('back-EMF too small')
    bound = float(motor.why().split('below ')[1].split()[0])
    assert 20.0 * math.pi / 30.0 < bound < 60.0


def test_the_most_telling_reason_is_kept():
    """With three times the flux three reasons alternate at each look."""
    motor, said = joint(flux=5.7e-3), []
    for stamps, values in steady(200):
        motor.take(stamps, values)
        said.append(motor.why())
    assert len(set(said)) > 1
    (kept,) = set(said[50:])
    assert kept.startswith('flux linkage outside its range (wrong flux')
    for stamps, values in steady(550, begin=200, turns=0.0):
        motor.take(stamps, values)
        said.append(motor.why())
    assert said[200 + 450] == kept and said[-1].startswith('back-EMF too small')  # after 10 s


# ---- pairs -------------------------------------------------------------------------------------


@pytest.mark.parametrize('tolerance', [0, 10])
def test_stamps_within_the_tolerance_pair_whatever_comes_first(tolerance):
    pairs = CurrentsAndVoltages(tolerance)
    assert pairs.take(CURRENT, 1000, (1.0, 2.0)) is None
    assert pairs.take(VOLTAGE, 1000 + tolerance, (3.0, 4.0)) == (1000, (1.0, 2.0, 3.0, 4.0))
    assert pairs.take(VOLTAGE, 2000 - tolerance, (5.0, 6.0)) is None
    assert pairs.take(CURRENT, 2000, (7.0, 8.0)) == (2000, (7.0, 8.0, 5.0, 6.0))
    assert pairs.nearest_ns is None and pairs.unpaired == 0
    assert pairs.take(CURRENT, 3000, (0.0, 0.0)) is None
    assert pairs.take(VOLTAGE, 3001 + tolerance, (0.0, 0.0)) is None
    assert (pairs.paired, pairs.nearest_ns) == (2, 1 + tolerance)


@pytest.mark.long
@given(
    st.sets(st.integers(0, 99)),
    st.sets(st.integers(0, 99)),
    st.integers(-5, 5),
    st.randoms(use_true_random=False),
)
def test_what_is_lost_of_either_costs_only_its_partner(lost, gone, shift, random):
    pairs = CurrentsAndVoltages(5)
    waiting = [[k for k in range(100) if k not in lost], [k for k in range(100) if k not in gone]]
    found = []
    while waiting[0] or waiting[1]:
        kind = random.choice([which for which in (0, 1) if waiting[which]])
        k = waiting[kind].pop(0)
        pair = pairs.take(kind, 1000 * k + kind * shift, (float(k), float(kind)))
        found += [pair] if pair else []
    both = [k for k in range(100) if k not in lost | gone]
    assert [stamp_ns for stamp_ns, _ in found] == [1000 * k for k in both]
    assert all(sample == (k, 0.0, k, 1.0) for k, (_, sample) in zip(both, found))


def test_topics_that_never_pair_are_distinguished():
    stream = DriveStream.of({**MOTOR, 'input': 'current_voltage'})
    for k in range(10):
        for port, shift in enumerate((0, 60_000)):
            stream.feed(port, vector3.encode(BEGIN + 200_000 * k + shift, '', 1.0, 0.0, 0.0), 0)
    assert stream.why_silent().endswith('differ by at least 6e-05 s: increase pair_tolerance')


@pytest.mark.parametrize('back', [10**4, 10**7, 10**9])
def test_a_clock_that_jumps_back_does_not_block(back):
    pairs = CurrentsAndVoltages(10)
    for k in range(20):
        pairs.take(CURRENT, back + 1000 * k, (0.0, 0.0))
    found = []
    for k in range(5):
        found += [pairs.take(kind, 1000 * k, (0.0, 0.0)) for kind in (CURRENT, VOLTAGE)]
    assert len([pair for pair in found if pair]) == 5


def test_phases_without_neutral_sum_to_zero():
    three = Phases(0.1)
    assert three.current(*phases(3.0, -4.0)) == pytest.approx((3.0, -4.0))
    assert three.current(4.0, -2.0, -1.0) is None and three.unbalanced == 1
    assert three.worst == pytest.approx(0.2, rel=0.3)
    assert three.current(0.01, 0.0, 0.0) is not None  # noise, beside the currents before
    assert three.voltage(*(u + 5.0 for u in phases(1.0, 2.0))) == pytest.approx((1.0, 2.0))


def test_the_large_currents_of_a_start_are_soon_forgotten():
    """After an inrush of 100 A a wrong wire at 1 A is found again, within a fraction of a second of
    20 kHz; but not within an electrical turn of a slow rotor, whose currents pass through zero.
    """
    three = Phases(0.1)
    assert three.current(*phases(100.0, 0.0)) is not None
    verdicts = [three.current(1.0, -0.2, -0.2) is None for _ in range(6000)]
    assert not any(verdicts[:1000]) and all(verdicts[4000:])
