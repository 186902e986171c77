# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``bench speed --part smoothed``: cost and error of ~/smoothed at its default lag.

The cost is that of one reading in plain Python, amortised, next to one update of `kalman` on the
same readings. The errors are over those of the off-line smoother, which `evaluate` uses.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.signals import SIGNALS, SKIPPED, Samples
from estimator_pkg.driver.joint import Joint
from estimator_pkg.evaluation.compare.timing import Side, best_and_median, interleave, ratio, row
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from estimator_pkg.observers.angle.smoother import Smoother
from estimator_pkg.progress import progress

LAG = 0.05  # [s]
LIMIT = 10.0  # [us]
ERROR = 2.0  # times that of the off-line smoother
PERIOD = 2.0 * np.pi
READINGS = 4000  # per round
JUDGED = {'sine', 'trapezoid'}  # signals with a required error


def velocities(samples: Samples) -> list[float]:
    """Return the smoothed velocity of every reading that is older than the lag [rad/s]."""
    smoother, found, head = Smoother(LAG, PERIOD), [], 0
    stamps = samples.stamps.tolist()
    for k, (stamp, angle) in enumerate(zip(stamps, samples.angle.tolist())):
        smoother.add(stamp, angle, angle, k == 0)
        while stamp - stamps[head] >= 1e9 * LAG:
            found.append(smoother.result()[1])
            head += 1
    return found


def smoothed(rounds: int = 15) -> list[dict[str, Any]]:
    """Return rows: cost [us], cost over that of an update, and errors over the off-line ones."""
    samples = SIGNALS[1].samples(duration=(rounds + 1) * READINGS * 1e-3)

    def part(number: int) -> Samples:
        rows = slice(number * READINGS, (number + 1) * READINGS)
        return Samples(samples.stamps[rows], samples.angle[rows], samples.velocity[rows])

    def smoothing(number: int) -> float:
        some = part(number)
        start = time.thread_time()
        velocities(some)
        return (time.thread_time() - start) / READINGS

    def updating(joint: Joint) -> Side:
        def side(number: int) -> float:
            some = part(number)
            rows = some.stamps.tolist(), some.angle.tolist()
            start = time.thread_time()
            for stamp, angle in zip(*rows):
                joint.update(stamp, angle)
                joint.estimate()
                joint.stddev()
            return (time.thread_time() - start) / READINGS

        return side

    sides = {'smoothed': smoothing, 'kalman': updating(Entry('kalman', 'kalman').joint())}
    with progress('smoothed', (rounds + 1) * len(sides)) as advance:
        times = interleave(sides, rounds, advance)
    least, median = best_and_median(times['smoothed'])
    rows = [
        row('one reading smoothed', least * 1e6, 'us', median=median * 1e6, limit=LIMIT),
        row('smoothed / kalman', ratio(times['smoothed'], times['kalman']), 'times'),
    ]
    for signal in SIGNALS:
        samples = signal.samples(duration=6.0)
        later = samples.stamps - samples.stamps[0] > 1e9 * SKIPPED
        found = np.array(velocities(samples))
        off_line = smooth(samples.stamps, samples.angle, PERIOD).velocity
        errors = [
            _rms((each - samples.velocity[: len(each)])[later[: len(each)]])
            for each in (found, off_line)
        ]
        rows.append(
            row(
                f'error of smoothed / off-line, {signal.name}',
                errors[0] / errors[1],
                'times',
                limit=ERROR if signal.name in JUDGED else None,
            )
        )
    return rows


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
