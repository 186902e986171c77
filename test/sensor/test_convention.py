# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The published position is written as the measurement is: wrapped, multi-turn or prismatic."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from observer_cases import make, stamps

from estimator_pkg.circle import wrap
from estimator_pkg.sensor.convention import Convention, begin_convention, follow_convention, present

TURN = 2.0 * math.pi
OBSERVERS = ('finite_difference', 'pll', 'kalman', 'hybrid_angle')
DT = 1e-3

CONVENTIONS = {
    # just below pi `wrap` is -pi less a rounding error
    'from -pi': lambda angle: max(wrap(angle, TURN), -math.pi),
    # once more by the turn: just below 0 is the whole turn itself, once rounded
    'from 0': lambda angle: (wrap(angle - math.pi, TURN) + math.pi) % TURN,
    'multi-turn': lambda angle: angle,
}
INTERVALS = {
    'from -pi': (-math.pi, math.pi),
    'from 0': (0.0, TURN),
    'multi-turn': (-math.inf, math.inf),
}


@st.composite
def motions(draw):
    """Angles [rad, any turn] of a shaft that changes its speed (at most 14 rad/s) at times."""
    start = draw(st.one_of(st.floats(-4.0, 10.0), st.sampled_from([0.0, math.pi, -math.pi, TURN])))
    parts = draw(
        st.lists(st.tuples(st.floats(-14.0, 14.0), st.integers(1, 150)), min_size=1, max_size=6)
    )
    speed = np.concatenate([np.full(count, value) for value, count in parts])
    return start + np.concatenate(([0.0], np.cumsum(speed) * DT))


@given(st.floats(-1e6, 1e6), st.sampled_from([TURN, math.pi, 1.0, 360.0]))
def test_wrap_stays_in_its_interval_and_takes_whole_turns(angle, period):
    wrapped = wrap(angle, period)
    slack = 1e-9 * period
    assert -0.5 * period - slack <= wrapped <= 0.5 * period + slack
    turns = (angle - wrapped) / period
    assert abs(turns - round(turns)) < 1e-9
    assert wrap(angle, 0.0) == angle


@pytest.mark.long
@pytest.mark.parametrize('convention', CONVENTIONS)
@pytest.mark.parametrize('name', OBSERVERS)
@settings(max_examples=20, deadline=None)
@given(motion=motions())
@example(motion=np.arange(400) * 0.05)
@example(motion=math.pi - np.arange(400) * 0.05)
def test_position_comes_out_as_it_goes_in(name, convention, motion):
    joint = make(name)
    low, high = INTERVALS[convention]
    at = stamps(len(motion), DT).tolist()
    for stamp, angle in zip(at, motion.tolist()):
        measured = CONVENTIONS[convention](angle)
        joint.update(stamp, measured)
        position = joint.estimate()[0]
        assert low <= position < high
        # far less than a turn; an observer lags so much behind a jump of 120 rad/s
        error = position - measured
        if convention != 'multi-turn':
            error = wrap(error, TURN)
        assert abs(error) < 2.0


@pytest.mark.long
@pytest.mark.parametrize('convention', CONVENTIONS)
@pytest.mark.parametrize('name, lag', [('finite_difference', 1e-9), ('hybrid_angle', 2.0)])
@settings(max_examples=20, deadline=None)
@given(motion=motions())
def test_unwrap_counts_turns_from_the_first_sample(name, lag, convention, motion):
    joint = make(name, unwrap=True)
    first = CONVENTIONS[convention](float(motion[0]))
    at = stamps(len(motion), DT).tolist()
    for stamp, angle in zip(at, motion.tolist()):
        joint.update(stamp, CONVENTIONS[convention](angle))
        position = joint.estimate()[0]
        assert abs(position - first - (angle - motion[0])) < lag


def test_unwrap_counts_on_over_a_gap_the_short_way():
    joint = make('kalman', unwrap=True)
    at = stamps(600, DT)
    for i in range(500):
        joint.update(int(at[i]), wrap(20.0 * i * DT, TURN))
    turns = joint.estimate()[0]
    assert turns == pytest.approx(20.0 * 0.499, abs=1e-6)
    after = 20.0 * 0.5 + 1.0  # a gap in which it moved on by one radian
    joint.update(int(at[500]) + 10**9, wrap(after, TURN))
    assert joint.estimate()[0] == pytest.approx(after, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize('name', OBSERVERS)
@settings(max_examples=12, deadline=None)
@given(motion=motions(), step=st.floats(-50.0, 50.0))
def test_prismatic_joints_never_wrap(name, motion, step):
    """A step is a step, however long: the estimate passes through all between."""
    joint = make(name, wrap_period=0.0)
    motion = np.concatenate((motion, np.full(400, motion[-1]), np.full(1500, motion[-1] + step)))
    out = joint.run(stamps(len(motion), DT), motion)
    assert out.position[-1] == pytest.approx(motion[-1], abs=1e-3 + 1e-3 * abs(step))
    if abs(step) > 1.0:
        at = len(motion) - 1500
        peak = np.max(np.abs(out.velocity[at : at + 200]))
        assert peak > abs(step)  # rad/s or m/s: it was seen as motion, not as turns
        assert np.sign(out.velocity[at + 1]) == np.sign(step)


def begun(measurement):
    convention = Convention()
    begin_convention(convention, measurement)
    return convention


def test_end_points_that_atan2_gives_do_not_look_multi_turn():
    """atan2 gives +pi and -pi both, in float32 even a little more."""
    for edge in (math.pi, float(np.float32(math.pi))):
        convention = begun(-3.0)
        for measured in (-edge, edge, 3.0, edge, -edge, -3.0):
            follow_convention(convention, measured, TURN)
        assert -math.pi <= present(convention, -math.pi - 0.01, TURN, False) < math.pi
    convention = begun(0.0)
    for measured in (0.1, 0.0, float(np.float32(TURN)), 6.2, 0.0):
        follow_convention(convention, measured, TURN)
    assert present(convention, -0.01, TURN, False) == pytest.approx(TURN - 0.01)
    convention = begun(6.0)  # and sums of counts and offsets a little less than 0
    for measured in (6.2, -1e-16, 0.1, 3.0, 4.0):
        follow_convention(convention, measured, TURN)
    assert present(convention, -0.01, TURN, False) == pytest.approx(TURN - 0.01)


@pytest.mark.parametrize('least, most', [(-0.1, 6.2), (0.3, 6.6), (-3.3, 1.0)])
def test_readings_a_little_beyond_every_interval_of_one_turn_are_multi_turn(least, most):
    convention = begun(0.5)
    for measured in np.concatenate([np.linspace(0.5, most, 20), np.linspace(most, least, 20)]):
        follow_convention(convention, float(measured), TURN)
    assert present(convention, least - 0.2, TURN, False) == pytest.approx(least - 0.2, abs=1e-12)
    follow_convention(convention, most, TURN)
    assert present(convention, most + 0.2, TURN, False) == pytest.approx(most + 0.2, abs=1e-12)


def test_edge_that_was_not_passed_yet_is_not_shown_passed():
    """Nothing tells yet whether 0 or -pi is where the reading wraps: both must stay right."""
    convention = begun(0.05)
    follow_convention(convention, 0.01, TURN)
    shown = present(convention, -0.02, TURN, False)
    assert 0.0 <= shown < 0.01
    convention = begun(3.1)
    assert 3.1 < present(convention, 3.2, TURN, False) < math.pi


@pytest.mark.parametrize('period', [1.0, math.pi, 360.0])
def test_other_periods(period):
    joint = make('kalman', {'jerk_psd': 1e12}, wrap_period=period)
    at = stamps(2000, DT)
    truth = 0.3 * period + 5.0 * period * (at - at[0]) * 1e-9
    out = joint.run(at, truth % period)
    assert np.all((out.position >= 0.0) & (out.position < period))
    assert out.velocity[-1] == pytest.approx(5.0 * period, rel=1e-6)
