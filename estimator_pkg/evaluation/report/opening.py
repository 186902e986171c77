# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The first screen of a report page: what to use, in words and as a parameter file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from estimator_pkg import registry, streams
from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import PERIOD_KEY, WRAP_PERIOD
from estimator_pkg.evaluation.parameter_file import as_yaml
from estimator_pkg.evaluation.ranking.verdict import Verdict, chosen, listed
from estimator_pkg.evaluation.report.findings import grouped
from estimator_pkg.evaluation.report.tables import changed
from estimator_pkg.evaluation.report.tradeoff import RAW
from estimator_pkg.evaluation.text import for_node, number
from estimator_pkg.observers import DEFAULT


def ordered(rows: Sequence[Row], verdict: Verdict | None) -> list[Row]:
    """Return the rows of a joint in the order of the verdict, else of their errors."""
    place = {name: i for i, name in enumerate(verdict.rms)} if verdict else {}
    return sorted(
        rows,
        key=lambda row: (
            place.get(row.source, len(place)),
            row.velocity['rms'] if math.isfinite(row.velocity['rms']) else math.inf,
        ),
    )


def choice(rows: Sequence[Row], verdict: Verdict | None) -> Row:
    """Return the row to use, by the rule of `chosen`."""
    order = ordered(rows, verdict)
    if verdict is not None:
        return next((row for row in order if row.source == verdict.choice), order[0])
    by_source = {row.source: row for row in order}
    errors = {
        source: row.velocity['rms'] if math.isfinite(row.velocity['rms']) else math.inf
        for source, row in by_source.items()
    }

    def better(one: str, other: str) -> int:
        """Return the result of the pair against the truth, where both have an estimate."""
        a, b = by_source[one], by_source[other]
        time, *rows = np.intersect1d(a.time, b.time, return_indices=True)
        if len(time) < 2:
            return 0
        squares = [(row.estimate[at] - row.truth[at]) ** 2 for row, at in zip((a, b), rows)]
        block = pairs.blocks(time)
        return pairs.of_sums(
            [np.bincount(block, squares[0] - squares[1])], [np.bincount(block)]
        ).sign

    return by_source[chosen(errors, (DEFAULT,), better)]


def words(
    chosen: Mapping[str, Row],
    raw: Mapping[str, Row],
    entries: Mapping[str, Entry],
    verdicts: Mapping[str, Verdict],
) -> tuple[list[str], list[str]]:
    """Return the recommendations, and the other sentences of the verdict.

    Parameters
    ----------
    chosen, raw : by joint, the row to use and that of the finite difference.
    entries : by source, the observers that were run.
    """
    by_source: dict[str, list[str]] = {}
    for joint, row in chosen.items():
        if not faulty(verdicts.get(joint)):
            by_source.setdefault(to_use(row, verdicts.get(joint)), []).append(joint)
    use = []
    for source, joints in by_source.items():
        how = ' as it is' if source in entries or _known(source) else ''
        if any(changed(entries.get(source), joint) for joint in joints):
            how = ' with the parameters below'
        on = '' if len(by_source) == 1 else f' on {listed(joints)}'
        if len(by_source) == 1 and len(joints) > 1:
            on = f' on all {len(joints)} joints'
        text = f'Use {source}{how}{on}.'
        own = [row for joint in joints if (row := chosen[joint]).source == source]
        theirs = [raw[row.joint] for row in own if row.joint in raw and source != RAW]
        if own:
            text += f' Its error is {_worst(own)} rad/s rms'
            text += f', that of {RAW} {_worst(theirs)}.' if theirs else '.'
        use.append(text)
    said = [
        f'{joint}: {text}'
        for joint, verdict in verdicts.items()
        if joint in chosen
        for text in verdict.sentences()
    ]
    if len(chosen) > 1:
        return use, grouped(said, chosen)
    return use, [text.partition(': ')[2] for text in said]


def to_use(row: Row, verdict: Verdict | None) -> str:
    """Return the name of the estimate to use: that of the row, unless nothing can be ranked."""
    return verdict.choice or row.source if verdict is not None else row.source


def faulty(verdict: Verdict | None) -> bool:
    """Return True if nothing is recommended: the readings must be mended first."""
    return verdict is not None and not verdict.choice


def _worst(rows: Sequence[Row]) -> str:
    return number(max(float(row.velocity['rms']) for row in rows), 2)


def _known(source: str) -> bool:
    return source in registry.names(registry.OBSERVERS)


def parameter_file(
    comparison: Comparison,
    chosen: Mapping[str, Row],
    entries: Mapping[str, Entry],
    quanta: Mapping[str, float],
    period: float,
    verdicts: Mapping[str, Verdict],
) -> str:
    """Return the parameter file of the node for the chosen observer.

    A node has one observer: the one that most joints need. '' if it is no observer, or if nothing
    is recommended for any joint.

    Parameters
    ----------
    quanta : of the readings [rad], by joint; 0: none.
    """
    chosen = {joint: row for joint, row in chosen.items() if not faulty(verdicts.get(joint))}
    quanta = {joint: quantum for joint, quantum in quanta.items() if joint in chosen}
    if not chosen:
        return ''
    sources = [to_use(row, verdicts.get(joint)) for joint, row in chosen.items()]
    source = max(dict.fromkeys(sources), key=sources.count)
    entry = entries.get(source)
    if entry is None and not _known(source):
        return ''
    observer = source if entry is None else entry.observer
    values = {} if entry is None else dict(entry.values)
    stream = streams.of_observer(observer)
    known = streams.parameters(observer, values)
    if stream.WRAPS and period != WRAP_PERIOD:
        values = {PERIOD_KEY: period} | values
    if 'observer' in known:
        values = {'observer': observer} | values
    head = [f'{observer}, from {Path(comparison.bag).name}', *for_node(stream.NODE)]
    return as_yaml(head, values, quanta if 'quantum' in known else {})
