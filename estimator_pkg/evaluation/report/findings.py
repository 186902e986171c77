# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Findings about the measurement and the estimates, with recommendations, as sentences."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry, streams
from estimator_pkg.bags.series import Series
from estimator_pkg.evaluation.checks.angles import jumps
from estimator_pkg.evaluation.checks.readings import FAIL, Readings, to_mend
from estimator_pkg.evaluation.checks.stamp_error import stamp_error
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.delay import GAP
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.matching import pieces, strays
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.signals import cubic, wrapped
from estimator_pkg.evaluation.text import interval, number
from estimator_pkg.parameters import declared
from estimator_pkg.sensor.guard import WHY_DROPPED

Array = NDArray[np.float64]

MOVING = 3.0  # a joint counts as moving above this many quanta per sample
REPEATS = 0.2  # this fraction of equal readings in motion is not chance
HOLES_NAMED = 5  # number of gaps that are listed individually
NONE = 'no findings: no gaps, repeats or jitter, and no dominant cause of errors'
USUAL = Entry('', 'hybrid_angle')  # linear observer whose noise the jitter is converted to
SETTLED = 400  # samples after which its noise gain is steady
MOSTLY = 0.7  # a cause explains most of an error if at most this ratio remains without the cause,
# or this ratio comes from it alone (of an rms, half of the squares)
WITHHELD = 0.05  # a larger fraction of time without an estimate is reported


@dataclass(frozen=True)
class Measurement:
    """Properties of one joint's readings.

    rate : [Hz], from the median sample time; rate_mean : from the mean.
    quantum : [rad]; 0: none found. repeats : a new reading comes every n-th sample; 1: each.
    jitter_s : standard deviation of the stamps' error [s]; 0: none found.
    speed : largest speed [rad/s] (99.9 %), if the position was measured accurately enough.
    holes : gaps (when, how long) [s], by length.
    steps : sample times [s].
    strays : number of single stamps far ahead of their neighbours.
    jumps : what is known of jumps that no joint can make; '' without one.
    """

    rate: float
    rate_mean: float
    quantum: float
    repeats: int
    jitter_s: float
    speed: float
    holes: tuple[tuple[float, float], ...]
    steps: Array
    strays: int
    jumps: str = ''

    def as_dict(self) -> dict[str, Any]:
        """Return all but the sample times for ``--json``."""
        found = asdict(self)
        del found['steps']
        return found


def look(series: Series, start: int, period: float) -> Measurement | None:
    """Return the properties of a joint's readings; None for too few.

    Parameters
    ----------
    start : stamp of time zero [ns].
    period : wrap period [rad]; 0: none.
    """
    good = np.flatnonzero(np.isfinite(series.position) & (series.stamps_ns > 0))
    runs = [good[run] for run in pieces(series.stamps_ns[good]) if len(run) > 2]
    if not runs:
        return None
    steps = np.concatenate([np.diff(series.stamps_ns[run]) for run in runs]) * 1e-9
    at = np.concatenate([series.stamps_ns[run][:-1] - start for run in runs]) * 1e-9
    step = float(np.median(steps))
    long = np.flatnonzero(steps > GAP * step)
    order = long[np.argsort(-steps[long], kind='stable')]
    count = quantum(series.position)
    moves = np.concatenate([np.abs(wrapped(np.diff(series.position[run]), period)) for run in runs])
    jitter = stamp_error(series, runs[0], period, count)
    return Measurement(
        1.0 / step,
        len(steps) / float(np.sum(steps[steps <= GAP * step])),
        count,
        _repeats(moves, count),
        jitter,
        float(np.percentile(moves[steps <= GAP * step] / steps[steps <= GAP * step], 99.9)),
        tuple((float(at[i]), float(steps[i])) for i in order[:1000]),
        steps,
        int(np.count_nonzero(strays(series.stamps_ns[good]))),
        _jumps(series, start, period),
    )


def _jumps(series: Series, start: int, period: float) -> str:
    nothing = np.full(len(series.position), np.nan)
    found = jumps(
        Readings('', series.stamps_ns, series.stamps_ns, series.position, nothing, period, start)
    )
    return to_mend([found]) if found.level == FAIL else ''


def _repeats(moves: Array, count: float) -> int:
    """Return n if a new reading comes every n-th sample while the joint moves."""
    small = count if count else 0.0
    window = 12
    if len(moves) < 4 * window:
        return 1
    sums = np.convolve(moves, np.ones(window), 'same')
    moving = sums > MOVING * window * max(small, 1e-12)
    if np.count_nonzero(moving) < 4 * window:
        return 1
    equal = float(np.mean(moves[moving] <= 1e-9 + 0.01 * small))
    return round(1.0 / (1.0 - equal)) if REPEATS < equal < 0.95 else 1


def speed_noise(position_noise: float, step: float) -> float:
    """Return the usual observer's velocity noise [rad/s] for white position noise [rad]."""
    if 'noise' not in declared(USUAL.joint().observer.gains):
        return math.nan
    joint = Entry('', USUAL.observer, (('noise', position_noise),)).joint()
    for i in range(SETTLED):
        joint.update(10**9 + round(i * step * 1e9), 0.0)
    return joint.stddev()[1]


def sentences(comparison: Comparison, seen: dict[str, Measurement]) -> list[str]:
    """Return findings and recommendations, most important first."""
    found: list[str] = []
    found += comparison.refused.values()
    for joint, measurement in seen.items():
        if measurement.jumps and measurement.jumps not in comparison.refused.get(joint, ''):
            found.append(f'{joint}: {measurement.jumps}')
        sources = {row.source for row in comparison.rows if row.joint == joint}
        with_quantum = any(has(each, 'quantum', of_topic=True) for each in sources)
        found += _of_measurement(joint, measurement, with_quantum)
    for joint in dict.fromkeys(row.joint for row in comparison.rows):
        rows = [row for row in comparison.rows if row.joint == joint]
        found += _of_samples(joint, rows[0])
        best = min(rows, key=lambda row: row.velocity['rms'])
        for row in rows if len(rows) <= 2 else [best]:
            found += _of_errors(row, joint in comparison.refused)
    found += comparison.notes
    return found


def _of_measurement(joint: str, seen: Measurement, with_quantum: bool) -> list[str]:
    found = []
    if seen.repeats > 1:
        every = 'second' if seen.repeats == 2 else f'{seen.repeats}th'
        found.append(
            f'{joint}: the encoder gives a new reading only every {every} sample at '
            f'{seen.rate:.0f} Hz; read it at '
            f'{seen.rate / seen.repeats:.0f} Hz, or stamp it when it is read'
        )
    if seen.jitter_s:
        noise = speed_noise(seen.jitter_s * seen.speed, 1.0 / seen.rate)
        expect = (
            ''
            if math.isnan(noise)
            else (f': expect {number(noise, 2)} rad/s of noise at {number(seen.speed, 3)} rad/s')
        )
        found.append(
            f'{joint}: stamps jitter by {_time(seen.jitter_s)}{expect}; stamp readings '
            'when they are taken'
        )
    for when, length in seen.holes[:HOLES_NAMED]:
        found.append(
            f'{joint}: gap of {_time(length)} at '
            + (f'{when:.1f} s' if when >= 0.1 else _time(when))
        )
    if seen.strays:
        found.append(
            f'{joint}: {seen.strays} single stamp{"s" * (seen.strays > 1)} far ahead of '
            'the neighbours: a wrong clock, or a damaged message'
        )
    if len(seen.holes) > HOLES_NAMED:
        found.append(f'{joint}: {len(seen.holes)} gaps in total')
    if seen.quantum:
        per_turn = 2.0 * math.pi / seen.quantum
        found.append(
            f'{joint}: one count is {number(seen.quantum, 3)} rad (about {per_turn:.0f} '
            f'per turn), which is {number(seen.quantum * seen.rate, 3)} rad/s of a finite '
            f'difference at {seen.rate:.0f} Hz'
            + (f"; set 'quantum: {seen.quantum:.4g}'" if with_quantum else '')
        )
    return found


def _of_samples(joint: str, row: Row) -> list[str]:
    return [
        f'{joint}: {count} of {row.samples["received"]} samples dropped: '
        f'{WHY_DROPPED.get(kind, kind)}'
        for kind, count in row.samples['dropped'].items()
    ]


def _of_errors(row: Row, refused: bool) -> list[str]:
    found = []
    name = f'{row.joint}, {row.source}'
    rms, noise = row.velocity['rms'], row.velocity['noise']
    late = row.velocity['delay_s']
    if not refused and not row.reference_cannot_tell and len(row.time) > 8:
        if late == late and late > 0.0 and _shifted(row, late) < MOSTLY * rms:
            found.append(
                f'{name}: most of its error comes from its delay of '
                + interval(late * 1e3, row.velocity['delay_95_s'] * 1e3, 'ms')
                + advice(
                    row.source,
                    bandwidth_hz='raise bandwidth_hz, or tune it for less delay',
                    prefer="set 'prefer: fast'",
                )
            )
        elif noise == noise and noise > MOSTLY * rms:
            found.append(
                f'{name}: most of its error is noise'
                + advice(
                    row.source,
                    bandwidth_hz='lower bandwidth_hz, or tune it',
                    prefer="set 'prefer: smooth'",
                )
            )
    away = sum(
        seconds for kind, seconds in row.validity.items() if kind not in ('tracking', 'published')
    )
    total = sum(row.validity.values())
    if total and away > WITHHELD * total:
        kinds = ', '.join(
            f'{kind} {seconds:.2f} s'
            for kind, seconds in row.validity.items()
            if kind not in ('tracking', 'published') and seconds >= 0.01
        )
        found.append(f'{name}: not tracking for {away:.2f} of {total:.2f} s ({kinds})')
    return found


def has(source: str, parameter: str, of_topic: bool = False) -> bool:
    """Return True if the observer has this parameter; `of_topic` for a topic, of any observer."""
    if source not in registry.names(registry.OBSERVERS):
        return of_topic
    return parameter in streams.parameters(source)


def advice(source: str, **texts: str) -> str:
    """Return the text on the first parameter that the observer has, after a colon; '' if none."""
    return next((f': {text}' for name, text in texts.items() if has(source, name)), '')


def _shifted(row: Row, late: float) -> float:
    """Return the rms error against the truth delayed like the estimate."""
    inside = row.time - late >= row.time[0]
    rest = row.estimate[inside] - cubic(row.time, row.truth, row.time[inside] - late)
    return float(np.sqrt(np.mean(np.square(rest)))) if len(rest) else math.inf


def _time(seconds: float) -> str:
    if seconds >= 1.0:
        return f'{seconds:.2f} s'
    if seconds >= 1e-3:
        return f'{number(seconds * 1e3, 2)} ms'
    return f'{number(seconds * 1e6, 2)} us'
