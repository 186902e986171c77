# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Many samples of one joint and their estimates, as arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.sensor.guard import DUPLICATE


class Estimates(NamedTuple):
    """Arrays of shape (n,), one row per received sample; nan where the sample was dropped.

    position [rad or m], velocity, acceleration (SI), one standard deviation of position and of
    velocity, status (see `observers.contract`) and the guard's verdict (see `sensor.guard`).
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    position_stddev: NDArray[np.float64]
    velocity_stddev: NDArray[np.float64]
    status: NDArray[np.int8]
    verdict: NDArray[np.int8]

    @property
    def used(self) -> NDArray[np.bool_]:
        """True for each sample that was used, shape (n,)."""
        return self.verdict < DUPLICATE


def empty(count: int) -> Estimates:
    """Return arrays for `count` samples; what they contain is arbitrary."""
    return Estimates._make(np.empty(count, kind) for kind in 5 * (np.float64,) + 2 * (np.int8,))


class Samples(NamedTuple):
    """Arrays of shape (n,), one row per received sample, and the estimates to fill.

    stamps [ns], measurements [rad or m] and known_input [its unit].
    """

    stamps: NDArray[np.int64]
    measurements: NDArray[np.float64]
    known_input: NDArray[np.float64]
    out: Estimates

    def row(self, row: int) -> tuple[int, float, float]:
        """Return the stamp, the measurement and the known input of one row."""
        return int(self.stamps[row]), float(self.measurements[row]), float(self.known_input[row])

    def part(self, rows: slice) -> Samples:
        """Return views of these rows."""
        stamps, measurements, known_input, out = self
        return Samples(
            stamps[rows],
            measurements[rows],
            known_input[rows],
            Estimates._make(column[rows] for column in out),
        )
