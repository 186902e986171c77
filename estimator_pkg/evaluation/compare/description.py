# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A comparison as text: the table for a terminal, and the quality of the reference."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.evaluation.compare.evaluate import Comparison, Row
from estimator_pkg.evaluation.compare.truth import Truth
from estimator_pkg.evaluation.reference.reference import Reference
from estimator_pkg.evaluation.text import (
    WIDTH,
    error,
    fixed,
    interval,
    number,
    table,
    units,
    wrapped,
)
from estimator_pkg.streams.drive import ELECTRICAL

NARROW_COLUMNS = ('estimate', 'joint', 'rms', 'max', 'delay', 'noise', 'drops')
WIDE_COLUMNS = (
    *('estimate', 'joint', 'rms', 'mean', 'max', 'bias', 'delay', 'noise', 'compared', 'received'),
    *('used', 'dropped'),
)
ZERO_BELOW = 1e-10  # a smaller noise counts as zero [rad/s]


def cells(row: Row) -> dict[str, str]:
    """Return what the tables of a terminal and of a page show of an estimate, by column."""
    v, dropped, difference = row.velocity, row.samples['dropped'], np.abs(row.estimate - row.truth)
    known = np.isfinite(difference).any()
    worst = float(row.time[int(np.nanargmax(difference))]) if known else math.nan
    total = sum(row.validity.values())
    valid = sum(row.validity.get(kind, 0.0) for kind in ('tracking', 'coasting', 'published'))
    places = 2 if total < 1000.0 else 0
    return {
        'estimate': row.source,
        'joint': row.joint,
        'rms': error(v['rms'], 4) + ' *' * row.reference_cannot_tell,
        'mean': error(v['mean_abs'], 4),
        'max': error(v['max_abs'], 3),
        'max at': fixed(worst, 2),
        'bias': fixed(v['bias'], 4),
        'delay': interval(v['delay_s'] * 1e3, v['delay_95_s'] * 1e3),
        'noise': number(v['noise'], 3),
        'in 95 % interval': f'{row.coverage:.0%}' if row.coverage == row.coverage else '-',
        'valid': f'{valid:.{places}f} of {total:.{places}f}' if total else '-',
        'compared': str(row.matched['compared']),
        'received': str(row.samples['received']),
        'used': str(row.samples['used']),
        'samples': f'{row.samples["used"]} of {row.samples["received"]}',
        'drops': str(sum(dropped.values())),  # in all
        'dropped': ' '.join(f'{kind} {count}' for kind, count in dropped.items()) or '0',
    }


def describe(comparison: Comparison, wide: bool = False, period: float = math.tau) -> str:
    """Return the comparison as text.

    Parameters
    ----------
    wide : all columns; else those that fit 80. period : wrap period of the positions; 0: none.
    """
    true = comparison.truth
    head = f'{comparison.bag}: velocity errors [rad/s] against {true.name}, at zero shift'
    columns = WIDE_COLUMNS if wide else NARROW_COLUMNS
    rows = [[cells(row)[name] for name in columns] for row in comparison.rows]
    header = [{'delay': 'delay ms', 'drops': 'dropped'}.get(name, name) for name in columns]
    shown = table(header, rows, left=2, width=None if wide else WIDTH)
    lines = []
    if any(row.reference_cannot_tell for row in comparison.rows):
        lines.append("* the error is below the reference's own error")
    for joint, verdict in comparison.verdicts.items():
        lines += ['', f'{joint}:', *(f'  {each}' for each in verdict.sentences())]
    if comparison.verdicts:
        lines.append('')
    for joint in true.references:
        if joint in true.smoothed and true.smoothed[joint].seldom:
            continue  # the refusal above gives the reason
        lines.append(describe_reference(true, joint))
        if removed := true.corrected.get(joint):
            bias = f', bias {removed["bias"]:.4f} rad/s' if removed['bias'] else ''
            lines.append(f'  removed: lag {removed["lag_s"] * 1e3:.2f} ms{bias}')
    for row in comparison.rows:
        lines += _remarks(row, true)
    said = [each for line in [*lines, *comparison.notes] for each in wrapped(units(line, period))]
    return '\n'.join([*wrapped(units(head, period)), shown, *said])


def _remarks(row: Row, true: Truth) -> list[str]:
    """Return the second sensors of an estimate, and how much of it has no truth of its stamp."""
    name, counts = f'{row.source}, {row.joint}', row.matched
    found = [
        f'{name}: source {source}: {state}'
        for source, state in row.samples.get('sources', {}).items()
    ]
    moved = row.joint in true.corrected  # by its lag, so nearly all truth is interpolated
    ends = moved or row.joint in true.smoothed  # such a reference ends earlier
    usual = moved or (ends and row.joint.endswith(ELECTRICAL))  # or has fewer samples
    few = counts['unmatched'] <= (0.01 * counts['estimates'] if ends else 0)
    if few and (usual or not counts['interpolated']):
        return found
    return [
        *found,
        f'{name}: of {counts["estimates"]} estimates {counts["interpolated"]} have an interpolated '
        f'truth, {counts["unmatched"]} none',
    ]


def describe_reference(true: Truth, joint: str) -> str:
    """Return the quality of a joint's reference, and what of it the record does not determine."""
    known = true.references[joint]
    if joint not in true.smoothed:
        return f'truth of {joint} against the measured position: {_fitted(known)}'
    smoothed = true.smoothed[joint]
    noise, changes = smoothed.noise, smoothed.changes
    if smoothed.seldom:
        return f'{joint}: the reading changes only {changes} times: too rarely for a reference'
    text = (
        f"{joint}: {true.name}'s own error is {number(known.noise, 2)} rad/s rms; readings "
        f'{number(noise.reading, 2)} rad'
    )
    if noise.quantum:
        text += f', counts of {number(noise.quantum, 3)} rad'
        text += ' (which explain it)' * noise.at_floor
    return text + f', {smoothed.outliers} outliers ignored' * bool(smoothed.outliers)


def _fitted(known: Reference) -> str:
    """Return lag, bias, slope and noise of a truth as text."""
    found, unknown = [], []
    for name, value, deviation, decimals, unit in (
        ('lag', known.lag_s * 1e3, known.lag_stddev * 1e3, 2, ' ms'),
        ('bias', known.bias, known.bias_stddev, 4, ' rad/s'),
        ('slope', known.slope, known.slope_stddev, 4, ''),
    ):
        if math.isfinite(value):
            found.append(f'{name} {fixed(value, decimals)} +- {fixed(deviation, decimals)}{unit}')
        else:
            unknown.append(name)
    found.append(f'noise {number(0.0 if known.noise < ZERO_BELOW else known.noise, 2)} rad/s')
    return ', '.join(found) + (f'; not determined: {", ".join(unknown)}' if unknown else '')
