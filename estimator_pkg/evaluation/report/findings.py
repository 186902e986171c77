# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Findings about the measurement and the estimates, with recommendations, as sentences."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry, streams
from estimator_pkg.bags.series import Series
from estimator_pkg.evaluation.checks.joint import FEWEST_READINGS, checked
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.checks.row import LEVELS, PASS
from estimator_pkg.evaluation.compare.comparison import Comparison, Row
from estimator_pkg.evaluation.signals import cubic
from estimator_pkg.evaluation.text import interval, units
from estimator_pkg.sensor.guard import WHY_DROPPED

Array = NDArray[np.float64]

DROPPED_CHECKS = ('repeated stamps', 'missing stamps')  # checks of samples that the guard drops
NO_FINDINGS = 'no findings: no gaps, repeats or jitter, and no dominant cause of errors'
MAIN_PART = 0.7  # a cause explains most of an error if at most this ratio remains without it,
# or this ratio comes from it alone (of an rms, half of the squares)
WITHHELD_PART = 0.05  # a larger fraction of time without an estimate is reported


def look(series: Series, start: int, period: float) -> Readings | None:
    """Return a joint's readings as `doctor` checks them; None for too few.

    Parameters
    ----------
    start : stamp of time zero [ns].
    period : wrap period [rad]; 0: none.
    """
    nothing = np.full(len(series.position), np.nan)
    stamps = series.stamps_ns
    seen = Readings('', stamps, stamps, series.position, nothing, period, start)
    return seen if len(seen.rows) >= FEWEST_READINGS else None


def sentences(comparison: Comparison, of_readings: Mapping[str, list[str]]) -> list[str]:
    """Return findings and recommendations, most important first.

    Parameters
    ----------
    of_readings : by joint, see `of_joint`.
    """
    found: list[str] = []
    found += comparison.refused.values()
    for each in of_readings.values():
        found += each
    for joint in dict.fromkeys(row.joint for row in comparison.rows):
        rows = [row for row in comparison.rows if row.joint == joint]
        found += _of_samples(joint, rows[0])
        best = min(rows, key=lambda row: row.velocity['rms'])
        for row in rows if len(rows) <= 2 else [best]:
            found += _of_errors(row, joint in comparison.refused)
    found += comparison.notes
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
    every = f'all {len(joints)} joints'
    return [
        f'{every if len(names) == len(joints) > 1 else ", ".join(names)}: {text}' if names else text
        for text, names in of.items()
    ]


def of_joint(comparison: Comparison, joint: str, seen: Readings) -> list[str]:
    """Return what the checks of `doctor` find, and one count; dropped samples have a finding."""
    sources = {row.source for row in comparison.rows if row.joint == joint}
    with_quantum = any(has(each, 'quantum', of_topic=True) for each in sources)
    refused = comparison.refused.get(joint, '')
    found = []
    for each in sorted(checked(seen), key=lambda check: -LEVELS.index(check.level)):
        if (
            each.check in DROPPED_CHECKS
            or each.value in refused
            or (each.level == PASS and not each.remedy)
        ):
            continue
        remedy = each.remedy if with_quantum or each.check != 'resolution' else ''
        text = units(each.value, seen.period)
        found.append(f'{joint}: {text}{remedy and f"; {remedy}"}')
    return found


def _of_samples(joint: str, row: Row) -> list[str]:
    return [
        f'{joint}: {count} of {row.samples["received"]} samples dropped: '
        f'{WHY_DROPPED.get(kind, kind)}'
        for kind, count in row.samples['dropped'].items()
    ]


def _of_errors(row: Row, refused: bool) -> list[str]:
    found = []
    name = f'{row.joint}, {row.source}'
    rms, noise = row.velocity['rms'], row.velocity['noise']
    late = row.velocity['delay_s']
    if not refused and not row.reference_cannot_tell and len(row.time) > 8:
        if late == late and late > 0.0 and _shifted(row, late) < MAIN_PART * rms:
            found.append(
                f'{name}: most of its error comes from its delay of '
                + interval(late * 1e3, row.velocity['delay_95_s'] * 1e3, 'ms')
                + advice(
                    row.source,
                    bandwidth_hz='raise bandwidth_hz, or tune it for less delay',
                    prefer="set 'prefer: fast'",
                )
            )
        elif noise == noise and noise > MAIN_PART * rms:
            found.append(
                f'{name}: most of its error is noise'
                + advice(
                    row.source,
                    bandwidth_hz='lower bandwidth_hz, or tune it',
                    prefer="set 'prefer: smooth'",
                )
            )
    away = sum(
        seconds for kind, seconds in row.validity.items() if kind not in ('tracking', 'published')
    )
    total = sum(row.validity.values())
    if total and away > WITHHELD_PART * total:
        kinds = ', '.join(
            f'{kind} {seconds:.2f} s'
            for kind, seconds in row.validity.items()
            if kind not in ('tracking', 'published') and seconds >= 0.01
        )
        found.append(f'{name}: not tracking for {away:.2f} of {total:.2f} s ({kinds})')
    return found


def has(source: str, parameter: str, of_topic: bool = False) -> bool:
    """Return True if the observer has this parameter; `of_topic` for a topic, of any observer."""
    if source not in registry.names(registry.OBSERVERS):
        return of_topic
    return parameter in streams.parameters(source)


def advice(source: str, **texts: str) -> str:
    """Return the text on the first parameter that the observer has, after a colon; '' if none."""
    return next((f': {text}' for name, text in texts.items() if has(source, name)), '')


def _shifted(row: Row, late: float) -> float:
    """Return the rms error against the truth delayed like the estimate."""
    inside = row.time - late >= row.time[0]
    rest = row.estimate[inside] - cubic(row.time, row.truth, row.time[inside] - late)
    return float(np.sqrt(np.mean(np.square(rest)))) if len(rest) else math.inf
