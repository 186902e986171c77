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
