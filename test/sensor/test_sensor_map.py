# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sensor errors that repeat each turn: learnt and taken out, and nothing where there are none."""

import dataclasses
import math
import re
import tracemalloc

import numpy as np
import pytest

from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.observers.angle.smoother import Smoother
from estimator_pkg.sensor.map import SensorMap, enter

TURN = 2.0 * math.pi
START_NS = 1_700_000_000_000_000_000


def sampled(speed, seconds, rate=1000.0):
    """Return (stamps, true angle, true velocity) at a speed, or at a function of time."""
    time = np.arange(round(rate * seconds)) / rate
    velocity = np.full(len(time), speed) if np.isscalar(speed) else speed(time)
    angle = 0.3 + np.concatenate([[0.0], np.cumsum(velocity[1:] + velocity[:-1])]) / (2.0 * rate)
    return START_NS + np.rint(1e9 * time).astype(np.int64), angle, velocity


def read_by(edges, angle):
    """Return the readings of a counter with these edges [rad], ascending within a turn."""
    turns = np.floor(angle / TURN)
    counts = np.searchsorted(edges, angle - TURN * turns, side='right') - 1
    return wrapped((turns * len(edges) + counts) * TURN / len(edges))


def wrapped(angle):
    return (angle + math.pi) % TURN - math.pi


def eccentric(angle, size=0.03, counts=4096):
    return wrapped(np.floor((angle + size * np.sin(angle)) * counts / TURN) * TURN / counts)


def misplaced(counts=64, share=0.2, late=0.0):
    """Return edges that are misplaced by a share of a count, as a standard deviation."""
    random = np.random.default_rng(5)
    off = np.clip(random.normal(0.0, share, counts), -0.4, 0.4)
    return (np.arange(counts) + off - off.min()) * TURN / counts


def joint(observer='edge_adaptive', sensor_map='learn', **values):
    return Entry(observer, observer).joint(sensor_map=sensor_map, **values)


def error(out, velocity, start):
    rows = slice(round(start * len(velocity)), None)
    return float(np.sqrt(np.mean((out.velocity[rows] - velocity[rows]) ** 2)))


def both(observer, stamps, readings, velocity, start=0.5, **values):
    """Return the errors without and with a map, and the joint with it."""
    off = joint(observer, 'none', **values).run(stamps, readings)
    learning = joint(observer, **values)
    on = learning.run(stamps, readings)
    return error(off, velocity, start), error(on, velocity, start), learning


@pytest.mark.parametrize('observer', ['edge_adaptive', 'kalman', 'hybrid_angle'])
@pytest.mark.parametrize('speed', [12.0, -12.0])
def test_eccentricity_costs_at_most_a_third(observer, speed):
    stamps, angle, velocity = sampled(speed, 6.0)
    values = {'quantum': TURN / 4096}
    off, on, learning = both(observer, stamps, eccentric(angle), velocity, 0.75, **values)
    assert on < off / 3.0
    assert 'sensor errors of up to 2 deg that repeat each turn' in learning.why()


@pytest.mark.parametrize('speed', [10.0, -10.0])
@pytest.mark.long
def test_misplaced_edges_cost_at_most_a_third(speed):
    stamps, angle, velocity = sampled(2.0 * speed, 9.0, 4000.0)
    readings = read_by(misplaced(32), angle)
    off, on, learning = both('edge_adaptive', stamps, readings, velocity, 0.7)
    assert on < off / 3.0
    assert learning.learner.shaft.text()


@pytest.mark.parametrize('speed', [20.0, -20.0])
def test_a_hall_sensor_of_six_edges_is_learnt(speed):
    stamps, angle, velocity = sampled(speed, 6.0)
    readings = read_by(misplaced(6), angle)
    off, on, learning = both('kalman', stamps, readings, velocity, 0.7, quantum=TURN / 6)
    assert on < 0.6 * off  # the rest is the quantum's
    assert re.search('errors of up to [1-9]0? deg', learning.why())


def test_a_new_map_begins_without_a_jump():
    stamps, angle, velocity = sampled(40.0, 2.0)
    off, on = (
        joint('kalman', each, quantum=TURN / 4096).run(stamps, eccentric(angle))
        for each in ('none', 'learn')
    )
    worst, usual = (np.max(np.abs(out.velocity - velocity)[600:]) for out in (on, off))
    assert not np.array_equal(on.velocity, off.velocity)
    assert worst < 1.05 * usual


def test_a_map_that_no_longer_helps_is_given_up():
    """The error goes on with another wheel, and the turn before predicts it no more."""
    stamps, angle, _ = sampled(24.0, 7.5)
    learning, n = joint('kalman', quantum=TURN / 4096), 3000
    learning.run(stamps[:n], eccentric(angle[:n], 0.01))
    assert learning.why()
    learning.run(stamps[n:], wrapped(angle + 0.03 * np.sin(1.41 * angle))[n:])
    assert not learning.why()
    assert learning.learner.awake
    assert not learning.channel.map.active  # as if there had never been one


@pytest.mark.parametrize('coarse', [True, False])
@pytest.mark.parametrize('step', [1, -1])
def test_readings_that_wrap_are_no_motion(coarse, step):
    size = TURN / 8
    tables = np.vstack([np.random.default_rng(2).normal(0.0, 0.1, (2, 8)), np.zeros((2, 8))])
    reading = (step + 0.25) * size
    plain, *turned = (
        in_map(size, tables, reading + turns * TURN, coarse=coarse, quantum=0.5 * size).place
        for turns in (0, -1, 1)
    )
    for wraps in turned:
        for name in ('size', 'error', 'slope', 'further', 'cell', 'offset'):
            assert getattr(wraps, name) == pytest.approx(getattr(plain, name))
        assert (wraps.heading, wraps.taken) == (plain.heading, plain.taken)


def in_map(size, tables, reading, **fields):
    """A map with these tables, after a reading in another cell than the first."""
    made = SensorMap()
    made.active, made.period, made.marks, made.place.size = True, TURN, tables.shape[1], size
    made.place.heading = 1
    for name, value in fields.items():
        setattr(made, name, value)
    for row, values in zip(made.tables, tables.tolist()):
        row[: len(values)] = values
    enter(made, reading)
    return made


def test_a_ripple_is_foreseen_from_cell_to_cell_and_one_way():
    """A shaft that turns back, or that skips a cell, passes the cell as it likes."""
    size = TURN / 8
    tables = np.vstack([np.zeros((2, 8)), np.full((2, 8), -0.2)])
    for way, cells, foreseen in ((1, 1, -0.2), (-1, -1, -0.2), (1, -1, 0.0), (1, 2, 0.0)):
        place = in_map(size, tables, (cells + 0.5) * size, coarse=True, quantum=size, way=way).place
        assert (place.rise, place.motion) == (foreseen, foreseen)
        assert place.further == 0.0  # no cell is larger


def test_a_map_of_one_direction_serves_the_other():
    def there_and_back(time):
        return 12.0 * np.clip(5.0 - time, -1.0, 1.0)

    stamps, angle, velocity = sampled(there_and_back, 9.0, 600.0)
    off, on, _ = both('edge_adaptive', stamps, eccentric(angle), velocity, quantum=TURN / 4096)
    assert on < off / 3.0


@pytest.mark.parametrize('observer', ['edge_adaptive', 'hybrid_angle'])
@pytest.mark.parametrize(
    'readings',
    [
        lambda angle: eccentric(angle, 0.0),
        lambda angle: wrapped(angle + np.random.default_rng(3).normal(0.0, 1e-3, len(angle))),
        lambda angle: read_by(np.arange(64) * TURN / 64, angle),
    ],
    ids=['counts', 'noise', 'coarse'],
)
def test_a_sensor_without_errors_costs_nothing(observer, readings):
    stamps, angle, velocity = sampled(lambda time: 10.0 + 4.0 * np.sin(0.7 * time), 6.0)
    off, on, learning = both(observer, stamps, readings(angle), velocity, 0.1)
    assert on == off
    assert learning.why() == ''


@pytest.mark.long
def test_a_coarse_map_of_one_direction_serves_the_other_until_it_is_learnt():
    stamps, angle, velocity = sampled(lambda time: 20.0 * np.clip(6.0 - time, -1.0, 1.0), 7.6, 2e3)
    readings = read_by(misplaced(32), angle)
    off, on, _ = both('edge_adaptive', stamps, readings, velocity, 7.15 / 7.6)
    assert on < 0.7 * off  # in the first turn and a half backwards


def test_a_given_quantum_is_not_refined():
    stamps, angle, _ = sampled(10.0, 3.0)
    readings = read_by(np.arange(64) * TURN / 64, angle)
    for quantum, marks in ((0.0, 64), (TURN / 32, 32)):
        learning = joint(quantum=quantum)
        learning.run(stamps, readings)
        assert learning.learner.shaft.turn == marks


def test_a_joint_that_does_not_turn_is_never_corrected():
    stamps, angle, velocity = sampled(lambda time: 12.0 * np.sin(6.0 * time), 8.0)
    assert np.ptp(angle) < 0.7 * TURN
    off, on, learning = both('edge_adaptive', stamps, eccentric(angle), velocity, 0.0)
    assert on == off
    assert not learning.learner.awake


@pytest.mark.long
def test_an_edge_that_comes_late_by_a_time_is_learnt_at_any_speed():
    counts, late = 12, 8e-3  # every second edge, forward
    size = TURN / counts
    stamps, angle, velocity = sampled(lambda time: np.clip(3.0 * time - 9.0, 10.0, 20.0), 16.0, 2e3)
    edge = np.floor(angle / size)
    behind = (edge % 2 == 1) & (angle - edge * size < late * velocity)
    readings = (edge - behind) * size
    off, on, learning = both('edge_adaptive', stamps, readings, velocity, 0.85, quantum=size)
    assert on < off  # 0.018 and 0.019 rad/s: without a map it was 0.062 until ramps did not fade
    errors = learning.sensor_errors(1)(size * np.arange(counts), np.full(counts, 20.0))
    assert np.abs(np.diff(errors)) == pytest.approx(np.full(counts - 1, 20.0 * late), rel=0.05)


@pytest.mark.long
def test_errors_that_repeat_after_another_angle_than_the_turn_are_found():
    edges = misplaced(12)
    stamps, angle, velocity = sampled(60.0, 8.0, 4000.0)
    readings = np.floor(angle / TURN) * 12 + np.searchsorted(edges, angle % TURN, side='right') - 1
    # behind a gear of 7.5: 90 counts a turn, of which 12 repeat
    learning = joint(quantum=TURN / 90)
    learning.run(stamps, readings * TURN / 90)
    assert learning.learner.shaft.marks == 12
    assert 'repeat each 48 deg' in learning.why()


def cogging(mean, rate=1000.0, times=2.0):
    """Return (angle, velocity) of a shaft with a torque that repeats `times` times a turn."""
    angle, angles, velocities = 0.0, [], []
    for speed in mean:
        velocities.append(speed * (1.0 + 5.0 / speed**2 * math.cos(times * angle)))
        angle += velocities[-1] / rate
        angles.append(angle)
    return np.array(angles), np.array(velocities)


@pytest.mark.parametrize('times', [4.0, 12.0])
def test_a_cogging_torque_of_many_poles_is_no_error_of_the_sensor(times):
    """Not at one speed: an eccentric sensor's error has few harmonics."""
    angle, velocity = cogging(np.full(6000, 12.0), times=times)
    stamps = START_NS + 1_000_000 * np.arange(len(angle))
    off, on, learning = both('kalman', stamps, eccentric(angle, 0.0), velocity)
    assert on == off
    assert learning.why() == ''


@pytest.mark.long
def test_many_harmonics_are_taken_out_once_another_speed_has_shown_that_they_are_the_sensors():
    stamps, angle, velocity = sampled(lambda t: np.where(t < 6.0, 12.0, 20.0), 18.0)
    readings = eccentric(angle + 0.005 * np.sin(6.0 * angle))
    values = {'quantum': TURN / 4096}
    for end, most in ((6000, 0.85), (18_000, 1.0 / 3.0)):
        rows = slice(end)
        off, on, learning = both(
            'kalman', stamps[rows], readings[rows], velocity[rows], 0.8, **values
        )
        assert on < most * off
        assert learning.learner.shaft.tables[0].all_sure is (end > 6000)
    other = wrapped(angle + 0.03 * np.sin(1.41 * angle))[6000:14_000]
    learning.run(stamps[6000:14_000] + (stamps[-1] - stamps[5999]), other)
    assert not learning.learner.shaft.tables[0].all_sure  # another wheel's


@pytest.mark.long
def test_an_unbalanced_shaft_is_not_corrected_faster_than_it_was_learnt_from():
    """Its ripple falls with the square of the speed, within a turn and not after several."""
    angle, velocity = cogging(np.repeat([12.0, 24.0], [12_000, 1500]), times=1.0)
    stamps = START_NS + 1_000_000 * np.arange(len(angle))
    joints = joint('kalman', 'none'), joint('kalman')
    for each in joints:
        each.run(stamps[:12_000], eccentric(angle[:12_000], 0.0))
    assert 'or motion' in joints[1].why()
    off, on = (each.run(stamps[12_000:], eccentric(angle[12_000:], 0.0)) for each in joints)
    turn = round(1000.0 * TURN / 24.0)
    assert joints[1].why() == ''
    wrong = [error(out, velocity[12_000:], 2.5 * turn / 1500.0) for out in (off, on)]
    assert wrong[1] < 1.5 * wrong[0]


def test_a_cogging_torque_is_dropped_at_another_speed():
    """A speed that ripples with the angle is as an error of the sensor only while it is steady."""
    angle, _ = cogging(np.repeat([12.0, 36.0], 6000))
    stamps = START_NS + 1_000_000 * np.arange(len(angle))
    learning = joint(quantum=TURN / 4096)
    learning.run(stamps[:6000], eccentric(angle[:6000], 0.0))
    assert learning.why()
    learning.run(stamps[6000:], eccentric(angle[6000:], 0.0))
    assert not learning.why()


@pytest.mark.long
def test_a_motion_that_another_speed_has_shown_is_not_learnt_at_one_speed_again():
    mean = np.repeat([12.0, 20.0], [5000, 11_000])
    angle, _ = cogging(mean)
    angle = np.insert(angle, np.full(35_000, 9000), angle[9000])  # it stands for 35 s
    stamps, readings = START_NS + 1_000_000 * np.arange(len(angle)), eccentric(angle, 0.0)
    learning, awake = joint('kalman', quantum=TURN / 4096), []
    for first in range(0, len(angle), 500):
        rows = slice(first, first + 500)
        learning.run(stamps[rows], readings[rows])
        awake.append(learning.learner.awake)
        if first == 4500:
            assert 'or motion' in learning.why()
        if first > 7000:
            assert learning.why() == ''
    assert awake[17] and not awake[84] and awake[-1]  # it rested, and tried again


@pytest.mark.parametrize('other', [13.0, 24.0])
def test_errors_as_large_as_a_motion_need_another_speed(other):
    stamps, angle, _ = sampled(lambda t: np.where(t < 6.0, 15.0, other), 12.0)
    learning, readings = joint('kalman', quantum=TURN / 4096), eccentric(angle, 0.08)
    learning.run(stamps[:6000], readings[:6000])
    assert learning.why() == ''
    learning.run(stamps[6000:], readings[6000:])
    assert ('of up to 5 deg' in learning.why()) is (other == 24.0)
    assert 'or motion' not in learning.why()


@pytest.mark.parametrize('sensor', [True, False])
def test_a_slower_turn_shows_the_sensor_but_no_motion(sensor):
    mean = np.repeat([20.0, 12.0], 4000)
    if sensor:
        readings = eccentric(np.cumsum(mean) / 1000.0)
    else:
        readings = eccentric(cogging(mean)[0], 0.0)
    stamps, learning = START_NS + 1_000_000 * np.arange(8000), joint('kalman', quantum=TURN / 4096)
    for part, doubt in ((slice(4000), True), (slice(4000, None), not sensor)):
        learning.run(stamps[part], readings[part])
        assert 'sensor errors' in learning.why()
        assert ('or motion' in learning.why()) is doubt


def test_what_may_be_motion_widens_the_interval_by_as_much():
    stamps, angle, _ = sampled(12.0, 5.0)
    learning, knowing = (
        joint('kalman', each, quantum=TURN / 4096).run(stamps, eccentric(angle, size))
        for each, size in (('learn', 0.01), ('none', 0.0))
    )
    for of, rms in (('velocity_stddev', 0.01 * 12.0), ('position_stddev', 0.01)):
        wide, usual = (getattr(out, of)[4000:] for out in (learning, knowing))
        more = np.sqrt(np.mean(wide**2 - usual**2))
        assert more == pytest.approx(rms / math.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize('observer', ['edge_adaptive', 'hybrid_angle'])
@pytest.mark.long
def test_what_may_be_motion_is_in_the_interval_until_another_speed_shows_the_sensor(observer):
    """At one speed a cogging torque is as an error of the sensor: the interval covers both."""
    angle, velocity = cogging(np.full(10_000, 12.0))
    stamps = START_NS + 1_000_000 * np.arange(20_000)
    learning = joint(observer, quantum=TURN / 4096)
    out = learning.run(stamps[:10_000], eccentric(angle, 0.0))
    assert 'sensor errors' in learning.why()
    wrong = np.abs(out.velocity - velocity)[7000:]
    assert np.mean(wrong <= 1.96 * out.velocity_stddev[7000:]) > 0.9
    _, angle, _ = sampled(lambda t: np.where(t < 8.0, 12.0, 20.0), 20.0)
    learning = joint(observer)
    out = learning.run(stamps, eccentric(angle, 0.01))
    assert 'sensor errors' in learning.why()
    assert np.median(out.velocity_stddev[6000:8000]) > 0.05  # of a ripple of 0.085 rad/s rms
    exact, without = (
        joint(observer, 'none').run(stamps, eccentric(angle, size)).velocity_stddev[-5000:]
        for size in (0.0, 0.01)
    )
    assert np.median(out.velocity_stddev[-5000:] - exact) < 0.1 * np.median(without)


def test_the_map_survives_a_gap_and_is_proven_again_after_an_outage():
    stamps, angle, _ = sampled(12.0, 6.0)
    readings = eccentric(angle)
    for pause, kept in ((0.3, True), (30.0, False)):
        learning = joint(quantum=TURN / 4096)
        learning.run(stamps[:4500], readings[:4500])
        learning.update(int(stamps[4500]) + round(1e9 * pause), float(readings[4500]))
        assert bool(learning.why()) is kept
        learning.run(stamps[4501:] + round(1e9 * pause), readings[4501:])
        assert learning.why()
    learning.reset()
    assert not learning.why()
    assert not learning.learner.awake


@pytest.mark.slow  # compiles
def test_live_equals_a_batch_and_the_compiled_one():
    stamps, angle, _ = sampled(lambda time: 30.0 * np.cos(0.8 * time), 5.0)
    readings = eccentric(angle)
    values = {'quantum': TURN / 4096}
    plain = joint('kalman', **values).run(stamps, readings)
    fast = joint('kalman', **values).run(stamps, readings)
    live = joint('kalman', **values)
    for k, (stamp_ns, reading) in enumerate(zip(stamps.tolist(), readings.tolist())):
        assert live.update(stamp_ns, reading)
        assert live.estimate()[:2] == (plain.position[k], plain.velocity[k])
    assert live.why()
    for one, other in zip(plain, fast):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow  # compiles
def test_a_batch_of_a_joint_that_does_not_turn_round_copies_no_estimates():
    stamps, angle, _ = sampled(lambda time: 5.0 * np.sin(12.0 * time), 400.0)
    learning = joint('kalman')
    learning.run(stamps[:10], angle[:10])
    tracemalloc.start()
    out = learning.run(stamps[10:], angle[10:])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1.5 * sum(column.nbytes for column in out)


@pytest.mark.long
def test_live_equals_batches_in_parts_with_gaps_and_lost_samples():
    stamps, angle, _ = sampled(20.0, 8.0, 600.0)
    readings = eccentric(angle)
    for at, pause in ((1500, 0.3), (3900, 0.3), (4200, 5.0)):
        stamps[at:] += round(1e9 * pause)
    readings[[900, 2000, 2001]] = math.nan
    stamps[1200] = stamps[1199]
    batch, live, velocities, learnt = joint('kalman'), joint('kalman'), [], set()
    for part in np.split(np.arange(len(stamps)), [70, 1501, 2222, 4000]):
        velocities += batch.run(stamps[part], readings[part]).velocity.tolist()
    for stamp_ns, reading, velocity in zip(stamps.tolist(), readings.tolist(), velocities):
        if live.update(stamp_ns, reading):
            assert live.estimate()[1] == velocity
        learnt.add(live.why() != '')
    assert learnt == {True, False}
    assert batch.why() == live.why() and batch.counts == live.counts


def test_the_errors_that_are_reported_are_those_of_the_sensor_and_go_with_its_quantum():
    """Within two counts: a fifth of the largest. Another quantum is another sensor's; the speed
    goes on.
    """
    stamps, angle, _ = sampled(12.0, 9.0)
    learning, plain = joint(quantum=TURN / 4096), joint(sensor_map='none')
    angles = np.linspace(-3.1, 3.1, 60)
    for each in (learning, plain):
        each.run(stamps, eccentric(angle))
        speed = each.estimate()[1]
        found = each.sensor_errors(1)(angles, np.full(60, 12.0))
        if each is learning:
            assert np.max(np.abs(found - found.mean() + 0.03 * np.sin(angles))) < 2 * TURN / 4096
            assert re.fullmatch(
                r'sensor errors of up to 2 deg that repeat each turn are taken out '
                r'\(largest near (80|90|100|260|270|280) deg\), '
                r'or motion: turns 1.4 times as fast will show it',
                each.why(),
            )
        each.set_gains(dataclasses.replace(each.gains, quantum=TURN / 2048))
        assert not np.any(each.sensor_errors(1)(angles, np.full(60, 12.0)))
        assert 'taken out' not in each.why()
        assert each.estimate()[1] == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize('lowest', [-math.pi, 0.0])
def test_corrected_positions_keep_the_interval_of_the_readings(lowest):
    stamps, angle, _ = sampled(12.0, 6.0)
    readings = (eccentric(angle + 1.5) - lowest) % TURN + lowest
    out = joint(quantum=TURN / 4096).run(stamps, readings)
    assert lowest - 1e-9 <= np.nanmin(out.position) < np.nanmax(out.position) < lowest + TURN


def test_without_a_map_the_track_is_the_same_as_before():
    assert not joint(sensor_map='none').channel.map.active
    assert not joint(wrap_period=0.0).channel.map.active


def rippled(rate=2000.0):
    """Return (stamps, readings, true velocity): fast turns, then slow ones that ripple.

    12 counts a turn; each rising edge is late by 2 ms.
    """
    time = np.arange(round(18.0 * rate)) / rate
    velocity, angle = np.zeros(len(time)), np.zeros(len(time))
    at = 0.1
    for k, mean in enumerate(np.where(time < 5.0, 20.0, 3.0).tolist()):
        velocity[k] = mean * (1.0 + 5.4 / mean**2 * math.cos(2.0 * at))
        at += velocity[k] / rate
        angle[k] = at
    size = TURN / 12
    edge = np.floor(angle / size)
    behind = (edge % 2 == 1) & (angle - edge * size < 2e-3 * velocity)
    stamps = START_NS + np.rint(1e9 * time).astype(np.int64)
    return stamps, wrapped((edge - behind) * size), velocity


@pytest.mark.long
def test_a_ripple_of_a_slow_shaft_is_foreseen():
    stamps, readings, velocity = rippled()
    off, on, learning = both('edge_adaptive', stamps, readings, velocity, 0.6, quantum=TURN / 12)
    assert on < off / 2.0
    assert 'a ripple of the speed that repeats each 180 deg is foreseen' in learning.why()
    # one that takes no edge as a time gains nothing
    follows = joint('pll', quantum=TURN / 12)
    follows.run(stamps, readings)
    assert 'ripple' not in follows.why()


def test_a_ripple_comes_in_over_one_period_of_it():
    stamps, readings, _ = rippled(1000.0)
    learning, shares = joint(quantum=TURN / 12), set()
    for part in np.split(np.arange(10_000), 200):
        learning.run(stamps[part], readings[part])
        shares.add(learning.learner.shaft.share)
    assert {0.0, 1.0} < shares
    assert min(shares - {0.0}) < 0.6


def test_the_smoothed_velocity_has_no_errors_that_are_learnt():
    stamps, angle, velocity = sampled(12.0, 5.0)
    readings, quantum, lag = eccentric(angle), TURN / 4096, 50
    errors = []
    for sensor_map in ('none', 'learn'):
        found, smoother = joint('pll', sensor_map, quantum=quantum), Smoother(0.05, TURN, quantum)
        out = []
        for k, (stamp_ns, reading) in enumerate(zip(stamps.tolist(), readings.tolist())):
            found.update(stamp_ns, reading)
            smoother.add(stamp_ns, reading, reading, k == 0, found.correction())
            if k >= lag:
                out.append(smoother.result()[1])
        errors.append(np.sqrt(np.mean((out[4500:] - velocity[4500:-lag]) ** 2)))
    assert errors[1] < errors[0] / 20.0
