# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The guard for time and data before every observer, one per joint."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from estimator_pkg.parameters import parameter
from estimator_pkg.record import record

# Verdicts. Below DUPLICATE the sample is used.
USED_SAMPLE = 0
FIRST_SAMPLE = 1
AFTER_GAP = 2  # position re-initialised, speed kept
AFTER_CLOCK_JUMP = 3  # reset: a looping bag, a restarted simulation
AFTER_STRAY_STAMP = 4  # the previous stamp was far in the future: continue from the one before it
AFTER_OUTAGE = 5  # a new start: the motion before is too old
DUPLICATE = 6
LATE_STAMP = 7
NON_FINITE = 8
ZERO_STAMP = 9
UNSTABLE_GAINS = 10
REPEATED_READING = 11  # an earlier reading, published again: see `sensor.holds`
VERDICTS = (
    'used',
    'first',
    'gap',
    'clock_jump',
    'stray_stamp',
    'outage',
    'duplicate',
    'late',
    'non_finite',
    'zero_stamp',
    'misconfigured',
    'repeated',
)
NEW_STARTS = (AFTER_CLOCK_JUMP, AFTER_OUTAGE)  # turns may have been lost in them
DROP_REASONS = VERDICTS[DUPLICATE:]

WHY_DROPPED = {
    'duplicate': 'repeated stamps: the driver publishes faster than it stamps',
    'late': 'stamps older than the previous one: messages overtake each other',
    'zero_stamp': 'no time stamp',
    'non_finite': 'NaN or infinite positions, or too large for any joint',
    'misconfigured': 'gains that are unstable at this sample rate: lower them, or sample faster',
    'repeated': 'repeated readings: the sensor is slower than its driver',
}

LATE_IN_A_ROW = 3  # this many late stamps in a row mean that the clock jumped
SLOW_STREAM = 4.0  # a gap is at least this many mean sample times: slow streams have none
LONGEST_FIRST = 8.0  # largest plausible first sample time [s]: 0.5 Hz with three samples lost


@dataclass(frozen=True)
class GuardSettings:
    """Limits of the guard, declared once for nodes, commands and docs."""

    gap_max: float = parameter(
        0.2,
        unit='s',
        range=(0.001, 3600.0),
        description='a longer gap re-initialises the position and keeps the speed '
        '(never shorter than four mean sample times)',
    )
    reorder_window: float = parameter(
        0.1,
        unit='s',
        range=(0.0, 10.0),
        advanced=True,
        description='stamps older than the last one by at most this are late and dropped; '
        'older ones mean that the clock jumped',
    )
    timeout: float = parameter(
        0.5,
        unit='s',
        range=(0.01, 3600.0),
        description='after this time without input (steady clock) the joint is lost; a longer gap '
        'between stamps is a new start (neither is ever shorter than gap_max or four mean sample '
        'times)',
    )


@record
class Limits:
    """The guard's limits in the form that the driver uses."""

    gap_ns: int
    reorder_ns: int
    timeout_ns: int
    longest_dt: float  # sample time beyond which the gains are unstable [s]
    period: float  # wrap period of a single angle [rad]; 0: none
    count: float  # the quantum of its readings as given [rad]; 0: not known


def longest_dt(limits: Callable[[float], str | None]) -> float:
    """Return the longest sample time [s] that an observer's `limits` accepts; inf for no limit.

    `limits` must be monotone: if it refuses a dt it refuses every longer one.
    """
    low, high = 1e-7, 100.0
    if limits(high) is None:
        return math.inf
    if limits(low) is not None:
        return 0.0
    while high / low > 1.0 + 1e-9:
        middle = math.sqrt(low * high)
        if limits(middle) is None:
            low = middle
        else:
            high = middle
    return low


def limits(settings: Any, longest_dt: float, period: float = 0.0, quantum: float = 0.0) -> Limits:
    """Return settings as `GuardSettings` has in ns, and the others as `Limits` has."""
    made = Limits()
    made.gap_ns = round(settings.gap_max * 1e9)
    made.reorder_ns = round(settings.reorder_window * 1e9)
    made.timeout_ns = round(settings.timeout * 1e9)
    made.longest_dt = float(longest_dt)
    made.period, made.count = float(period), float(quantum)
    return made


def why_dropped(received: int, dropped: Mapping[str, int], stamp_remedy: str) -> str:
    """Return why one cause dropped more than half of the samples; '' if none did.

    Parameters
    ----------
    received : number of samples. dropped : their numbers by cause.
    stamp_remedy : what to do about missing stamps.
    """
    for kind, count in dropped.items():
        if 2 * count > received:
            how_many = 'every sample' if count == received else f'{count} of {received} samples'
            remedy = f': {stamp_remedy}' if kind == 'zero_stamp' else ''
            return f'{how_many} dropped: {WHY_DROPPED.get(kind, kind)}{remedy}'
    return ''
