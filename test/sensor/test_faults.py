# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder that an angle alone can show: named soon, covered until then, no false one.

`python test/sensor/test_faults.py` prints the table of docs/silence.md.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

if __name__ == '__main__':
    sys.path += ['.', 'test/support', 'test/observers/angle']

from edge_streams import streams
from encoder_faults import FAULTS, STOPS, TURN, case, stop

from benchmarks.captures import captures
from benchmarks.recorded import recordings
from benchmarks.signals import SIGNALS
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.engine.calls import available, run
from estimator_pkg.evaluation.checks.angles import faults_of
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import MEASUREMENT
from estimator_pkg.sensor.faults import KINDS, NONE, STOPPED

NAMES = [name for name, _ in KINDS]
BAGS = Path(__file__).parents[2] / 'bags'
SOON = 1.0  # [s]
FEW, MANY = 12, 100
FAULTY = ('glitches', 'repeated', 'held')  # streams with faults


class Found(NamedTuple):
    """Shares of the cases: named rightly, named at all; of the samples until then: covered.

    before : cases in which something is named before the fault.
    """

    rightly: float
    named: float
    covered: float
    before: int


def kinds_of(stamps, readings, period=TURN):
    """The kind of the fault that each reading decides, as `doctor` finds it."""
    return faults_of(stamps, readings, period, float(np.median(np.diff(stamps))) * 1e-9)[1]


def alarms(stamps, readings, period=TURN):
    """The faults that are named; a stop that may be one is none."""
    good = np.isfinite(readings) & (np.diff(stamps, prepend=0) > 0)
    found = kinds_of(stamps[good], readings[good], period)
    return {NAMES[kind] for kind in found if kind not in (NONE, STOPPED)}


def period_of(one):
    return TURN if np.ptp(one.reading) < TURN else 0.0


def look(name, count):
    """What is found in this many cases of a fault."""
    rightly = named = before = 0
    covered = []
    for number in range(count):
        one = case(name, number)
        kinds = kinds_of(one.stamps, one.reading, period_of(one))
        until = one.stamps[min(one.known, len(kinds) - 1)] + round(SOON * 1e9)
        when = np.flatnonzero((kinds != NONE) & (one.stamps <= until))
        before += bool(np.any(when < one.onset))
        named += bool(np.any(when >= one.onset))
        right = [k for k in when if k >= one.onset and NAMES[kinds[k]] in FAULTS[name][1]]
        rightly += bool(right)
        joint = Entry('', 'edge_adaptive').joint(wrap_period=period_of(one))
        out = joint.run(one.stamps, one.reading)
        end = right[0] if right else np.searchsorted(one.stamps, until)
        part = slice(one.onset, int(end) + 1)
        off = np.abs(out.velocity - one.velocity)[part]
        covered.append(np.mean(~(off > 3.0 * out.velocity_stddev[part])))
    return Found(rightly / count, named / count, float(np.mean(covered)), before)


# named rightly, covered: at least
TABLE = {
    'stuck at speed': (1.00, 1.00),
    'stuck, then right again': (0.99, 1.00),
    'lost channel': (0.83, 0.84),
    'toggling by a count': (0.69, 0.94),
    'reversed': (0.87, 0.78),
    'reversed about zero': (0.81, 0.80),
    'stuck bit 1 to 3': (0.92, 0.97),
    'stuck bit 6 to 10': (0.97, 1.00),
    'zero for one reading': (0.99, 1.00),
    'zero for 2 to 19': (0.91, 0.99),
    'hold of 3 to 39': (0.98, 0.99),
    'hold of one': (0.81, 0.99),
    'counts lost for 3 to 19': (0.61, 0.99),
    'counts lost at once': (0.80, 1.00),
    'jump': (0.87, 1.00),
    'glitches': (0.97, 1.00),
    'repetition of every second': (1.00, 0.96),
    'repetition of every nth': (1.00, 0.99),
}


@pytest.mark.parametrize(
    'count', [FEW, pytest.param(MANY, marks=pytest.mark.slow)], ids=['few', 'many']
)
@pytest.mark.parametrize('name', FAULTS)
def test_a_fault_is_named_soon_and_covered_until_then(name, count):
    found = look(name, count)
    rightly, covered = TABLE[name]
    slack = 2.0 / count if count == MANY else 3.0 / count
    assert found.rightly >= rightly - slack and found.covered >= covered - slack
    assert found.before <= 0.02 * count


@pytest.mark.parametrize('name', [each for each in STOPS if 'strike' not in each])
def test_a_stop_that_machines_make_is_no_fault(name):
    every = [stop(name, number) for number in range(3 * FEW)]
    alarmed = [one for one in every if alarms(one.stamps, one.reading, period_of(one))]
    # a stop of an ideal joint within a sample: its step may be whole, and then nobody can know
    assert len(alarmed) <= (1 if 'within a sample' in name else 0)


def test_recordings_captures_and_clean_columns_raise_no_alarm():
    hours = 0.0
    for path in recordings(BAGS):
        if 'faults' in path.name:
            continue
        with open_bag(path) as bag:
            for one in joint_series(bag, MEASUREMENT).values():
                assert not alarms(one.stamps_ns, one.position), path
                hours += np.ptp(one.stamps_ns) / 3.6e12
    for column in captures(BAGS):
        assert not alarms(column.samples.stamps, column.samples.angle, 0.0), column.name
        hours += np.ptp(column.samples.stamps) / 3.6e12
    for signal in SIGNALS:
        samples = signal.drawn(0)
        assert not alarms(samples.stamps, samples.angle), signal.name
        hours += np.ptp(samples.stamps) / 3.6e12
    assert hours > 0.09


def test_clean_streams_raise_no_alarm():
    for stream in streams(0.0):
        if not stream.name.startswith(FAULTY):
            samples = stream.samples
            assert not alarms(samples.stamps, samples.angle, stream.period), stream.name


@pytest.mark.skipif(not available(), reason='without the engine both are plain')
def test_plain_equals_the_engine():
    some = 0
    for name in FAULTS:
        one = case(name, 3)

        def plain(function, faults, count, period, dt, stamps, readings, kinds):
            made = kinds.tolist()
            function(faults, count, period, dt, stamps.tolist(), readings.tolist(), made)
            kinds[:] = made

        compiled = kinds_of(one.stamps, one.reading, period_of(one))
        np.testing.assert_array_equal(
            kinds_of(one.stamps, one.reading, period_of(one), plain), compiled
        )
        some += bool(np.any(compiled != NONE))
    assert some > len(FAULTS) // 2


def test_a_stop_is_covered_until_the_joint_moves_again_or_long_enough():
    one = case('stuck at speed', 0)
    out = Entry('', 'kalman').joint(wrap_period=period_of(one)).run(one.stamps, one.reading)
    late = slice(one.onset + 2, None)
    assert np.all(
        np.abs(out.velocity[late] - one.velocity[one.onset]) < 3.0 * out.velocity_stddev[late]
    )


if __name__ == '__main__':
    print('| Fault | Named [%] | Covered until then [%] |\n|---|---|---|')
    for fault in FAULTS:
        shares = look(fault, MANY)
        print(f'| {fault} | {100 * shares.rightly:.0f} | {100 * shares.covered:.1f} |', flush=True)
