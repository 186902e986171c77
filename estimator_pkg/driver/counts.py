# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The counts of one joint's samples by verdict, and how long it may be silent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.sensor.guard import (
    DROP_REASONS,
    DUPLICATE,
    LONGEST_FIRST,
    NEW_STARTS,
    SLOW_STREAM,
    VERDICTS,
)


class Counted:
    """Counts of samples: received = used + dropped by each kind."""

    counts: Sequence[int]  # by verdict
    mean_dt: float
    running: bool
    settings: JointSettings

    @property
    def silence(self) -> float:
        """Silence after which the joint is lost [s]; between two stamps it is an outage."""
        slowest = self.mean_dt
        if slowest == 0.0 and self.running:  # one sample does not show the rate
            slowest = LONGEST_FIRST / SLOW_STREAM
        return max(self.settings.timeout, self.settings.gap_max, SLOW_STREAM * slowest)

    @property
    def received(self) -> int:
        """Number of received samples, used and dropped."""
        return sum(self.counts)

    @property
    def used(self) -> int:
        """Number of samples that reached the observer."""
        return sum(self.counts[:DUPLICATE])

    def dropped(self) -> dict[str, int]:
        """Return the number of dropped samples by reason; reasons without any are omitted."""
        return {kind: count for kind, count in zip(DROP_REASONS, self.counts[DUPLICATE:]) if count}

    def samples(self) -> dict[str, Any]:
        """Return the numbers of samples: received, used, dropped by reason."""
        counts = self.counts
        return {'received': sum(counts), 'used': sum(counts[:DUPLICATE]), 'dropped': self.dropped()}

    def events(self) -> dict[str, int]:
        """Return the number of gaps, outages, clock jumps and stray stamps before used samples."""
        counted = zip(VERDICTS[2:DUPLICATE], self.counts[2:DUPLICATE])
        return {kind: count for kind, count in counted if count}

    def new_starts(self) -> int:
        """Return the number of starts in which turns may have been lost."""
        return sum(self.counts[verdict] for verdict in NEW_STARTS)
