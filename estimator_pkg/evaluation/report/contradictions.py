# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Findings that contradict what one expects of a record, each with its reason."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

from estimator_pkg.evaluation.compare.comparison import BAND, Comparison, Row
from estimator_pkg.evaluation.reference.late import MATTERS
from estimator_pkg.evaluation.report.findings import has
from estimator_pkg.evaluation.report.tradeoff import of_row
from estimator_pkg.evaluation.text import interval
from estimator_pkg.streams.angle import AngleSettings

SURE = 2.0  # --correct-reference removes a lag above this many of its standard deviations
NARROW = 0.85  # smallest coverage of a 95 % interval that is not reported
SMALLER = 0.9  # a part of the error is smaller below this ratio


def contradictions(
    comparison: Comparison, rows: Mapping[str, Sequence[Row]], chosen: Mapping[str, Row]
) -> list[str]:
    """Return the findings.

    Parameters
    ----------
    rows : by joint. chosen : by joint, the row to use.
    """
    late: list[str] = []
    other_best: dict[tuple[str, str, str], dict[str, float]] = {}
    narrow: dict[tuple[str, ...], dict[str, float]] = {}
    for joint, of_joint in rows.items():
        late += _late_reference(comparison, joint)
        other = _better_than_default(of_joint, chosen.get(joint))
        if other is not None:
            default, better, why = other
            ratio = better.velocity['rms'] / max(default.velocity['rms'], 1e-300)
            other_best.setdefault((default.source, better.source, why), {})[joint] = ratio
        names = tuple(row.source for row in of_joint if _is_narrow(row))
        if names:
            least = min(row.coverage for row in of_joint if _is_narrow(row))
            narrow.setdefault(names, {})[joint] = least
    found = late
    for (default_name, name, why), ratios in other_best.items():
        found.append(
            f'{listed(ratios, rows)}: {default_name}, the default, is not the best here. {name} '
            f'has {_range(ratios.values())} of its error{why}'
        )
    for names, covered in narrow.items():
        lagging = [name for name in names if has(name, 'bandwidth_hz')]
        found.append(
            f'{listed(covered, rows)}: the 95 % interval is too narrow for {", ".join(names)} (it '
            f'contains {100.0 * min(covered.values()):.0f} % of the errors): a noise model '
            'knows the noise of the readings, and not the lag while the joint accelerates'
            + (f'. Raise bandwidth_hz of {", ".join(lagging)}' if lagging else '')
        )
    return found


def grouped(findings: Iterable[str], joints: Collection[str]) -> list[str]:
    """Return the findings, with those that are equal but for the joint in one sentence.

    Parameters
    ----------
    findings : a finding on a joint begins with its name and a colon.
    """
    of: dict[str, list[str]] = {}
    for finding in findings:
        joint, colon, text = finding.partition(': ')
        known = bool(colon) and joint in joints
        of.setdefault(text if known else finding, []).extend([joint] if known else [])
    return [f'{listed(names, joints)}: {text}' if names else text for text, names in of.items()]


def listed(some: Collection[str], joints: Collection[str]) -> str:
    """Return the names of some of the joints."""
    return f'all {len(joints)} joints' if len(some) == len(joints) > 1 else ', '.join(some)


def _range(values: Collection[float]) -> str:
    low, high = f'{min(values):.2g}', f'{max(values):.2g}'
    return low if low == high else f'{low} to {high}'


def _late_reference(comparison: Comparison, joint: str) -> list[str]:
    known = comparison.references.get(joint)
    if known is None or joint in comparison.smoothed or joint in comparison.corrected:
        return []
    lag = known.lag_s
    if not (math.isfinite(lag) and abs(lag) > max(MATTERS, SURE * known.lag_stddev)):
        return []
    return [
        f'{joint}: the reference is {interval(abs(lag) * 1e3, BAND * known.lag_stddev * 1e3)} ms '
        f'{"late" if lag > 0.0 else "early"} against the measured position, so every delay here '
        f'is {"smaller" if lag > 0.0 else "larger"} than it should be by that. Shift the '
        'reference: --correct-reference'
    ]


def _better_than_default(rows: Sequence[Row], used: Row | None) -> tuple[Row, Row, str] | None:
    """Return (default, the one that is used instead, why); None if the default is used."""
    default = next((row for row in rows if row.source == AngleSettings.observer), None)
    if default is None or used is None or used is default:
        return None
    (late, noise), (late_other, noise_other) = of_row(default), of_row(used)
    why = ''
    if noise_other < SMALLER * noise:
        why = ', because it is less noisy'
    elif abs(late_other) < SMALLER * abs(late):
        why = ', because it is less late'
    return default, used, why


def _is_narrow(row: Row) -> bool:
    return math.isfinite(row.coverage) and row.coverage < NARROW and not row.reference_cannot_tell
