# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure times of several functions in turn, so that other load on the machine hits all."""

from __future__ import annotations

import gc
import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from benchmarks.runner import Part, Table
from estimator_pkg.evaluation.text import number

Side = Callable[[int], float]


def interleave(
    sides: Mapping[str, Side], rounds: int, advance: Callable[[int], Any] = lambda steps: None
) -> dict[str, list[float]]:
    """Run A B C A B C ...; return the times [s] of each side, one per round.

    Parameters
    ----------
    sides : name -> (round number) -> its time [s].
    rounds : runs of each side, after one warm-up run that does not count.
    advance : called with 1 after each run (for a progress bar).
    """
    times: dict[str, list[float]] = {name: [] for name in sides}
    was_enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        for number in range(-1, rounds):
            for name, side in sides.items():
                taken = side(number + 1)
                if number >= 0:
                    times[name].append(taken)
                advance(1)
    finally:
        if was_enabled:
            gc.enable()
    return times


def ratio(of: Sequence[float], to: Sequence[float]) -> float:
    """Return the median over the rounds of one side's time over the other's in the same round."""
    return statistics.median(a / b for a, b in zip(of, to))


def compared(
    title: str,
    times: Mapping[str, Sequence[float]],
    convert: Callable[[float], float],
    unit: str,
    peer: str,
    factors: Mapping[str, float],
) -> list[dict[str, Any]]:
    """Return rows: each side's cost at its best and at the median, and the peer's time over it.

    Parameters
    ----------
    convert : time [s] -> the cost in `unit`.
    factors : required ratio, by side; the others have no requirement.
    """
    rows = []
    for name, own in times.items():
        best, median = convert(min(own)), convert(statistics.median(own))
        rows.append(row(f'{title} {name}'.strip(), best, unit, median=median))
        if name != peer and peer in times:
            value, limit = ratio(times[peer], own), factors.get(name)
            rows.append(row(f'{peer} / {name}', value, 'times', limit=limit, at_least=True))
    return rows


def row(
    name: str,
    value: float | None,
    unit: str,
    *,
    limit: float | None = None,
    at_least: bool = False,
    **more: Any,
) -> dict[str, Any]:
    """Return one row of a benchmark.

    Parameters
    ----------
    value : the measured value; None: not run (give the reason in `why`).
    limit : the required limit; None: none.
    at_least : the value must reach the limit; else it must not exceed it.
    more : min, median, peer, why, ...: copied into the row.
    """
    met = None
    if limit is not None and value is not None:
        met = value >= limit if at_least else value <= limit
    return {
        'name': name,
        'value': value,
        'unit': unit,
        'limit': limit,
        'required': None if limit is None else ('at least' if at_least else 'at most'),
        'ok': met,
        **more,
    }


def not_run(name: str, why: str) -> dict[str, Any]:
    """Return a row for a benchmark that could not run here."""
    return row(name, None, '', why=why)


def part(rows: list[dict[str, Any]]) -> Part:
    """Return the rows, and their table with the requirements that are not met."""
    lines = []
    for each in rows:
        limit, value = each['limit'], number(each['value'])
        if each['value'] is None:
            lines.append((each['name'], 'not run', '', '', each.get('why', '')))
            continue
        met = '' if limit is None else f'{each["required"]} {number(limit)}: '
        met += {None: '', True: 'yes', False: 'NO'}[each['ok']]
        lines.append((each['name'], value, number(each.get('median')), each['unit'], met))
    missed = [each['name'] for each in rows if each['ok'] is False]
    return rows, [
        'value, median over the rounds, requirement',
        Table(('', 'value', 'median', 'unit', 'required'), lines),
        'requirement not met: ' + '; '.join(missed) if missed else '',
    ]
