# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A stamp that comes late is no motion: every angle observer finds it by its innovations."""

import math
from itertools import cycle

import numpy as np
import pytest
from observer_cases import angle_observers, make, plain, stamps

QUANTUM, RATE, WAY, FREQUENCY = 3.8e-4, 667.0, 4.0, 2.0 * math.pi * 0.8
EVERY, DELAYS = 500, (1e-3, 2e-3, 4e-3)  # samples; s
FORMS = {
    'hybrid_angle': [
        {'order': 2},
        {'form': 'paper', 'bandwidth_hz': 20.0},
        {'injection': 'sin'},
        {'injection': 'tan', 'order': 2},
        {'injection': 'sat'},
    ],
    'kalman': [
        {'model': 'constant_velocity'},
        {'bandwidth_hz': 45.0},
        {'model': 'constant_velocity', 'bandwidth_hz': 45.0},
    ],
    'pll': [{'damping': 0.7}],
    'super_twisting': [{'order': 1}, {'order': 3}, {'form': 'explicit'}],
}
CASES = [(name, gains) for name in angle_observers() for gains in ({}, *FORMS.get(name, ()))]

QUICK = 'edge_adaptive', 'pll'  # the others without a quantum run with the slow ones


def label(case):
    return '-'.join((case[0], *(str(value) for value in case[1].values())))


def delayed(t, burst, delays=DELAYS):
    """Times at which samples of `t` [s] are stamped: one in EVERY comes late, the delays in turn.

    burst : those behind it come 0.1 ms apart until the true times have caught up; else only the
        next does, and the one after it is stamped truly.
    """
    late = t.copy()
    for k, delay in zip(range(EVERY // 2, len(t) - 20, EVERY), cycle(delays)):
        late[k] += delay
        for j in range(k + 1, k + 20 if burst else k + 2):
            late[j] = max(late[j], late[j - 1] + 1e-4) if burst else late[j - 1] + 1e-4
    return late


def speed(t):
    return WAY * FREQUENCY * np.cos(FREQUENCY * t)


def run(case, t, late, quantum=None):
    name, gains = case
    reading = np.floor(WAY * np.sin(FREQUENCY * t) / QUANTUM) * QUANTUM
    reading = (reading + math.pi) % (2.0 * math.pi) - math.pi
    gains = gains if quantum is None else {**gains, 'quantum': quantum}
    at = stamps(1)[0] + np.rint(late * 1e9).astype(np.int64)
    return make(name, gains).run(at, reading)


def errors(out, t, late):
    """Largest error of the velocity [rad/s] after a second: against the speed at the true time of
    the reading, and against that at its stamp.
    """
    used = (t > 1.0) & (out.verdict < 5)
    return [float(np.max(np.abs(out.velocity - speed(at))[used])) for at in (t, late)]


@pytest.mark.long
@pytest.mark.parametrize(
    'case, known',
    [
        pytest.param(
            *(case, known),
            id=label(case) + '-no' * (not known) + '-quantum',
            marks=pytest.mark.slow if not known and case[0] not in QUICK else (),
        )
        for case in CASES
        for known in (True, False)
    ],
)
def test_a_late_stamp_is_no_motion(case, known):
    t = np.arange(int(8.0 * RATE)) / RATE
    given = {'quantum': QUANTUM if known else None}
    usual = max(errors(run(case, t, t, **given), t, t))
    found = {}
    for burst in (True, False):
        late = delayed(t, burst)
        found[burst] = errors(run(case, t, late, **given), t, late)
    worst = max(max(pair) for pair in found.values())
    assert worst <= 10.0, found
    if case[1].get('form') != 'paper':  # which starts its position anew after the long sample time
        assert worst <= usual + 1.0, found  # the speed changes by 0.4 in 4 ms


@pytest.mark.long
@pytest.mark.parametrize('case', [case for case in CASES if not case[1]], ids=label)
def test_true_sample_times_are_believed(case):
    """Samples drawn at random are no late stamps, and a joint may stop while some are lost."""
    t = np.arange(int(8.0 * RATE)) / RATE
    random = np.random.default_rng(3)
    uneven = (t + random.uniform(0.0, 0.8 / RATE, len(t)))[random.random(len(t)) > 0.05]
    usual = errors(run(case, t, t), t, t)[0]
    assert errors(run(case, uneven, uneven), uneven, uneven)[0] <= 1.5 * usual + 0.2
    at = np.delete(np.arange(2000), slice(1000, 1004)) / 1000.0
    angle = 8.0 * np.minimum(at, 1.0001)
    reading = np.floor(angle / QUANTUM) * QUANTUM
    out = make(*case, wrap_period=0.0).run(
        stamps(1)[0] + np.rint(at * 1e9).astype(np.int64), reading
    )
    assert np.max(np.abs(out.velocity[1400:])) < 0.01
    rest = np.abs(out.position - reading)[1001:]
    assert np.max(rest) < 8.0 * 0.02


def queued(t, random):
    """Times at which a receiver stamps samples of `t` [s] if it pauses now and then."""
    stamped, free = t.copy(), 0.0
    for k, at in enumerate(t):
        if random.random() < 0.08:
            free = max(free, at + random.uniform(0.02, 0.05))
        stamped[k] = max(at, free)
        if stamped[k] > at:
            free = stamped[k] + random.uniform(3e-5, 1.3e-4)
    return stamped


@pytest.mark.parametrize('name', angle_observers())
def test_samples_that_waited_in_a_queue_are_no_fast_motion(name):
    random = np.random.default_rng(7)
    t = np.arange(1, 4000) / 200.0
    angle = np.sin(2.0 * t) + random.normal(0.0, 3e-4, len(t))
    velocity = 2.0 * np.cos(2.0 * t)
    at = stamps(1)[0] + np.rint(queued(t, random) * 1e9).astype(np.int64)
    joint = make(name, {})
    found = joint.run(at, angle)
    assert 'stamps are off' in joint.why()
    error = (found.velocity - velocity)[400:]
    assert np.isfinite(error).all()
    assert np.sqrt(np.mean(error**2)) < 0.45  # of a speed of 1.4
    assert np.abs(error).max() < 10.0


@pytest.mark.parametrize('name', angle_observers())
def test_samples_at_random_times_did_not_wait(name):
    random = np.random.default_rng(8)
    t = np.cumsum(np.maximum(random.exponential(0.005, 3000), 2e-5))
    angle = np.sin(6.0 * t) + random.normal(0.0, 1e-3, len(t))
    joint, late = plain(name, {}), []
    for stamp, reading in zip((stamps(1)[0] + np.rint(t * 1e9)).astype(np.int64), angle):
        joint.update(int(stamp), float(reading))
        late.append(abs(joint.view.track.sample_time.late))
    assert 'stamps' not in joint.why()
    assert np.mean(np.array(late) > 1e-3) < 0.01  # of 5 ms
