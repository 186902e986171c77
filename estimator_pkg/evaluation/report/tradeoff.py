# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Noise against delay: each estimate as a point, and each observer's curve over its main gain."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UserError
from estimator_pkg.estimate import VALID
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.compare.comparison import Comparison, Row, coverage
from estimator_pkg.evaluation.delay import measured
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.plots import ahead
from estimator_pkg.evaluation.signals import cubic
from estimator_pkg.parameters import declared

Array = NDArray[np.float64]

RAW = 'finite_difference'  # what most users have today
FEWEST = 8  # estimates that are compared
CURVE_SAMPLES = 15_000  # of the record's middle, on which the curves rest
FACTORS = (0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # of the default bandwidth
SWEEP_HZ = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0)  # where the default is automatic [Hz]
MAIN_GAINS = ('bandwidth_hz', 'prefer')


class Sweep(NamedTuple):
    """One estimate, and its observer's curve.

    own : delay [s] and noise [rad/s] of the estimate.
    curve : shape (k, 2), the same over its main gain; nan: none.
    """

    source: str
    own: tuple[float, float]
    curve: Array


def raw_difference(comparison: Comparison, joint: str, row: Row, period: float) -> Row | None:
    """Return the finite difference at its default, compared at the same times as `row`.

    None without measured positions of the joint.
    """
    series = comparison.measurement.get(joint)
    if series is None:
        return None
    found = _run(Entry(RAW, RAW), series, row.time, comparison.starts[joint], period)
    if found is None:
        return None
    estimate, deviation, samples = found
    good = np.isfinite(estimate)
    if np.count_nonzero(good) < FEWEST:
        return None
    at, true, estimate, deviation = (
        each[good] for each in (row.time, row.truth, estimate, deviation)
    )
    return replace(
        row,
        source=RAW,
        velocity=metrics.velocity(at, estimate, true, row.reference_noise),
        samples=samples,
        validity={},
        coverage=coverage(estimate - true, np.hypot(deviation, row.reference_noise)),
        reference_cannot_tell=False,
        time=at,
        truth=true,
        estimate=estimate,
        stddev=deviation,
        status_time=np.zeros(0),
        status=np.zeros(0, np.int8),
    )


def _run(
    entry: Entry, series: Series, wanted: Array, start: int, period: float
) -> tuple[Array, Array, dict[str, Any]] | None:
    """Return (velocity, its deviation, counts of samples) of an observer; None: no estimates.

    Parameters
    ----------
    wanted : shape (n,), times of the velocities [s], interpolated linearly; nan outside.
    """
    try:
        joint = entry.joint(wrap_period=period)
        out = joint.run(series.stamps_ns, series.position)
    except UserError:
        return None
    valid = np.flatnonzero(out.used & np.isin(out.status, VALID) & np.isfinite(out.velocity))
    valid = valid[ahead((series.stamps_ns[valid] - start) * 1e-9)]
    if len(valid) < FEWEST:
        return None
    time = (series.stamps_ns[valid] - start) * 1e-9
    velocity, deviation = (
        np.interp(wanted, time, each[valid], left=np.nan, right=np.nan)
        for each in (out.velocity, out.velocity_stddev)
    )
    return velocity, deviation, joint.samples()


def sweeps(
    comparison: Comparison,
    joint: str,
    rows: Sequence[Row],
    entries: Mapping[str, Entry],
    period: float,
) -> list[Sweep]:
    """Return the points and curves of one joint, from the middle of its record.

    Parameters
    ----------
    entries : by source, of the rows that are observers run now.
    """
    start, middle = comparison.starts[joint], rows[0].time
    first = max(0, (len(middle) - CURVE_SAMPLES) // 2)
    middle = middle[first : first + CURVE_SAMPLES]
    series = comparison.measurement.get(joint)
    if series is not None:
        time = (series.stamps_ns - start) * 1e-9
        near = (time >= middle[0] - 1.0) & (time <= middle[-1])  # a second to settle
        series = Series(*(each[near] for each in series))
    found = []
    for row in rows:
        inside = slice(*np.searchsorted(row.time, [middle[0], np.nextafter(middle[-1], np.inf)]))
        time, true = row.time[inside], row.truth[inside]
        entry = entries.get(row.source) or (Entry(RAW, RAW) if row.source == RAW else None)
        curve = []
        for varied in _varied(entry):
            run = None if series is None else _run(varied, series, time, start, period)
            estimate = np.full(len(time), np.nan) if run is None else run[0]
            curve.append(late_and_noisy(time, estimate, true))
        own = late_and_noisy(time, row.estimate[inside], true)
        found.append(Sweep(row.source, own, np.reshape(np.array(curve, float), (-1, 2))))
    return found


def _varied(entry: Entry | None) -> list[Entry]:
    """Return the entry with other values of its main gain; [] if it has none."""
    if entry is None or entry.observer not in angle_observers():
        return []
    known = declared(observers.find(entry.observer).gains)
    gain = next((name for name in MAIN_GAINS if name in known), '')
    if not gain:
        return []
    default = dict(entry.values).get(gain, known[gain].default)
    values: Sequence[Any] = SWEEP_HZ
    if known[gain].choices:
        values = tuple(known[gain].choices)
    elif isinstance(default, (int, float)) and default > 0.0:
        values = [factor * float(default) for factor in FACTORS]
    return [Entry(entry.label, entry.observer, (*entry.values, (gain, each))) for each in values]


def late_and_noisy(time: Array, estimate: Array, truth: Array) -> tuple[float, float]:
    """Return (delay [s], rms error against the truth with the same delay [rad/s]).

    Parameters
    ----------
    time : shape (n,), increasing [s].
    estimate, truth : shape (n,) [rad/s]; nan: none.
    """
    good = np.isfinite(estimate) & np.isfinite(truth)
    time, estimate, truth = time[good], estimate[good], truth[good]
    late = measured(time, estimate, truth).known.late
    if not math.isfinite(late):
        return math.nan, math.nan
    inside = (time - late >= time[0]) & (time - late <= time[-1])
    rest = estimate[inside] - cubic(time, truth, time[inside] - late)
    return late, float(np.sqrt(np.mean(rest * rest)))


def front(points: Iterable[Sequence[float]]) -> list[tuple[float, float]]:
    """Return the Pareto front: no other point has both less delay and less noise; by delay."""
    found: list[tuple[float, float]] = []
    for late, noise in sorted((max(late, 0.0), noise) for late, noise in points):
        if math.isfinite(late + noise) and (not found or noise < found[-1][1]):
            found.append((late, noise))
    return found
