# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints of a stream: a limit of their number, names that are known, expiry, what is counted."""

import math

from estimator_pkg import observers
from estimator_pkg.driver.adaptive import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.efforts import EFFORT_COMMAND

START_NS, MS = 1_700_000_000_000_000_000, 1_000_000


def bank(only=(), most=None, overrides=None, **values):
    return Bank(Configuration(observers.find('kalman'), values, overrides), only, most)


def adaptive(**given):
    return AdaptiveBank(AdaptiveConfiguration(observers.find('adaptive'), {}), **given)


def moved(one, names, count=30, first=0):
    """Take messages of joints that all turn at 2 rad/s; return what the last one gave."""
    for k in range(first, first + count):
        found = one.update(START_NS + k * MS, names, [0.002 * k] * len(names))
    return found


def test_a_limit_refuses_new_names_and_never_named_ones():
    one = bank(most=2, overrides={'x': {'noise': 1e-4}})
    found = moved(one, ('a', 'x', 'b', 'c', 'd'), 1)
    assert list(one.joints) == ['a', 'x', 'b']
    assert [estimate is None for estimate in found.estimates] == [False] * 3 + [True] * 2
    assert (one.refused, one.refused_name) == (2, 'd')
    moved(one, ('c', 'a'), 3, 1)
    assert one.refused == 5 and one.refused_name == 'c'
    assert one.joint('a').used == 4
    one.forget('x')  # named: its place was no place of the limit's
    assert one.joint('c') is None and one.refused == 6
    assert one.joint('x') is not None  # it has a place in any case
    one.forget('a')
    assert one.expired == 2 and one.joint('c') is not None and one.joint('e') is None
    assert list(one.joints) == ['b', 'x', 'c']
    again = bank(only=('a', 'b', 'c'), most=1)
    moved(again, ('a', 'b', 'c', 'd'), 1)
    assert list(again.joints) == ['a', 'b', 'c'] and again.refused == 0  # all are named
    assert bank(most=0).joint('a') is None


def test_selected_joints_keep_their_place_and_efforts_come_whole_or_not():
    one = bank(only=('c', 'a'))
    names, positions, efforts = ('a', 'b', 'c'), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)
    assert one.selected(names, positions, efforts) == (['a', 'c'], [1.0, 3.0], [4.0, 6.0])
    assert not one.selected(names, positions, efforts[:2])[2]
    assert bank().selected(names, positions, efforts) == (names, positions, efforts)


def test_without_efforts_the_adaptive_observer_counts_and_says_why():
    one = adaptive()
    assert one.take(START_NS, ('a', 'b'), (0.0, 0.0), (1.0,)) is None
    assert (one.without_input, one.mismatched) == (1, 1)
    found = one.take(START_NS, ('a', 'b'), (0.0, 0.0), (1.0, math.nan))
    assert found.estimates[0] is not None and found.estimates[1] is None
    assert one.why_silent('a') == '' and one.why_silent('b')
    assert one.joint('b').dropped() == {'non_finite': 1}
    one.take(START_NS + MS, ('b',), (0.0,), (1.0,))
    assert one.why_silent('b') == '' and one.joint('b').used == 1
    one.take(START_NS + 2 * MS, ('b',), (0.0,), (math.inf,))
    one.forget('b')
    assert list(one.joints) == ['a']


def test_a_command_is_of_use_once_its_joint_has_a_position():
    one = adaptive(source=EFFORT_COMMAND, most=2)
    one.command(START_NS, ('a', 'b', 'c', 'd'), (1.0,) * 4)
    assert one.take(START_NS, ('a',), (0.0,), ()).estimates == [None] and list(one.joints) == ['a']
    one.command(START_NS, ('a', 'b', 'c', 'd'), (1.0,) * 4)
    found = one.take(START_NS + MS, ('a',), (0.0,), ())
    assert found.estimates[0] is not None and one.without_input == 0
