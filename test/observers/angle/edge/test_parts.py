# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The pieces of the edge-aware adaptive observer."""

import math

import numpy as np
import pytest

from estimator_pkg.observers.angle.edge import bandwidth as edge_bandwidth
from estimator_pkg.observers.angle.edge import constants as edge_constants
from estimator_pkg.observers.angle.edge import covariance as edge_covariance
from estimator_pkg.observers.angle.edge import quantum as edge_quantum
from estimator_pkg.observers.angle.edge import sensor as edge_sensor
from estimator_pkg.observers.angle.edge import sigma as edge_sigma
from estimator_pkg.observers.angle.edge import start as edge_start
from estimator_pkg.observers.angle.edge.interval import HELD, INTERVAL, NOTHING, interval, within

Q = 1.0
SLACK = 0.3
COVARIANCE = (1e-4, 1e-3, 5e-3, 0.04, 0.3, 5.0)


@pytest.mark.parametrize(
    'e, half',
    [(0.0, 1.0), (0.5, 0.2), (-3.0, 0.5), (2.0, 5.0), (3.9, 0.4), (1.0, 1e-4), (-0.3, 1e-2)],
)
def test_within_is_the_truncated_gaussian(e, half):
    from scipy import stats  # takes half a second to import

    sigma = 0.7
    mean, ratio = within(e, half, sigma)
    exact = stats.truncnorm((e - half) / sigma, (e + half) / sigma, scale=sigma)
    assert mean == pytest.approx(exact.mean(), abs=1e-6 * sigma)
    assert ratio == pytest.approx(exact.var() / sigma**2, rel=1e-2, abs=1e-6)


@pytest.mark.parametrize('e, half', [(9.0, 1.0), (30.0, 0.01), (-40.0, 3.0)])
def test_far_in_the_tail_the_mean_is_at_the_near_end(e, half):
    mean, ratio = within(e, half, 1.0)
    near = abs(e) - half
    assert near < abs(mean) < min(near + 1.01 / near, abs(e) + half)
    assert 0.0 < ratio < 1.2 / near**2


def test_an_edge_places_the_angle_within_the_way_made_behind_it():
    # creep: 0.1 quanta per sample, one count further; the cell's centre is 0.4 ahead
    kind, centre, half = interval(0.4, 1.0 - 0.1, Q, 1e-4, 0.0, False)
    assert kind == INTERVAL
    assert 2.0 * half == pytest.approx(0.1)
    assert centre - half == pytest.approx(0.4 - 0.5)  # from the lower edge of the cell on
    kind, centre, half = interval(-0.4, -1.0 + 0.1, Q, 1e-4, 0.0, False)
    assert kind == INTERVAL and centre + half == pytest.approx(-0.4 + 0.5)


@pytest.mark.parametrize('whole', [0, 1, 130])
def test_a_frame_that_moves_along_changes_nothing(whole):
    """130.1 counts a sample are told from 131 as 0.1 from 1."""
    moved = whole + 0.1
    assert interval(0.4, whole + 1.0 - moved, Q, 1e-4, 0.0, False) == pytest.approx(
        interval(0.4, 0.9, Q, 1e-4, 0.0, False)
    )
    assert interval(0.2, whole - moved, Q, 1e-4, 0.0, False)[0] == NOTHING


def test_without_an_edge_a_prediction_outside_is_held_and_one_inside_is_left_alone():
    noise = (0.1 / 3.0) ** 2  # three standard deviations are a tenth of a quantum
    assert interval(0.3, -0.1, Q, 1e-4, noise, False)[0] == NOTHING
    assert interval(0.59, -0.1, Q, 1e-4, noise, False)[0] == NOTHING
    assert interval(0.61, -0.1, Q, 1e-4, noise, False)[0] == HELD
    assert interval(-0.61, -0.1, Q, 1e-4, noise, False)[0] == HELD
    for end in (-0.5, 0.5):  # known without noise: the end of a cell is in it
        assert interval(end, 0.0, Q, 1e-4, 0.0, False)[0] == NOTHING


def test_a_cell_is_news_where_less_is_known_and_where_the_speed_was_wrong():
    assert interval(0.3, -0.1, Q, 0.09, 0.0, False) == (INTERVAL, 0.3, 0.5)
    assert interval(3.0, 2.5, Q, 1e-4, 0.0, False) == (INTERVAL, 3.0, 0.5)
    # a little faster than thought
    kind, centre, half = interval(0.6, 1.2, Q, 1e-4, 0.0, False)
    assert kind == INTERVAL and half == 0.0 and centre == pytest.approx(0.1)


def follow(innovations, gain=0.1, slack=SLACK):
    band = edge_bandwidth.begin_band(1.0)
    dates = []
    for z in innovations:
        band, _, date, _ = edge_bandwidth.follow_band(band, z, gain, 1e-3, 1e-30, slack)
        if date > 0.0:
            dates.append(date)
    return math.log(band[0]), dates


def test_density_rises_where_innovations_go_on_and_falls_where_they_are_white():
    random = np.random.default_rng(1)
    white = random.normal(size=4000)
    lagging = np.convolve(white, np.ones(20) / math.sqrt(20.0), 'same')
    eager = np.diff(white) / math.sqrt(2.0)
    assert follow(lagging)[0] > 5.0
    assert -12.0 < follow(white)[0] < -3.0  # the slack alone: 0.3 * 0.022 * 0.3 * 4000
    assert follow(eager)[0] < follow(white)[0]
    assert abs(follow(white, slack=0.0)[0]) < 5.0  # unbiased
    # noise alone does not open it, however the noise is thought of
    assert abs(follow(1.5 * white, slack=0.0)[0]) < 8.0


def test_an_alarm_takes_more_than_one_sample_and_is_dated():
    assert follow([12.0])[1] == []
    assert follow([0.0] * 50 + [12.0] + [0.0] * 50)[1] == []
    assert follow([12.0, 12.0])[1] == [pytest.approx(2e-3)]
    assert follow([0.0] * 50 + [-7.5] * 3)[1] == [pytest.approx(3e-3)]
    assert follow(np.random.default_rng(2).normal(size=20_000))[1] == []


def full(p):
    return np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])


def test_opening_keeps_the_covariance_positive_and_explains_the_deviation():
    wide = edge_covariance.widened(COVARIANCE, 2.0)
    assert np.all(np.linalg.eigvalsh(full(wide)) > 0.0)
    assert wide[3] / COVARIANCE[3] == pytest.approx(math.exp(1.0))
    opened = edge_covariance.manoeuvred(COVARIANCE, 0.01, 5e-3)
    added = full(opened) - full(COVARIANCE)
    assert added[0, 0] == pytest.approx(1e-4)
    assert np.all(np.linalg.eigvalsh(added) > -1e-9)
    # half of it white jerk since then, half white acceleration: P_ij of the integrated chains
    date = 5e-3
    jerk, blow = 0.5e-4 * 20.0 / date**5, 0.5e-4 * 3.0 / date**3
    assert added[0, 1] == pytest.approx(jerk * date**4 / 8.0 + blow * date**2 / 2.0)
    assert added[1, 1] == pytest.approx(jerk * date**3 / 3.0 + blow * date)
    assert added[0, 2] == pytest.approx(jerk * date**3 / 6.0)
    assert added[1, 2] == pytest.approx(jerk * date**2 / 2.0)
    assert added[2, 2] == pytest.approx(jerk * date)


def sensed(angles, dts=None, quantum=0.01):
    sensor = edge_sensor.begin_sensor(quantum)
    steps = edge_quantum.FIRST_STEPS
    for i in range(1, len(angles)):
        step = angles[i] - angles[i - 1]
        if step != 0.0:
            steps = edge_quantum.follow_steps(
                steps, step, sensor[6], sensor[7], abs(angles[i]), quantum, sensor[2]
            )
        dt = 1e-3 if dts is None else dts[i]
        sensor = edge_sensor.follow_sensor(
            sensor, step, step, dt, edge_quantum.quantum_of(steps, quantum), math.inf
        )
    return sensor, steps


def test_scatter_is_the_noise_whatever_the_motion_and_the_sample_times():
    random = np.random.default_rng(3)
    dts = random.uniform(0.6e-3, 1.4e-3, 4000)
    t = np.cumsum(dts)
    noise = 0.05
    scatters = [
        sensed(
            (5.0 * t * t + noise * random.normal(size=4000))[k : k + 200], dts[k : k + 200], 1e-3
        )[0][2]
        for k in range(0, 3800, 200)
    ]
    assert math.sqrt(np.mean(scatters)) == pytest.approx(noise, rel=0.1)


def test_quantisation_is_never_taken_for_noise():
    for speed in np.linspace(0.01, 40.0, 57):
        angles = np.floor(speed * np.arange(500) * 1e-3 / 0.01) * 0.01
        sensor, _ = sensed(angles)
        assert math.sqrt(sensor[1]) < 0.0004


def test_noise_follows_its_score_within_blur_and_scatter():
    def after(noise, excess):
        return edge_sensor.follow_noise(noise, excess, 4e-6, 0.01)

    assert after(1e-6, 16.0) == pytest.approx(1.5e-6)
    assert after(1e-6, 32.0) == pytest.approx(2e-6)
    assert after(1e-6, 1e9) == pytest.approx(2e-6)
    assert after(3e-6, 1e9) == 4e-6
    assert after(1e-6, -1e3) == pytest.approx(9e-8)


def test_no_constant_speed_looks_like_a_vibration():
    """However the speed beats with the sampling, and at creep, from any phase."""
    quantum = 0.01
    for counts in (*np.linspace(0.003, 1.0, 41), 1.2, 2.0 / 3.0, 7.334, 130.67):
        for phase in (0.0, 0.37):
            angles = np.floor(counts * np.arange(300) + phase) * quantum
            for count in (20, 100, 300):
                assert edge_sensor.vibration(sensed(angles[:count], quantum=quantum)[0]) == 0.0


def test_noise_is_no_vibration():
    random = np.random.default_rng(8)
    for _ in range(30):
        sensor, _ = sensed(0.05 * random.normal(size=200), quantum=1e-3)
        assert edge_sensor.vibration(sensor) == 0.0


@pytest.mark.parametrize('period', [5.0, 7.0, 12.0])
def test_a_vibration_is_measured_by_its_third_differences(period):
    quantum, amplitude = 1e-6, 0.02
    angles = amplitude * np.sin(2.0 * math.pi * np.arange(600) / period)
    angles = np.round(angles / quantum) * quantum
    found = np.mean(
        [
            edge_sensor.vibration(sensed(angles[:count], quantum=quantum)[0])
            for count in range(540, 600)
        ]
    )
    third = np.mean(np.diff(angles, 3) ** 2)
    share = (3.0 + 8.0 * math.cos(2.0 * math.pi / period)) / 11.0
    whole = 20.0 * share * third / 1e-3**5
    assert 0.75 * whole < found < whole  # what is taken for noise is taken off


def test_the_size_of_the_innovations_is_remembered():
    band = edge_bandwidth.begin_band(1.0)
    for z in 2.0 * np.random.default_rng(3).choice([-1.0, 1.0], size=300):
        band = edge_bandwidth.follow_band(band, z, 0.1, 1e-3, 1e-30, SLACK)[0]
    assert band[7] == pytest.approx(4.0, rel=0.01)


def sways(deviations):
    """The mean of `follow_sway` after each of the deviations."""
    sway, means = edge_bandwidth.STEADY, []
    for ahead in deviations:
        sway = edge_bandwidth.follow_sway(sway, ahead, math.inf, True)
        means.append(sway[0])
    return np.array(means)


@pytest.mark.parametrize('counts', [0.004, 0.07, 0.25, 1.0 / 3.0, 0.4, 0.5, 0.63, 0.93, 1.02, 7.34])
def test_a_constant_speed_does_not_sway(counts):
    """However it beats with the sampling; the mean is that of edge_adaptive_theory.md."""
    moved = np.diff(np.floor(counts * np.arange(6001) + 0.123))
    means = sways(moved - counts)
    beside = abs(counts - round(counts))
    assert np.mean(means[600:]) == pytest.approx(-max(0.0, 3.0 * beside - 1.0), abs=0.01)
    assert np.max(means) < 1.0 / 6.0


def test_noise_does_not_sway_and_a_speed_that_goes_at_random_does():
    random = np.random.default_rng(5)
    noise = sways(np.diff(0.3 * random.normal(size=50_000)))
    assert np.mean(noise) == pytest.approx(-0.09, rel=0.05)
    assert np.max(noise) < 2.0 * 0.09
    kept = 0.95  # the speed forgets, lest it run away; a filter that lags sees the like
    speed = np.zeros(50_000)
    steps = 0.3 * random.normal(size=len(speed))
    for k in range(1, len(speed)):
        speed[k] = kept * speed[k - 1] + steps[k]
    assert np.mean(sways(speed)) == pytest.approx(0.09 * kept / (1.0 + kept), rel=0.1)
    assert sways([1.0, 1.0, 1.0, 1e6])[-1] < sways([1.0, 1.0, 1.0])[-1]  # lasting is no sway
    assert edge_bandwidth.follow_sway((0.0, -1e9, 1.0), 1.0, 4.0, True)[0] == -4.0 / 32.0
    assert edge_bandwidth.follow_sway((0.0, 1e9, 1.0), 1.0, 4.0, True)[0] == 4.0 / 32.0


def test_a_sway_is_white_acceleration():
    dt, sway = 2e-3, 3e-6
    rate = 2.0 * sway / dt**3  # (rad/s)^2 per s
    p = edge_covariance.swayed((1e-6, 0.0, 0.1, 1.0, 0.2, 5.0), sway, dt)
    assert p == pytest.approx(
        (1e-6 + rate * dt**3 / 3.0, rate * dt**2 / 2.0, 0.1, 1.0 + rate * dt, 0.2, 5.0)
    )


SUMS = (3.0, 12.0)  # their slack and alarm


def test_an_alarm_in_noise_dates_further_back():
    """A deviation t^3 of which only the part above SIGMAS counts: when did it begin?"""
    dt, grown = 1e-3, 2e-5
    z = grown * np.arange(400) ** 3.0
    run = np.cumsum(np.clip(z - SUMS[0], 0.0, None))
    alarm = int(np.argmax(run > SUMS[1]))
    first = int(np.argmax(z > SUMS[0]))
    date = (alarm - first + 1) * dt
    assert edge_bandwidth.began(date, dt, False) == pytest.approx(date + dt)
    assert edge_bandwidth.began(date, dt, True) == pytest.approx((alarm + 1) * dt, rel=0.4)
    assert edge_bandwidth.began(2.0 * dt, dt, True) == pytest.approx(3.0 * dt)
    assert edge_bandwidth.began(dt, dt, True) > 0.0


def test_a_measurement_corrects_the_covariance():
    r, left = 2e-6, 0.3
    before = full(COVARIANCE)
    s = before[0, 0] + r
    expected = before - (1.0 - left) / s * np.outer(before[0], before[0])
    assert full(edge_covariance.corrected(COVARIANCE, r, left)) == pytest.approx(expected)


def test_a_measurement_far_finer_than_the_prediction_leaves_a_covariance():
    """Known to 1e-10 of a deviation of 1e5: what rounding leaves must be one still."""
    p = (1e10, 1e13, 1e16, 1e16, 1e19, 1e22)
    for r in (1e-10, 1e-14, 1e-20):
        q = edge_covariance.corrected(p, r, 0.0)
        assert 0.0 < q[0] <= r * (1.0 + 1e-12)
        assert q[3] * q[0] >= q[1] * q[1] * (1.0 - 1e-12)
        assert q[5] * q[0] >= q[2] * q[2] * (1.0 - 1e-12)


def test_clean_floats_are_no_counts():
    """Steps that are no multiples of each other, and do not scatter, show no counter."""
    t = np.arange(4000) * 1e-4
    _, steps = sensed(0.3 + np.cumsum(1e-5 + 4e-8 * np.arange(4000)), quantum=0.0)
    found = edge_quantum.quantum_of(steps, 0.0)
    assert found < 1e-6  # a tenth of the smallest step
    coarse = np.floor((0.3 + 2.0 * t + 3.0 * t * t) / 1e-4) * 1e-4  # a counter that accelerates
    _, steps = sensed(coarse, quantum=0.0)
    assert edge_quantum.quantum_of(steps, 0.0) == pytest.approx(1e-4)


def test_the_density_expects_manoeuvres_like_the_last():
    begun, manoeuvre = edge_bandwidth.begin_band(1e-6), 20.0 * 0.01 / 0.2**5
    band = (*begun[:-1], 8.0)  # 8 s since the one before
    after = edge_bandwidth.after_manoeuvre(band, 0.1, 0.2, False, 1e3)
    assert after == (pytest.approx(0.01 * manoeuvre), *band[1:-1], 0.0)
    assert edge_bandwidth.after_manoeuvre(after, 1e-3, 0.2, False, 1e3) == after  # it does not fall
    hidden = edge_bandwidth.after_manoeuvre(band, -0.1, 0.2, True, 1e3)
    assert hidden == (*band[:-1], 0.0)  # a cell may hide it
    # in noise it is spread over the time since the one before: 0.2 s in 8 s, 0.2 s in 0.1 s
    rare = edge_bandwidth.after_manoeuvre(band, 0.1, 0.2, True, 1e3)
    often = edge_bandwidth.after_manoeuvre((*begun[:-1], 0.1), 0.1, 0.2, True, 1e3)
    assert (rare[0], often[0]) == pytest.approx((0.2 / 8.0 * manoeuvre, manoeuvre))
    assert edge_bandwidth.after_manoeuvre(band, 6.28, 0.02, True, 5.0)[0] == 5.0


def test_the_doubt_of_a_new_speed_is_what_the_way_since_the_last_edge_leaves_open():
    speed, dt, noise, square = 3.0, 0.01, 0.002, 1e-4
    before = (9.0, edge_start.UNSURE, 1.0, 2.0, 0.0, 0.0)
    # the second edge after a rest of 0.04 s: off by the mean speed since then, and a sample's way
    after, left, *times, _, _ = edge_start.settled(before, speed, 0.1, 0.04, dt, square, noise)
    way = (0.1 / 0.05) ** 2 * dt * dt
    own = (0.1 / 0.05 - speed) ** 2 + (min(way, square) + 12.0 * noise) / 0.05**2
    assert after == pytest.approx(own) and (left, times) == (edge_start.UNSURE - 1.0, [1.0, 2.0])
    # a cell, where it is less than a sample's way
    fine = edge_start.settled(before, speed, 0.1, 0.04, dt, 1e-9, noise)[0]
    assert after - fine == pytest.approx((way if way < square else square) / 0.05**2, rel=1e-3)
    coarse = edge_start.settled(before, speed, 0.1, 0.04, dt, 1.0, noise)[0]
    assert coarse - fine == pytest.approx(way / 0.05**2, rel=1e-3)
    doubt = (9.0, edge_start.SETTLES - 0.5, 1.0, 2.0, 0.0, 0.0)
    mean = edge_start.settled(doubt, speed, 0.1, 0.04, dt, square, noise)[0]
    assert mean == pytest.approx(0.5 * (own + 9.0))  # from the second on, with the one before
    recent = edge_start.RECENT
    for since, age in ((recent, recent), (0.9 * recent, recent), (recent, 0.9 * recent)):
        left = 0.0 if since == age else edge_start.LAST
        doubt = (9.0, 1.0, since, age, 2.0, 0.1)
        last = edge_start.settled(doubt, speed, 0.1, 0.04, dt, square, noise)
        assert last == (0.0, left, since, age, 2.0, 0.1)
        almost = (4.0, edge_start.LAST, since - 0.01, age - 0.01, 2.0, 0.1)
        assert edge_start.later(almost, 0.01) == pytest.approx((4.0, left, since, age, 2.0, 0.1))
    doubt = edge_start.later((4.0, 2.0, 0.2, 0.1, 0.0, 0.0), 0.2)
    assert doubt == pytest.approx((4.0, 2.0, 0.4, 0.3, 0.0, 0.0))


def test_readings_in_noise_add_up_to_a_start_and_one_alone_may_show_it():
    dt, quantum, noise = 1e-3, 2.0, 4.0

    def after(doubt, *offs):  # distances from the cell in standard deviations of the noise
        for off in offs:
            off = math.copysign(0.5 * quantum + 2.0 * abs(off), off)
            doubt = edge_start.doubted_in_noise(doubt, off, 0.0, quantum, noise, dt, 0.0)
        return doubt

    rest = (0.0, 0.0, 9.0, 9.0, 0.0, 0.0)
    assert after(rest, 1.4, 1.4, 1.4) == pytest.approx((0.0, 0.0, 9.0, 9.0, 1.2, 3.0 * dt))
    begins = after(rest, 1.4, 1.4, 1.4, 1.4)  # their sum, 4 x 0.4, is above 1.5
    assert begins == pytest.approx((0.0, edge_start.PERHAPS, 9.0, 4.0 * dt, 4.0, 4.0 * dt))
    assert after(begins, 0.0, 0.0, 0.0)[1] == edge_start.PERHAPS
    over = after(begins, 0.0, 0.0, 0.0, 0.0)
    assert over == (0.0, edge_start.LAST, 9.0, edge_start.RECENT, 0.0, 0.0)
    # one beyond 2.5 alone, whatever those on the other side summed up to
    begins = after(rest, -1.9, -1.2, 2.6)
    assert begins == pytest.approx((0.0, edge_start.PERHAPS, 9.0, dt, 4.0, dt))
    variance, settles, *_ = after(rest, -4.1)
    assert variance > 0.0 and settles == edge_start.SETTLES


def test_a_shaft_that_stood_is_a_straight_line_from_its_cell_to_the_edge():
    p, _ = edge_start.stood(Q)
    blur, floor, long = edge_constants.BLUR, Q * Q / 12.0, edge_constants.LONGEST
    assert p == pytest.approx((blur * blur, 0.0, 0.0, floor / long**2, 0.0, floor / long**4))
    finer, _ = edge_start.stood(0.1 * Q)
    assert finer == pytest.approx([0.01 * each for each in p])


@pytest.mark.parametrize('jump', [0.6, -0.6, 3e-8])
def test_a_jump_that_lasts_is_the_quantum_whatever_was_read_before(jump):
    motion, p, _, sensor, steps, _ = edge_start.after_jump(jump, 7.0, 1e-3, 0.0, 0.0)
    assert edge_quantum.quantum_of(steps, 0.0) == sensor[0] == abs(jump)
    assert motion[0] == 7.0 - 0.5 * jump  # at the edge
    assert p == edge_start.stood(abs(jump))[0]


@pytest.mark.parametrize('part, starts', [(0.68, False), (0.72, True)])
def test_a_shaft_of_which_less_than_a_cell_is_known_may_start(part, starts):
    p = (part * Q * Q / 12.0, 0.0, 0.0, 1.0, 0.0, 1.0)
    doubt, sensor = edge_start.START, edge_sensor.begin_sensor(Q)
    assert edge_start.stirred(doubt, sensor, p, 1.0, 1e-3, False, 0.0)[1] is starts
    assert edge_start.stirred(doubt, sensor, p, 1.0, 1e-3, True, 0.0)[1]  # the first of all
    noisy = edge_sensor.with_noise(sensor, 1.01 * edge_constants.PLAIN * Q * Q)
    assert not edge_start.stirred(doubt, noisy, p, 1.0, 1e-3, True, 0.0)[1]


def test_an_unchanged_reading_allows_the_larger_of_quantum_and_last_change_since_then():
    noise = 1e-4
    for change, way in ((0.3, 1.0), (2.5, 2.5)):
        sensor = (Q, noise, 0.0, 0.0, 0.0, 1e-3, change, 0.2, math.inf, 0.0, 1e-3)
        allowed = way + 2.0 * edge_constants.SIGMAS * math.sqrt(noise)
        assert edge_sigma.fastest(sensor, 0.0) == pytest.approx(allowed / 0.2)
        assert edge_sigma.fastest(sensor, -0.5) == pytest.approx((allowed + 0.5) / 0.2)


def test_a_start_is_the_line_through_two_readings():
    dt, noise, floor = 2e-3, 0.05, Q * Q / 12.0 + 0.05
    motion, p, _ = edge_start.started(7.0, 3.0, dt, Q, noise, 0.0)
    assert motion == (7.0, 3.0 / dt, 0.0, 0.0)
    assert p[:3] == pytest.approx((floor, floor / dt, 0.0))
    assert p[3] == pytest.approx((2.0 * floor + 0.25 * edge_start.swerve(Q, 0.0)) / dt**2)


def test_what_a_start_hides_is_a_parabola_in_a_quantum_and_two_samples_of_acceleration():
    assert edge_start.unseen(0.0, Q, 0.0, 1e-3, 0.1) == pytest.approx(0.5 * (4.0 * Q / 0.1) ** 2)
    assert edge_start.unseen(-5.0, 0.0, 0.0, 1e-3, 0.1) == pytest.approx(
        (2.0 * edge_start.LAG * 5.0 * 1e-3) ** 2
    )
