# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The first screen of a report page: what to use, in words and as a parameter file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from estimator_pkg import observers, params_file, registry, streams, yaml_text
from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.ranking.choice import chosen
from estimator_pkg.evaluation.ranking.verdict import Verdict, listed
from estimator_pkg.evaluation.report.findings import grouped
from estimator_pkg.evaluation.report.tables import SHOWN_GAINS, changed
from estimator_pkg.evaluation.report.tradeoff import RAW, of_row
from estimator_pkg.evaluation.text import interval, number
from estimator_pkg.observers import DEFAULT
from estimator_pkg.parameters import declared

NO_DELAY = 1e-4  # shorter delays are not worth a number [s]


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
        source: row.velocity['rms'] if _finite(row, 'rms') else math.inf
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
) -> list[str]:
    """Return the verdict in sentences.

    Parameters
    ----------
    chosen, raw : by joint, the row to use and that of the finite difference.
    entries : by source, the observers that were run.
    """
    by_source: dict[str, list[str]] = {}
    for joint, row in chosen.items():
        if not faulty(verdicts.get(joint)):
            by_source.setdefault(to_use(row, verdicts.get(joint)), []).append(joint)
    found = []
    for source, joints in by_source.items():
        rows = [chosen[joint] for joint in joints if chosen[joint].source == source]
        values, *others = [changed(entries.get(source), joint) for joint in joints]
        if len(values) > SHOWN_GAINS or any(each != values for each in others):
            how = ' with the parameters below'
        elif values:
            how = ' with ' + ', '.join(f'{name} {text}' for name, text in values.items())
        else:
            how = ' as it is' if source in entries or _known(source) else ''
        on = '' if len(by_source) == 1 else f' on {listed(joints)}'
        if len(by_source) == 1 and len(joints) > 1:
            on = f' on all {len(joints)} joints'
        beside = [raw[row.joint] for row in rows if row.joint in raw and source != RAW]
        found.append(
            ' '.join([f'Use {source}{how}{on}.', *_quality(rows), *_against(rows, beside, entries)])
        )
    of_joints = [
        f'{joint}: {text}'
        for joint, verdict in verdicts.items()
        if joint in chosen
        for text in verdict.sentences()
    ]
    if len(chosen) > 1:
        return found + grouped(of_joints, chosen)
    return found + [text.partition(': ')[2] for text in of_joints]


def to_use(row: Row, verdict: Verdict | None) -> str:
    """Return the name of the estimate to use: that of the row, unless nothing can be ranked."""
    return verdict.choice or row.source if verdict is not None else row.source


def faulty(verdict: Verdict | None) -> bool:
    """Return True if nothing is recommended: the readings must be mended first."""
    return verdict is not None and not verdict.choice


def _quality(rows: Sequence[Row]) -> list[str]:
    """Return error, delay, noise and coverage of the worst joint."""
    if not rows:
        return []
    parts = [f'its error is {number(_worst(rows), 2)} rad/s rms']
    late = max(
        (
            abs(row.velocity['delay_s']) + row.velocity['delay_95_s']
            for row in rows
            if _finite(row, 'delay_s')
        ),
        default=-1.0,
    )
    if late > NO_DELAY:
        parts.append(f'it follows within {number(late * 1e3, 2)} ms')
    elif late >= 0.0:
        parts.append('it follows within 0.1 ms')
    noise = max((row.velocity['noise'] for row in rows if _finite(row, 'noise')), default=-1.0)
    if noise >= 0.0:
        parts.append(f'noise {number(noise, 2)} rad/s at constant speed')
    covered = [row.coverage for row in rows if math.isfinite(row.coverage)]
    if covered:
        parts.append(f'its 95 % interval contained {100.0 * min(covered):.0f} % of the errors')
    text = '; '.join(parts)
    return [text[0].upper() + text[1:] + '.']


def _against(rows: Sequence[Row], raw: Sequence[Row], entries: Mapping[str, Entry]) -> list[str]:
    """Return the sentence on the finite difference."""
    late, ratios = [], []
    for row, other in zip(rows, raw):
        if _finite(other, 'delay_s'):
            late.append((other.velocity['delay_s'], other.velocity['delay_95_s']))
        if _finite(row, 'noise') and _finite(other, 'noise') and row.velocity['noise'] > 0.0:
            ratios.append(other.velocity['noise'] / row.velocity['noise'])
            continue
        own, theirs = of_row(row)[1], of_row(other)[1]
        if own > 0.0 and math.isfinite(theirs):
            ratios.append(theirs / own)
    if not raw:
        return []
    parts = [f'has an error of {number(_worst(raw), 2)} rad/s rms']
    if late:
        middle, half = sorted(late)[len(late) // 2]
        parts.append(
            'has no delay'
            if abs(middle) + half < 0.5 * NO_DELAY
            else f'is {interval(middle * 1e3, half * 1e3, "ms")} late'
        )
    if ratios:
        ratio = float(np.median(ratios))
        parts.append(
            'has the same noise'
            if 0.95 < ratio < 1.05
            else f'is {number(ratio, 2)} times noisier'
            if ratio >= 2.0
            else f'has {number(ratio, 2)} times the noise'
        )
    known_gains = declared(observers.find(RAW).gains)
    values = dict(entries[RAW].values) if RAW in entries else {}
    hz = values.get('bandwidth_hz', known_gains['bandwidth_hz'].default)
    return [f'Your finite difference, low-passed at {hz:g} Hz, {listed(parts)}.']


def _worst(rows: Sequence[Row]) -> float:
    return max(float(row.velocity['rms']) for row in rows)


def _finite(row: Row, name: str) -> bool:
    return bool(math.isfinite(row.velocity[name]))


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
    lines = [
        yaml_text.comment(f'{observer}, from {Path(comparison.bag).name}'),
        f'# ros2 run velocity_estimator {stream.NODE} \\',
        '#   --ros-args --params-file THIS_FILE',
        '/**:',
        '  ros__parameters:',
    ]
    if 'observer' in known:
        lines.append(f'    observer: {yaml_text.scalar(observer)}')
    if stream.WRAPS and abs(period - 2.0 * math.pi) > 1e-9:
        lines.append(f'    wrap_period: {period!r}')
    lines += [
        f'    {yaml_text.key(name)}: {known[params_file.parameter_of(name)].text(value)}'
        for name, value in values.items()
    ]
    counted = {joint: quantum for joint, quantum in quanta.items() if quantum}
    if counted and 'quantum' in known and 'quantum' not in values:
        if len({f'{each:.3g}' for each in counted.values()}) == 1 and len(counted) == len(quanta):
            quantum = float(np.median(list(counted.values())))
            lines += [f'    # {_counts(quantum)}', f'    quantum: {quantum:.6g}']
        else:
            for joint, quantum in counted.items():
                lines.append(f'    {yaml_text.key(f"{params_file.OVERRIDES}.{joint}")}:')
                lines += [f'      # {_counts(quantum)}', f'      quantum: {quantum:.6g}']
    return '\n'.join(lines) + '\n'


def _counts(quantum: float) -> str:
    return f'from the readings: {2.0 * math.pi / quantum:.0f} counts a turn'
