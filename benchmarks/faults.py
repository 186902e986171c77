# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part faults``: faults of stamps and readings, what the default observer counts and reports.

The joint moves as a sine of 5 rad/s at 2 Hz, read at 1 kHz with 4096 counts. The status is judged
by two numbers: how long it gave no estimate, and how many of the estimates were wrong.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.runner import SIGMAS, Part, Table
from benchmarks.signals import SIGNALS, encoder
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import VALID
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.text import number
from estimator_pkg.sensor.faults import KINDS

Array = NDArray[Any]
OBSERVER = 'edge_adaptive'
SECONDS = 20.0
WRONG = 0.5  # error of a wrong estimate, at least, and outside of its 95 % interval [rad/s]
LOOK = 10  # samples between two looks at the text of the status
MS = 1_000_000  # [ns]
SIGNAL = next(each for each in SIGNALS if each.name == 'sine')


class Stream(NamedTuple):
    """What arrives: stamps [ns], readings [rad] and the true velocity [rad/s]; shape (n,)."""

    stamps: Array
    angle: Array
    velocity: Array

    def at(self, rows: Array) -> Stream:
        """Return these rows."""
        return Stream(*(each[rows] for each in self))


Fault = Callable[[Stream, np.random.Generator], Stream]


def _rows(choose: Callable[[Array, np.random.Generator], Array]) -> Fault:
    """Return a fault that takes other rows: those that `choose` makes of 0 to n - 1."""
    return lambda sent, rng: sent.at(choose(np.arange(len(sent.stamps)), rng))


def _stamps(change: Callable[[Array, np.random.Generator], Array]) -> Fault:
    """Return a fault of the stamps [ns]."""
    return lambda sent, rng: sent._replace(stamps=change(sent.stamps, rng).astype(np.int64))


def _angle(change: Callable[[Array, Array, np.random.Generator], Array]) -> Fault:
    """Return a fault of the readings [rad], from them and their numbers."""

    def fault(sent: Stream, rng: np.random.Generator) -> Stream:
        return sent._replace(angle=change(sent.angle, np.arange(len(sent.angle)), rng))

    return fault


def _stuck(angle: Array, k: Array, rng: np.random.Generator) -> Array:
    return angle[np.where(k % 2000 >= 1800, k - k % 2000 + 1800, k)]


def _swapped(k: Array, rng: np.random.Generator) -> Array:
    return np.where(k % 50 == 10, k + 1, np.where(k % 50 == 11, k - 1, k))


FAULTS: dict[str, Fault] = {
    'none': lambda sent, rng: sent,
    '10 % of the messages lost': _rows(lambda k, rng: k[rng.random(len(k)) > 0.1]),
    'each 50th message twice': _rows(lambda k, rng: np.sort(np.append(k, k[::50]))),
    'each 50th overtakes the next': _rows(_swapped),
    'a gap of 0.3 s each 2 s': _rows(lambda k, rng: k[k % 2000 < 1700]),
    'an outage of 1 s each 5 s': _rows(lambda k, rng: k[k % 5000 < 4000]),
    'stamps up to 0.4 ms wrong': _stamps(lambda t, rng: t + rng.uniform(-0.4, 0.4, len(t)) * MS),
    'stamps in steps of 4 ms': _stamps(lambda t, rng: t // (4 * MS) * (4 * MS)),
    'each 50th without a stamp': _stamps(lambda t, rng: np.where(t // MS % 50 == 10, 0, t)),
    'one stamp an hour ahead each 2 s': _stamps(
        lambda t, rng: np.where(t // MS % 2000 == 1000, t + 3_600_000 * MS, t)
    ),
    'the clock 10 s back each 5 s': _stamps(
        lambda t, rng: t - (t - t[0]) // (5000 * MS) * 10_000 * MS
    ),
    'each reading five times': _angle(lambda angle, k, rng: angle[k - k % 5]),
    '2 % NaN': _angle(lambda angle, k, rng: np.where(rng.random(len(k)) < 0.02, math.nan, angle)),
    'one reading 1 rad wrong each 2 s': _angle(
        lambda angle, k, rng: np.where(k % 2000 == 1000, angle + 1.0, angle)
    ),
    'stuck for 0.2 s each 2 s': _angle(_stuck),
    'a jump by 0.2 rad each 2 s': _angle(lambda angle, k, rng: angle + 0.2 * (k // 2000)),
    'reversed after 10.1 s': _angle(
        lambda angle, k, rng: np.where(k < 10_100, angle, 2.0 * angle[10_100] - angle)
    ),
    'stuck bit 5': _angle(
        lambda angle, k, rng: (
            ((np.rint(angle / SIGNAL.quantum).astype(int) | 32) * SIGNAL.quantum + math.pi)
            % (2.0 * math.pi)
            - math.pi
        )
    ),
    'eccentric disc, 2 mrad': _angle(
        lambda angle, k, rng: encoder(angle + 0.5 * SIGNAL.quantum + 0.002 * np.sin(angle))
    ),
    'stamps 5 ms late': _stamps(lambda t, rng: t + 5 * MS),
}


def part() -> Part:
    """Return rows, by fault: what was counted and reported, times without estimate, errors."""
    sent = Stream(*SIGNAL.samples(duration=SECONDS))
    rows = [
        {'fault': name, **judged(fault(sent, np.random.default_rng(1)))}
        for name, fault in FAULTS.items()
    ]
    return rows, [describe(rows)]


def judged(received: Stream) -> dict[str, Any]:
    """Return what becomes of the samples.

    Returns
    -------
    counted : dropped samples and events by kind. reported : names of faults of the encoder, else
    the first text of the status. published : part of the samples with an estimate. wrong : part of
    these with an error above `WRONG` that their 95 % interval does not contain. rms : of these
    [rad/s]. covered : part of these whose error the interval contains.
    """
    joint: Joint = Entry(OBSERVER, OBSERVER).joint()
    reported: dict[str, None] = {}
    valid, error, sigma = [], [], []
    for k, (stamp, angle, velocity) in enumerate(zip(*(each.tolist() for each in received))):
        used = joint.update(stamp, angle)
        estimate = joint.estimate()
        valid.append(used and estimate[3] in VALID)
        error.append(estimate[1] - velocity)
        sigma.append(joint.stddev()[1])
        reported |= dict.fromkeys(f'`{KINDS[kind][0]}`' for kind in joint.new_faults())
        if k % LOOK == 0 and not reported and joint.why():
            reported[re.split('[:;(]', joint.why())[0]] = None
    rows = np.flatnonzero(valid)
    errors, bound = np.abs(error)[rows], SIGMAS * np.array(sigma)[rows]
    return {
        'counted': {**joint.dropped(), **joint.events()},
        'reported': list(reported),
        'published': len(rows) / len(valid),
        'wrong': float(np.mean((errors > WRONG) & (errors > bound))),
        'rms': float(np.sqrt(np.mean(errors**2))),
        'covered': float(np.mean(errors <= bound)),
    }


def describe(rows: Sequence[dict[str, Any]]) -> Table:
    """Return the rows as a table."""
    lines = [
        (
            row['fault'],
            ', '.join(f'{count} {kind}' for kind, count in row['counted'].items()) or '-',
            '; '.join(row['reported']) or '-',
            f'{100.0 * row["published"]:.1f}',
            f'{100.0 * row["wrong"]:.2f}',
            number(row['rms'], 2),
            f'{100.0 * row["covered"]:.0f}',
        )
        for row in rows
    ]
    measured = 'published [%]', 'wrong [%]', 'rms [rad/s]', 'covered [%]'
    return Table(('fault', 'counted', 'reported', *measured), lines)
