"""The picture of a comparison: true and estimated velocity, and the error below."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.comparison import Comparison, Row

HINT = "plots need matplotlib: pip install 'velocity_estimator[report]'"
COLUMNS = 4


def check(path: str) -> None:
    """Holds that `path` can be drawn: better before the work than after it.

    Raises
    ------
    UserError : matplotlib is missing or knows no such kind of file.
    """
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError as error:
        raise UserError(HINT) from error
    kinds = FigureCanvasBase.get_supported_filetypes()
    kind = Path(path).suffix[1:].lower() or 'png'
    if kind not in kinds:
        raise UserError(f'{path}: plots can be {", ".join(sorted(kinds))}, not {kind}')


def draw(comparisons: Sequence[Comparison], path: str) -> None:
    """Writes a picture (its kind by the suffix) with a pair of panels per bag and joint.

    Raises
    ------
    UserError : as `check`.
    """
    check(path)
    from matplotlib.figure import Figure
    panels: list[tuple[str, list[Row]]] = []
    for comparison in comparisons:
        by_joint: dict[str, list[Row]] = {}
        for row in comparison.rows:
            by_joint.setdefault(row.joint, []).append(row)
        panels += [(f'{comparison.bag}: {joint}', rows) for joint, rows in by_joint.items()]
    across = min(COLUMNS, len(panels))
    down = -(-len(panels) // across)
    figure = Figure(figsize=(max(9.0, 5.0 * across), 5.0 * down), layout='constrained')
    axes = figure.subplots(2 * down, across, squeeze=False, height_ratios=[3, 2] * down)
    for axis in axes.flat:
        axis.set_visible(False)
    for number, (title, rows) in enumerate(panels):
        down_at, across_at = divmod(number, across)
        above, below = axes[2 * down_at][across_at], axes[2 * down_at + 1][across_at]
        above.set_visible(True)
        below.set_visible(True)
        below.sharex(above)
        above.plot(rows[0].time, rows[0].truth, color='black', linewidth=1.2, label='truth')
        for row in rows:
            line, = above.plot(row.time, row.estimate, linewidth=0.8, label=row.source)
            below.plot(row.time, row.estimate - row.truth, linewidth=0.8, color=line.get_color())
        above.set_title(title, fontsize='small')
        above.set_ylabel('velocity [rad/s]')
        above.legend(fontsize='x-small', loc='upper right')
        below.set_ylabel('error [rad/s]')
        below.set_xlabel('time [s]')
        for axis in (above, below):
            axis.grid(alpha=0.3)
    figure.savefig(path, dpi=120)

