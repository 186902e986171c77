# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""~/smoothed in a stream and in a replay: its shape, its lag, and no effect on other outputs."""

import itertools
import json
import math

import pytest

from estimator_pkg import cli
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.streams.angle import AngleStream

MS = 1_000_000
START = 1_700_000_000_000_000_000
decode = Decoder().decode


def stream_of(**values):
    stream = AngleStream.of({'observer': 'hybrid_angle', **values})
    stream.wanted[:] = [True] * len(stream.outputs)
    return stream


def number_of(stream, name):
    return [output.name for output in stream.outputs].index(name)


def angle(k, joint=0):
    return math.remainder(3.0 * math.sin(0.01 * k + joint), 2.0 * math.pi)


def velocity(k, joint=0):
    return 30.0 * math.cos(0.01 * k + joint)


def fed(stream, messages):
    """[(k, [answers])] of messages (k, names, positions, efforts)."""
    encoder, found = Encoder(), []
    for k, names, positions, efforts in messages:
        raw = encoder.encode(START + k * MS, 'base', names, positions, [0.0] * len(names), efforts)
        found.append((k, stream.feed(0, bytes(raw), START + k * MS)))
    return found


def both(count, skipped=()):
    return [
        (k, ('a', 'b'), (angle(k), angle(k, 1)), (0.5, 1.5))
        for k in range(count)
        if k not in skipped
    ]


def smoothed_of(stream, found, name='smoothed'):
    """[(k, message)] with the message during which each came."""
    number = number_of(stream, name)
    return [
        (k, decode(answer[number]))
        for k, answers in found
        for answer in answers
        if number in answer
    ]


def test_each_message_is_answered_once_more_a_lag_later():
    stream = stream_of(smoothing_lag=0.03)
    answered = fed(stream, both(1000))
    found, deviations = (
        smoothed_of(stream, answered),
        smoothed_of(stream, answered, 'smoothed_stddev'),
    )
    assert [message.stamp_ns for _, message in found] == [START + k * MS for k in range(970)]
    assert [k for k, _ in found] == [k for k, _ in deviations] == list(range(30, 1000))
    for (k, message), (_, deviation) in zip(found[100:], deviations[100:]):
        assert message.names == ('a', 'b') and message.frame_id == 'base'
        assert message.efforts == (0.5, 1.5)
        assert (message.stamp_ns, message.names) == (deviation.stamp_ns, deviation.names)
        assert all(0.0 < each < 1.0 for each in deviation.velocities)
        for joint in (0, 1):
            assert message.velocities[joint] == pytest.approx(velocity(k - 30, joint), abs=0.02)
            assert message.positions[joint] == pytest.approx(angle(k - 30, joint), abs=1e-4)


@pytest.mark.parametrize('observer', ['finite_difference', 'edge_adaptive'])
def test_every_observer_has_it_and_the_same(observer):
    raws = []
    for name in (observer, 'hybrid_angle'):
        stream = stream_of(observer=name)
        found = smoothed_of(stream, fed(stream, both(200)))
        raws.append([(k, message.velocities, message.positions) for k, message in found])
    assert raws[0] == raws[1] and len(raws[0]) == 150


def test_without_a_subscriber_there_is_nothing_and_the_rest_is_the_same():
    silent, asked = stream_of(), stream_of()
    silent.wanted[-2:] = [False, False]
    numbers = range(3)
    ours, theirs = fed(silent, both(300)), fed(asked, both(300))
    for (_, (mine,)), (_, (first, *_)) in zip(ours, theirs):
        assert {n: mine.get(n) for n in numbers} == {n: first.get(n) for n in numbers}
        assert set(mine) <= set(numbers)
    assert not silent._smoothing._of and not silent._smoothing._waiting
    # a subscriber that leaves and one that comes again
    asked.wanted[-2:] = [False, False]
    fed(asked, [(400, ('a', 'b'), (angle(400), angle(400, 1)), ())])
    assert not asked._smoothing._of and not asked._smoothing._waiting
    asked.wanted[-2:] = [True, False]
    again = fed(asked, both(1000)[500:])
    assert len(smoothed_of(asked, again)) == 450
    assert smoothed_of(asked, again, 'smoothed_stddev') == []


def coming_and_going():
    for k in range(600):
        names, lost = (('b',), False) if k % 7 == 0 else (('b', 'a'), k % 11 == 0)
        values = [math.nan if lost and each == 'a' else angle(k, each == 'b') for each in names]
        yield from [(k, names, values, ())] * (2 if k % 50 == 0 else 1)  # a duplicate


CASES = {  # messages, how many are answered, largest error of the velocity [rad/s]
    'joints that come and go, drops and duplicates': (list(coming_and_going()), 550, 0.1),
    'a gap and a jump back': (both(400, skipped=range(150, 390)) + both(200), 310, 1.0),
    'a low rate': ([(200 * k, ('a',), (angle(20 * k),), ()) for k in range(60)], 59, math.inf),
    'clocks that differ': (  # the first is 0.3 s ahead
        [
            message
            for k in range(400)
            for message in ((k + 300, ('a',), (angle(k),), ()), (k, ('b',), (angle(k, 1),), ()))
        ],
        700,
        0.05,
    ),
}


@pytest.mark.parametrize('name', CASES)
def test_each_message_is_answered_once_in_its_order(name):
    sent, answered, bound = CASES[name]
    stream = stream_of()
    found = smoothed_of(stream, fed(stream, sent))
    assert len(found) == answered
    once = [next(same) for _, same in itertools.groupby(sent, lambda message: message[:2])]
    for names in {message[1] for message in once}:
        mine = [message for _, message in found if message.names == names]
        asked = [message for message in once if message[1] == names][: len(mine)]
        assert [message.stamp_ns for message in mine] == [START + k * MS for k, *_ in asked]
        for message, (k, _, positions, _) in zip(mine[20:], asked[20:]):
            for joint, speed, given in zip(names, message.velocities, positions):
                at = k - 300 * (name == 'clocks that differ' and joint == 'a')
                expected = velocity(at, joint == 'b') + 0.0 * given  # NaN where it was lost
                assert speed == pytest.approx(expected, abs=bound, nan_ok=True)
    stream.reset()  # loses none of those that wait
    more = smoothed_of(stream, fed(stream, both(1500)[1000:]))
    assert len(more) == 450 + len(once) - answered


def test_skip_leaves_out_what_is_not_complete():
    messages = [
        (k, ('a', 'b'), (angle(k), math.nan if k % 5 == 0 else angle(k, 1)), ()) for k in range(300)
    ]
    stream = stream_of(no_estimate='skip')
    found = smoothed_of(stream, fed(stream, messages))
    assert found and all(math.isfinite(sum(message.velocities)) for _, message in found)
    assert not any((message.stamp_ns - START) // MS % 5 == 0 for _, message in found)


@pytest.mark.parametrize('words', [(), ('--set', 'stamp_repair=regular')])
def test_replay_writes_it_on_request_and_the_rest_is_the_same(tmp_path, words):
    sets = ('joints=[a, b]', 'stamp_jitter=0.001', 'gap_every=2', 'frequency=1', 'amplitude=0.5')
    simulate = [part for word in sets for part in ('--set', word)]
    bag, found = str(tmp_path / 'bag'), []
    assert cli.main(['simulate', 'encoder', '--out', bag, '--duration', '3', *simulate]) == 0
    for smoothed in ([], ['--smoothed']):
        out, summary = f'{bag}{smoothed}', f'{bag}{smoothed}.json'
        line = ['replay', bag, '--out', out, '--json', summary, *smoothed, *words]
        assert cli.main(line) == 0
        topics = {}
        with open_bag(out) as made:
            for message in made.messages():
                topics.setdefault(message.topic, []).append(message.raw)
        with open(summary, encoding='utf-8') as file:
            found.append((topics, json.load(file)['joints']))
    (plain, first), (more, second) = found
    assert set(more) - set(plain) == {'/joint_observer/smoothed', '/joint_observer/smoothed_stddev'}
    assert all(more[topic] == plain[topic] for topic in plain)
    assert len(more['/joint_observer/smoothed']) > 1500
    assert first == second
    if words:
        assert first['a']['stamps']['stamp_repair'] == 'repaired'
        assert first['a']['stamps']['device_period_s'] == pytest.approx(1e-3, rel=1e-4)
        assert first['a']['dropped'].get('late', 0) < 200
    else:
        assert 'stamps' not in first['a']
        assert first['a']['dropped']['late'] > 225
