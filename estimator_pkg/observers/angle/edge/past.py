# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The readings since a start, kept while the quantum is searched for.

A joint that skips counts when it starts shows a quantum that is too large, and estimate, bandwidth
and noise follow it. Where a later reading shows another quantum, the observer takes these readings
in again with it. From then on its state is that with the quantum given. This is ordinary Python,
which the driver calls after the step while there is a past (see `Functions.again`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from estimator_pkg.observers.angle.edge.quantum import DIGITS, SEARCH
from estimator_pkg.observers.angle.edge.sensor import begin_sensor
from estimator_pkg.observers.angle.edge.start import SETTLES, first_state
from estimator_pkg.observers.circle import wrap
from estimator_pkg.observers.contract import Past

# A past is (Start, Row, Row, ...), or () before a start.
# (reading before the start [rad], time since the first motion of all and since this start [s])
Start = tuple[float, float, float]
Row = tuple[float, float, float]  # (sample time [s], reading [rad], known input [rad])


def make_again(
    prepare: Callable[..., tuple], step: Callable[..., tuple], period: float
) -> Callable[..., tuple[Past, tuple]]:
    """Return the function that takes the readings since a start in again; see `Functions.again`.

    Parameters
    ----------
    prepare, step : of the observer.
    period : wrap period [rad]; 0: none.
    """

    def again(
        past: tuple,
        before: tuple,
        state: tuple,
        coefficients: tuple,
        design: Any,
        measurement: float,
        known_input: float,
    ) -> tuple[Past, tuple]:
        _, _, _, (used, *_), (_, _, _, _, left, _, jump), (last, *_), *_ = before
        _, p, _, sensor, _, _, _, _, (_, _, since, age, _, _), _, _ = state
        if left <= 0.0 or design.quantum > 0.0:
            return None, state
        quantum, _, _, _, stepped, *_ = sensor
        _, _, p02, _, p12, _ = p
        dt, *_ = coefficients
        row = dt, measurement, known_input
        if p02 == 0.0 < p12 and stepped != 0.0:  # the second reading of a start
            return ((last, since - dt, age - dt), row), state
        if jump != 0.0 or not 0 < len(past) <= SEARCH:
            return (), state
        start, *rows = past = (*past, row)
        if quantum == used or not fits(past, quantum, period):
            return past, state
        newest, state = state, first_again(start, state, quantum)
        design = design._replace(quantum=quantum)
        for dt, measurement, known_input in rows:
            state = step(state, prepare(design, dt), design, measurement, known_input)
        return past, retaken(newest, state)

    return again


def fits(past: tuple, quantum: float, period: float) -> bool:
    """Return True if all steps of the past are multiples of the quantum [rad]."""
    (last, _, _), *rows = past
    for _, measurement, known_input in rows:
        rest = abs(wrap(measurement - last, period) + known_input) % quantum
        if DIGITS * quantum < rest < (1.0 - DIGITS) * quantum:
            return False
        last = measurement
    return True


def first_again(start: Start, state: tuple, quantum: float) -> tuple:
    """Return the state before a start whose later readings show this quantum [rad]."""
    _, _, _, _, steps, (_, low, high, wraps, turns), _, _, _, clock, _ = state
    last, since, age = start
    _, uneven, _, longest, evidence, _ = clock
    return first_state(
        last,
        begin_sensor(quantum),
        steps,
        (last, low, high, wraps, turns),
        (0.0, SETTLES, since, age, 0.0, 0.0),
        (0.0, uneven, 0.0, longest, evidence, 0.0),
    )


def retaken(newest: tuple, again: tuple) -> tuple:
    """Return the state `again`, but with what the `newest` knows of quantum, turns and lock."""
    _, _, _, _, steps, convention, lock, _, _, _, _ = newest
    motion, p, band, sensor, _, _, _, sway, doubt, clock, other = again
    return (motion, p, band, sensor, steps, convention, lock, sway, doubt, clock, other)
