# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The plot of a comparison: true and estimated velocity, and the error below."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.image import check, save
from estimator_pkg.evaluation.thinning import broken, extremes, limits
from estimator_pkg.printable import drawn

Array = NDArray[np.float64]

PANEL_COLUMNS = 4
LINE_POINTS = 20_000  # largest number of points of a line


def draw(comparisons: Sequence[Comparison], path: str) -> None:
    """Write a plot (type by the suffix) with a pair of panels per bag and joint.

    Raises
    ------
    UserError : as `check`.
    """
    check(path)
    from matplotlib.figure import Figure

    panels: list[tuple[str, str, list[Row]]] = []
    for comparison in comparisons:
        reference = 'reference' if comparison.smoothed else 'truth'
        by_joint: dict[str, list[Row]] = {}
        for row in comparison.rows:
            by_joint.setdefault(row.joint, []).append(row)
        panels += [
            (f'{Path(comparison.bag).name}: {joint}', reference, rows)
            for joint, rows in by_joint.items()
        ]
    across = min(PANEL_COLUMNS, len(panels))
    down = -(-len(panels) // across)
    figure = Figure(figsize=(max(9.0, 5.0 * across), 5.0 * down + 0.4), layout='constrained')
    axes = figure.subplots(2 * down, across, squeeze=False, height_ratios=[3, 2] * down)
    for axis in axes.flat:
        axis.set_visible(False)
    names: dict[str, Any] = {}
    for number, (title, reference, rows) in enumerate(panels):
        down_at, across_at = divmod(number, across)
        above, below = axes[2 * down_at][across_at], axes[2 * down_at + 1][across_at]
        above.set_visible(True)
        below.set_visible(True)
        below.sharex(above)
        names.setdefault(
            reference, _line(above, rows[0].time, rows[0].truth, color='black', linewidth=1.2)
        )
        for row in rows:
            colour = names[row.source].get_color() if row.source in names else None
            line = _line(above, row.time, row.estimate, linewidth=0.8, color=colour)
            names.setdefault(row.source, line)
            _line(below, row.time, row.estimate - row.truth, linewidth=0.8, color=line.get_color())
        for axis, lines in (
            (above, [rows[0].truth, *(row.estimate for row in rows)]),
            (below, [row.estimate - row.truth for row in rows]),
        ):
            outer = limits(lines)
            if outer:
                axis.set_ylim(*outer)
                axis.annotate(
                    'outliers cut off',
                    (0.01, 0.03),
                    xycoords='axes fraction',
                    fontsize='x-small',
                    color='dimgrey',
                )
            axis.grid(alpha=0.3)
        above.tick_params(labelbottom=False)
        above.set_title(drawn(title), fontsize='small')
        above.set_ylabel('velocity [rad/s]')
        below.set_ylabel('error [rad/s]')
        below.set_xlabel('time [s]')
    figure.legend(
        names.values(),
        map(drawn, names),
        loc='outside upper center',
        fontsize='small',
        ncols=min(len(names), 7),
        frameon=False,
    )
    save(figure, path)


def _line(axis: Any, time: Array, values: Array, **style: Any) -> Any:
    """Draw a line, thinned to the visible points and broken at gaps."""
    at, drawn = broken(time, values, extremes(values, LINE_POINTS))
    (line,) = axis.plot(at, drawn, **style)
    return line
