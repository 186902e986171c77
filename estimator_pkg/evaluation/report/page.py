# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``evaluate --html``: one self-contained page for any number of bags and observers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from estimator_pkg import __version__, destination
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.compare.many import LeftOut
from estimator_pkg.evaluation.report.findings import Measurement, look, sentences
from estimator_pkg.evaluation.report.tables import Overview, table, worth
from estimator_pkg.optional import needs
from estimator_pkg.printable import escaped

POINTS_OF_A_PAGE = 240_000  # of all lines over time: a few megabytes,
POINTS = (600, 40000)  # smallest and largest number of one line
LINES = 3  # per estimate: velocity, error, band

STYLE = """
:root { color-scheme: light dark; }
body { font: 14px/1.45 system-ui, sans-serif; color: #222; background: #fff; max-width: 1120px;
       margin: 1.5em auto; padding: 0 1em; overflow-wrap: anywhere; }
h1 { font-size: 1.5em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ccc; }
h3 { font-size: 1.05em; margin-top: 1.4em; }
table { border-collapse: collapse; font-size: 13px; } th, td { padding: .2em .5em;
       text-align: right; border-bottom: 1px solid #e4e4e4; white-space: nowrap; }
th { background: #f4f4f4; vertical-align: top; }
td:first-child, td:nth-child(2), th:first-child, th:nth-child(2) { text-align: left; }
tr.best td { font-weight: 600; } .note { color: #666; font-size: 13px; }
.scroll { overflow-x: auto; } .closer { display: flex; flex-wrap: wrap; }
.plot { overflow-x: auto; } .closer .plot { flex: 1 1 420px; min-width: 0; }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #1b1b1b; } h2 { border-color: #555; }
  th { background: #2a2a2a; } th, td { border-color: #3a3a3a; } .note { color: #aaa; }
  .plot { filter: invert(.894) hue-rotate(180deg); }
}
"""


class Report:
    """Collects bags and writes the page; a context manager.

    Parameters
    ----------
    path : of the page; it appears when it is complete.
    bags : number of bags, which share the points.
    period : wrap period of the positions [rad].
    data : file with every sample, to which the page refers; None: none.

    Raises
    ------
    UserError : Bokeh is missing, or the file cannot be written.
    """

    def __init__(self, path: str, bags: int, period: float, data: str | None = None) -> None:
        try:
            import bokeh  # noqa: F401  (checks that it is installed)
        except ImportError as error:
            raise UserError(f'pages: {needs("bokeh")}') from error
        self.path = Path(path)
        destination.check(path)
        self._data = data
        self._period = period
        self._bags = max(1, bags)
        self._overview = Overview()
        self._sections: list[str] = []
        self._figures: dict[str, Any] = {}

    def __enter__(self) -> Report:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write the page, unless an error occurred."""
        if kind is None:
            self._write()

    def add(self, comparison: Comparison) -> list[str]:
        """Add a bag; return its findings as sentences."""
        seen: dict[str, Measurement] = {}
        for joint in dict.fromkeys(row.joint for row in comparison.rows):
            if joint in comparison.measurement:
                found = look(comparison.measurement[joint], comparison.starts[joint], self._period)
                if found is not None:
                    seen[joint] = found
        findings = sentences(comparison, seen)
        bag = Path(comparison.bag)
        parts = [
            f'<h2 id="{self._overview.add(comparison)}">{escaped(bag.name)}</h2>',
            f'<p class="note">{escaped(str(bag))}</p>',
            f'<p>Velocity errors against {escaped(comparison.truth)}, at zero shift, and '
            'the delay.</p>',
            table(comparison),
            worth(comparison),
            '<h3>Findings and recommendations</h3>',
            '<ul>' + ''.join(f'<li>{escaped(each)}</li>' for each in findings) + '</ul>',
        ]
        points = self._points(comparison)
        for joint in dict.fromkeys(row.joint for row in comparison.rows):
            rows = [row for row in comparison.rows if row.joint == joint]
            parts.append(f'<h3>{escaped(joint)}</h3>')
            parts += self._draw(comparison, joint, rows, seen.get(joint), points)
        self._sections.append('\n'.join(parts))
        return findings

    def leave_out(self, bags: Sequence[LeftOut]) -> None:
        """Add the list of bags that could not be evaluated."""
        if bags:
            self._sections.append(
                '<h2>Skipped</h2><ul>'
                + ''.join(f'<li>{escaped(str(bag))}</li>' for bag in bags)
                + '</ul>'
            )

    def _points(self, comparison: Comparison) -> int:
        """Return the number of points of a line."""
        share = POINTS_OF_A_PAGE // (self._bags * LINES * max(1, len(comparison.rows)))
        return min(max(share, POINTS[0]), POINTS[1])

    def _draw(
        self,
        comparison: Comparison,
        joint: str,
        rows: Sequence[Row],
        seen: Measurement | None,
        points: int,
    ) -> list[str]:
        from estimator_pkg.evaluation.report import figures

        wide = figures.over_time(comparison, joint, rows, points)
        small = figures.closer(comparison, rows)
        wide.append(figures.around_the_worst(rows))
        figures.link(wide + small)
        if seen is not None:
            small.append(figures.sample_times(seen))
        return [
            self._place('over_time', wide),
            self._place('closer', small),
            '<p class="note">Drag a box over a plot to zoom; the time axes are linked. The tools '
            'above a plot pan, zoom with the wheel, reset and save. A click on a name hides it in '
            'all plots of the joint. A triangle at the edge marks a value outside the plot.</p>',
        ]

    def _place(self, kind: str, drawn: Sequence[Any]) -> str:
        names = []
        for figure in drawn:
            name = f'figure_{len(self._figures)}'
            self._figures[name] = figure
            names.append(name)
        slots = ''.join(
            f'<div class="plot"><div data-figure="{name}"></div></div>' for name in names
        )
        return f'<div class="{kind}">{slots}</div>'

    def _write(self) -> None:
        from bokeh.document import Document
        from bokeh.embed import components
        from bokeh.resources import Resources

        document = Document()
        with document.models.freeze():  # else Bokeh visits all figures for each new one
            for figure in self._figures.values():
                document.add_root(figure)
        script, slots = components(self._figures)
        body = '\n'.join([self._overview.html(), *self._sections])
        for name, slot in slots.items():
            body = body.replace(f'<div data-figure="{name}"></div>', slot)
        library = Resources(mode='inline', components=['bokeh'], minified=True).render_js()
        page = (
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<title>Velocity estimates</title><style>{STYLE}</style>\n{library}\n</head><body>'
            f'<h1>Velocity estimates</h1>\n{body}\n<p class="note">Made by velocity_estimator '
            f'{__version__}. {self._where()}The plots show the extremes of each stretch, and '
            f'more detail when zoomed.</p>\n{script}\n'
            '</body></html>\n'
        )
        destination.write_text(self.path, page)

    def _where(self) -> str:
        if self._data is None:
            return ''
        return f'Every compared sample is in {escaped(Path(self._data).name)} (numpy.load). '
