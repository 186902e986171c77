# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A self-contained page: the verdict, a parameter file, a picture, a table, findings and plots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import __version__, destination, whole_file
from estimator_pkg.evaluation import plots
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.compare.description import cells, describe_smoother, describe_truth
from estimator_pkg.evaluation.compare.many import LeftOut
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.report import figures, opening, tradeoff
from estimator_pkg.evaluation.report.findings import NO_FINDINGS, grouped, look, of_joint, sentences
from estimator_pkg.evaluation.report.tables import COLUMNS, gains
from estimator_pkg.evaluation.text import filled
from estimator_pkg.observers import DEFAULT
from estimator_pkg.progress import progress
from estimator_pkg.streams.drive import ELECTRICAL

PER_ESTIMATE, SHARED = 4, 4  # numbers per instant: velocity, error, deviation, status; and others


class ReportPage:
    """Collects bags and writes the page at the end of `written`.

    Parameters
    ----------
    path : of the page; it appears when it is complete.
    bags : number of bags, which share the points.
    period : wrap period of the positions [rad].
    data : file with every sample, to which the page refers; None: none.
    entries : the observers that were run, with their parameters.

    Attributes
    ----------
    left_out : the bags that could not be evaluated.

    Raises
    ------
    UserError : the file cannot be written, or the library is missing.
    """

    def __init__(
        self, path: str, bags: int, period: float, data: str | None, entries: Sequence[Entry]
    ) -> None:
        self._path = Path(path)
        destination.check(path)
        plots.check()
        self._data = data
        self._period = period
        self._count = max(1, bags)
        self._entries = {entry.label: entry for entry in entries}
        self._bags: list[dict[str, Any]] = []
        self._drawn: list[Any] = []
        self._sources: dict[str, None] = {}  # in the order of the first verdict
        self._front: dict[str, None] = {}  # those that are visible at first
        self.left_out: list[LeftOut] = []

    @contextmanager
    def written(self) -> Iterator[ReportPage]:
        """Write the page at the end, unless an error occurred."""
        yield self
        with progress(f'{self._path}: page', None):
            every = 'Every compared sample: evaluate --data FILE.'
            if self._data is not None:
                every = f'Every compared sample is in {Path(self._data).name} (numpy.load).'
            text = plots.page(
                'evaluate.html',
                self._drawn,
                title='Velocity estimates',
                bags=self._bags,
                styles=plots.styles(self._sources),
                front=self._front,
                left_out=self.left_out,
                data=every,
                version=__version__,
            )
            whole_file.write_text(self._path, text)

    def add(self, comparison: Comparison) -> list[str]:
        """Add a bag; return its findings as sentences."""
        verdicts = comparison.verdicts
        joints = list(dict.fromkeys(row.joint for row in comparison.rows))
        bag: dict[str, Any] = {'name': Path(comparison.bag).name, 'path': comparison.bag}
        bag['faulty'] = any(map(opening.faulty, verdicts.values()))
        self._bags.append(bag)
        if not joints:  # nothing was compared: the default observer
            said = [f'{name}: {text}' for name, v in verdicts.items() for text in v.sentences()]
            use = [] if bag['faulty'] else [f'Use {DEFAULT} as it is.']
            bag |= {'use': use, 'said': grouped(said, verdicts), 'errors': {}}
            return list(comparison.refused.values())
        quanta: dict[str, float] = {}
        of_readings: dict[str, list[str]] = {}
        rows: dict[str, list[Row]] = {}
        raw: dict[str, Row] = {}
        chosen: dict[str, Row] = {}
        with progress(f'{comparison.bag}: page', 2 * len(joints)) as advance:
            for joint in joints:
                series = comparison.measurement.get(joint)
                if series is not None and not joint.endswith(ELECTRICAL):
                    seen = look(series, comparison.starts[joint], self._period)
                    if seen is not None:
                        quanta[joint] = seen.own_quantum
                        of_readings[joint] = of_joint(comparison, joint, seen)
                own = [row for row in comparison.rows if row.joint == joint]
                chosen[joint] = opening.choice(own, verdicts.get(joint))
                difference = next((row for row in own if row.source == tradeoff.RAW), None)
                if difference is None:
                    difference = tradeoff.raw_difference(comparison, joint, own[0], self._period)
                    own += [] if difference is None else [difference]
                if difference is not None:
                    raw[joint] = difference
                rows[joint] = opening.ordered(own, verdicts.get(joint))
                advance(1)
            order = [row.source for each in rows.values() for row in each]
            front = [*(row.source for row in chosen.values()), *([tradeoff.RAW] if raw else [])]
            self._front |= dict.fromkeys(front)
            self._sources |= dict.fromkeys([*front, *order])
            bag['findings'] = grouped(sentences(comparison, of_readings), joints) or [NO_FINDINGS]
            bag['use'], said = opening.words(chosen, raw, self._entries, verdicts)
            every = f'all {len(joints)} joints: '
            common = [text for text in said if len(joints) == 1 or text.startswith(every)]
            bag['said'] = [text.removeprefix(every) for text in common]
            bag['of_joints'] = [text for text in said if text not in common]
            bag['parameters'] = opening.parameter_file(
                comparison, chosen, self._entries, quanta, self._period, verdicts
            )
            bag |= self._table(comparison, rows, chosen) | self._picture(comparison, rows)
            numbers = PER_ESTIMATE * (len(comparison.rows) + len(joints)) + SHARED * len(joints)
            instants = plots.MOST_NUMBERS // (self._count * numbers)
            bag['joints'] = []
            for joint in joints:
                styles = plots.styles(self._sources)
                panels, note = figures.over_time_of_joint(
                    comparison, joint, rows[joint], instants, styles, self._front
                )
                bag['joints'].append((joint, self._place(panels), note))
                advance(1)
        return bag['findings']

    def _place(self, plot: Any) -> int:
        """Add a plot; return its number on the page."""
        self._drawn.append(plot)
        return len(self._drawn) - 1

    def _picture(self, comparison: Comparison, rows: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
        """Return the picture of noise against delay, of the joint that moves fastest."""
        moving = max(rows, key=lambda joint: float(np.mean(rows[joint][0].truth ** 2)))
        found = tradeoff.sweeps(comparison, moving, rows[moving], self._entries, self._period)
        picture = figures.noise_against_delay(found, plots.styles(self._sources))
        return {'moving': moving, 'picture': None if picture is None else self._place(picture)}

    def _table(
        self, comparison: Comparison, rows: Mapping[str, Sequence[Row]], chosen: Mapping[str, Row]
    ) -> dict[str, Any]:
        """Return the table of the estimates, and how good their reference is."""
        ordered = [row for each in rows.values() for row in each]
        every = [cells(row) for row in ordered]
        kept, texts = filled([*COLUMNS], [[each[name] for name in COLUMNS] for each in every])
        lines = []
        errors: dict[str, dict[str, Any]] = {}
        for row, own, shown in zip(ordered, every, texts):
            verdict = comparison.verdicts.get(row.joint)
            ranked = verdict.best if verdict is not None else not row.reference_cannot_tell
            small = [row.joint] * (len(rows) > 1) + [gains(row, self._entries.get(row.source))]
            best = bool(ranked) and chosen[row.joint] is row
            line = {'source': row.source, 'best': best, 'small': small, 'cells': shown}
            lines.append(line | {'rms': own['rms']})
            errors.setdefault(row.joint, {})[row.source] = lines[-1]
        references = [
            f'{joint}: {describe_smoother(comparison.smoothed[joint], known.noise)}'
            if joint in comparison.smoothed
            else f'The truth of {joint}, compared with the measured position: '
            f'{describe_truth(known)}'
            for joint, known in comparison.references.items()
            if joint in rows
        ]
        columns = [(title, COLUMNS[title]) for title in kept]
        return {
            'truth': comparison.truth,
            'columns': columns,
            'rows': lines,
            'errors': errors,
            'references': references,
        }
