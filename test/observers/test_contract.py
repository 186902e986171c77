# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What every observer owes the driver, whoever wrote it."""

import dataclasses
import math
from inspect import signature

import numpy as np
import pytest
from observer_cases import UNTUNED, beside, found, label, make, stamps, stream, variants, wrapped

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import (
    COASTING,
    INITIALISING,
    LOST,
    MISCONFIGURED,
    NOT_OBSERVABLE,
    STATUS_NAMES,
    TRACKING,
    Deviation,
    Estimate,
)
from estimator_pkg.observers import Observer
from estimator_pkg.parameters import build, declared
from estimator_pkg.record import Vector
from estimator_pkg.sensor.guard import DUPLICATE

NAMES = sorted({name for name, _ in variants()})
each_variant = pytest.mark.parametrize('variant', variants(), ids=label)
each_observer = pytest.mark.parametrize('name', NAMES)


def test_every_observer_can_be_loaded():
    for name in observers.names():
        assert observers.find(name).name == name


def test_a_status_is_the_number_that_recorded_bags_carry():
    numbers = (INITIALISING, TRACKING, COASTING, LOST, NOT_OBSERVABLE, MISCONFIGURED)
    assert numbers == (0, 1, 2, 3, 4, 5)
    assert len(STATUS_NAMES) == 6 and STATUS_NAMES[LOST] == 'lost'


CLASSES = [
    observer
    for observer in found().values()
    if observer.kind != 'mechanical'  # a class with matrices
]
each_class = pytest.mark.parametrize('observer', CLASSES, ids=lambda observer: observer.name)


BRANCHES = (  # of the equations, that no variant takes
    {'order': 2, 'k1': 1.0, 'k2': 1.0, 'injection': 'sin'},
    {'k1': 7.0, 'k2': 14.0, 'k3': 8.0, 'injection': 'tan', 'noise': 1e-3, 'max_speed': 60.0},
    {'k1': 4.0, 'k2': 6.0, 'k3': 4.0, 'injection': 'sat', 'M': 0.02},
    {'order': 2, 'bandwidth_hz': 4.0},
    {'form': 'paper', 'injection': 'tan', 'bandwidth_hz': 5.0},
)


@pytest.mark.long
@pytest.mark.parametrize(
    'variant',
    [
        *variants(),
        *(pytest.param(('hybrid_angle', each), marks=pytest.mark.slow) for each in BRANCHES),
    ],
)
def test_plain_equals_the_engine_per_sample(variant):
    for seed in (1, 2):
        seen = set()
        for (channel, here), (twin, there) in beside(*variant, *stream(seed)):
            assert channel == twin
            for mine, other in zip(here, there):
                np.testing.assert_array_equal(mine, other)
            seen.add((here.verdict.item(), here.status.item()))
        assert {status for _, status in seen} == {INITIALISING, TRACKING, COASTING}
        assert len({verdict for verdict, _ in seen}) >= 5


@each_class
def test_an_observer_has_what_the_contract_lists(observer):
    for name in ('Design', 'Coefficients', 'State'):
        assert isinstance(getattr(observer, name).fields, dict), name
    for name, inherited in vars(Observer).items():
        if isinstance(inherited, staticmethod):
            expected = list(signature(inherited.__func__).parameters)
            assert list(signature(getattr(observer, name)).parameters) == expected, name


class Parts:
    """The records of an observer with these gains, and its functions on them."""

    def __init__(self, variant, period=2.0 * math.pi):
        name, gains = variant
        observer = observers.find(name)
        gains = build(observer.gains, gains)
        self.module = observer.bound(gains)
        self.design = self.module.design(gains, Circle(period))
        self.state = self.module.State.of(self.module)()
        self.coefficients = self.module.Coefficients()
        self.module.prepare(self.coefficients, self.design, 1e-3)

    def start(self, angle):
        self.module.start(self.module, self.state, self.design, angle)

    def take(self, angle, name='step', *known_input):
        function = getattr(self.module, name)
        function(self.module, self.state, self.coefficients, self.design, angle, *known_input)

    def told(self, angle):
        """The estimate, and its deviation."""
        now, sigma, rest = Estimate(), Deviation(), (self.state, self.coefficients, self.design)
        self.module.estimate(self.module, now, *rest, angle, 0.0)
        self.module.deviation(self.module, sigma, *rest, 1.0)
        return now, sigma


def check_kinds(record):
    """Each field has the type that is declared."""
    for name, kind in type(record).fields.items():
        check_kind(kind, getattr(record, name), name)


def check_kind(kind, value, name):
    if isinstance(kind, Vector):
        assert type(value) is list and len(value) == kind.size, name
        for item in value:
            check_kind(kind.kind, item, name)
    elif kind in (float, int, bool):
        assert type(value) is kind, (name, value)
    else:
        check_kinds(value)


@each_variant
def test_numbers_keep_the_types_that_are_declared(variant):
    one = Parts(variant)
    one.start(0.0)
    for angle in (0.1, 0.2, 0.2, 3.0, -3.0, -3.0, 1e-9, 100.0):
        one.take(angle, 'step', 0.0)
        one.take(angle, 'resume')
        for record in (one.state, one.coefficients, one.design, *one.told(angle)):
            check_kinds(record)
    one.take(0.3, 'restart')
    check_kinds(one.state)


def poison(record, number):
    """Set all fields to this number."""
    for name, kind in type(record).fields.items():
        value = getattr(record, name)
        if isinstance(kind, Vector):
            value[:] = [kind.kind(number)] * kind.count
        elif kind in (float, int, bool):
            setattr(record, name, kind(number))
        else:
            poison(value, number)


@each_variant
def test_a_start_sets_every_field(variant):
    one, other = Parts(variant), Parts(variant)
    poison(other.state, 7e77)
    for each in (one, other):
        each.start(0.5)
    assert repr(one.state) == repr(other.state)


@each_variant
def test_only_finite_measurements_reach_the_state(variant):
    joint = make(*variant)
    at = stamps(60).tolist()
    for i, stamp in enumerate(at):
        joint.update(stamp, wrapped(0.02 * i).item())
        before = repr(joint.channel.track)
        for bad in (math.nan, math.inf, -math.inf):
            assert not joint.update(stamp + 1000, bad)
        assert repr(joint.channel.track) == before
    assert joint.dropped() == {'non_finite': 180}
    assert joint.received == 240 and joint.used == 60


@each_variant
def test_absurd_measurements_do_not_spoil_the_state_for_good(variant):
    """Memory that was never written reads as any double: finite, but no angle."""
    joint = make(*variant)
    at = stamps(3000).tolist()
    for i, stamp in enumerate(at):
        angle = wrapped(2.0 * i * 1e-3).item()
        if i == 1000:
            angle = 1.7e308
        if i == 1001:
            angle = -1.7e308
        if i == 1010:
            angle = 1e18
        joint.update(stamp, angle)
    position, velocity, _, status = joint.estimate()
    assert status == TRACKING
    assert velocity == pytest.approx(2.0, abs=0.02)
    assert position == pytest.approx(angle, abs=0.02)


@each_variant
def test_estimates_and_deviations_are_finite_whatever_comes(variant):
    joint = make(*variant)
    for stamp, angle in zip(*(array.tolist() for array in stream(7))):
        if joint.update(stamp, angle):
            position, velocity, _, status = joint.estimate()
            assert math.isfinite(position) and math.isfinite(velocity)
            assert status in (INITIALISING, TRACKING, COASTING)
            # infinite where no reading has changed yet: neither quantum nor speed is known
            assert all(sigma >= 0.0 for sigma in joint.stddev())


@each_variant
def test_no_sample_time_breaks_an_observer_that_names_no_limit(variant):
    name, gains = variant
    for dt in (1e-6, 1e-4, 0.05, 1.0):
        joint = make(name, gains, gap_max=3000.0)
        if dt > joint.longest_dt:
            continue
        at = stamps(4000 if dt < 1e-2 else 400, dt, 0.1 * dt)
        t = (at - at[0]) * 1e-9
        speed = 0.5 / dt if dt > 1e-3 else 50.0  # half a radian per sample at most
        out = joint.run(at, wrapped(speed * t))
        assert np.all(np.isfinite(out.velocity))
        if out.status[-1] == TRACKING:
            assert out.velocity[-1] == pytest.approx(speed, rel=0.02)
        else:
            assert dt < 1e-3  # a few milliseconds of samples do not settle it


@each_variant
def test_says_tracking_only_when_the_speed_is_right(variant):
    """A cold start at speed, without noise: from the first `tracking` on, within 10 %."""
    for speed in (5.0, 20.0, 100.0):
        joint = make(*variant)
        at = stamps(3000)
        t = (at - at[0]) * 1e-9
        out = joint.run(at, wrapped(1.0 + speed * t))
        assert out.status[-1] == TRACKING
        good = np.abs(out.velocity - speed) < 0.1 * speed
        assert np.all(good[out.status == TRACKING])
        assert np.sum(good & (out.status == INITIALISING)) < 300  # right, but withheld: 0.3 s


def samples_of(parameter):
    """Values of a parameter other than its default, all admitted."""
    if parameter.kind is bool:
        return [not parameter.default]
    if parameter.kind is str:
        return []
    low, high = parameter.search or (parameter.minimum, parameter.maximum)
    if parameter.default is None:
        centre = math.sqrt(max(low, 1e-9) * high)
        return [min(max(centre, parameter.minimum), parameter.maximum)]
    if parameter.default == 0:
        return [min(1e-3, high)]
    return [min(max(factor * parameter.default, low), high) for factor in (0.7, 1.5)]


LIVE = [
    (name, key, value)
    for name in NAMES
    for key, parameter in declared(observers.find(name).gains).items()
    if not parameter.structural
    for value in samples_of(parameter)
]


@pytest.mark.parametrize(
    'name, key, value', LIVE, ids=[f'{name}-{key}-{value:.3g}' for name, key, value in LIVE]
)
def test_live_change_of_a_gain_keeps_the_state(name, key, value):
    observer = observers.find(name)
    joint, same = make(name), make(name)
    at = stamps(2400).tolist()
    # 7 rad/s and 1.5 mrad of noise
    angles = (
        wrapped(np.arange(2400) * 7e-3 + np.random.default_rng(3).normal(0.0, 1.5e-3, 2400))
    ).tolist()
    for stamp, angle in zip(at[:2000], angles[:2000]):
        joint.update(stamp, angle)
        same.update(stamp, angle)
    before = joint.estimate()
    assert before[3] == TRACKING
    try:
        gains = dataclasses.replace(joint.gains, **{key: value})
        observer.design(gains, Circle())
    except UsageError as error:
        pytest.skip(f'not alone: {error}')
    joint.set_gains(gains)
    if key != 'low_speed_bound':
        assert joint.estimate()[1] == pytest.approx(before[1], abs=1e-9)
    for stamp, angle in zip(at[2000:2003], angles[2000:2003]):
        joint.update(stamp, angle)
        same.update(stamp, angle)
        # one noisy sample moves the speed by no more than its raw difference could
        assert abs(joint.estimate()[1] - 7.0) < abs(same.estimate()[1] - 7.0) + 4.0 * 1.5
        assert joint.estimate()[3] == TRACKING


@each_observer
def test_every_parameter_is_declared_in_full(name):
    for key, parameter in declared(observers.find(name).gains).items():
        assert parameter.description.strip(), key
        if parameter.kind in (float, int):
            assert parameter.minimum is not None and parameter.maximum is not None, key
        if parameter.kind is str:
            assert parameter.choices, key
        assert isinstance(parameter.unit, str), key
        if parameter.default is not None:
            assert parameter.check(parameter.default) == parameter.default
        if parameter.search:
            low, high = parameter.search
            assert parameter.minimum <= low < high <= parameter.maximum
            if parameter.default is not None:
                assert low <= parameter.default <= high
    fields = {field.name for field in dataclasses.fields(observers.find(name).gains)}
    assert fields == set(declared(observers.find(name).gains))


@each_observer
def test_lengths_and_rates_carry_units(name):
    """'' is for flags, choices and pure numbers: nothing whose name or text speaks of a unit."""
    for key, parameter in declared(observers.find(name).gains).items():
        if parameter.kind is bool or parameter.kind is str:
            assert parameter.unit == ''
        if key.endswith('_hz'):
            assert parameter.unit == 'Hz'
        if key in ('quantum', 'noise'):
            assert parameter.unit == 'rad'


@each_observer
def test_tuner_has_something_to_vary(name):
    known = declared(observers.find(name).gains).values()
    assert name in UNTUNED or any(parameter.search for parameter in known)


@each_observer
def test_observer_says_what_it_is(name):
    observer = observers.find(name)
    assert observer.name == name
    assert observer.summary and '\n' not in observer.summary and observer.reference
    assert build(observer.gains, {}) == observer.gains()


@each_variant
def test_acceleration_is_given_where_it_is_promised(variant):
    name, gains = variant
    joint = make(name, gains)
    at = stamps(2000)
    t = (at - at[0]) * 1e-9
    out = joint.run(at, wrapped(10.0 * t * t))  # 20 rad/s^2
    if observers.find(name).gives_acceleration(joint.gains):
        assert out.acceleration[-1] == pytest.approx(20.0, rel=0.02)
    else:
        assert np.all(np.isnan(out.acceleration[out.verdict < DUPLICATE]))


@each_variant
def test_group_delay_is_the_lag_in_a_ramp(variant):
    """At constant acceleration the estimate is late by the group delay, at any sample time."""
    name, gains = variant
    if gains.get('model') == 'constant_velocity':
        assert math.isnan(make(name, gains).group_delay(1e-3))  # follows from the noise
        gains = {**gains, 'noise': 1e-3}
    if name in UNTUNED:
        assert math.isnan(make(name, gains).group_delay(1e-3))  # follows from the stream
        return
    for dt in (5e-4, 2e-3):
        joint = make(name, gains)
        at = stamps(int(3.0 / dt), dt)
        t = (at - at[0]) * 1e-9
        out = joint.run(at, wrapped(5.0 * t * t))
        lag = t[-1] - out.velocity[-1] / 10.0
        assert joint.group_delay(dt) == pytest.approx(lag, abs=2e-5)


@pytest.mark.parametrize('variant', variants(), ids=label)
def test_a_motion_and_its_mirror_image_have_estimates_that_are_mirrored(variant):
    """Rest, a blow, a ramp, a reversal, a stop, an outlier and a hole, in 4096 counts."""
    t = 1e-3 * np.arange(3000)
    speed = np.interp(
        t,
        (0.0, 0.3, 0.301, 1.0, 1.2, 2.0, 2.001, 2.4, 2.401, 3.0),
        (0.0, 0.0, 9.0, 9.0, 40.0, -20.0, 0.0, 0.0, 0.7, 0.7),
    )
    quantum = 2.0 * np.pi / 4096
    y = np.rint((np.cumsum(speed) * 1e-3 + 0.3 * quantum) / quantum) * quantum
    y[1500] += 0.4
    keep = np.delete(np.arange(3000), np.arange(2700, 2930))
    at = stamps(3000)[keep]
    name, gains = variant
    for given in (0.0, quantum):
        here, there = (
            make(name, {**gains, 'quantum': given}).run(at, wrapped(sign * y[keep]))
            for sign in (1.0, -1.0)
        )
        assert np.array_equal(here.status, there.status)
        np.testing.assert_allclose(here.velocity, -there.velocity, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(
            here.velocity_stddev, there.velocity_stddev, rtol=1e-6, atol=1e-6
        )
