# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A self-contained page: the verdict, a parameter file, tables, findings and plots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import __version__, registry, streams, whole_file
from estimator_pkg.evaluation import pairs, plots
from estimator_pkg.evaluation.compare.description import cells, describe_reference
from estimator_pkg.evaluation.compare.evaluate import RAW, Comparison, Row
from estimator_pkg.evaluation.compare.many import LeftOut
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import PERIOD_KEY, WRAP_PERIOD
from estimator_pkg.evaluation.parameter_file import as_yaml
from estimator_pkg.evaluation.ranking.verdict import Verdict, chosen
from estimator_pkg.evaluation.report.figures import noise_against_delay, over_time_of_joint
from estimator_pkg.evaluation.report.findings import Findings, grouped
from estimator_pkg.evaluation.text import filled, for_node, number
from estimator_pkg.observers import DEFAULT
from estimator_pkg.progress import progress

COLUMNS = {  # of `description.cells`: unit
    **{'rms': 'rad/s', 'mean': 'rad/s', 'max': 'rad/s', 'max at': 's', 'bias': 'rad/s'},
    **{'delay': 'ms', 'noise': 'rad/s', 'in 95 % interval': '', 'valid': 's'},
    **{'samples': '', 'dropped': ''},
}
NUMBERS = 4  # of an instant and an estimate: velocity, error, deviation, status
NO_FINDINGS = 'no findings: no gaps, repeats or jitter, and no dominant cause of errors'


def write(
    path: str,
    comparisons: Sequence[Comparison],
    findings: Mapping[str, Findings],
    entries: Sequence[Entry],
    period: float,
    left_out: Sequence[LeftOut] = (),
    data: str | None = None,
) -> None:
    """Write the page.

    Parameters
    ----------
    findings : by bag. entries : the observers that were run, with their parameters.
    period : wrap period of the positions [rad]. left_out : the bags that could not be evaluated.
    data : file with every sample, to which the page refers; None: none.
    """
    by_label = {entry.label: entry for entry in entries}
    rows = {each.bag: _rows(each) for each in comparisons}
    best = {each.bag: _best(each, rows[each.bag]) for each in comparisons}
    front = dict.fromkeys(row.source for of in best.values() for row in of.values())
    front |= dict.fromkeys([RAW.label] if any(each.raw for each in comparisons) else [])
    every = (row.source for of in rows.values() for own in of.values() for row in own)
    styles = plots.styles(dict.fromkeys([*front, *every]))
    count = sum(NUMBERS * (1 + len(own)) for of in rows.values() for own in of.values())
    bags: list[dict[str, Any]] = []
    drawn: list[Any] = []

    def place(plot: Any) -> int:
        drawn.append(plot)
        return len(drawn) - 1

    with progress(f'{path}: page', len(comparisons)) as advance:
        for comparison in comparisons:
            own, chosen = rows[comparison.bag], best[comparison.bag]
            bag = _verdict(comparison, chosen, by_label)
            bags.append(bag)
            advance(1)
            if not own:
                continue
            found = findings[comparison.bag]
            bag['findings'] = found.sentences or [NO_FINDINGS]
            bag['parameters'] = parameter_file(comparison, chosen, by_label, found.quanta, period)
            bag |= _table(comparison, own, chosen, by_label)
            bag['moving'] = max(own, key=lambda joint: float(np.mean(own[joint][0].truth ** 2)))
            picture = noise_against_delay(own[bag['moving']], styles)
            bag['picture'] = None if picture is None else place(picture)
            bag['joints'] = []
            for joint, shown in own.items():
                points = plots.MOST_NUMBERS // count
                panels, note = over_time_of_joint(comparison, joint, shown, points, styles, front)
                bag['joints'].append((joint, place(panels), note))
    text = 'Every compared sample: evaluate --data FILE.'
    if data is not None:
        text = f'Every compared sample is in {Path(data).name} (numpy.load).'
    page = plots.page(
        'evaluate.html',
        drawn,
        title='Velocity estimates',
        bags=bags,
        styles=styles,
        front=front,
        left_out=left_out,
        data=text,
        version=__version__,
    )
    whole_file.write_text(Path(path), page)


def _rows(comparison: Comparison) -> dict[str, list[Row]]:
    """Return the rows of each joint with the finite difference, best first."""
    found: dict[str, list[Row]] = {}
    for row in comparison.rows:
        found.setdefault(row.joint, []).append(row)
    for joint, own in found.items():
        raw = comparison.raw.get(joint)
        if raw is not None and all(row.source != raw.source for row in own):
            own.append(raw)
    return {joint: ordered(own, comparison.verdicts.get(joint)) for joint, own in found.items()}


def _best(comparison: Comparison, rows: Mapping[str, Sequence[Row]]) -> dict[str, Row]:
    """Return the best row of each joint. The raw difference does not count."""
    found = {}
    for joint, own in rows.items():
        asked = [row for row in own if row is not comparison.raw.get(joint)]
        found[joint] = choice(asked, comparison.verdicts.get(joint))
    return found


def _verdict(
    comparison: Comparison, best: Mapping[str, Row], entries: Mapping[str, Entry]
) -> dict[str, Any]:
    """Return the first screen of a bag."""
    verdicts = comparison.verdicts
    faulty = any(not verdict.choice for verdict in verdicts.values())
    said = [
        f'{joint}: {text}'
        for joint, verdict in verdicts.items()
        if joint in best or not best
        for text in verdict.sentences()
    ]
    if len(best) == 1:
        said = [text.partition(': ')[2] for text in said]
    use_default = [] if best or faulty else [f'Use {DEFAULT} as it is.']
    return {
        'name': Path(comparison.bag).name,
        'path': comparison.bag,
        'truth': comparison.truth.name,
        'faulty': faulty,
        'use': use(best, comparison, entries) or use_default,
        'said': grouped(said, best or verdicts),
        'errors': {},
    }


def _table(
    comparison: Comparison,
    rows: Mapping[str, Sequence[Row]],
    best: Mapping[str, Row],
    entries: Mapping[str, Entry],
) -> dict[str, Any]:
    """Return the table of the estimates, and how good their reference is."""
    every = [row for own in rows.values() for row in own]
    shown = [cells(row) for row in every]
    kept, texts = filled([*COLUMNS], [[each[name] for name in COLUMNS] for each in shown])
    errors: dict[str, dict[str, Any]] = {joint: {} for joint in rows}
    for row, line, text in zip(every, shown, texts):
        verdict = comparison.verdicts.get(row.joint)
        ranked = verdict.best if verdict is not None else not row.reference_cannot_tell
        entry = entries.get(row.source)
        gains = ', '.join(f'{name} {value}' for name, value in entry.values) if entry else ''
        errors[row.joint][row.source] = {
            'source': row.source,
            'best': bool(ranked) and best[row.joint] is row,
            'small': [row.joint] * (len(rows) > 1) + [gains] * bool(gains),
            'cells': text,
            'rms': line['rms'],
        }
    return {
        'columns': [(title, COLUMNS[title]) for title in kept],
        'rows': [line for of in errors.values() for line in of.values()],
        'errors': errors,
        'references': [describe_reference(comparison.truth, joint) for joint in rows],
    }


def _rms(row: Row) -> float:
    return float(np.nan_to_num(row.velocity['rms'], nan=math.inf))


def ordered(rows: Sequence[Row], verdict: Verdict | None) -> list[Row]:
    """Return the rows of a joint in the order of the verdict, else of their errors."""
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


def _is_observer(source: str) -> bool:
    return source in registry.names(registry.OBSERVERS)
