# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Readings that a fast shaft cannot repeat, as the edge-aware observer finds them.

A sensor that has a clock of its own is read too early now and then: the reading repeats while the
shaft moves on, and such a reading is none. The next one shows whether the sensor only skipped one
(it moved by all of the way), or goes by another clock (it moved by a sample less).
"""

from __future__ import annotations

from typing import Any

from estimator_pkg.record import record
from estimator_pkg.sensor.noise import NOISE_SAMPLES, SIGMAS

EVEN_SAMPLING = 0.5  # mean deviation: with a larger one no sample time is known to be the usual one
STOPS = 4.0  # samples: a shaft that is about to stop within them may have stopped
REPEAT_EVIDENCE = 0.25  # what one repeat adds to the evidence of another clock, from 0 to 1
BELIEVED = 0.3  # evidence above this is believed: two repeats
EVIDENCE_MEMORY = 8.0 * NOISE_SAMPLES  # samples in which evidence of another clock is forgotten


@record
class Sampling:
    """What is known of the sensor's own clock."""

    repeat_duration: float  # time since the reading repeats [s]; 0: it does not
    longest_repeat: float  # the longest such time after which the shaft had moved on [s]
    evidence: float  # that the sensor has another clock, 0 to 1


def begin_sampling(clock: Sampling) -> None:
    """Set the clock of a start."""
    clock.repeat_duration = clock.longest_repeat = clock.evidence = 0.0


def is_repeat(
    clock: Sampling, motion: Any, p: Any, mean_dt: float, tracking: bool, dt: float
) -> bool:
    """Return True if an unchanged reading is an old one, at a speed of `REPEATS` in a sample.

    One is held so at first, and as many as twice the longest such pause after which the shaft had
    moved on.
    """
    speed, held = abs(motion.velocity), clock.repeat_duration + dt
    way = speed * dt
    return (
        tracking
        and way * way > SIGMAS * SIGMAS * p.p11 * dt * dt
        and speed > STOPS * abs(motion.acceleration) * dt
        and held <= 2.0 * clock.longest_repeat + 1.5 * dt
        and held <= NOISE_SAMPLES * mean_dt
    )


def resume_sampling(
    clock: Sampling, change: float, passed: float, mean_dt: float, v: float
) -> None:
    """Take a reading that is believed, and moved by `change` [rad].

    Parameters
    ----------
    passed : time since the last one that was [s].
    """
    clock.evidence -= 1.0 / EVIDENCE_MEMORY
    if clock.repeat_duration > 0.0:
        short = (v * passed - change) / (v * mean_dt)  # of the way [samples]
        if change != 0.0 and -1.5 < short < 1.5:  # the shaft had moved on
            if clock.repeat_duration > clock.longest_repeat:
                clock.longest_repeat = clock.repeat_duration
            clock.evidence += REPEAT_EVIDENCE if short > 0.5 else 0.0
    clock.evidence = (
        0.0 if clock.evidence < 0.0 else 1.0 if clock.evidence > 1.0 else clock.evidence
    )
    clock.repeat_duration = 0.0
