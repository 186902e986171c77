# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Each row of the table of faults is reported in three ways where it is present, and not elsewhere.

``python test/nodes/test_faults.py`` prints the table of docs/troubleshooting.md.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

if __name__ == '__main__':
    sys.path[:0] = [str(Path(__file__).parents[1] / 'support')]

import dds  # noqa: F401  the domain of these tests
import numpy as np
from fault_cases import CASES, LONGEST, MS, Case, Run, arm_and_finger
from own_node import logged
from rosgraph_msgs.msg import Clock

from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.nodes import faults, senders

DOCS = Path(__file__).parents[2] / 'docs/troubleshooting.md'


@pytest.mark.parametrize('name', CASES)
def test_a_fault_is_reported_in_three_ways_in_time_and_once(name, probe, monkeypatch, capfd):
    case, space = CASES[name], re.sub(r'\W+', '_', f'fault_{name}')
    (row,) = [fault for fault in faults.FAULTS if fault.name == case.row]
    run = Run(monkeypatch, space, case)
    try:
        cause = run.run()
    finally:
        run.own.close()
    report, latest = case.report.replace('SPACE', f'/{space}'), cause + LONGEST + case.more
    text = capfd.readouterr().err
    lines = [(level, line) for level, line in logged(text) if re.search(report, line)]
    assert len(lines) == 1, text
    for reports in (run.own.status, run.own.diagnostics):
        when = [now for now, entry in reports if re.search(report, entry.message)]
        assert when and cause <= when[0] <= latest, (name, [each.message for _, each in reports])
        levels = {entry.level for now, entry in reports if now >= when[0]}
        assert case.estimates or b'\x00' not in levels
    if any(run.own.node.stream.received) and not (case.later or case.estimates or row.harmless):
        assert [level for level, _ in logged(text)].count('ERROR') == 1


def test_every_row_has_a_case():
    assert {case.row for case in CASES.values()} == {fault.name for fault in faults.FAULTS}


@pytest.mark.parametrize('simulated', [False, True])
def test_without_a_fault_there_is_no_report(simulated, probe, monkeypatch, capfd):
    """Disjoint joints of two publishers; simulated time that begins at 0."""

    def tick(run):
        if not simulated:
            return arm_and_finger(run)
        stamp, message = run.k * 20 * MS, Clock()
        message.clock.sec, message.clock.nanosec = divmod(stamp, 10**9)
        run.own.publishers['clock'].publish(message)
        return run.send(stamp_ns=stamp)

    space = f'fine_{simulated}'.lower()
    publishers = ('driver',) if simulated else ('driver', 'gripper')
    run = Run(
        monkeypatch,
        space,
        Case('', '', tick, publishers=publishers, parameters={'use_sim_time': simulated}),
    )
    try:
        if simulated:
            run.own.publisher('clock', Clock, 'clock')
        run.run()
    finally:
        run.own.close()
    text = capfd.readouterr().err
    some = r'3 joints of' if simulated else r'4 joints of'
    assert len(re.findall(rf'tracking {some} /{space}/joint_states at \d+(\.\d)? Hz \(', text)) == 1
    assert {level for level, _ in logged(text)} == {'INFO'}, text
    assert run.own.status[-1][1].level == run.own.diagnostics[-1][1].level == b'\x00'


SHOWN = {'count': 'N', 'received': 'M', 'kept': 'joint', 'hint': '', 'meant': '', 'other': ''}


def words(text):
    """A text of the table with its places as words."""
    return re.sub(r'\{(\w+)[^}]*\}', lambda found: SHOWN.get(found[1], found[1].upper()), text)


def table():
    """The rows in the docs."""
    for fault in faults.FAULTS:
        yield f'| {fault.cause} | {words(fault.text)} | {words(fault.remedy)} |'


def test_the_docs_have_the_table():
    lines = DOCS.read_text().splitlines()
    assert not [line for line in table() if line not in lines]


# ---------------------------------------------------------------- when a fault is reported


def test_a_lasting_fault_is_logged_once_and_again_after_it_was_gone():
    written = []
    found = faults.Faults(lambda fault, text: written.append(text))
    late = {'late': (faults.FAULTS[0], 'text')}
    for second in range(10):
        found.update(late, float(second))
    assert written == ['text'] and found.present == {'late': 'text'}
    found.update({}, 10.0)
    assert found.present == {}
    found.update(late, 9.0 + faults.AGAIN)  # it flickers
    assert written == ['text']
    for second in (20.0, 30.0):
        found.update({}, second - 1.0)
        found.update(late, second)
    assert written == ['text'] * 3 and len(found._shown) == 1


def saw(runs, monkeypatch):
    """Return the joints that come twice, after messages of 5 ms: (number, is lost) of each."""
    now = [0.0]
    monkeypatch.setattr(senders, 'monotonic', lambda: now[0])
    heard, raw = senders.Senders(True), Encoder().encode(10**18, '', ['elbow'], [0.0])
    heard.several, found = True, []
    for number, lost in runs:
        now[0] += 0.005
        if not lost:
            heard.saw(raw, number)
        found += heard.twice(now[0])
    return found


@pytest.mark.parametrize('seed', range(5))
def test_two_publishers_of_a_joint_are_told_from_one_that_is_started_again(seed, monkeypatch):
    random = np.random.default_rng(seed)
    starts = zip(random.integers(1, 60, 8), random.integers(100, 400, 8))
    numbers = [first + k for first, count in starts for k in range(count)]
    assert not saw(zip(numbers, random.random(len(numbers)) < 0.1), monkeypatch)
    numbers, due = random.integers(1, 300, 2), [0.0, 0.0]
    numbers[1] = numbers[seed % 2]  # half of them in step
    periods, sent = random.uniform(0.5, 5.0, 2), []
    while len(sent) < 1000:
        one = int(due[1] < due[0])
        sent.append(int(numbers[one]))
        numbers[one] += 1
        due[one] += periods[one]
    assert saw(zip(sent, random.random(1000) < 0.1), monkeypatch)[-1:] == ['elbow']


if __name__ == '__main__':
    print('| Fault | Report | Remedy |\n|---|---|---|', *table(), sep='\n')
