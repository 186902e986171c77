# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The bookkeeping of faults: when one is logged, and how much is kept of ever-new names."""

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
    for kept in (senders.names, senders._newest, senders._turns, senders._turned):
        assert len(kept) <= faults.FORGOTTEN + 3
