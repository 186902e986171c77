# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find how many periods of a regular device passed between messages, some of which were lost.

The rate of the device is that of the largest line in the spectrum of its stamps. Lost messages
leave it where it is, and jitter of up to 0.7 periods leaves enough of it. With more jitter the
readings show the numbers, while a joint moves fast enough: a step across a lost message is twice
the usual one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from statistics import median

import numpy as np

from estimator_pkg.circle import wrap

LOWEST_RATE, HIGHEST_RATE = 0.98, 1.6  # periods per message, of the rates that are tried
LINE = 0.4  # of the spectrum, over its largest possible value
COUNTED_PERIODS = 4  # largest number of periods that a step shows
NEIGHBOUR_STEPS = 6  # steps to both sides that show what is usual
COMMON = 0.8  # this part of the steps deviates from the usual one by less than
CLEAR_RATIO = 5.0  # times less than the usual one, if they show anything

Arrival = tuple[int, Sequence[str], Sequence[float]]  # stamp [ns], joints, readings [rad or m]


def numbers_of(messages: Sequence[Arrival], periods: Callable[[str], float]) -> list[int] | None:
    """Return the numbers of periods between messages; None if nothing shows them.

    Parameters
    ----------
    periods : (joint) -> its wrap period [rad]; 0: none.
    """
    numbers = by_stamps([stamp for stamp, _, _ in messages])
    for name in () if numbers else messages[0][1]:
        at = [dict(zip(names, readings)).get(name, math.nan) for _, names, readings in messages]
        if all(map(math.isfinite, at)):
            period = periods(name)
            numbers = numbers or by_steps([wrap(b - a, period) for a, b in pairwise(at)])
    return numbers


def by_stamps(stamps: Sequence[int]) -> list[int] | None:
    """Return the numbers as the stamps show them [ns]; None if they do not."""
    since = np.array([stamp - stamps[0] for stamp in stamps], float)
    if since[-1] <= 0.0:
        return None
    rate = (len(since) - 1) / since[-1]
    rates = np.arange(LOWEST_RATE * rate, HIGHEST_RATE * rate, 0.4 / since[-1])
    lines = np.exp(2j * np.pi * np.outer(rates, since)).mean(1)
    best = np.argmax(np.abs(lines))
    phase = np.angle(lines[best]) / (2.0 * np.pi)
    numbers: list[int] = np.diff(np.rint(rates[best] * since - phase)).astype(int).tolist()
    return numbers if abs(lines[best]) > LINE and min(numbers) > 0 else None


def by_steps(steps: Sequence[float]) -> list[int] | None:
    """Return the numbers as steps of a joint's readings show them; None if it is too slow."""
    usual = [
        median(steps[max(0, k - NEIGHBOUR_STEPS) : k + NEIGHBOUR_STEPS + 1])
        for k in range(len(steps))
    ]
    deviations = sorted(abs(step - each) for step, each in zip(steps, usual))
    if min(map(abs, usual)) <= CLEAR_RATIO * deviations[int(COMMON * len(deviations))]:
        return None
    return [min(max(1, round(step / each)), COUNTED_PERIODS) for step, each in zip(steps, usual)]
