# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Events of a hybrid system: which are used, which are refused, and that each is counted once."""

import math

import pytest

from estimator_pkg.driver.efforts import EFFORT_COMMAND, STORED_EFFORTS, DrivenSettings
from estimator_pkg.driver.switched import (
    APPLIED,
    EARLY,
    JUMPED,
    LATE,
    OUT_OF_ORDER,
    PAST,
    TOO_MANY,
    WAITING,
    SwitchedBank,
    SwitchedJoint,
)
from estimator_pkg.observers.switched.observer import Gains, Switched
from estimator_pkg.parameters import build

START_NS, MS = 1_700_000_000_000_000_000, 1_000_000


def system(**settings):
    made = SwitchedJoint(
        Switched, build(Gains, {'model': 'gripper'}), build(DrivenSettings, settings)
    )
    made.happened = []  # the sample after which an event took effect
    module = made.module

    def noted(observer, state, design, mode, v):
        made.happened.append(((made.last_ns - START_NS) // MS, mode))
        module.jump(observer, state, design, mode, v)

    made.module = type('Noted', (module,), {'jump': staticmethod(noted)})
    return made


def sampled(made, first, last):
    for k in range(first, last):
        assert made.update(START_NS + k * MS, (1e-3 * k,), (0.1,))


def test_an_event_takes_effect_at_the_sample_nearest_to_its_stamp():
    made = system(reorder_window=0.02)
    assert made.event(START_NS, 'close') == EARLY
    sampled(made, 0, 100)  # the newest is 99
    assert made.event(START_NS + 99 * MS - 20 * MS - 1, 'close') == PAST
    assert made.event(START_NS + 79 * MS, 'close') == LATE
    assert made.event(START_NS + 79 * MS, 'open') == OUT_OF_ORDER
    assert made.event(START_NS + 98 * MS, 'open') == LATE
    assert made.event(START_NS + 99 * MS - MS // 2, 'close') == APPLIED
    assert made.event(START_NS + 99 * MS, 'open') == APPLIED
    assert made.happened == [(99, 'close'), (99, 'open'), (99, 'close'), (99, 'open')]
    made.happened.clear()
    for at, mode in ((99.4, 'close'), (101.5, 'open'), (103.0, 'close'), (104.6, 'open')):
        assert made.event(START_NS + round(at * MS), mode) == WAITING
    sampled(made, 100, 108)
    assert made.happened == [(99, 'close'), (101, 'open'), (103, 'close'), (105, 'open')]
    assert made.event_counts == {
        EARLY: 1, PAST: 1, LATE: 2, OUT_OF_ORDER: 1, APPLIED: 2, WAITING: 4,
    }  # fmt: skip


def test_a_reset_forgets_events_but_not_how_many_came():
    made = system()
    sampled(made, 0, 10)
    assert made.event(START_NS + 50 * MS, 'close') == WAITING
    made.reset()
    sampled(made, 10, 60)
    assert made.happened == []
    assert made.event(START_NS + 59 * MS, 'close') == APPLIED
    assert made.event_counts[WAITING] == 1


@pytest.mark.parametrize('at', [4, 9, 9.6, 10, 10.4])
def test_an_event_after_a_reset_follows_the_first_sample(at):
    made = system()
    sampled(made, 0, 10)
    made.reset()
    assert made.event(START_NS + round(at * MS), 'close') == WAITING
    assert not made.update(START_NS + 10 * MS, (math.nan,), (0.1,))
    sampled(made, 11, 13)
    assert made.happened == [(11, 'close')]
    made.reset()
    assert made.event(START_NS - 1000 * MS, 'close') == PAST


def test_an_event_in_an_outage_follows_the_new_start():
    """The first one was of the state before it, too, which the new start forgets."""
    made = system()
    sampled(made, 0, 100)
    assert made.event(START_NS + 200 * MS, 'close') == WAITING
    assert made.event(START_NS + 60_000 * MS, 'open') == WAITING
    sampled(made, 60_001, 60_003)
    assert made.happened == [(99, 'close'), (60_001, 'close'), (60_001, 'open')]


def jumped(back_ms):
    """A system with 100 samples, and when its clock starts again [ms]."""
    made = system(reorder_window=0.02)
    sampled(made, 0, 100)
    return made, 100 - back_ms


@pytest.mark.parametrize('back', [10, 50, 500, 10_000, 10**6])
@pytest.mark.parametrize('when', ['before', 'between', 'after'])
def test_events_go_on_after_the_clock_jumped_back(back, when):
    """Its first sample may come before or after the event, and the first ones may seem late."""
    made, k = jumped(back)
    assert made.event(START_NS + 99 * MS, 'close') == APPLIED
    made.happened.clear()
    if when == 'before':
        made.event(START_NS + k * MS, 'open')
    made.update(START_NS + k * MS, (0.1,), (0.1,))
    if when == 'between':
        made.event(START_NS + k * MS, 'open')
    for _ in range(2):
        k += 1
        made.update(START_NS + k * MS, (0.1,), (0.1,))
    if when == 'after':
        made.event(START_NS + k * MS, 'open')
    assert made.events() == {'clock_jump': 1}
    assert made.happened[-1][1] == 'open' and made.happened[-1][0] in (k - 2, k)
    assert made.event_counts[APPLIED] + made.event_counts[LATE] == 2
    assert made.event_counts.total() == 2 and made.refused == ''
    sampled(made, k + 1, k + 3)
    made.happened.clear()
    assert made.event(START_NS + (k + 4) * MS, 'close') == WAITING
    sampled(made, k + 3, k + 6)
    assert made.happened == [(k + 4, 'close')]


def test_events_that_wait_for_the_clock_before_are_refused():
    made, k = jumped(10_000)
    assert made.event(START_NS + 150 * MS, 'close') == WAITING
    sampled(made, k, k + 300)
    assert made.event_counts[JUMPED] == 1 and made.event_counts[WAITING] == 0
    assert made.refused == "the event 'close' is not used: clock jumped"
    made.happened.clear()
    sampled(made, 140, 160)
    assert made.happened == []


@pytest.mark.parametrize('at', [98, 100, 103])
@pytest.mark.long
def test_an_event_of_the_clock_before_does_not_stop_those_of_the_new_one(at):
    """It arrives after the first sample of the new clock."""
    made, k = jumped(10_000)
    sampled(made, k, k + 4)
    assert made.event(START_NS + at * MS, 'close') == JUMPED and 'clock jumped' in made.refused
    assert made.event(START_NS + (k + 3) * MS, 'open') == APPLIED
    assert made.event(START_NS + (k + 8) * MS, 'close') == WAITING
    sampled(made, k + 4, 150)
    assert made.happened == [(k + 3, 'open'), (k + 8, 'close')]


def test_events_that_wait_take_effect_in_the_order_of_their_stamps():
    made = system()
    sampled(made, 0, 10)
    for at, mode in ((30, 'open'), (15, 'close'), (20, 'close')):
        assert made.event(START_NS + at * MS, mode) == WAITING
    assert made.event(START_NS + 20 * MS, 'open') == OUT_OF_ORDER
    sampled(made, 10, 40)
    assert made.happened == [(15, 'close'), (20, 'close'), (30, 'open')]


@pytest.mark.parametrize('first', [True, False])
def test_an_event_at_zero_is_used_after_the_clock_jumped_to_it(first):
    """A simulation that starts again, or a bag of one that loops: its first sample is dropped."""
    made = system()
    for k in range(1, 400):
        made.update(k * MS, (0.1,), (0.1,))
    if first:
        made.event(0, 'open')
    for k in range(2):
        made.update(k * MS, (0.1,), (0.1,))
    if not first:
        made.event(0, 'open')
    assert made.events() == {'clock_jump': 1} and made.dropped() == {'zero_stamp': 1}
    assert made.event_counts.keys() <= {APPLIED, LATE} and made.event_counts.total() == 1


@pytest.mark.long
def test_events_without_samples_are_not_kept_for_ever():
    made = system()
    sampled(made, 0, 2)
    made.happened.clear()
    said = [made.event(START_NS + (10_000 + k) * MS, 'open') for k in range(5000)]
    assert said == [WAITING] * STORED_EFFORTS + [TOO_MANY] * (5000 - STORED_EFFORTS)
    assert 'too many wait' in made.refused


def test_no_event_is_taken_twice():
    made = system(reorder_window=0.004)
    sampled(made, 0, 20)
    assert made.event(START_NS + 19 * MS, 'close') == APPLIED
    sampled(made, 20, 150)
    sampled(made, 20, 22)  # the clock jumped back to where it was at the event
    assert made.events() == {'clock_jump': 1} and made.happened == [(19, 'close')]
    for first in (20, 15):  # both are older than the newest before the reset, one by a jump
        made.reset()
        made.happened.clear()
        assert made.event(START_NS + 17 * MS, 'open') == WAITING
        assert made.event(START_NS + 30 * MS, 'close') == WAITING
        sampled(made, first, first + 1)
        assert made.happened == [(first, 'open')]
    sampled(made, 16, 40)
    assert made.happened[1:] == []
    assert made.event_counts[JUMPED] == 1


def test_an_event_after_a_reset_and_a_jump_of_the_clock():
    made, k = jumped(10_000)
    made.reset()
    assert made.event(START_NS + k * MS, 'close') == PAST and made.refused
    sampled(made, k, k + 3)
    assert made.happened == [(k, 'close')] and made.refused == ''
    assert made.event_counts == {APPLIED: 1}


def test_until_z_has_converged_the_reason_says_so():
    made = system()
    assert 'Z has not converged' not in made.why()
    sampled(made, 0, 3)
    assert made.why() == 'Z has not converged: it is predicted'


def test_messages_without_the_joint_or_its_effort_are_counted():
    bank = SwitchedBank(system(), ('finger',))
    assert bank.actuated == ('finger',) and bank.orders == (('finger',), ('finger',))
    assert bank.take(START_NS, ('other',), (0.0,), (1.0,)) is None
    assert bank.take(START_NS, ('finger', 'other'), (0.0, 0.0), (1.0,)) is None
    assert bank.mismatched == 2 and bank.why_silent('finger') == ''
    found = bank.take(START_NS, ('finger',), (0.0,), (math.nan,))
    assert found.estimates == [None]
    assert bank.why_silent('finger') == 'its effort is not a number'
    assert bank.system.dropped() == {'non_finite': 1}
    found = bank.take(START_NS + MS, ('other', 'finger'), (9.0, 0.5), (7.0, 1.0))
    assert found.names == ['finger'] and found.estimates[0][0] == pytest.approx(0.5, abs=1e-3)
    assert (
        found.efforts == [1.0]
        and found.measured_position(0) == 0.5
        and bank.why_silent('finger') == ''
    )


def test_commands_of_the_joint_alone_are_its_input():
    bank = SwitchedBank(system(), ('finger',), EFFORT_COMMAND)
    assert bank.take(START_NS, ('finger',), (0.0,), ()).estimates == [None]
    assert bank.why_silent('finger').startswith('no effort_command is valid')
    bank.command(START_NS, ('other',), (1.0,))
    assert bank.take(START_NS + MS, ('finger',), (0.0,), ()).estimates == [None]
    bank.command(START_NS + MS, ('other', 'finger'), (1.0, 0.2))
    assert bank.take(START_NS + 2 * MS, ('finger',), (0.0,), ()).estimates[0] is not None
    assert bank.why_silent('finger') == ''
