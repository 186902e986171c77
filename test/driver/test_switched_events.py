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


@pytest.mark.parametrize('back', [10, 500, 10**6])
def test_events_go_on_after_the_clock_jumped_back(back):
    """Those that wait for the clock before are refused; those of the new one act again."""
    made, k = system(reorder_window=0.002), 100 - back
    sampled(made, 0, 100)
    assert made.event(START_NS + 99 * MS, 'close') == APPLIED
    assert made.event(START_NS + 150 * MS, 'close') == WAITING
    for i in range(3):  # the first ones may seem late
        made.update(START_NS + (k + i) * MS, (0.1,), (0.1,))
    assert made.events() == {'clock_jump': 1}
    assert made.event_counts == {APPLIED: 1, JUMPED: 1, WAITING: 0}
    assert made.refused == "the event 'close' is not used: clock jumped"
    assert made.event(START_NS + (k + 2) * MS, 'open') == APPLIED
    assert made.event(START_NS + (k + 5) * MS, 'close') == WAITING
    sampled(made, k + 3, k + 8)
    assert made.happened == [(99, 'close'), (k + 2, 'open'), (k + 5, 'close')]


def test_events_that_wait_take_effect_in_the_order_of_their_stamps():
    made = system()
    sampled(made, 0, 10)
    for at, mode in ((30, 'open'), (15, 'close'), (20, 'close')):
        assert made.event(START_NS + at * MS, mode) == WAITING
    assert made.event(START_NS + 20 * MS, 'open') == OUT_OF_ORDER
    sampled(made, 10, 40)
    assert made.happened == [(15, 'close'), (20, 'close'), (30, 'open')]


@pytest.mark.long
def test_events_without_samples_are_not_kept_for_ever():
    made = system()
    sampled(made, 0, 2)
    made.happened.clear()
    said = [made.event(START_NS + (10_000 + k) * MS, 'open') for k in range(5000)]
    assert said == [WAITING] * STORED_EFFORTS + [TOO_MANY] * (5000 - STORED_EFFORTS)
    assert 'too many wait' in made.refused


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
