# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The pieces of the edge-aware adaptive observer."""

import math

import numpy as np
import pytest

from estimator_pkg.observers.angle.edge import bandwidth as edge_bandwidth
from estimator_pkg.observers.angle.edge import constants as edge_constants
from estimator_pkg.observers.angle.edge import covariance as edge_covariance
from estimator_pkg.observers.angle.edge import observer as edge_observer
from estimator_pkg.observers.angle.edge import quantum as edge_quantum
from estimator_pkg.observers.angle.edge import sensor as edge_sensor
from estimator_pkg.observers.angle.edge import sigma as edge_sigma
from estimator_pkg.observers.angle.edge import start as edge_start
from estimator_pkg.observers.angle.edge.bandwidth import Band, Sway
from estimator_pkg.observers.angle.edge.interval import HELD, INTERVAL, NOTHING, interval, within
from estimator_pkg.observers.angle.edge.motion import Motion
from estimator_pkg.observers.angle.edge.sensor import Sensor
from estimator_pkg.observers.angle.edge.start import Doubt
from estimator_pkg.observers.maths.covariance import Covariance

Q = 1.0
SLACK = 0.3


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


def made(record, *values, **fields):
    """A record with these values, in their order or by name."""
    new = record()
    for name, value in (*zip(record.fields, values), *fields.items()):
        setattr(new, name, value)
    return new


def values(record):
    """The values of a record of numbers."""
    return tuple(getattr(record, name) for name in type(record).fields)


def covariance():
    return made(Covariance, 1e-4, 1e-3, 5e-3, 0.04, 0.3, 5.0)


def begun_band(density):
    band = Band()
    edge_bandwidth.begin_band(band, density)
    return band


def begun_sensor(quantum):
    sensor = Sensor()
    edge_sensor.begin_sensor(sensor, quantum)
    return sensor


def follow(innovations, gain=0.1, slack=SLACK):
    band, dates = begun_band(1.0), []
    for z in innovations:
        _, date, _ = edge_bandwidth.follow_band(band, z, gain, 1e-3, 1e-30, slack)
        if date > 0.0:
            dates.append(date)
    return math.log(band.density), dates


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
    return np.array([[p.p00, p.p01, p.p02], [p.p01, p.p11, p.p12], [p.p02, p.p12, p.p22]])


def test_opening_keeps_the_covariance_positive_and_explains_the_deviation():
    wide, opened = covariance(), covariance()
    edge_covariance.widen(wide, 2.0)
    assert np.all(np.linalg.eigvalsh(full(wide)) > 0.0)
    assert wide.p11 / covariance().p11 == pytest.approx(math.exp(1.0))
    edge_covariance.add_manoeuvre(opened, 0.01, 5e-3)
    added = full(opened) - full(covariance())
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
    sensor, steps = begun_sensor(quantum), edge_quantum.Steps()
    edge_quantum.begin_steps(steps)
    for i in range(1, len(angles)):
        step = angles[i] - angles[i - 1]
        if step != 0.0:
            edge_quantum.search(steps, step, abs(angles[i]), quantum, sensor)
        dt, found = 1e-3 if dts is None else dts[i], edge_quantum.quantum_of(steps, quantum)
        edge_sensor.follow_sensor(sensor, step, step, dt, found, math.inf)
    return sensor, steps


def test_scatter_is_the_noise_whatever_the_motion_and_the_sample_times():
    random = np.random.default_rng(3)
    dts = random.uniform(0.6e-3, 1.4e-3, 4000)
    t = np.cumsum(dts)
    noise = 0.05
    scatters = [
        sensed(
            (5.0 * t * t + noise * random.normal(size=4000))[k : k + 200], dts[k : k + 200], 1e-3
        )[0].scatter
        for k in range(0, 3800, 200)
    ]
    assert math.sqrt(np.mean(scatters)) == pytest.approx(noise, rel=0.1)


def test_quantisation_is_never_taken_for_noise():
    for speed in np.linspace(0.01, 40.0, 57):
        angles = np.floor(speed * np.arange(500) * 1e-3 / 0.01) * 0.01
        sensor, _ = sensed(angles)
        assert math.sqrt(sensor.noise) < 0.0004


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
    band = begun_band(1.0)
    for z in 2.0 * np.random.default_rng(3).choice([-1.0, 1.0], size=300):
        edge_bandwidth.follow_band(band, z, 0.1, 1e-3, 1e-30, SLACK)
    assert band.squares == pytest.approx(4.0, rel=0.01)


def sways(deviations):
    """The mean of `follow_sway` after each of the deviations."""
    sway, means = Sway(), []
    for ahead in deviations:
        edge_bandwidth.follow_sway(sway, ahead, math.inf, True)
        means.append(sway.mean)
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
    for last, mean in ((-1e9, -4.0 / 32.0), (1e9, 4.0 / 32.0)):
        sway = made(Sway, last=last, before=1.0)
        edge_bandwidth.follow_sway(sway, 1.0, 4.0, True)
        assert sway.mean == mean


def test_a_sway_is_white_acceleration():
    dt, sway = 2e-3, 3e-6
    rate = 2.0 * sway / dt**3  # (rad/s)^2 per s
    p = made(Covariance, 1e-6, 0.0, 0.1, 1.0, 0.2, 5.0)
    edge_covariance.add_sway(p, sway, dt)
    assert values(p) == pytest.approx(
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
    r, left, p = 2e-6, 0.3, covariance()
    before = full(p)
    s = before[0, 0] + r
    expected = before - (1.0 - left) / s * np.outer(before[0], before[0])
    edge_covariance.correct_covariance(p, r, left)
    assert full(p) == pytest.approx(expected)


def test_a_measurement_far_finer_than_the_prediction_leaves_a_covariance():
    """Known to 1e-10 of a deviation of 1e5: what rounding leaves must be one still."""
    for r in (1e-10, 1e-14, 1e-20):
        p = made(Covariance, 1e10, 1e13, 1e16, 1e16, 1e19, 1e22)
        edge_covariance.correct_covariance(p, r, 0.0)
        assert 0.0 < p.p00 <= r * (1.0 + 1e-12)
        assert p.p11 * p.p00 >= p.p01 * p.p01 * (1.0 - 1e-12)
        assert p.p22 * p.p00 >= p.p02 * p.p02 * (1.0 - 1e-12)


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
    manoeuvre = 20.0 * 0.01 / 0.2**5

    def after(beyond, date, most=1e3, quiet=8.0, density=1e-6):
        """The density of a band whose last manoeuvre was `quiet` [s] ago."""
        band = begun_band(density)
        band.quiet = quiet
        edge_bandwidth.expect_manoeuvres(band, beyond, date, most)
        assert values(band)[1:] == values(begun_band(density))[1:]
        return band.density

    # it is spread over the time since the one before: 0.2 s in 8 s, 0.2 s in 0.1 s
    assert after(0.1, 0.2) == pytest.approx(0.2 / 8.0 * manoeuvre)
    assert after(0.1, 0.2, quiet=0.1) == pytest.approx(manoeuvre)
    assert after(1e-3, 0.2, density=1.0) == 1.0  # it does not fall
    assert after(-0.1, 0.2) == 1e-6  # a cell may hide it
    assert after(6.28, 0.02, most=5.0) == 5.0


def test_the_doubt_of_a_new_speed_is_what_the_way_since_the_last_edge_leaves_open():
    speed, dt, noise, square = 3.0, 0.01, 0.002, 1e-4

    def settled(*doubt, square=square):
        doubt = made(Doubt, *doubt)
        edge_start.settle(doubt, speed, 0.1, 0.04, dt, square, noise)
        return values(doubt)

    def later(dt, *doubt):
        doubt = made(Doubt, *doubt)
        edge_start.pass_time(doubt, dt)
        return pytest.approx(values(doubt))

    before = (9.0, edge_start.UNSURE, 1.0, 2.0, 0.0, 0.0)
    # the second edge after a rest of 0.04 s: off by the mean speed since then, and a sample's way
    after, left, *times, _, _ = settled(*before)
    way = (0.1 / 0.05) ** 2 * dt * dt
    own = (0.1 / 0.05 - speed) ** 2 + (min(way, square) + 12.0 * noise) / 0.05**2
    assert after == pytest.approx(own) and (left, times) == (edge_start.UNSURE - 1.0, [1.0, 2.0])
    # a cell, where it is less than a sample's way
    fine = settled(*before, square=1e-9)[0]
    assert after - fine == pytest.approx((way if way < square else square) / 0.05**2, rel=1e-3)
    coarse = settled(*before, square=1.0)[0]
    assert coarse - fine == pytest.approx(way / 0.05**2, rel=1e-3)
    mean = settled(9.0, edge_start.SETTLES - 0.5, 1.0, 2.0, 0.0, 0.0)[0]
    assert mean == pytest.approx(0.5 * (own + 9.0))  # from the second on, with the one before
    recent = edge_start.RECENT
    for since, age in ((recent, recent), (0.9 * recent, recent), (recent, 0.9 * recent)):
        left = 0.0 if since == age else edge_start.LAST
        assert settled(9.0, 1.0, since, age, 2.0, 0.1) == (0.0, left, since, age, 2.0, 0.1)
        almost = (4.0, edge_start.LAST, since - 0.01, age - 0.01, 2.0, 0.1)
        assert later(0.01, *almost) == (4.0, left, since, age, 2.0, 0.1)
    assert later(0.2, 4.0, 2.0, 0.2, 0.1, 0.0, 0.0) == (4.0, 2.0, 0.4, 0.3, 0.0, 0.0)


def test_readings_in_noise_add_up_to_a_start_and_one_alone_may_show_it():
    dt, quantum, noise = 1e-3, 2.0, 4.0

    def after(doubt, *offs):  # distances from the cell in standard deviations of the noise
        doubt = made(Doubt, *doubt)
        for off in offs:
            off = math.copysign(0.5 * quantum + 2.0 * abs(off), off)
            edge_start.doubt_in_noise(doubt, off, 0.0, quantum, noise, dt, 0.0)
        return values(doubt)

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
    p, finer, band = Covariance(), Covariance(), Band()
    edge_start.stand(p, band, Q)
    edge_start.stand(finer, band, 0.1 * Q)
    blur, floor, long = edge_constants.BLUR, Q * Q / 12.0, edge_constants.LONGEST
    expected = (blur * blur, 0.0, 0.0, floor / long**2, 0.0, floor / long**4)
    assert values(p) == pytest.approx(expected)
    assert values(finer) == pytest.approx([0.01 * each for each in values(p)])


def begun_state(design, reading=7.0):
    state = edge_observer.State()
    edge_observer.start(edge_observer, state, design, reading)
    return state


@pytest.mark.parametrize('jump', [0.6, -0.6, 3e-8])
def test_a_jump_that_lasts_is_the_quantum_whatever_was_read_before(jump):
    design, p = edge_observer.Design(), Covariance()
    state = begun_state(design)
    state.steps.jump = jump
    edge_observer.believe_jump(state, design, 7.0, 1e-3)
    assert edge_quantum.quantum_of(state.steps, 0.0) == state.sensor.quantum == abs(jump)
    assert state.motion.angle == 7.0 - 0.5 * jump  # at the edge
    edge_start.stand(p, Band(), abs(jump))
    assert values(state.p) == values(p)


@pytest.mark.parametrize('part, starts', [(0.68, False), (0.72, True)])
def test_a_shaft_of_which_less_than_a_cell_is_known_may_start(part, starts):
    def stirs(first=False, **sensor):
        design = made(edge_observer.Design, quantum=Q)
        state = begun_state(design)
        state.p.p00, state.p.p11, state.p.p22 = part * Q * Q / 12.0, 1.0, 1.0
        state.reading.rested, state.reading.first = 1.0, first
        for name, value in sensor.items():
            setattr(state.sensor, name, value)
        edge_observer.stir(state, design, 1e-3)
        return state.doubt.to_settle == edge_start.UNSURE

    assert stirs() is starts
    assert stirs(first=True)  # the first of all
    assert not stirs(first=True, noise=1.01 * edge_constants.PLAIN * Q * Q)


def test_an_unchanged_reading_allows_the_larger_of_quantum_and_last_change_since_then():
    noise = 1e-4
    for change, way in ((0.3, 1.0), (2.5, 2.5)):
        sensor = made(Sensor, quantum=Q, noise=noise, size=change, since=0.2)
        allowed = way + 2.0 * edge_constants.SIGMAS * math.sqrt(noise)
        assert edge_sigma.fastest(sensor, 0.0) == pytest.approx(allowed / 0.2)
        assert edge_sigma.fastest(sensor, -0.5) == pytest.approx((allowed + 0.5) / 0.2)


def test_a_start_is_the_line_through_two_readings():
    dt, noise, floor = 2e-3, 0.05, Q * Q / 12.0 + 0.05
    motion, p = Motion(), Covariance()
    edge_start.begin_line(motion, p, Band(), 7.0, 3.0, dt, Q, noise, 0.0)
    assert values(motion) == (7.0, 3.0 / dt, 0.0, 0.0)
    assert (p.p00, p.p01, p.p02) == pytest.approx((floor, floor / dt, 0.0))
    assert p.p11 == pytest.approx((2.0 * floor + 0.25 * edge_start.swerve(Q, 0.0)) / dt**2)


def test_what_a_start_hides_is_a_parabola_in_a_quantum_and_two_samples_of_acceleration():
    assert edge_start.unseen(0.0, Q, 0.0, 1e-3, 0.1) == pytest.approx(0.5 * (4.0 * Q / 0.1) ** 2)
    assert edge_start.unseen(-5.0, 0.0, 0.0, 1e-3, 0.1) == pytest.approx(
        (2.0 * edge_start.LAG * 5.0 * 1e-3) ** 2
    )
