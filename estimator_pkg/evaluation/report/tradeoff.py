# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Noise against delay: each estimate as a point, and each observer's curve over its main gain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
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
from estimator_pkg.evaluation.plots import GREY, Style, figure
from estimator_pkg.evaluation.signals import cubic
from estimator_pkg.parameters import declared
from estimator_pkg.printable import printable

Array = NDArray[np.float64]

RAW = 'finite_difference'  # what most users have today
CURVE_SAMPLES = 15_000  # of the record's middle, on which the curves rest
FACTORS = (0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # of the default bandwidth
SWEEP_HZ = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0)  # where the default is automatic [Hz]
MAIN_GAINS = ('bandwidth_hz', 'prefer')
IN_VIEW = 2.0  # the picture shows curves up to this multiple of the points' range


class Sweep(NamedTuple):
    """One estimate, and its observer's curve.

    delay [s], noise [rad/s] : shape (k,), of the curve over its main gain.
    own : (delay, noise) of the estimate.
    """

    source: str
    delay: Array
    noise: Array
    own: tuple[float, float]


def raw_difference(comparison: Comparison, joint: str, row: Row, period: float) -> Row | None:
    """Return the finite difference at its default, compared at the same times as `row`.

    None without measured positions of the joint.
    """
    series = comparison.measurement.get(joint)
    if series is None or not len(row.time):
        return None
    found = _run(Entry(RAW, RAW), series, comparison.starts[joint], period)
    if found is None:
        return None
    time, velocity, stddev, samples = found
    estimate = at_times(row.time, time, velocity)
    good = np.isfinite(estimate)
    if np.count_nonzero(good) < 8:
        return None
    deviation = at_times(row.time, time, stddev)[good]
    at, true = row.time[good], row.truth[good]
    estimate = estimate[good]
    errors = estimate - true
    return Row(
        RAW,
        joint,
        metrics.velocity(at, estimate, true, row.reference_noise),
        {},
        samples,
        {'estimates': len(time), 'compared': len(at), 'interpolated': 0, 'unmatched': 0},
        {},
        coverage(errors, np.hypot(deviation, row.reference_noise)),
        False,
        at,
        true,
        estimate,
        deviation,
        row.reference_noise,
        np.zeros(0),
        np.zeros(0, np.int8),
    )


def at_times(wanted: Array, time: Array, values: Array) -> Array:
    """Return the values at these times [s], shape (n,), interpolated linearly; nan outside."""
    return np.interp(wanted, time, values, left=np.nan, right=np.nan)


def _run(
    entry: Entry, series: Series, start: int, period: float
) -> tuple[Array, Array, Array, dict[str, Any]] | None:
    """Return (time, velocity, its deviation, counts of samples) of an observer; None: none."""
    try:
        joint = entry.joint(wrap_period=period)
        out = joint.run(series.stamps_ns, series.position)
    except UserError:
        return None
    valid = out.used & np.isin(out.status, VALID) & np.isfinite(out.velocity)
    time = (series.stamps_ns[valid] - start) * 1e-9
    good = np.append(True, time[1:] > np.maximum.accumulate(time)[:-1])[: len(time)]
    if np.count_nonzero(good) < 8:
        return None
    return (
        time[good],
        out.velocity[valid][good],
        out.velocity_stddev[valid][good],
        joint.samples(),
    )


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
    series = comparison.measurement.get(joint)
    middle = rows[0].time
    if len(middle) > CURVE_SAMPLES:
        first = (len(middle) - CURVE_SAMPLES) // 2
        middle = middle[first : first + CURVE_SAMPLES]
    part = None
    if series is not None:
        low = comparison.starts[joint] + int((middle[0] - 1.0) * 1e9)  # a second to settle
        high = comparison.starts[joint] + int(middle[-1] * 1e9)
        near = (series.stamps_ns >= low) & (series.stamps_ns <= high)
        part = Series(
            series.stamps_ns[near],
            series.position[near],
            series.velocity[near],
            series.effort[near],
        )
    found = []
    for row in rows:
        inside = slice(*np.searchsorted(row.time, [middle[0], np.nextafter(middle[-1], np.inf)]))
        time, true = row.time[inside], row.truth[inside]
        own = late_and_noisy(time, row.estimate[inside], true)
        entry = entries.get(row.source) or (Entry(RAW, RAW) if row.source == RAW else None)
        gain, values = _varied(entry)
        curve = []
        for value in values:
            if part is None or entry is None:
                break
            varied = Entry(entry.label, entry.observer, (*entry.values, (gain, value)))
            run = _run(varied, part, comparison.starts[joint], period)
            curve.append(
                (math.nan, math.nan)
                if run is None
                else late_and_noisy(time, at_times(time, run[0], run[1]), true)
            )
        late, noise = np.reshape(np.array(curve, float), (-1, 2)).T
        found.append(Sweep(row.source, late, noise, own))
    return found


def _varied(entry: Entry | None) -> tuple[str, tuple[Any, ...]]:
    """Return the gain that a curve varies, and its values; ('', ()) for none."""
    if entry is None or entry.observer not in angle_observers():
        return '', ()
    known = declared(observers.find(entry.observer).gains)
    gain = next((name for name in MAIN_GAINS if name in known), '')
    if not gain:
        return '', ()
    if known[gain].choices:
        return gain, tuple(known[gain].choices)
    default = dict(entry.values).get(gain, known[gain].default)
    if isinstance(default, (int, float)) and default > 0.0:
        return gain, tuple(factor * float(default) for factor in FACTORS)
    return gain, SWEEP_HZ


def of_row(row: Row) -> tuple[float, float]:
    """Return the same of an estimate: its delay, and its noise in the middle of the record."""
    first = max(0, (len(row.time) - CURVE_SAMPLES) // 2)
    part = slice(first, first + CURVE_SAMPLES)
    return late_and_noisy(
        row.time[part], row.estimate[part], row.truth[part], row.velocity['delay_s']
    )


def late_and_noisy(
    time: Array, estimate: Array, truth: Array, late: float | None = None
) -> tuple[float, float]:
    """Return (delay [s], rms error against the truth with the same delay [rad/s]).

    Parameters
    ----------
    time : shape (n,), increasing [s].
    estimate, truth : shape (n,) [rad/s]; nan: none.
    late : the delay [s], if it is known already.
    """
    good = np.isfinite(estimate) & np.isfinite(truth)
    time, estimate, truth = time[good], estimate[good], truth[good]
    if late is None:
        late = measured(time, estimate, truth).known.late
    if not math.isfinite(late):
        return math.nan, math.nan
    inside = (time - late >= time[0]) & (time - late <= time[-1])
    rest = estimate[inside] - cubic(time, truth, time[inside] - late)
    return late, float(np.sqrt(np.mean(rest * rest)))


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the Pareto front: no other point has both less delay and less noise; by delay."""
    found: list[tuple[float, float]] = []
    for late, noise in sorted((max(late, 0.0), noise) for late, noise in points):
        if math.isfinite(late + noise) and (not found or noise < found[-1][1]):
            found.append((late, noise))
    return found


def picture(found: Sequence[Sweep], styles: Mapping[str, Style]) -> Any:
    """Return the plot; None if the motion determines no delay."""
    from bokeh.models import ColumnDataSource

    there = [each for each in found if np.isfinite(each.own).all()]
    if not there:
        return None
    late = np.array([each.own[0] * 1e3 for each in there])
    noise = np.array([each.own[1] for each in there])
    widest, top = IN_VIEW * max(float(late.max()), 1.0), IN_VIEW * max(float(noise.max()), 1e-12)
    plot = figure('noise against delay', 'delay [ms]', 'noise [rad/s]', 340, y_axis_type='log')
    best = front(
        [
            *(each.own for each in found),
            *((a, b) for each in found for a, b in zip(each.delay, each.noise)),
        ]
    )
    seen = [(a * 1e3, b) for a, b in best if a * 1e3 <= widest and b <= top]
    if seen:
        x, y = np.transpose(seen)
        plot.step(x, y, mode='after', line_color=GREY, line_width=7, line_alpha=0.45)
    shown = noise
    for each in found:
        near = (each.delay * 1e3 <= widest) & (each.noise <= top) & (each.noise > 0.0)
        shown = np.append(shown, each.noise[near])
        plot.line(each.delay[near] * 1e3, each.noise[near], **styles[each.source].line)
    names = [printable(each.source) for each in there]
    on_front = [(max(each.own[0], 0.0), each.own[1]) in best for each in there]
    right = late > 0.5 * (late.min() + late.max())  # their names are on their left
    heights = noise.copy()  # of the names, which do not overlap
    order, apart = np.argsort(noise), (shown.max() / shown.min()) ** 0.06
    for one, two in itertools.pairwise(order):
        heights[two] = max(heights[two], heights[one] * apart)
    colours = [styles[each.source].colour for each in there]
    columns = {
        'x': late,
        'y': noise,
        'name': names,
        'colour': colours,
        'ring': ['#1d1d1f' if each else colour for each, colour in zip(on_front, colours)],
        'align': ['right' if each else 'left' for each in right],
        'offset': [-9 if each else 9 for each in right],
        'height': heights,
    }
    data = ColumnDataSource(columns)
    plot.scatter(
        'x', 'y', source=data, size=11, fill_color='colour', line_color='ring', line_width=2
    )
    plot.text(
        'x',
        'height',
        'name',
        source=data,
        x_offset='offset',
        text_align='align',
        text_baseline='middle',
        text_font_size='12px',
    )
    return plot
