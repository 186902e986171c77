# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Files of comparisons: a plot of velocities and errors, and every sample as .npz."""

from __future__ import annotations

import logging
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import destination, whole_file
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.evaluate import Comparison, Row
from estimator_pkg.evaluation.plots import limits
from estimator_pkg.optional import needs
from estimator_pkg.printable import drawn

PANEL_COLUMNS = 4
TITLE_COLUMNS = 60  # characters of a line of a title


def check(path: str) -> None:
    """Raise UserError unless `path` can be drawn: called before the work, not after it.

    Raises
    ------
    UserError : matplotlib is missing, does not support the file type, or the file is not writable.
    """
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError as error:
        raise UserError(f'plots: {needs("matplotlib")}') from error
    logging.getLogger('matplotlib').setLevel(logging.ERROR)  # it lists missing fonts
    kinds = FigureCanvasBase.get_supported_filetypes()
    kind = Path(path).suffix[1:].lower()
    if kind not in kinds:
        why = f'{kind} is not supported' if kind else 'the name has no ending'
        raise UserError(f'{path}: {why}: end it in one of {", ".join(sorted(kinds))}')
    destination.check(path)


def draw(comparisons: Sequence[Comparison], path: str) -> None:
    """Write a plot (type by the suffix) with a pair of panels per bag and joint."""
    from matplotlib.figure import Figure

    panels: dict[tuple[str, str], list[Row]] = {}
    for comparison in comparisons:
        for row in comparison.rows:
            panels.setdefault((comparison.bag, row.joint), []).append(row)
    sources = dict.fromkeys(row.source for rows in panels.values() for row in rows)
    colours = {source: f'C{i}' for i, source in enumerate(sources)}
    across = max(1, min(PANEL_COLUMNS, len(panels)))
    down = max(1, -(-len(panels) // across))
    figure = Figure(figsize=(max(9.0, 5.0 * across), 5.0 * down + 0.4), layout='constrained')
    parts = figure.subfigures(down, across, squeeze=False)
    names: dict[str, Any] = {}
    for part, ((bag, joint), rows) in zip(parts.flat, panels.items()):
        above, below = part.subplots(2, sharex=True, height_ratios=[3, 2])
        velocities = {'reference': (rows[0].time, rows[0].truth)}
        velocities |= {row.source: (row.time, row.estimate) for row in rows}
        errors = {row.source: (row.time, row.estimate - row.truth) for row in rows}
        for axis, curves in ((above, velocities), (below, errors)):
            for name, curve in curves.items():
                (names[name],) = axis.plot(*curve, color=colours.get(name, 'black'), linewidth=0.8)
            if outer := limits(values for _, values in curves.values()):
                axis.set_ylim(*outer)
            axis.grid(alpha=0.3)
        title = textwrap.fill(drawn(f'{Path(bag).name}: {joint}'), TITLE_COLUMNS)
        above.set_title(title, fontsize='small')
        above.set_ylabel('velocity [rad/s]')
        below.set_ylabel('error [rad/s]')
        below.set_xlabel('time [s]')
    figure.legend(
        names.values(),
        map(drawn, names),
        loc='outside upper center',
        fontsize='small',
        ncols=max(1, min(len(names), 7)),
        frameon=False,
    )
    with whole_file.replacing(path) as temporary:
        figure.savefig(temporary, dpi=120, format=Path(path).suffix[1:].lower())


def write_samples(path: str, comparisons: Sequence[Comparison]) -> None:
    """Write every compared sample; ``numpy.load(path)[name]`` returns an array."""
    arrays: dict[str, Any] = {}
    for comparison in comparisons:
        for row in comparison.rows:
            base = _name(comparison.bag, row.joint)
            series, here = comparison.measurement.get(row.joint), _name(base, row.source)
            if series is not None:
                arrays[f'{base}/measurement/stamps_ns'] = series.stamps_ns
                arrays[f'{base}/measurement/position'] = series.position
            arrays[f'{here}/time'], arrays[f'{here}/reference'] = row.time, row.truth
            arrays[f'{here}/velocity'] = row.estimate
            if np.isfinite(row.stddev).any():
                arrays[f'{here}/velocity_stddev'] = row.stddev
    with whole_file.replacing(path) as temporary, open(temporary, 'wb') as file:
        np.savez_compressed(file, **arrays)


def _name(*parts: str) -> str:
    """Return a name inside the .npz; no part of it can lead out of it."""
    return '/'.join(part.strip('/').replace('..', '_') for part in parts)
