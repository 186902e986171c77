# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A column of a comparison: readings of one joint and the truth about them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.signals import SIGNALS, SKIPPED, Samples, Signal
from estimator_pkg.driver.batch import Estimates
from estimator_pkg.estimate import VALID
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.sensor.guard import DUPLICATE

Array = NDArray[np.float64]

DURATION = 6.0  # [s] of each signal
EDGE = 0.1  # [s] ignored at the end: references lack samples there
FLOOR = 0.01  # errors below this do not distinguish laws [rad/s]
START = 0.5  # [s] of a recording that is not evaluated
LEAST = 0.25  # an estimator that publishes less of a column has no error there


class Cleaned(NamedTuple):
    """Readings for an estimator without a guard: increasing stamps, no nan, multi-turn angles.

    rows : shape (m,), indices of these samples. time [s], angle [rad] : shape (m,).
    """

    rows: NDArray[np.int64]
    time: Array
    angle: Array


@dataclass(frozen=True)
class Column:
    """Readings of one joint and the truth about them.

    samples : as received; the velocity is nan where it is not known.
    quantum : quantum of the reading [rad].
    skip : time at the beginning that is not evaluated [s].
    noise : error of the reference itself [rad/s rms]; 0: it is the ground truth.
    reference : origin of the true velocity.
    period : wrap period of the readings [rad]; 0: none.
    """

    name: str
    samples: Samples
    quantum: float
    skip: float = SKIPPED
    noise: float = 0.0
    reference: str = 'truth'
    period: float = 2.0 * math.pi

    @property
    def time(self) -> Array:
        """Time of each sample since the first positive stamp [s]."""
        stamps = self.samples.stamps
        return (stamps - stamps[np.argmax(stamps > 0)]) * 1e-9

    @property
    def counted(self) -> NDArray[np.bool_]:
        """True for the samples that are evaluated."""
        time = self.time
        return (
            (time >= self.skip) & (time <= np.max(time) - EDGE) & np.isfinite(self.samples.velocity)
        )

    @property
    def floor(self) -> float:
        """Errors below this do not rank estimators [rad/s]."""
        return max(FLOOR, self.noise)

    def error(self, velocity: Array) -> tuple[float, float]:
        """Return (rms error, published fraction); the error is inf if too few or diverged."""
        counted = self.counted
        error = (velocity - self.samples.velocity)[counted]
        error = error[~np.isnan(error)]
        share = float(len(error) / max(1, int(np.count_nonzero(counted))))
        if share < LEAST or not np.all(np.abs(error) < 1e100):
            return math.inf, share
        return float(np.sqrt(np.mean(error * error))), share

    def cleaned(self) -> Cleaned:
        """Return the readings for estimators without a guard."""
        stamps, angle = self.samples.stamps, self.samples.angle
        newest = np.concatenate([[0], np.maximum.accumulate(stamps)[:-1]])
        rows = np.flatnonzero((stamps > newest) & np.isfinite(angle))
        return Cleaned(rows, self.time[rows], np.unwrap(angle[rows]).astype(np.float64))

    def at_rows(self, rows: NDArray[np.int64], velocity: Array) -> Array:
        """Return the velocities of `rows` as an array over all samples; nan elsewhere."""
        every = np.full(len(self.samples.stamps), np.nan)
        every[rows] = velocity
        return every


def referenced(
    name: str,
    readings: tuple[NDArray[np.int64], Array],
    known: tuple[NDArray[np.int64], Array, Array],
    noise: float,
    reference: str,
    period: float = 2.0 * math.pi,
) -> Column:
    """Return a column of recorded readings, judged by a reference that is a sensor or a smoother.

    Parameters
    ----------
    readings : stamps and angles [rad]. known : stamps, velocities and positions of the reference.
    noise : error of the reference [rad/s]; nan: not known.
    """
    stamps, angle = readings
    at = match(stamps, *known, period)
    velocity = np.full(len(stamps), np.nan)
    velocity[at.rows] = at.velocity
    error = float(noise) if np.isfinite(noise) else 0.0
    samples = Samples(stamps, angle, velocity)
    return Column(name, samples, quantum(angle), START, error, reference, period)


def published(out: Estimates) -> NDArray[np.bool_]:
    """Return True for the samples with a published velocity."""
    found: NDArray[np.bool_] = (out.verdict < DUPLICATE) & np.isin(out.status, VALID)
    return found


def of_signal(signal: Signal, duration: float = DURATION) -> Column:
    """Return a signal as a column."""
    return Column(signal.name, signal.samples(duration=duration), signal.quantum)


def shared(signals: Sequence[Signal] = SIGNALS, duration: float = DURATION) -> list[Column]:
    """Return the columns of the shared set."""
    return [of_signal(signal, duration) for signal in signals]
