# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The bookkeeping of faults: when one is logged, and how much is kept of ever-new names."""

import numpy as np
import pytest

from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.nodes import faults


def test_a_lasting_fault_is_logged_once_and_again_after_it_was_gone():
    logged = []
    found = faults.Faults(lambda kind, text: logged.append(text))
    for second in range(10):
        found.update({'late': 'text'}, float(second))
    assert logged == ['text'] and found.present == {'late': 'text'}
    found.update({}, 10.0)
    assert found.present == {}
    found.update({'late': 'text'}, 9.0 + faults.AGAIN)  # it flickers
    assert logged == ['text']
    for second in (20.0, 30.0):
        found.update({}, second - 1.0)
        found.update({'late': 'text'}, second)
    assert logged == ['text'] * 3


def test_faults_of_ever_new_kinds_are_not_kept():
    found = faults.Faults(lambda kind, text: None)
    for second in range(1000):
        found.update({f'type /joint_states node_{second}': 'text'}, float(second))
    assert len(found._seen) <= faults.AGAIN + 1


def test_the_remedy_comes_before_a_list_of_joints():
    joints = [f'left_arm_shoulder_joint_{k}' for k in range(8)]
    verb = ('is', 'are')
    assert faults.of_joints(joints[:1], 'joint', verb) == f"joint '{joints[0]}' is"
    assert faults.which(joints[:1]) == ''
    assert faults.of_joints(joints, 'joint', verb) + faults.which(joints) == (
        "8 joints are ('" + "', '".join(joints[:5]) + "' and 3 more)"
    )
    text = faults.absent(joints[:3], '/joint_states', joints[3:], "set 'joints'")
    assert text.startswith(
        f"3 joints are not in /joint_states: did you mean '{joints[7]}'? (missing: '{joints[0]}', "
    ) and text.endswith(f'; it carries {", ".join(joints[3:])})')


def test_what_is_dropped_has_its_number_and_that_of_all():
    drops = [text for text in faults.TEXTS.values() if 'dropped' in text]
    assert len(drops) == 7
    for text in drops:
        assert text.startswith('{count} of {received} '), text


def test_ever_new_names_are_not_kept_and_two_publishers_of_a_joint_are_found(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(faults, 'monotonic', lambda: now[0])
    senders, encode = faults.Senders(True), Encoder().encode
    for second in range(1000):
        now[0] = float(second)
        for sequence, new in ((2 * second + 500, f'new_{second}'), (second + 1, 'other')):
            senders.saw(encode(10**18, '', ['elbow', new], [0.0, 0.0]), sequence)
        twice = senders.twice(now[0])
    assert twice == ['elbow']  # 'other' comes from one of them alone
    assert senders.recent(now[0] - 1.5) == {'elbow', 'other', 'new_998', 'new_999'}
    for kept in (senders.names, senders._next, senders._returned):
        assert len(kept) <= faults.FORGOTTEN + 3


def saw(runs, monkeypatch):
    """Return the joints that come twice, after messages of 5 ms: (number, is lost) of each."""
    now = [0.0]
    monkeypatch.setattr(faults, 'monotonic', lambda: now[0])
    senders, raw = faults.Senders(True), Encoder().encode(10**18, '', ['elbow'], [0.0])
    found = []
    for number, lost in runs:
        now[0] += 0.005
        if not lost:
            senders.saw(raw, number)
        found += senders.twice(now[0])
    return found


@pytest.mark.parametrize('seed', range(20))
def test_a_publisher_that_is_killed_again_and_again_is_one(seed, monkeypatch):
    random = np.random.default_rng(seed)
    numbers = [
        first + k
        for first, count in zip(random.integers(1, 60, 12), random.integers(2, 400, 12))
        for k in range(count)
    ]
    assert not saw(zip(numbers, random.random(len(numbers)) < 0.1), monkeypatch)


@pytest.mark.parametrize('seed', range(20))
def test_two_publishers_of_a_joint_are_found_whatever_their_numbers(seed, monkeypatch):
    random = np.random.default_rng(seed)
    numbers, due = random.integers(1, 300, 2), [0.0, 0.0]
    numbers[1] = numbers[seed % 2]  # half of them in step
    periods, sent = random.uniform(0.5, 5.0, 2), []
    while len(sent) < 1000:
        one = int(due[1] < due[0])
        sent.append(int(numbers[one]))
        numbers[one] += 1
        due[one] += periods[one]
    assert saw(zip(sent, random.random(1000) < 0.1), monkeypatch)[-1:] == ['elbow']
