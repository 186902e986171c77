# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Wait for absolute deadlines and record the lateness. Imports no ROS."""

from __future__ import annotations

import threading
import time

SECOND = 1_000_000_000  # [ns]
LATE = 1_000_000  # a message that is later than this counts as late [ns]
LONG = 50_000_000  # longer waits are split, so that `stop` takes effect soon [ns]


class Deadlines:
    """Deadlines counted from a start on the steady clock.

    They are absolute: one late message does not shift the next, and the mean rate is exact. The
    thread sleeps in the kernel until each deadline; it never spins.

    Attributes
    ----------
    met : deadlines passed so far.
    late : those passed by more than `LATE`.
    lateness, mean_lateness, worst_lateness : of the last deadline, of all, and the largest [s].
    """

    def __init__(self) -> None:
        self.met = 0
        self.late = 0
        self._last_ns = 0
        self._total_ns = 0
        self._worst_ns = 0
        self._start_ns = 0
        self._stop = threading.Event()

    def start(self) -> int:
        """Start the clock; return the system time of the start [ns]."""
        before = time.monotonic_ns()
        system = time.time_ns()
        self._start_ns = (before + time.monotonic_ns()) // 2
        return system

    def wait(self, due_ns: int) -> bool:
        """Sleep until `due_ns` [ns from the start]; return False if `stop` was called."""
        due = self._start_ns + due_ns
        remaining = due - time.monotonic_ns()
        while remaining > LONG:
            if self._stop.wait((remaining - LONG // 2) / SECOND):
                return False
            remaining = due - time.monotonic_ns()
        if remaining > 0:
            time.sleep(remaining / SECOND)
            remaining = due - time.monotonic_ns()
        if self._stop.is_set():
            return False
        lateness = max(0, -remaining)
        self.met += 1
        self.late += lateness > LATE
        self._last_ns = lateness
        self._total_ns += lateness
        self._worst_ns = max(self._worst_ns, lateness)
        return True

    def pause(self, seconds: float) -> bool:
        """Sleep for `seconds`, without a deadline; return False if `stop` was called."""
        return not self._stop.wait(seconds)

    def stop(self) -> None:
        """End the current wait and all later ones."""
        self._stop.set()

    @property
    def lateness(self) -> float:
        """Lateness of the last message [s]."""
        return self._last_ns / SECOND

    @property
    def mean_lateness(self) -> float:
        """Mean lateness [s]."""
        return self._total_ns / SECOND / self.met if self.met else 0.0

    @property
    def worst_lateness(self) -> float:
        """Largest lateness [s]."""
        return self._worst_ns / SECOND

    def summary(self) -> str:
        """Return a one-line summary for the log."""
        return (
            f'{self.met} messages, {self.late} of them more than {LATE / 1e6:g} ms late '
            f'(mean {self.mean_lateness * 1e3:.2f} ms, worst '
            f'{self.worst_lateness * 1e3:.2f} ms)'
        )
