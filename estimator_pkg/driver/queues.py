# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Samples that waited in a queue.

A receiver that pauses stamps the samples of the pause when it goes on, some 0.1 ms apart. Each of
them moved as in a sample time, so that its stamp shows a speed a hundred times too large.

Where sampling is truly irregular, some samples come as soon after another, and moved as little. So
the stamps are believed where they explain the readings better than the mean sample time does, the
more readily the more often they did before (docs/stamps_and_quantisation.md).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from estimator_pkg.observers.circle import wrap
from estimator_pkg.observers.contract import Functions

QUEUED = 0.1  # mean sample times: a sample that comes sooner may have waited in a queue
SURELY = 16.0  # times that its stamp may explain its reading better if all before it had waited
VOTES = 16.0  # samples over which the evidence is averaged
EVIDENCE = 0.25  # at a start
IN_BURSTS = 0.5  # evidence that the status reports


def make_waited(functions: Functions, period: float) -> Callable[..., tuple[bool, float]]:
    """Return the function that finds a sample that waited in a queue with the one before.

    A receiver that pauses stamps the samples of the pause together. Each of them moved as in a
    sample time, which no speed explains in so short a step.

    Parameters
    ----------
    functions : of the observer; one that knows that a stamp was late is left to it.
    period : wrap period [rad]; 0: none.
    """
    output, late = functions.output, functions.late

    def waited(
        queue: float,
        state: tuple,
        coefficients: tuple,
        design: tuple,
        measurement: float,
        reading: float,
        passed: float,
        mean_dt: float,
    ) -> tuple[bool, float]:
        """Return whether the reading moved as in a mean sample time, and the evidence.

        Parameters
        ----------
        queue : evidence that such samples waited, from 0 to 1.
        measurement, reading : the newest reading, and the one before [rad].
        passed : between their stamps [s].
        """
        if measurement == reading or late(state) != 0.0:
            return False, queue
        _, speed, _, _ = output(state, coefficients, design, reading, 0.0)
        moved = wrap(measurement - reading, period)
        at_stamps, evenly = abs(moved - speed * passed), abs(moved - speed * mean_dt)
        vote = 1.0 if evenly < at_stamps else 0.0
        return evenly <= SURELY * queue * queue * at_stamps, queue + (vote - queue) / VOTES

    return waited


def never_waited(
    queue: float,
    state: tuple,
    coefficients: tuple,
    design: tuple,
    measurement: Any,
    reading: Any,
    passed: float,
    mean_dt: float,
) -> tuple[bool, float]:
    """Believe every stamp: replaces `make_waited` for measurements that are not a single angle."""
    return False, queue


def note_on_queue(queue: float) -> str:
    """Return a note for the status on samples that wait in a queue; '' if they do not."""
    if queue <= IN_BURSTS:
        return ''
    return (
        'stamps come in bursts: samples that waited in a queue are taken at the mean '
        'sample time (stamp them where they are measured, or see stamp_repair)'
    )
