# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock of the edge-aware observer: which stamps and which repeated readings it believes."""

import math

import pytest

from estimator_pkg.circle import Circle
from estimator_pkg.observers.angle.edge import observer
from estimator_pkg.observers.angle.edge.constants import NOISE_SAMPLES, SIGMAS
from estimator_pkg.observers.angle.edge.covariance import Motion, set_covariance
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.sensor.noise import Sensor
from estimator_pkg.sensor.sampling import (
    LEAST_ODD,
    ODD,
    Sampling,
    begin_sampling,
    corrected_sample_time,
    is_repeat,
)

PACE = 1e-3
QUANTUM = 1e-3
NOISE = 2e-6
KNOWN = (1e-6, 0.9e-3, 0.0, 1.0, 0.0, 0.0)  # covariance in which angle and speed err together


def at(uneven, dt, moved, v):
    """The time that is taken to have passed, and the clock after it."""
    clock, motion, p, sensor = Sampling(), Motion(), Covariance(), Sensor()
    clock.uneven, motion.velocity = uneven, v
    sensor.quantum, sensor.noise, sensor.mean_sample_time = QUANTUM, NOISE, PACE
    set_covariance(p, *KNOWN)
    return corrected_sample_time(clock, dt, moved, motion, p, sensor), clock


@pytest.mark.parametrize('part, lies', [(0.98, False), (1.02, True)])
def test_a_stamp_is_doubted_beyond_a_quantum_and_three_sigmas_of_the_prediction(part, lies):
    dt = 2.0 * PACE
    p00, p01, _, p11, _, _ = KNOWN
    bound = QUANTUM + SIGMAS * math.sqrt(p00 + 2.0 * p01 * dt + p11 * dt * dt + NOISE)
    way = part * bound  # in a mean sample time, which is what the reading moved by
    taken, clock = at(0.02, dt, way, way / PACE)
    assert (taken, clock.lateness) == ((PACE, dt - PACE) if lies else (dt, 0.0))


def test_unevenness_is_the_mean_deviation_of_the_sample_times_that_are_taken():
    uneven, far = 0.1, 100.0 * QUANTUM
    kept = 1.0 - 1.0 / NOISE_SAMPLES
    _, clock = at(uneven, 1.3 * PACE, 1.3 * far, far / PACE)
    assert clock.uneven == pytest.approx(kept * uneven + 0.3 / NOISE_SAMPLES)
    # the stamp lies: the mean sample time is taken, which deviates by nothing
    _, clock = at(uneven, 1.9 * PACE, far, far / PACE)
    assert clock.lateness == pytest.approx(0.9 * PACE)
    assert clock.uneven == pytest.approx(kept * uneven)


def test_an_even_stream_is_looked_at_no_more_unless_a_stamp_is_late():
    uneven = 0.9 * LEAST_ODD / ODD
    assert at(uneven, PACE, 0.0, 0.0)[1].uneven == 0.0
    way = 100.0 * QUANTUM
    taken, clock = at(uneven, 1.5 * PACE, way, way / PACE)
    assert (taken, clock.lateness) == (PACE, pytest.approx(0.5 * PACE))
    assert clock.uneven == LEAST_ODD / ODD


@pytest.mark.parametrize(
    'paces, known', [(NOISE_SAMPLES - 1.0, True), (NOISE_SAMPLES + 1.0, False)]
)
def test_a_stamp_that_is_late_by_more_than_the_memory_makes_the_clock_unknown(paces, known):
    way, dt = 100.0 * QUANTUM, (1.0 + paces) * PACE
    taken, clock = at(0.02, dt, way, way / PACE)
    if known:
        assert (taken, clock.lateness) == (PACE, pytest.approx(paces * PACE))
    else:
        unknown = Sampling()
        begin_sampling(unknown)
        assert (taken, repr(clock)) == (dt, repr(unknown))


def repeats(v, p11, held=0.0, longest=0.0, a=0.0):
    """True if the observer takes an unchanged reading for an old one."""
    clock, motion, p = Sampling(), Motion(), Covariance()
    clock.repeat_duration, clock.longest_repeat = held, longest
    motion.velocity, motion.acceleration, p.p11 = v, a, p11
    return is_repeat(clock, motion, p, PACE, True, PACE)


def test_a_repeated_reading_is_old_only_if_the_shaft_surely_moves_on():
    v = 100.0
    sure, unsure = (v / SIGMAS / 1.01) ** 2, (v / SIGMAS * 1.01) ** 2
    assert repeats(v, sure) and repeats(-v, sure)
    assert not repeats(v, unsure)
    assert not repeats(v, sure, a=-0.26 * v / PACE)  # about to stop


def test_one_repeat_is_held_and_twice_the_longest_after_which_the_shaft_had_moved_on():
    v, sure = 100.0, 1.0
    assert not repeats(v, sure, held=0.6 * PACE)
    assert repeats(v, sure, held=2.4 * PACE, longest=PACE)
    assert not repeats(v, sure, held=2.6 * PACE, longest=PACE)
    assert not repeats(v, sure, held=NOISE_SAMPLES * PACE, longest=1.0)


def test_a_shaft_that_stops_soon_after_a_start_is_seen_to_stop():
    design = observer.design(observer.Gains(quantum=QUANTUM), Circle())
    state, coefficients, reading = observer.State(), observer.Coefficients(), 0.0
    observer.prepare(coefficients, design, PACE)
    observer.start(observer, state, design, 0.0)
    for i in range(60):
        reading += 20.0 * QUANTUM if i < 50 else 0.0
        observer.step(observer, state, coefficients, design, reading, 0.0)
    assert state.motion.angle == pytest.approx(reading, abs=2.0 * QUANTUM)
    assert abs(state.motion.velocity) < 20.0 * QUANTUM / PACE * 0.2
