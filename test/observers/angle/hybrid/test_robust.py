# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""hybrid_angle, the robust form: equations, streams, low speed, live changes; plain is compiled."""

import math

import numpy as np
import pytest
from angle_runs import MARGIN, PHI, TURN, Inner, make, stamps, wrapped

from estimator_pkg.estimate import COASTING, TRACKING
from estimator_pkg.observers.angle.hybrid.observer import HybridAngle
from estimator_pkg.parameters import build

# --- the robust form --------------------------------------------------------------------------


def test_second_order_follows_the_spec_line_by_line():
    """Spec 1.4 with tan: continued innovation, reset first, never past the measurement."""
    epsilon, dt = 0.05, 0.01
    inner = Inner(dt, order=2, injection='tan', epsilon=epsilon)
    z1, z2 = math.exp(-dt / epsilon), math.exp(-5.0 * dt / epsilon)
    a, b = 1.0 - z1 * z2, (1.0 - z1) * (1.0 - z2)
    random = np.random.default_rng(4)
    resets = capped = 0
    for _ in range(5000):
        last, error, velocity = random.uniform(-3, 3), random.uniform(-2.9, 2.9), 10.0
        y = last + velocity * dt + random.uniform(-0.7, 0.7)  # one sample is off by less than 1/8
        p = last - error + dt * velocity
        e = PHI['saw'](y - p)
        continued = error + PHI['saw'](e - error)
        if abs(continued) >= math.pi - MARGIN:
            expected = (y, velocity)
            resets += 1
        else:
            f = 2.0 * math.tan(0.5 * continued)
            if abs(f) > abs(continued) / a:
                f = math.copysign(abs(continued) / a, f)
                capped += 1
            expected = (y - (continued - a * f), velocity + b / dt * f)
        inner.put(last=last, error=error, velocity=velocity, phase=0.0)
        assert inner.correct(y) == pytest.approx(continued)
        assert (inner.core.position, inner.core.velocity) == pytest.approx(expected)
    assert resets > 50 and capped > 50


@pytest.mark.parametrize('name', ['saw', 'sat', 'sin'])
def test_third_order_is_set_on_the_reading_before_it_is_half_a_turn_off(name):
    """10 to -20 rad/s in 0.1 s at 0.5 Hz: the position slips, and each time it is put right (J2)
    within 5 degrees of half a turn, instead of coming back from the other side.
    """
    t = 1e-3 * np.arange(6000)
    speed = np.interp(t, (0.0, 2.0, 2.1, 6.0), (10.0, 10.0, -20.0, -20.0))
    angle = np.concatenate(((0.0,), np.cumsum(0.5 * (speed[1:] + speed[:-1])) * 1e-3))
    out = make(bandwidth_hz=0.5, injection=name).run(stamps(t), wrapped(angle))
    off = np.abs(wrapped(out.position - angle))
    assert np.max(off) < math.pi - MARGIN
    slips = np.flatnonzero((off[:-1] > 2.9) & (off[1:] < 1e-9))
    assert len(slips) > 1
    before, after = out.velocity[slips], out.velocity[slips + 1]
    gained = 1e-3 * out.acceleration[slips]  # the speed goes on as it was
    assert after - before == pytest.approx(gained, abs=1e-9)


def test_third_order_never_puts_the_position_past_the_measurement():
    """tan grows without bound towards half a turn; what it injects is held back."""
    dt = 0.01
    inner = Inner(dt, injection='tan', epsilon=0.05)
    random = np.random.default_rng(6)
    capped = 0
    for _ in range(3000):
        error, push = random.uniform(-2.9, 2.9), random.uniform(-0.1, 0.1)
        inner.put(last=1.0, error=error, velocity=10.0, acceleration=0.0, phase=0.0)
        innovation = inner.correct(1.0 + 10.0 * dt + push)
        left, velocity = inner.core.error, inner.core.velocity
        assert innovation == pytest.approx(error + push)
        assert left * innovation >= -1e-12 and abs(left) <= abs(innovation)
        assert (velocity - 10.0) * innovation >= 0.0
        capped += abs(innovation) > 0.1 and abs(left) < 1e-12
    assert capped > 300


def fitted(dt, readings, order):
    """(position, velocity) at the newest reading of the parabola, or line, of least squares."""
    times = dt * np.arange(1 - len(readings), 1)
    *_, velocity, position = np.polyfit(times, readings, min(order - 1, len(readings) - 1))
    return position, velocity


@pytest.mark.parametrize('dt, held', [(1e-3, 20), (0.02, 3)])
@pytest.mark.parametrize('order', [2, 3])
def test_after_readings_that_stay_astray_it_starts_from_the_newest_two(order, dt, held):
    """For 20 ms and three samples it holds the speed, in case they are outliers."""
    inner = Inner(dt, order=order, epsilon=0.2)
    position, speed, random = 0.4, 2.0, np.random.default_rng(2)
    inner.put(last=position, velocity=speed, phase=0.0)
    readings = [position]
    for k in range(1, held + 6):
        readings.append(position + (speed + 1.5 * (k > 1)) * dt * k + 1.2)
        readings[-1] += 1e-3 * random.standard_normal()
        innovation = inner.correct(readings[-1])
        assert math.isinf(innovation) == (k == held + 1)
        if k <= held:
            assert inner.core.velocity == speed
        else:
            expected = fitted(dt, readings[held:], order)
            now = inner.core.position, inner.core.velocity
            assert now == pytest.approx(expected, abs=1e-8)


# --- starts -----------------------------------------------------------------------------------


@pytest.mark.long
def test_injections_differ_at_large_errors_as_in_figure_4():
    """10 to -20 rad/s in 50 ms, epsilon 0.7 s: the spec's RMS errors, and its order."""
    t = 1e-3 * np.arange(8000)
    speed = np.interp(t, (0.0, 2.0, 2.05, 8.0), (10.0, 10.0, -20.0, -20.0))
    angle = np.concatenate(((0.0,), np.cumsum(0.5 * (speed[1:] + speed[:-1])) * 1e-3))
    for name, expected in {'tan': 8.104, 'saw': 8.227, 'sat': 12.498, 'sin': 13.992}.items():
        out = make(order=2, epsilon=0.7, injection=name).run(stamps(t), wrapped(angle))
        assert math.sqrt(np.mean((out.velocity - speed)[2000:] ** 2)) == pytest.approx(
            expected, rel=0.04
        ), name


def test_the_speed_limit_holds():
    t = 0.01 * np.arange(200)
    for order in (2, 3):
        joint = make(order=order, max_speed=5.0)
        out = joint.run(stamps(t), wrapped(8.0 * t))
        assert np.max(np.abs(out.velocity)) <= 5.0
        out = make(order=order, max_speed=5.0).run(stamps(t), wrapped(4.0 * t))
        assert out.velocity[-1] == pytest.approx(4.0)


@pytest.mark.parametrize('bandwidth, settled', [(5.0, 0.35), (2.0, 0.9), (1.0, 1.8)])
def test_no_acceleration_winds_up_at_the_speed_limit(bandwidth, settled):
    """3 to 8 rad/s and back with a limit of 5: at the limit no acceleration is published, and the
    speed is right again as soon as after any other ramp.
    """
    t = 0.01 * np.arange(1000)
    speed = np.interp(t, (0.0, 1.0, 2.0, 4.0, 5.0, 10.0), (3.0, 3.0, 8.0, 8.0, 3.0, 3.0))
    angle = np.concatenate(((0.0,), np.cumsum(0.5 * (speed[1:] + speed[:-1])) * 0.01))
    out = make(max_speed=5.0, bandwidth_hz=bandwidth).run(stamps(t), wrapped(angle))
    assert np.max(out.velocity) == 5.0
    assert np.max(np.abs(out.acceleration[250:400])) < 1.0
    late = (out.velocity > 4.9) & (t > 4.0)
    assert t[late][-1] < 4.65 + 0.3 / bandwidth
    assert np.max(np.abs(out.velocity - 3.0)[t > 5.0 + settled]) < 0.15


def test_a_gap_re_initialises_the_position_and_keeps_the_speed():
    t = np.concatenate((0.01 * np.arange(200), 0.01 * np.arange(240, 340)))
    angle = 150.0 * t
    joint = make(bandwidth_hz=5.0)
    out = joint.run(stamps(t), wrapped(angle))
    assert joint.events() == {'gap': 1}
    assert out.velocity[199:] == pytest.approx(150.0, abs=1e-5)
    assert wrapped(out.position - angle)[199:] == pytest.approx(0.0, abs=1e-6)
    assert out.status[199] == TRACKING and out.status[200] == COASTING
    assert out.status[-1] == TRACKING


def test_a_gap_after_which_the_speed_is_another():
    t = np.concatenate((0.01 * np.arange(200), 0.01 * np.arange(300, 400)))
    angle = np.where(t < 2.5, 150.0 * t, -40.0 * t)
    out = make().run(stamps(t), wrapped(angle))
    wrong = np.abs(out.velocity[200:] + 40.0) > 4.0
    assert not wrong[8:].any()
    assert not np.any(wrong & (out.status[200:] == TRACKING))
    assert out.status[-1] == TRACKING


@pytest.mark.parametrize('period', [TURN / 7.0, 1.0, 360.0])
def test_other_periods(period):
    limit = make(period=period).design.reset_from
    assert limit == pytest.approx((math.pi - MARGIN) * period / TURN)
    t = 1e-3 * np.arange(2000)
    speed = 20.0 * period / TURN
    for gains in ({}, {'injection': 'tan', 'order': 2}, {'form': 'paper', 'bandwidth_hz': 10.0}):
        out = make(period=period, **gains).run(stamps(t), (speed * t) % period)
        assert out.velocity[-1] == pytest.approx(speed, rel=1e-6)
        assert out.status[-1] == TRACKING
        assert np.all((out.position >= 0.0) & (out.position < period))


@pytest.mark.parametrize('order, lag', [(2, 1.5), (3, 0.1)])
def test_a_joint_without_a_circle_is_linear(order, lag):
    t = 1e-3 * np.arange(1000)
    position = 50.0 + 30.0 * np.sin(3.0 * t)  # metres; nothing wraps
    out = make(period=0.0, order=order).run(stamps(t), position)
    assert out.velocity[500:] == pytest.approx((90.0 * np.cos(3.0 * t))[500:], abs=lag)
    assert out.position[500:] == pytest.approx(position[500:], abs=1e-2 * lag)
    jump = np.where(np.arange(1000) < 500, 0.0, 10.0)
    out = make(period=0.0, order=order).run(stamps(t), jump)
    assert out.velocity[501] == pytest.approx(10.0 / 0.5, rel=0.01)  # over the time it rested


def test_gains_change_live_without_losing_the_state():
    t = 1e-3 * np.arange(1000)
    y = wrapped(40.0 * t)
    joint, ns = make(), stamps(t).tolist()
    for k in range(500):
        joint.update(ns[k], y[k])
    joint.set_gains(build(HybridAngle.gains, {'bandwidth_hz': 5.0, 'M': 0.5, 'max_speed': 100.0}))
    for k in range(500, 1000):
        joint.update(ns[k], y[k])
        assert joint.estimate()[1] == pytest.approx(40.0, abs=1e-6)
        assert joint.estimate()[3] == TRACKING
    slow = make(bandwidth_hz=5.0)
    slow.run(stamps(t), y)
    assert joint.stddev()[0] >= 0.0
    now, then = joint.channel.track.coefficients, slow.channel.track.coefficients
    assert (now.alpha, now.beta, now.gamma) == (then.alpha, then.beta, then.gamma)
