# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Lost messages are counted by the sequence numbers of their publishers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator_pkg.ros.loss import Loss

BEGIN, LEFT = 10**18, None


def at(*numbers, later=0):
    """Messages of these numbers, each sent at its number [s] and so much later."""
    return [(number, number + later) for number in numbers]


STAYS = [*at(*range(1, 11)), LEFT, *at(*range(11, 14))]
GAP = at(*range(1, 11), *range(60, 70), 72)
LOSSES = {  # publishers, time from which messages count [ns], messages and those that leave; lost
    'nothing': (1, 0, at(1, 2, 3), 0),
    'no numbers': (1, 0, [(None, 0), (0, 0)], 0),
    'what is missing': (1, 0, at(7, 8, 11, 12, 20), 2 + 7),
    'another publisher in the place of the first': (1, 0, at(50, 51, 1, 2, 4), 1),
    'one that left is forgotten': (1, 0, [*at(1, 2, 3), LEFT, *at(700, 702)], 1),
    'one that stays when another leaves is not new': (2, BEGIN, STAYS, 0),
    'a new one, whose first messages nobody got': (2, BEGIN, [*STAYS, *at(6, 7, 8, later=14)], 5),
    'a gap beside a silent publisher': (2, 0, GAP, 49 + 2),
    'the same, of messages that count': (2, BEGIN, GAP, 49 + 2),
    'the first message is there': (1, BEGIN, at(1, 2, 3, 4, 5, 8, later=4), 2),
    'sent before the first one came': (1, BEGIN, at(31, 32, 33, 34, 35, 38, later=9), 30 + 2),
    'sent before anybody was there': (1, BEGIN, at(31, 32, 33, 34, 35, 38, later=-11), 2),
}


@pytest.mark.parametrize('case', LOSSES)
def test_loss_is_what_is_missing(case):
    publishers, since_ns, messages, lost = LOSSES[case]
    loss, now_ns = Loss(lambda: publishers, since_ns), BEGIN
    for message in messages:
        if message is LEFT:
            loss.forget(now_ns)
            continue
        number, sent = message
        now_ns = BEGIN + sent * 10**9
        loss.saw(number, now_ns)
    assert loss.count == lost


@pytest.mark.long
@given(st.data())
def test_the_sum_is_right_whichever_publisher_lost(data):
    """Two publishers, interleaved anyhow, until both have come to the same number."""
    streams, lost = [], 0
    first, ahead = data.draw(st.integers(1, 20)), data.draw(st.sampled_from([0, *range(2, 20)]))
    for start in (first, first + ahead):  # heard one after the other, seen to be two
        between = range(start + 1, 50)
        heard = data.draw(st.lists(st.sampled_from(between), unique=True).map(sorted))
        lost += len(between) - len(heard)
        streams.append([start, *heard, 50])
    loss = Loss(lambda: 2)
    loss.saw(streams[0].pop(0))
    loss.saw(streams[1].pop(0))
    while any(streams):
        stream = data.draw(st.sampled_from([stream for stream in streams if stream]))
        loss.saw(stream.pop(0))
    assert loss.count == lost


def test_where_there_are_no_sequence_numbers_the_middleware_is_believed():
    loss = Loss(lambda: 1)
    loss.reported = 3
    assert loss.lost == 3
    loss.saw(5)
    loss.saw(7)
    assert loss.lost == 1
