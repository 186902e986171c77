# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Findings about the measurement and the estimates, with recommendations, as sentences."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from estimator_pkg import registry, streams
from estimator_pkg.bags.series import Series
from estimator_pkg.evaluation.checks.joint import FEWEST_READINGS, checked
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.checks.row import LEVELS, PASS
from estimator_pkg.evaluation.compare.evaluate import Comparison, Row
from estimator_pkg.evaluation.compare.metrics import rms_at_delay
from estimator_pkg.evaluation.text import interval, units
from estimator_pkg.sensor.guard import WHY_DROPPED
from estimator_pkg.streams.drive import ELECTRICAL

DROPPED_CHECKS = ('repeated stamps', 'missing stamps')  # checks of samples that the guard drops
MAIN_PART = 0.7  # a cause explains most of an error if at most this ratio remains without it,
# or this ratio comes from it alone (of an rms, half of the squares)
WITHHELD_PART = 0.05  # a larger fraction of time without an estimate is reported
GOOD = ('tracking', 'published')  # seconds of these are seconds with an estimate


class Findings(NamedTuple):
    """Sentences on a bag, and the quantum of the readings of each joint [rad or m]; 0: none."""

    sentences: list[str]
    quanta: dict[str, float]


def findings(comparison: Comparison, period: float) -> Findings:
    """Return the findings on a bag; `period`: wrap period of its positions [rad]; 0: none."""
    joints = list(dict.fromkeys(row.joint for row in comparison.rows))
    of_readings, quanta = {}, {}
    for joint in joints:
        series = comparison.measurement.get(joint)
        if series is not None and not joint.endswith(ELECTRICAL):
            seen = look(series, comparison.start(joint), period)
            if len(seen.rows) >= FEWEST_READINGS:
                of_readings[joint] = of_joint(comparison, joint, seen)
                quanta[joint] = seen.own_quantum
    return Findings(grouped(sentences(comparison, of_readings), joints), quanta)


def look(series: Series, start: int, period: float) -> Readings:
    """Return a joint's readings as `doctor` checks them.

    Parameters
    ----------
    start : stamp of time zero [ns]. period : wrap period [rad]; 0: none.
    """
    nothing = np.full(len(series.position), np.nan)
    return Readings('', series.stamps_ns, series.stamps_ns, series.position, nothing, period, start)


def sentences(comparison: Comparison, of_readings: Mapping[str, list[str]]) -> list[str]:
    """Return findings and recommendations, most important first.

    Parameters
    ----------
    of_readings : by joint, see `of_joint`.
    """
    found = list(comparison.refused.values())
    for each in of_readings.values():
        found += each
    for joint in dict.fromkeys(row.joint for row in comparison.rows):
        rows = [row for row in comparison.rows if row.joint == joint]
        received, dropped = rows[0].samples['received'], rows[0].samples['dropped']
        found += [
            f'{joint}: {count} of {received} samples dropped: {WHY_DROPPED.get(kind, kind)}'
            for kind, count in dropped.items()
        ]
        best = min(rows, key=lambda row: row.velocity['rms'])
        for row in rows if len(rows) <= 2 else [best]:
            if joint not in comparison.refused:
                found += _of_errors(row)
            found += _of_validity(row)
    return [*found, *comparison.notes]


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
    with_quantum = any(_parameters(each) is None or has(each, 'quantum') for each in sources)
    refused = comparison.refused.get(joint, '')
    found = []
    for each in sorted(checked(seen), key=lambda check: -LEVELS.index(check.level)):
        known = each.check in DROPPED_CHECKS or each.value in refused
        if known or (each.level == PASS and not each.remedy):
            continue
        remedy = each.remedy if with_quantum or each.check != 'resolution' else ''
        text = units(each.value, seen.period)
        found.append(f'{joint}: {text}{remedy and f"; {remedy}"}')
    return found


def _of_errors(row: Row) -> list[str]:
    """Return the cause of most of an error, and the gain to change; [] if there is none."""
    rms, noise, late = (row.velocity[name] for name in ('rms', 'noise', 'delay_s'))
    if row.reference_cannot_tell or len(row.time) <= 8:
        return []
    name = f'{row.joint}, {row.source}: most of its error'
    if late > 0.0 and rms_at_delay(row.time, row.estimate, row.truth, late) < MAIN_PART * rms:
        text = (
            f'comes from its delay of {interval(late * 1e3, row.velocity["delay_95_s"] * 1e3)} ms'
        )
        gains = {
            'bandwidth_hz': 'raise bandwidth_hz, or tune it for less delay',
            'prefer': "set 'prefer: fast'",
        }
    elif noise > MAIN_PART * rms:
        text = 'is noise'
        gains = {'bandwidth_hz': 'lower bandwidth_hz, or tune it', 'prefer': "set 'prefer: smooth'"}
    else:
        return []
    advice = next((f': {what}' for gain, what in gains.items() if has(row.source, gain)), '')
    return [f'{name} {text}{advice}']


def _of_validity(row: Row) -> list[str]:
    """Return for how long an estimate is not tracking, if that is long."""
    away = {kind: seconds for kind, seconds in row.validity.items() if kind not in GOOD}
    total = sum(row.validity.values())
    if sum(away.values()) <= WITHHELD_PART * total:
        return []
    kinds = ', '.join(f'{kind} {each:.2f} s' for kind, each in away.items() if each >= 0.01)
    name = f'{row.joint}, {row.source}'
    return [f'{name}: not tracking for {sum(away.values()):.2f} of {total:.2f} s ({kinds})']


def has(source: str, parameter: str) -> bool:
    """Return True if the source is an observer that has this parameter."""
    return parameter in (_parameters(source) or {})


def _parameters(source: str) -> Mapping[str, object] | None:
    """Return the parameters of an observer; None for a recorded topic."""
    if source not in registry.names(registry.OBSERVERS):
        return None
    return streams.parameters(source)
