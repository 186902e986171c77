# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A comparison as text: the table for a terminal, and the quality of the reference."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.evaluation.compare.comparison import ZERO_BELOW, Comparison, Row
from estimator_pkg.evaluation.compare.truth import OFFLINE_SMOOTHER
from estimator_pkg.evaluation.reference.reference import Reference
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed
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
        'delay': interval(_ms(v['delay_s']), _ms(v['delay_95_s'])),
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
    head = f'{comparison.bag}: velocity errors [rad/s] against {comparison.truth}, at zero shift'
    lines: list[str] = []
    rows, remarks = [], []
    for row in comparison.rows:
        rows.append(cells(row))
        for source, state in row.samples.get('sources', {}).items():
            remarks.append(f'{row.source}, {row.joint}: source {source}: {state}')
        counts = row.matched
        moved = row.joint in comparison.corrected  # by its lag, so nearly all truth is interpolated
        ends = moved or row.joint in comparison.smoothed  # such a reference ends earlier
        moved = moved or (ends and row.joint.endswith(ELECTRICAL))  # or has fewer samples
        if counts['unmatched'] > (0.01 * counts['estimates'] if ends else 0) or (
            counts['interpolated'] and not moved
        ):
            remarks.append(
                f'{row.source}, {row.joint}: of {counts["estimates"]} estimates '
                f'{counts["interpolated"]} have an interpolated truth, '
                f'{counts["unmatched"]} none'
            )
    columns = WIDE_COLUMNS if wide else NARROW_COLUMNS
    texts = [[row[name] for name in columns] for row in rows]
    header = [{'delay': 'delay ms', 'drops': 'dropped'}.get(name, name) for name in columns]
    shown = table(header, texts, left=2, width=None if wide else WIDTH)
    if any(row.reference_cannot_tell for row in comparison.rows):
        lines.append("* the error is below the reference's own error")
    for joint, verdict in comparison.verdicts.items():
        lines += ['', f'{joint}:', *(f'  {each}' for each in verdict.sentences())]
    if comparison.verdicts:
        lines.append('')
    for joint, known in comparison.references.items():
        if joint in comparison.smoothed:
            if comparison.smoothed[joint].seldom:
                continue  # the refusal above gives the reason
            lines.append(f'{joint}: {describe_smoother(comparison.smoothed[joint], known.noise)}')
            continue
        lines.append(f'truth of {joint} against the measured position: {describe_truth(known)}')
        if joint in comparison.corrected:
            removed = comparison.corrected[joint]
            bias = f', bias {removed["bias"]:.4f} rad/s' if removed['bias'] else ''
            lines.append(f'  removed: lag {_ms(removed["lag_s"]):.2f} ms{bias}')
    lines = [units(line, period) for line in [head, *lines, *remarks, *comparison.notes]]
    said = [each for line in lines[1:] for each in wrapped(line)]
    return '\n'.join([*wrapped(lines[0]), shown, *said])


def describe_smoother(smoothed: Smoothed, own: float) -> str:
    """Return the quality and the inputs of the off-line reference as text.

    Parameters
    ----------
    own : expected error of its velocity [rad/s].
    """
    noise = smoothed.noise
    if smoothed.seldom:
        return (
            f'the reading changes only {smoothed.changes} times: too rarely for an off-line '
            'reference'
        )
    text = (
        f"{OFFLINE_SMOOTHER}'s own error is {number(own, 2)} rad/s rms; readings "
        f'{number(noise.reading, 2)} rad'
    )
    if noise.quantum:
        text += f', counts of {number(noise.quantum, 3)} rad' + (
            ' (which explain it)' if noise.at_floor else ''
        )
    if smoothed.outliers:
        text += f', {smoothed.outliers} outliers ignored'
    return text


def describe_truth(known: Reference) -> str:
    """Return lag, bias, slope and noise as text, and those that the record does not determine."""
    known_values, unknown = [], []
    for name, value, deviation, decimals, unit in (
        ('lag', _ms(known.lag_s), _ms(known.lag_stddev), 2, ' ms'),
        ('bias', known.bias, known.bias_stddev, 4, ' rad/s'),
        ('slope', known.slope, known.slope_stddev, 4, ''),
    ):
        if math.isfinite(value):
            known_values.append(
                f'{name} {fixed(value, decimals)} +- {fixed(deviation, decimals)}{unit}'
            )
        else:
            unknown.append(name)
    noise = 0.0 if known.noise < ZERO_BELOW else known.noise
    known_values.append(f'noise {number(noise, 2)} rad/s')
    return ', '.join(known_values) + (f'; not determined: {", ".join(unknown)}' if unknown else '')


def _ms(seconds: float) -> float:
    return seconds * 1e3
