# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A self-contained page: the verdict, a parameter file, tables, findings and plots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import __version__, destination, registry, streams, whole_file
from estimator_pkg.evaluation import pairs, plots
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.compare.description import cells, describe_reference
from estimator_pkg.evaluation.compare.evaluate import RAW, Comparison, Row
from estimator_pkg.evaluation.compare.many import LeftOut
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import PERIOD_KEY, WRAP_PERIOD
from estimator_pkg.evaluation.parameter_file import as_yaml
from estimator_pkg.evaluation.ranking.choice import chosen
from estimator_pkg.evaluation.ranking.verdict import Verdict
from estimator_pkg.evaluation.report.figures import noise_against_delay, over_time_of_joint
from estimator_pkg.evaluation.report.findings import grouped, look, of_joint, sentences
from estimator_pkg.evaluation.text import filled, for_node, number
from estimator_pkg.observers import DEFAULT
from estimator_pkg.progress import progress
from estimator_pkg.streams.drive import ELECTRICAL

COLUMNS = {  # of `description.cells`: unit
    **{'rms': 'rad/s', 'mean': 'rad/s', 'max': 'rad/s', 'max at': 's', 'bias': 'rad/s'},
    **{'delay': 'ms', 'noise': 'rad/s', 'in 95 % interval': '', 'valid': 's'},
    **{'samples': '', 'dropped': ''},
}
NUMBERS = 4  # of an instant and an estimate: velocity, error, deviation, status
NO_FINDINGS = 'no findings: no gaps, repeats or jitter, and no dominant cause of errors'


class ReportPage:
    """Collects bags, and writes the page.

    Parameters
    ----------
    path : of the page.
    bags : number of bags, which share the points.
    period : wrap period of the positions [rad].
    data : file with every sample, to which the page refers; None: none.
    entries : the observers that were run, with their parameters.

    Raises
    ------
    UserError : the file cannot be written, or the library is missing.
    """

    def __init__(
        self, path: str, bags: int, period: float, data: str | None, entries: Sequence[Entry]
    ) -> None:
        destination.check(path)
        plots.check()
        self._path, self._data, self._period, self._count = Path(path), data, period, max(1, bags)
        self._entries = {entry.label: entry for entry in entries}
        self._bags: list[dict[str, Any]] = []
        self._drawn: list[Any] = []
        self._sources: dict[str, None] = {}  # in the order of the first verdict
        self._front: dict[str, None] = {}  # those that are visible at first

    def write(self, left_out: Sequence[LeftOut]) -> None:
        """Write the page; `left_out`: the bags that could not be evaluated."""
        data = 'Every compared sample: evaluate --data FILE.'
        if self._data is not None:
            data = f'Every compared sample is in {Path(self._data).name} (numpy.load).'
        text = plots.page(
            'evaluate.html',
            self._drawn,
            title='Velocity estimates',
            bags=self._bags,
            styles=plots.styles(self._sources),
            front=self._front,
            left_out=left_out,
            data=data,
            version=__version__,
        )
        whole_file.write_text(self._path, text)

    def add(self, comparison: Comparison) -> list[str]:
        """Add a bag; return its findings as sentences."""
        verdicts = comparison.verdicts
        joints = list(dict.fromkeys(row.joint for row in comparison.rows))
        said = [
            f'{joint}: {text}'
            for joint, verdict in verdicts.items()
            if joint in joints or not joints
            for text in verdict.sentences()
        ]
        bag: dict[str, Any] = {
            'name': Path(comparison.bag).name,
            'path': comparison.bag,
            'truth': comparison.truth.name,
            'faulty': any(map(_faulty, verdicts.values())),
            'said': [text.partition(': ')[2] for text in said]
            if len(joints) == 1
            else grouped(said, joints or verdicts),
        }
        self._bags.append(bag)
        if not joints:  # nothing was compared: the default observer
            bag |= {'use': [] if bag['faulty'] else [f'Use {DEFAULT} as it is.'], 'errors': {}}
            return list(comparison.refused.values())
        rows: dict[str, list[Row]] = {}
        best: dict[str, Row] = {}
        seen: dict[str, Readings] = {}
        for joint in joints:
            own = ordered([each for each in comparison.rows if each.joint == joint], comparison)
            best[joint] = choice(own, verdicts.get(joint))
            raw = comparison.raw.get(joint)
            if raw is not None and all(each.source != raw.source for each in own):
                own = ordered([*own, raw], comparison)
            rows[joint] = own
            series = comparison.measurement.get(joint)
            if series is not None and not joint.endswith(ELECTRICAL):
                found = look(series, comparison.start(joint), self._period)
                seen |= {} if found is None else {joint: found}
        shown = [row.source for row in best.values()] + [RAW.label] * bool(comparison.raw)
        self._front |= dict.fromkeys(shown)
        self._sources |= dict.fromkeys(
            [*shown, *(row.source for own in rows.values() for row in own)]
        )
        of_readings = {joint: of_joint(comparison, joint, each) for joint, each in seen.items()}
        bag['findings'] = grouped(sentences(comparison, of_readings), joints) or [NO_FINDINGS]
        bag['use'] = use(best, comparison, self._entries)
        quanta = {joint: each.own_quantum for joint, each in seen.items()}
        bag['parameters'] = parameter_file(comparison, best, self._entries, quanta, self._period)
        bag |= self._table(comparison, rows, best)
        self._draw(bag, comparison, rows)
        return bag['findings']

    def _table(
        self, comparison: Comparison, rows: Mapping[str, Sequence[Row]], best: Mapping[str, Row]
    ) -> dict[str, Any]:
        """Return the table of the estimates, and how good their reference is."""
        ordered = [row for own in rows.values() for row in own]
        every = [cells(row) for row in ordered]
        kept, texts = filled([*COLUMNS], [[each[name] for name in COLUMNS] for each in every])
        errors: dict[str, dict[str, Any]] = {joint: {} for joint in rows}
        for row, own, shown in zip(ordered, every, texts):
            verdict = comparison.verdicts.get(row.joint)
            ranked = verdict.best if verdict is not None else not row.reference_cannot_tell
            entry = self._entries.get(row.source)
            gains = ', '.join(f'{name} {value}' for name, value in entry.values) if entry else ''
            errors[row.joint][row.source] = {
                'source': row.source,
                'best': bool(ranked) and best[row.joint] is row,
                'small': [row.joint] * (len(rows) > 1) + [gains] * bool(gains),
                'cells': shown,
                'rms': own['rms'],
            }
        return {
            'columns': [(title, COLUMNS[title]) for title in kept],
            'rows': [line for of in errors.values() for line in of.values()],
            'errors': errors,
            'references': [describe_reference(comparison.truth, joint) for joint in rows],
        }

    def _draw(
        self, bag: dict[str, Any], comparison: Comparison, rows: Mapping[str, Sequence[Row]]
    ) -> None:
        """Draw the figures; the bag has their numbers."""
        numbers = NUMBERS * sum(1 + len(own) for own in rows.values())
        instants = plots.MOST_NUMBERS // (self._count * numbers)
        styles = plots.styles(self._sources)
        bag['moving'] = max(rows, key=lambda joint: float(np.mean(rows[joint][0].truth ** 2)))
        picture = noise_against_delay(rows[bag['moving']], styles)
        bag['picture'] = None if picture is None else self._place(picture)
        bag['joints'] = []
        with progress(f'{comparison.bag}: page', len(rows)) as advance:
            for joint, own in rows.items():
                panels, note = over_time_of_joint(
                    comparison, joint, own, instants, styles, self._front
                )
                bag['joints'].append((joint, self._place(panels), note))
                advance(1)

    def _place(self, plot: Any) -> int:
        """Add a plot; return its number on the page."""
        self._drawn.append(plot)
        return len(self._drawn) - 1


def _rms(row: Row) -> float:
    return float(np.nan_to_num(row.velocity['rms'], nan=math.inf))


def ordered(rows: Sequence[Row], comparison: Comparison) -> list[Row]:
    """Return the rows of a joint in the order of the verdict, else of their errors."""
    verdict = comparison.verdicts.get(rows[0].joint)
    place = {name: i for i, name in enumerate(verdict.rms)} if verdict else {}
    return sorted(rows, key=lambda row: (place.get(row.source, len(place)), _rms(row)))


def choice(rows: Sequence[Row], verdict: Verdict | None) -> Row:
    """Return the row to use, of those in order, by the rule of `chosen`."""
    if verdict is not None:
        return next((row for row in rows if row.source == verdict.choice), rows[0])
    by_source = {row.source: row for row in rows}

    def better(one: str, other: str) -> int:
        """Return the result of the pair against the truth, where both have an estimate."""
        a, b = by_source[one], by_source[other]
        time, *common = np.intersect1d(a.time, b.time, return_indices=True)
        if len(time) < 2:
            return 0
        squares = [(row.estimate[at] - row.truth[at]) ** 2 for row, at in zip((a, b), common)]
        block = pairs.blocks(time)
        sums = np.bincount(block, squares[0] - squares[1])
        return pairs.of_sums([sums], [np.bincount(block)]).sign

    errors = {source: _rms(row) for source, row in by_source.items()}
    return by_source[chosen(errors, (DEFAULT,), better)]


def use(best: Mapping[str, Row], comparison: Comparison, entries: Mapping[str, Entry]) -> list[str]:
    """Return what to use, and its largest error next to that of the finite difference."""
    by_source: dict[str, list[str]] = {}
    for joint, row in best.items():
        if source := _to_use(row, comparison.verdicts.get(joint)):
            by_source.setdefault(source, []).append(joint)
    found = []
    for source, joints in by_source.items():
        entry = entries.get(source)
        how = ' as it is' if entry or _is_observer(source) else ''
        how = ' with the parameters below' if entry and entry.values else how
        on = f' on {", ".join(joints)}' if len(by_source) > 1 else ''
        text = f'Use {source}{how}{on}.'
        own = [best[joint] for joint in joints if best[joint].source == source]
        raw = [comparison.raw[row.joint] for row in own if row.joint in comparison.raw]
        if own:
            text += f' Its error is {number(max(map(_rms, own)), 2)} rad/s rms'
            others = f', that of {RAW.label} {number(max(map(_rms, raw)), 2)}' if raw else ''
            text += f'{others if source != RAW.label else ""}.'
        found.append(text)
    return found


def parameter_file(
    comparison: Comparison,
    best: Mapping[str, Row],
    entries: Mapping[str, Entry],
    quanta: Mapping[str, float],
    period: float,
) -> str:
    """Return the parameter file of the node for the observer that most joints need.

    '' if it is no observer, or if nothing is recommended for any joint.

    Parameters
    ----------
    quanta : of the readings [rad], by joint; 0: none. period : wrap period [rad]; 0: none.
    """
    used = {joint: _to_use(row, comparison.verdicts.get(joint)) for joint, row in best.items()}
    used = {joint: source for joint, source in used.items() if source}
    sources = list(used.values())
    source = max(dict.fromkeys(sources), key=sources.count, default='')
    entry = entries.get(source)
    if entry is None and not _is_observer(source):
        return ''
    observer, values = (entry.observer, dict(entry.values)) if entry else (source, {})
    stream = streams.of_observer(observer)
    known = streams.parameters(observer, values)
    if stream.WRAPS and period != WRAP_PERIOD:
        values = {PERIOD_KEY: period} | values
    if 'observer' in known:
        values = {'observer': observer} | values
    head = [f'{observer}, from {Path(comparison.bag).name}', *for_node(stream.NODE)]
    counts = {joint: quanta[joint] for joint in used if joint in quanta}
    return as_yaml(head, values, counts if 'quantum' in known else {})


def _to_use(row: Row, verdict: Verdict | None) -> str:
    """Return the name of the estimate to use; '': the readings must be mended first."""
    return row.source if verdict is None else verdict.choice


def _faulty(verdict: Verdict) -> bool:
    """Return True if nothing is recommended: the readings must be mended first."""
    return not verdict.choice


def _is_observer(source: str) -> bool:
    return source in registry.names(registry.OBSERVERS)
