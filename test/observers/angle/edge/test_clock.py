# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock of the edge-aware observer: which stamps and which repeated readings it believes."""

import math

import pytest

from estimator_pkg.observers.angle.edge.clock import ODD, UNEVEN, UNKNOWN, elapsed, repeats
from estimator_pkg.observers.angle.edge.constants import MEMORY, SIGMAS
from estimator_pkg.observers.angle.edge.observer import Gains, build
from estimator_pkg.observers.angle.edge.sensor import begin_sensor, paced
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.contract import TRACKING

PACE = 1e-3
QUANTUM = 1e-3
NOISE = 2e-6
KNOWN = (1e-6, 0.9e-3, 0.0, 1.0, 0.0, 0.0)  # covariance in which angle and speed err together


def sensor(noise=NOISE):
    quantum, _, *rest = paced(begin_sensor(QUANTUM), PACE)
    return (quantum, noise, *rest)


def at(clock, dt, moved, v):
    return elapsed(clock, dt, PACE, moved, (0.0, v, 0.0, 0.0), KNOWN, sensor())


@pytest.mark.parametrize('part, lies', [(0.98, False), (1.02, True)])
def test_a_stamp_is_doubted_beyond_a_quantum_and_three_sigmas_of_the_prediction(part, lies):
    dt = 2.0 * PACE
    p00, p01, _, p11, _, _ = KNOWN
    bound = QUANTUM + SIGMAS * math.sqrt(p00 + 2.0 * p01 * dt + p11 * dt * dt + NOISE)
    way = part * bound  # in a mean sample time, which is what the reading moved by
    taken, (late, *_) = at((0.0, 0.02, 0.0, 0.0, 0.0, 0.0), dt, way, way / PACE)
    assert (taken, late) == ((PACE, dt - PACE) if lies else (dt, 0.0))


def test_unevenness_is_the_mean_deviation_of_the_sample_times_that_are_taken():
    uneven, far = 0.1, 100.0 * QUANTUM
    kept = 1.0 - 1.0 / MEMORY
    _, (_, after, *_) = at((0.0, uneven, 0.0, 0.0, 0.0, 0.0), 1.3 * PACE, 1.3 * far, far / PACE)
    assert after == pytest.approx(kept * uneven + 0.3 / MEMORY)
    # the stamp lies: the mean sample time is taken, which deviates by nothing
    _, (late, after, *_) = at((0.0, uneven, 0.0, 0.0, 0.0, 0.0), 1.9 * PACE, far, far / PACE)
    assert late == pytest.approx(0.9 * PACE)
    assert after == pytest.approx(kept * uneven)


def test_an_even_stream_is_looked_at_no_more_unless_a_stamp_is_late():
    uneven = 0.9 * UNEVEN / ODD
    assert at((0.0, uneven, 0.0, 0.0, 0.0, 0.0), PACE, 0.0, 0.0)[1][1] == 0.0
    way = 100.0 * QUANTUM
    taken, (late, after, *_) = at((0.0, uneven, 0.0, 0.0, 0.0, 0.0), 1.5 * PACE, way, way / PACE)
    assert (taken, late) == (PACE, pytest.approx(0.5 * PACE))
    assert after == UNEVEN / ODD


@pytest.mark.parametrize('paces, known', [(MEMORY - 1.0, True), (MEMORY + 1.0, False)])
def test_a_stamp_that_is_late_by_more_than_the_memory_makes_the_clock_unknown(paces, known):
    way, dt = 100.0 * QUANTUM, (1.0 + paces) * PACE
    taken, clock = at((0.0, 0.02, 0.0, 0.0, 0.0, 0.0), dt, way, way / PACE)
    if known:
        assert (taken, clock[0]) == (PACE, pytest.approx(paces * PACE))
    else:
        assert (taken, clock) == (dt, UNKNOWN)


def state(v, p11, held=0.0, longest=0.0, a=0.0):
    """State of the observer that `repeats` looks at."""
    return (
        (0.0, v, a, 0.0),
        (0.0, 0.0, 0.0, p11, 0.0, 0.0),
        None,
        sensor(),
        None,
        None,
        (TRACKING, 0.0, 0.0),
        None,
        None,
        (0.0, 0.0, held, longest, 0.0, 0.0),
        None,
    )


def test_a_repeated_reading_is_old_only_if_the_shaft_surely_moves_on():
    v = 100.0
    sure, unsure = (v / SIGMAS / 1.01) ** 2, (v / SIGMAS * 1.01) ** 2
    assert repeats(state(v, sure), PACE) and repeats(state(-v, sure), PACE)
    assert not repeats(state(v, unsure), PACE)
    assert not repeats(state(v, sure, a=-0.26 * v / PACE), PACE)  # about to stop


def test_one_repeat_is_held_and_twice_the_longest_after_which_the_shaft_had_moved_on():
    v, sure = 100.0, 1.0
    assert not repeats(state(v, sure, held=0.6 * PACE), PACE)
    assert repeats(state(v, sure, held=2.4 * PACE, longest=PACE), PACE)
    assert not repeats(state(v, sure, held=2.6 * PACE, longest=PACE), PACE)
    assert not repeats(state(v, sure, held=MEMORY * PACE, longest=1.0), PACE)


def test_a_shaft_that_stops_soon_after_a_start_is_seen_to_stop():
    functions = build(Gains(quantum=QUANTUM), Circle())
    design, step = functions.design(), functions.step
    coefficients = functions.prepare(design, PACE)
    now, reading = functions.init(0.0, design), 0.0
    for i in range(60):
        reading += 20.0 * QUANTUM if i < 50 else 0.0
        now = step(now, coefficients, design, reading, 0.0)
    (x, v, _, _), *_ = now
    assert x == pytest.approx(reading, abs=2.0 * QUANTUM)
    assert abs(v) < 20.0 * QUANTUM / PACE * 0.2
