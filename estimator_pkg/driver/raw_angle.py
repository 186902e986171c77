# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Convert raw counts, or an angle with another zero or sign, to rad."""

from __future__ import annotations

import math
from typing import Any, NamedTuple


class RawAngle(NamedTuple):
    """The conversion of a raw number to an angle.

    counts_per_revolution : counts per turn; 0: the number is in rad.
    offset : added after scaling [rad].
    sign : 1 or -1.
    """

    counts_per_revolution: float = 0.0
    offset: float = 0.0
    sign: int = 1

    @property
    def scale(self) -> float:
        """Angle per unit of the raw number [rad], with its sign."""
        if self.counts_per_revolution > 0.0:
            return self.sign * 2.0 * math.pi / self.counts_per_revolution
        return float(self.sign)

    @property
    def quantum(self) -> float:
        """Quantum of counts [rad]; 0: not known."""
        return abs(self.scale) if self.counts_per_revolution > 0.0 else 0.0

    def angle(self, value: Any) -> Any:
        """Return the angle [rad] of a raw number, or of an array of them (any shape)."""
        return value * self.scale + self.offset
