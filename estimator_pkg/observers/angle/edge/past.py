# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The readings since a start, kept while the quantum is searched for.

A joint that skips counts when it starts shows a quantum that is too large, and estimate, bandwidth
and noise follow it. Where a later reading shows another quantum, the observer takes these readings
in again with it. From then on its state is that with the quantum given.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.observers.angle.edge.clock import Clock
from estimator_pkg.observers.angle.edge.quantum import DIGITS
from estimator_pkg.observers.angle.edge.start import Doubt
from estimator_pkg.observers.circle import wrap
from estimator_pkg.observers.maths.seldom import seldom

# (time since the first motion of all, and since this start [s]; mean deviation of the sample times,
# see `Clock`; reading before the start [rad]; then for each reading: sample time [s], reading and
# known input [rad]); none: shape (0,)
Past = NDArray[np.float64]

BEFORE, EACH = 4, 3  # numbers before the first reading, and of each

NO_PAST: Past = np.empty(0)  # one for all and read-only: compiled code counts no references to it,
NO_PAST.flags.writeable = False  # which would cost a third of a batch's speed


@seldom
def begin_past(
    doubt: Doubt, clock: Clock, last: float, dt: float, measurement: float, known_input: float
) -> Past:
    """Return the past of one reading [rad], the second of a start, after the `last` [rad]."""
    _, _, since, age, _, _ = doubt
    _, uneven, _, _, _, _ = clock
    return np.array([since - dt, age - dt, uneven, last, dt, measurement, known_input])


def longer(past: Past, dt: float, measurement: float, known_input: float) -> Past:
    """Return the past with one more reading; see `Past`."""
    return np.concatenate((past, np.array([dt, measurement, known_input])))


def first_of(past: Past) -> tuple[float, float, float, float]:
    """Return what was known before the first reading; see `Past`."""
    return float(past[0]), float(past[1]), float(past[2]), float(past[3])


def count_of(past: Past) -> int:
    """Return how many readings the past has."""
    return (len(past) - BEFORE) // EACH


def reading_of(past: Past, number: int) -> tuple[float, float, float]:
    """Return sample time [s], reading and known input [rad] of one reading."""
    i = BEFORE + EACH * number
    return float(past[i]), float(past[i + 1]), float(past[i + 2])


def fits(past: Past, quantum: float, period: float) -> bool:
    """Return True if all steps of the past are multiples of the quantum [rad]."""
    _, _, _, last = first_of(past)
    for i in range(count_of(past)):
        _, measurement, known_input = reading_of(past, i)
        rest = abs(wrap(measurement - last, period) + known_input) % quantum
        if DIGITS * quantum < rest < (1.0 - DIGITS) * quantum:
            return False
        last = measurement
    return True
