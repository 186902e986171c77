# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Small plots of a joint: error against speed, its spectrum and distribution, sample times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from estimator_pkg.evaluation.compare.comparison import Row
from estimator_pkg.evaluation.report.findings import Measurement
from estimator_pkg.evaluation.report.spectrum import by_speed, density, normalised
from estimator_pkg.evaluation.report.svg import Axis, Plot, Style

HOLES_MARKED = 200
AROUND = 300  # samples on either side of the largest error
FREQUENCIES = 160  # points of a spectrum, evenly on its logarithmic axis


def around_the_worst(best: Row, rows: Sequence[Row], styles: Mapping[str, Style]) -> str:
    """Return every sample around the largest error of the best estimate."""
    worst = int(np.nanargmax(np.abs(best.estimate - best.truth)))
    low, high = max(0, worst - AROUND), min(len(best.time), worst + AROUND)
    window = best.time[low], best.time[high - 1]
    truth = best.truth[low:high]
    parts = []
    for row in rows:
        inside = slice(*np.searchsorted(row.time, [window[0], np.nextafter(window[1], np.inf)]))
        parts.append((row.source, row.time[inside], row.estimate[inside]))
    shown = [truth, next(each for name, _, each in parts if name == best.source)]
    plot = Plot(
        f'largest error of {best.source}',
        Axis('time [s]', float(window[0]), float(window[1])),
        Axis.around('velocity [rad/s]', shown),
        styles,
    ).line('', best.time[low:high], truth, 'reference')
    for source, time, estimate in parts:
        plot.line(source, time, estimate)
    return plot.svg()


def error_by_speed(rows: Sequence[Row], styles: Mapping[str, Style]) -> str:
    """Return the rms error in bins of the reference's speed."""
    found = [(row.source, *by_speed(row.truth, row.estimate - row.truth)[:2]) for row in rows]
    plot = Plot(
        'error against speed',
        Axis.around('speed of the reference [rad/s]', [speed for _, speed, _ in found]),
        Axis.around('rms error [rad/s]', [rms for _, _, rms in found], zero=True),
        styles,
    )
    for source, speed, rms in found:
        plot.line(source, speed, rms)
    return plot.svg()


def error_spectrum(rows: Sequence[Row], styles: Mapping[str, Style]) -> str:
    """Return the spectral density of the errors."""
    found = []
    for row in rows:
        frequency, root = density(row.time, row.estimate - row.truth)
        if len(frequency) > FREQUENCIES:  # means of bins that are even on the axis
            edges = np.geomspace(frequency[0], frequency[-1] * 1.001, FREQUENCIES)
            starts = np.unique(np.searchsorted(frequency, edges[:-1]))
            count = np.diff(starts, append=len(frequency))
            frequency = np.add.reduceat(frequency, starts) / count
            root = np.sqrt(np.add.reduceat(root**2, starts) / count)
        found.append((row.source, frequency, np.where(root > 0.0, root, np.nan)))
    plot = Plot(
        'spectrum of the error',
        Axis.around('frequency [Hz]', [each for _, each, _ in found], log=True),
        Axis.around('(rad/s) / root Hz', [each for _, _, each in found], log=True),
        styles,
    )
    for source, frequency, root in found:
        plot.line(source, frequency, root)
    return plot.svg()


def distribution(rows: Sequence[Row], styles: Mapping[str, Style]) -> str:
    """Return the distribution of error over standard deviation, and the expected one."""
    found = []
    for row in rows:
        middles, heights = normalised(
            row.estimate - row.truth, np.hypot(row.stddev, row.reference_noise)
        )
        if len(middles):
            found.append((row.source, middles, heights))
    at = np.linspace(-5.0, 5.0, 81)
    expected = np.exp(-0.5 * at * at) / math.sqrt(2.0 * math.pi)
    highest = min(max((float(each.max()) for _, _, each in found), default=0.0), 1.2)
    plot = Plot(
        'error / deviation; dashed: expected',
        Axis('standard deviations (outermost: beyond)', -5.0, 5.0),
        Axis('density', 0.0, 1.05 * max(highest, 0.45)),
        styles,
    )
    for source, middles, heights in found:
        plot.line(source, middles, heights)
    return plot.line('', at, expected, 'expected').svg()


def sample_times(seen: Measurement) -> str:
    """Return a histogram of sample times with the gaps marked."""
    holes = np.array([length for _, length in seen.holes[:HOLES_MARKED]]) * 1e3
    milliseconds = seen.steps[seen.steps > 0.0] * 1e3
    usual = 1e3 / seen.rate
    low = min(float(np.min(milliseconds)) * 0.9, 0.5 * usual)
    high = max(float(np.max(milliseconds)) * 1.1, 2.0 * usual)
    edges = np.geomspace(low, high, 61)
    heights, _ = np.histogram(milliseconds, edges)
    most = max(float(heights.max()), 1.0)
    return (
        Plot(
            'sample times' + (' (triangles: gaps)' if len(holes) else ''),
            Axis('sample time [ms]', low, high, True),
            Axis('samples', 0.5, 2.0 * most, True),
            {},
        )
        .bars(edges, heights.astype(float), 0.5)
        .gaps(holes, 0.6)
        .svg()
    )
