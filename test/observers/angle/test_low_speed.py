# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The low-speed bound: a shaft that turned faster would have moved the reading by now."""

import math

import numpy as np
import pytest
from observer_cases import label, make, stamps, tunable_variants, variants, wrapped

from estimator_pkg.observers.angle.shared import low_speed_bound

QUANTUM = 2.0 * math.pi / 4096
DT = 1e-3
each_variant = pytest.mark.parametrize('variant', tunable_variants(), ids=label)
every_variant = pytest.mark.parametrize('variant', variants(), ids=label)
each_quantum = pytest.mark.parametrize('known', [True, False], ids=['quantum', 'no quantum'])


def with_gains(variant, known=False, **more):
    name, gains = variant
    return make(name, {**gains, **({'quantum': QUANTUM} if known else {}), **more})


def slow(variant):
    """The variant at a low bandwidth, where it lags so far behind that the bound has work to do."""
    name, gains = variant
    return name, {
        **gains,
        **({'bound': 50.0} if name == 'super_twisting' else {'bandwidth_hz': 4.0}),
    }


def read(angle):
    """What an encoder shows."""
    return wrapped(np.floor(np.asarray(angle) / QUANTUM + 0.5) * QUANTUM)


def since_change(measured):
    """Samples since the reading last changed; 0 at a change."""
    count = np.zeros(len(measured), int)
    for i in range(1, len(measured)):
        count[i] = count[i - 1] + 1 if measured[i] == measured[i - 1] else 0
    return count


def test_bound_is_the_last_change_over_the_time_since():
    assert low_speed_bound(2e-3, 0.1, 1e-3, 0.0) == pytest.approx(0.02)
    assert low_speed_bound(2e-3, 0.1, 5e-3, 0.0) == pytest.approx(0.05)  # at least a quantum
    assert low_speed_bound(2e-3, 0.0, 5e-3, 0.0) == math.inf  # it just changed
    assert low_speed_bound(2e-3, 1.0, 0.0, 0.0) == math.inf  # no quantum is known
    assert low_speed_bound(2e-3, 0.1, 1e-3, 1.01e-6) == math.inf  # noise beyond a quantum
    assert low_speed_bound(2e-3, 0.1, 1e-3, 1e-8) == pytest.approx(0.024)  # held back by 4 sigma
    assert low_speed_bound(2e-3, 0.1, 1e-3, 0.99e-6) < math.inf


def stop_and_go():
    """Speed [rad/s] of a shaft that goes, creeps (an edge every 51 samples), goes on."""
    return np.tile(np.repeat([2.0, 0.03], 500), 4)


@each_quantum
@each_variant
@pytest.mark.long
def test_creep_is_held_to_a_quantum_over_the_time_since_the_edge(variant, known):
    speed = stop_and_go()
    measured = read(1.0 + np.cumsum(speed) * DT)
    at = stamps(len(speed))
    out, free = (
        with_gains(slow(variant), known, **more).run(at, measured)
        for more in ({}, {'low_speed_bound': False})
    )
    since = since_change(measured)
    # where the noise is not known, it may be taken for more than a quantum for eight readings
    still = since > 8
    largest = 1.001 * 2.0 * QUANTUM / (np.where(still, since, 1) * DT)  # a change is 1 or 2 quanta
    assert np.all(np.abs(out.velocity[still]) <= largest[still])
    assert np.all(out.velocity_stddev[still] <= largest[still])
    assert np.sum(np.abs(free.velocity[still]) > largest[still]) > 20
    creep = (speed < 0.1) & (np.arange(len(speed)) > 500)
    assert np.sum((out.velocity - speed)[creep] ** 2) < np.sum((free.velocity - speed)[creep] ** 2)
    go = ~creep & (np.arange(len(speed)) > 500)
    assert np.mean(out.velocity[go]) == pytest.approx(np.mean(free.velocity[go]), rel=0.01)


@each_variant
def test_a_shaft_that_came_to_rest_in_a_gap_is_held_to_a_quantum_over_the_time_since(variant):
    time = np.concatenate([np.arange(1000), 1300 + np.arange(200)]) * DT
    at = 1_700_000_000_000_000_000 + np.rint(time * 1e9).astype(np.int64)
    measured = read(1.0 + 8.0 * np.minimum(time, 1.1))
    out = with_gains(slow(variant), True).run(at, measured)
    since = np.arange(1, 200) * DT
    still = since > 8 * DT
    assert np.all(np.abs(out.velocity[1001:])[still] <= 1.001 * QUANTUM / since[still])


@each_quantum
@every_variant
def test_a_shaft_that_stops_is_shown_to_stop(variant, known):
    t = np.arange(4000) * DT
    speed = np.interp(t, [1.98, 2.0], [8.0, 0.0])  # one within a sample may be a stuck sensor
    measured = read(1.0 + np.cumsum(speed) * DT)
    out = with_gains(variant, known).run(stamps(4000), measured)
    assert out.velocity[1979] == pytest.approx(8.0, rel=0.05)
    last_change = 8.0 * DT + QUANTUM
    for after in (1.0, 1.9):
        assert abs(out.velocity[2000 + int(after / DT)]) <= last_change / after
        assert out.velocity_stddev[2000 + int(after / DT)] <= last_change / after


@every_variant
def test_a_shaft_at_rest_from_the_start_is_shown_at_rest(variant):
    out = with_gains(variant).run(stamps(1000), np.full(1000, 1.234))
    assert np.all(out.velocity == 0.0)


@pytest.mark.long
@pytest.mark.parametrize('given', [True, False], ids=['noise given', 'noise estimated'])
@each_variant
def test_noise_above_a_quantum_switches_it_off(variant, given):
    noise = 3.0 * QUANTUM
    t = np.arange(6000) * DT
    random = np.random.default_rng(2)
    measured = read(2.0 * t + random.normal(0.0, noise, len(t)))
    more = {'noise': noise} if given else {}
    held = with_gains(variant, True, **more)
    free = with_gains(variant, True, low_speed_bound=False, **more)
    assert np.sum(measured[1:] == measured[:-1]) > 200  # readings that repeat by chance
    one, other = (joint.run(stamps(len(t)), measured) for joint in (held, free))
    settled = slice(1000, None)
    same = one.velocity[settled] == other.velocity[settled]
    assert np.mean(same) > 0.999
    assert repr(held.state) == repr(free.state)


@pytest.mark.long
@pytest.mark.parametrize('given', [True, False], ids=['noise given', 'noise estimated'])
@each_variant
def test_noise_that_holds_a_reading_back_does_not_slow_a_shaft(variant, given):
    """1.3 counts per sample: only noise, of a fifth of a count, lets a reading stay as it was."""
    noise = 0.2 * QUANTUM
    t = np.arange(6000) * DT
    random = np.random.default_rng(4)
    measured = read(1.3 * QUANTUM / DT * t + random.normal(0.0, noise, len(t)))
    more = {'noise': noise} if given else {}
    held = with_gains(variant, True, **more).run(stamps(len(t)), measured)
    free = with_gains(variant, True, low_speed_bound=False, **more).run(stamps(len(t)), measured)
    assert np.sum(measured[1001:] == measured[1000:-1]) > 50
    assert np.abs(held.velocity - free.velocity)[1000:].max() <= 0.1 * QUANTUM / DT


@pytest.mark.long
@pytest.mark.parametrize('repeat', [2, 3, 5])
@each_quantum
@each_variant
def test_a_stream_that_repeats_its_readings_is_not_slowed(variant, known, repeat):
    """A sensor slower than the stream: the same reading several times, then a larger change."""
    measured = read(5.0 * (np.arange(3000) // repeat * repeat * DT + 1e-6))
    joint = with_gains(variant, known)
    out = joint.run(stamps(3000), measured)
    assert joint.dropped()['repeated'] > 1500 * (1 - 1 / repeat)
    if joint.longest_dt < repeat * DT:  # gains that need more readings than the sensor gives
        assert 'unstable' in joint.why()
        return
    free = with_gains(variant, known, low_speed_bound=False).run(stamps(3000), measured)
    settled = slice(1000, None)
    assert np.nanmean(out.velocity[settled]) == pytest.approx(5.0, rel=0.02)
    unbounded = np.nanmean(free.velocity[settled])
    assert np.nanmean(out.velocity[settled]) == pytest.approx(unbounded, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize(
    'variant',
    [
        pytest.param(each, marks=pytest.mark.slow if number % 4 else ())
        for number, each in enumerate(tunable_variants())
    ],
    ids=label,
)
def test_it_acts_on_the_output_and_never_on_the_state(variant):
    measured = read(1.0 + np.cumsum(stop_and_go()) * DT)
    held, free = (with_gains(slow(variant), low_speed_bound=on) for on in (True, False))
    differs = 0
    for stamp, value in zip(stamps(len(measured)).tolist(), measured.tolist()):
        held.update(stamp, value)
        free.update(stamp, value)
        assert repr(held.state) == repr(free.state)
        differs += held.estimate()[1] != free.estimate()[1]
    assert differs > 50
