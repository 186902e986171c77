# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of an encoder that an angle alone can show: named soon, covered until then, no false one.

`python test/sensor/test_faults.py` prints the table of docs/troubleshooting.md.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

if __name__ == '__main__':
    sys.path += ['.', 'test/support', 'test/observers/angle']

from clean_streams import clean_stream
from edge_streams import streams
from encoder_faults import FAULTS, STOPS, TURN, case, stop

from benchmarks.captures import captures
from benchmarks.recorded import POSE, recordings
from benchmarks.signals import SIGNALS
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.recording import measured
from estimator_pkg.bags.series import joint_series
from estimator_pkg.bags.wiring import wired
from estimator_pkg.evaluation.checks import angles
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import MEASUREMENT, TRUTH
from estimator_pkg.sensor.faults import KINDS, NO_FAULT, STOPPED
from estimator_pkg.streams.angle import AngleStream
from estimator_pkg.streams.contract import Request

NAMES = [name for name, _ in KINDS]
BAGS = Path(__file__).parents[2] / 'bags'
SOON = 1.0  # [s]
FEW, MANY = 12, 100
FLIP = 'flybag/orientation.yaw'  # two readings are half a turn off
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
    dt = float(np.median(np.diff(stamps))) * 1e-9
    return angles.faults_of(stamps, readings, period, dt)[1]


def alarms(stamps, readings, period=TURN):
    """(stamp, fault) of each that is named; a stop that may be one is none."""
    good = np.isfinite(readings) & (np.diff(stamps, prepend=0) > 0)
    found = kinds_of(stamps[good], readings[good], period)
    at = np.flatnonzero((found != NO_FAULT) & (found != STOPPED))
    return [(stamp, NAMES[kind]) for stamp, kind in zip(stamps[good][at], found[at])]


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
        when = np.flatnonzero((kinds != NO_FAULT) & (one.stamps <= until))
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
    'stuck at speed': (0.91, 0.91),
    'stuck, then right again': (0.88, 0.98),
    'lost channel': (0.88, 0.90),
    'toggling by a count': (0.54, 0.95),
    'reversed': (0.73, 0.65),
    'reversed about zero': (0.72, 0.74),
    'stuck bit 1 to 3': (0.66, 0.96),
    'stuck bit 6 to 10': (0.87, 0.99),
    'zero for one reading': (1.00, 0.99),
    'zero for 2 to 19': (0.93, 0.99),
    'hold of 3 to 39': (0.90, 0.99),
    'hold of one': (0.75, 0.99),
    'counts lost for 3 to 19': (0.72, 0.99),
    'counts lost at once': (0.88, 0.99),
    'jump': (0.91, 1.00),
    'glitches': (0.86, 0.99),
    'repetition of every second': (0.83, 0.98),
    'repetition of every nth': (0.87, 0.99),
}


@pytest.mark.parametrize('first', range(0, 60, 15))
def test_random_motions_of_a_right_encoder_are_no_faults(first):
    """A bit that a motion did not pass, as it turned or braked, was named stuck."""
    for seed in range(first, first + 15):
        stream = clean_stream(seed, seconds=30.0)
        kinds = kinds_of(stream.stamps, stream.readings)
        assert set(kinds) <= {NO_FAULT, STOPPED}, seed


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


@pytest.mark.parametrize('name', STOPS)
def test_a_stop_that_machines_make_is_no_fault(name):
    for number in range(MANY):
        one = stop(name, number)
        assert not alarms(one.stamps, one.reading, period_of(one)), number


def measurements():
    """(name, stamps, readings, wrap period) of all recordings, captures and clean columns."""
    for path in recordings(BAGS):
        with open_bag(path) as bag:
            for joint, one in joint_series(bag, MEASUREMENT).items():
                yield f'{path.name}/{joint}', one.stamps_ns, one.position, TURN
    for path in sorted(each.parent for each in (BAGS / 'vicon').rglob('metadata.yaml')):
        for field in ('orientation.yaw', 'position.x', 'position.y', 'position.z'):
            with open_bag(path) as bag:
                setup = wired(AngleStream, bag, {}, Request(angle=f'{POSE}:pose.{field}'))
                ((stamps, readings, *_),) = measured(bag, setup).values()
            period = TURN if 'yaw' in field else 0.0
            yield f'{path.name}/{field}', np.asarray(stamps), np.asarray(readings), period
    for column in captures(BAGS):
        yield column.name, column.samples.stamps, column.samples.angle, 0.0
    for signal in SIGNALS:
        samples = signal.drawn(0)
        yield signal.name, samples.stamps, samples.angle, TURN


def test_recordings_captures_and_clean_columns_raise_no_alarm():
    hours = 0.0
    for name, stamps, readings, period in measurements():
        hours += np.ptp(stamps) / 3.6e12
        if 'faults' in name:
            continue
        found = [kind for _, kind in alarms(stamps, readings, period)]
        assert found == (['glitch'] if name == FLIP else []), name
    print(f'{hours:.2f} h without an alarm')
    assert hours > 0.11


def test_alarms_on_the_recording_with_faults_are_at_its_faults():
    with open_bag(BAGS / 'simulated' / 'random_with_faults') as bag:
        (one,) = joint_series(bag, MEASUREMENT).values()
        (true,) = joint_series(bag, TRUTH).values()
    angle = np.interp(one.stamps_ns, true.stamps_ns, np.unwrap(true.position))
    off = np.abs((one.position - angle + np.pi) % TURN - np.pi)
    wrong = one.stamps_ns[off > 4.0 * TURN / 4096]  # the noise is one count
    found = alarms(one.stamps_ns, one.position)
    assert found
    for stamp, name in found:
        assert np.min(np.abs(stamp - wrong)) < 30_000_000, name


def test_clean_streams_raise_no_alarm():
    for stream in streams(0.0):
        if not stream.name.startswith(FAULTY):
            samples = stream.samples
            assert not alarms(samples.stamps, samples.angle, stream.period), stream.name


if __name__ == '__main__':
    print('| Fault | Named [%] | Covered until then [%] |\n|---|---|---|')
    for fault in FAULTS:
        shares = look(fault, MANY)
        print(f'| {fault} | {100 * shares.rightly:.0f} | {100 * shares.covered:.1f} |', flush=True)
