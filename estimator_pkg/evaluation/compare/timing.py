"""Timing two or more things side by side, so that what else the machine does hits them alike."""

from __future__ import annotations

import gc
import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Side = Callable[[int], float]


def interleave(
    sides: Mapping[str, Side], rounds: int, advance: Callable[[int], Any] = lambda steps: None
) -> dict[str, list[float]]:
    """A B C A B C ...: the times [s] of each side, one per round.

    Parameters
    ----------
    sides : name -> (round number) -> its time [s].
    rounds : how often each side runs; one more run of each before them does not count.
    advance : told of each run (for a progress bar).
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


def best_and_median(times: Sequence[float]) -> tuple[float, float]:
    """The smallest and the median of some times."""
    return min(times), statistics.median(times)


def ratio(of: Sequence[float], to: Sequence[float]) -> float:
    """The median over the rounds of one side's time over the other's in the same round."""
    return statistics.median(a / b for a, b in zip(of, to))


def row(
    name: str,
    value: float | None,
    unit: str,
    *,
    limit: float | None = None,
    at_least: bool = False,
    **more: Any,
) -> dict[str, Any]:
    """One line of a benchmark.

    Parameters
    ----------
    value : what was measured; None: not run (say why in `why`).
    limit : what is required of it; None: nothing.
    at_least : the value must reach the limit; else it must not exceed it.
    more : min, median, peer, why, ...: kept as they are.
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
    """A line for what could not be measured here."""
    return row(name, None, '', why=why)
