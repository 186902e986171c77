# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The drive: pass many samples at once through guard and observer, and check the batches' order.

The same track (guard and observer) as for a joint; a measurement is the tuple
(i_alpha, i_beta, u_alpha, u_beta).
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver import drive_channel
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import INITIALISING, MISCONFIGURED, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.pmsm.watch import BLIND, LOW_EMF, describe
from estimator_pkg.sensor.guard import DUPLICATE, LATE_IN_A_ROW, LATE_STAMP, UNSTABLE_GAINS

ESTIMATE_COLUMNS = ('electrical_angle', 'electrical_speed', 'flux_linkage', 'valid')


class DriveEstimates(NamedTuple):
    """One row per received sample.

    rows : shape (n, 4), `ESTIMATE_COLUMNS`: rad, rad/s, Wb, 0 or 1; nan where withheld or where
        the sample was dropped.
    status : shape (n,), see `observers.contract`.
    reasons : shape (n,), bits of `observers.pmsm.watch.REASON_TEXTS`.
    verdict : shape (n,), see `sensor.guard`.
    """

    rows: NDArray[np.float64]
    status: NDArray[np.int8]
    reasons: NDArray[np.int32]
    verdict: NDArray[np.int8]

    @property
    def electrical_angle(self) -> NDArray[np.float64]:
        """Electrical angle, shape (n,) [rad]."""
        return self.rows[:, 0]

    @property
    def electrical_speed(self) -> NDArray[np.float64]:
        """Electrical speed, shape (n,) [rad/s]."""
        return self.rows[:, 1]

    @property
    def flux_linkage(self) -> NDArray[np.float64]:
        """Flux linkage, shape (n,) [Wb]."""
        return self.rows[:, 2]


def empty(count: int) -> DriveEstimates:
    """Return arrays for `count` samples."""
    return DriveEstimates(
        np.full((count, len(ESTIMATE_COLUMNS)), np.nan),
        np.full(count, INITIALISING, np.int8),
        np.zeros(count, np.int32),
        np.zeros(count, np.int8),
    )


BATCHES_REMEMBERED = 64  # number of batches for the detection of repeated ones
GAP_PERIODS = 2.5  # this many sample periods without a sample are a gap
UNKNOWN_GAP = 0.01  # length of a gap while the sample period is unknown [s]
CONTRADICTION_TIME = 200_000_000  # what contradicts the motor data for this time is no start [ns],
CONTRADICTION_KEPT = 10**10  # and is kept as the reason for this time [ns]
LONGEST_BATCH = 10**8  # longer times between two estimates are pauses [ns]
PERIOD_TOLERANCE = 0.01  # allowed relative difference of the sample period from the stamps


class DriveJoint(Joint):
    """A motor's observer, live: pass it batches of samples, read its estimate.

    A sample is (i_alpha, i_beta, u_alpha, u_beta). The estimate of the base class is the mechanical
    one.

    Parameters
    ----------
    observer : one of kind 'drive'.
    gains, settings : as in `Joint`.
    sample_period : s; 0: from the first batch.

    Attributes
    ----------
    misfit : why the sample period contradicts the stamps; '' if it does not.
    """

    plain: Any = drive_channel

    def __init__(
        self,
        observer: type[Observer],
        gains: Any,
        settings: JointSettings,
        *,
        sample_period: float = 0.0,
    ) -> None:
        self.given_period = sample_period
        self._period = sample_period
        self.misfit = ''
        self._late_batches = 0
        self._contradiction = 0, 0, 0  # reasons without an estimate, their time, last stamp [ns]
        self._recent: deque[tuple[int, int]] = deque(maxlen=BATCHES_REMEMBERED)
        super().__init__(observer, gains, settings)

    def _use_gains(self) -> None:
        super()._use_gains()
        self._tighten()

    def set_settings(self, settings: JointSettings) -> None:
        """Use other guard settings from the next sample on; the state is kept."""
        super().set_settings(settings)
        self._tighten()

    def _tighten(self) -> None:
        """Shorten the guard's gap: the rotor turns far between two samples."""
        gap = GAP_PERIODS * self._period if self._period > 0.0 else UNKNOWN_GAP
        with self._changing() as channel:
            channel.limits.gap_ns = min(round(self.settings.gap_max * 1e9), round(gap * 1e9))

    def reset(self) -> None:
        """Reset the observer to its start; the counters continue."""
        super().reset()
        self._recent.clear()
        self._late_batches = 0
        self._contradiction = 0, 0, 0

    def _at_rest(self) -> tuple[Any, Any]:
        return (0.0,) * 4, 0.0

    def update(self, stamp_ns: int, measurement: Any, known_input: float = 0.0) -> bool:
        """Take one sample; return True if it was used, False if it was dropped (and counted)."""
        return self._call('take', stamp_ns, *measurement) < DUPLICATE

    def take(self, stamps: NDArray[np.int64], samples: NDArray[np.float64]) -> DriveEstimates:
        """Take a batch; return the estimates, one row per received sample.

        A repeated batch, or one older than the last, is dropped completely. Three late ones in a
        row mean that the clock jumped.

        Parameters
        ----------
        stamps : shape (n,), int64 nanoseconds.
        samples : shape (n, 4) [A, A, V, V].
        """
        count = len(stamps)
        if not count:
            return empty(0)
        if not self._fits(stamps):
            return self._dropped(count, UNSTABLE_GAINS)
        fresh: Any = slice(None)
        last, behind = self.last_ns, self._value('limits', 'reorder_ns')
        old = (stamps <= last) & (stamps > 0)
        if self.running and old.any() and last - int(stamps.max()) <= behind:
            if old.all():
                if (int(stamps[0]), int(stamps[-1])) in self._recent:
                    return self._dropped(count, DUPLICATE)
                self._late_batches += 1
                if self._late_batches < LATE_IN_A_ROW:
                    return self._dropped(count, LATE_STAMP)
                with self._changing() as channel:
                    channel.track.clock.late_in_a_row = LATE_IN_A_ROW - 1
            else:
                fresh = np.flatnonzero(~old)
        self._late_batches = 0
        self._recent.append((int(stamps[0]), int(stamps[-1])))
        before_ns = self.stamp_ns
        out = empty(len(stamps[fresh]))
        self._batch(stamps[fresh], [samples[fresh]], out)
        used = np.flatnonzero(out.verdict < DUPLICATE)
        if len(used):
            status, reasons = int(out.status[used[-1]]), int(out.reasons[used[-1]])
            self._note(status, reasons, self.stamp_ns - before_ns)
        if not isinstance(fresh, slice):
            whole = empty(count)
            whole.verdict[:] = DUPLICATE
            self._add(count - len(fresh), DUPLICATE)
            for name, rows in out._asdict().items():
                getattr(whole, name)[fresh] = rows
            out = whole
        return out

    def _note(self, status: int, reasons: int, passed_ns: int) -> None:
        """Note what contradicts the motor data since the last estimate; blind, nothing does."""
        if status == TRACKING:
            self._contradiction = 0, 0, 0
        elif reasons and not reasons & BLIND:
            before, total, _ = self._contradiction
            total += min(passed_ns, LONGEST_BATCH)
            self._contradiction = before | reasons, total, self.stamp_ns

    def _fits(self, stamps: NDArray[np.int64]) -> bool:
        """Return True if a batch's stamps fit the sample period, which they define if unset."""
        if len(stamps) < 3:
            return not self.misfit
        # the median; NumPy's own takes as long as all samples in the engine
        spacing = float(np.sort(stamps[1:] - stamps[:-1])[(len(stamps) - 1) // 2]) * 1e-9
        if self.given_period <= 0.0:
            if spacing > 0.0 and abs(spacing - self._period) > PERIOD_TOLERANCE * self._period:
                self._period = spacing
                self._tighten()
            return True
        if abs(spacing - self.given_period) <= PERIOD_TOLERANCE * self.given_period:
            self.misfit = ''
        else:
            self.misfit = (
                f'sample_period is {self.given_period:g} s, but the stamps are '
                f'{spacing:g} s apart: correct sample_period'
            )
        return not self.misfit

    def _call(self, name: str, *values: Any) -> Any:
        """Call a function of the drive's numbers."""
        if self.memory is not None:
            return getattr(self.compiled, name)(self.memory.pointer, *values)
        return getattr(self.plain, name)(self.module, self._channel, *values)

    def _shown(self, function: str, name: str) -> tuple:
        """Call a function; return the values of a record that it sets."""
        self._call(function)
        if self.memory is not None:
            values: tuple = self.memory.array[name][0].item()
            return values
        record = getattr(self._channel, name)
        return tuple(getattr(record, field) for field in type(record).fields)

    def _dropped(self, count: int, verdict: int) -> DriveEstimates:
        out = empty(count)
        out.verdict[:] = verdict
        self._add(count, verdict)
        return out

    def _add(self, count: int, verdict: int) -> None:
        """Count samples that are dropped before the guard."""
        with self._changing() as channel:
            channel.counts[verdict] += count

    @property
    def needs_motion(self) -> bool:
        """See `Joint`."""
        return self.running and self._reasons() & BLIND == LOW_EMF

    def _reasons(self) -> int:
        self._call('write_estimate')
        return int(self._value('electrical', 'reasons'))

    def estimate(self) -> tuple[float, float, float, int]:
        """Return (position, velocity, nan, status), mechanical, at the last used sample."""
        if self.misfit:
            return math.nan, math.nan, math.nan, MISCONFIGURED
        return super().estimate()

    def electrical(self) -> tuple[float, float, float, float]:
        """Return (angle [rad], speed [rad/s], flux linkage [Wb], 1.0 if valid), electrical."""
        return self._shown('write_estimate', 'electrical')[:4]

    def electrical_stddev(self) -> tuple[float, float, float]:
        """Return standard deviations of electrical angle, electrical speed and flux linkage."""
        return self._shown('write_deviation', 'electrical_deviation')

    def estimates(self) -> list[tuple[float, float, float, int]]:
        """Return rows as `estimate`: mechanical, and electrical."""
        estimate, (angle, speed, *_) = self.estimate(), self.electrical()
        return [estimate, (angle, speed, math.nan, estimate[3])]

    def deviations(self) -> list[tuple[float, float]]:
        """Return rows as `stddev`: mechanical, and electrical."""
        return [self.stddev(), self.electrical_stddev()[:2]]

    def speed_bound(self) -> float:
        """Return an upper bound of |mechanical speed| [rad/s] while not observable; inf: none."""
        self._call('write_deviation')
        return float(self._value('speed_bound'))

    def why(self) -> str:
        """Return the meaning of the status as text."""
        if self.misfit or not self.running:
            return self.misfit
        note = super().why()
        if note:
            return note
        reasons = self._reasons()
        known, total, last_ns = self._contradiction
        if total > CONTRADICTION_TIME and self.stamp_ns - last_ns < CONTRADICTION_KEPT:
            return describe(known | (reasons & ~LOW_EMF))
        if self.estimate()[3] != NOT_OBSERVABLE:
            return describe(reasons)
        reason, bound = describe(reasons & BLIND), self.speed_bound()
        return f'{reason}; |speed| is below {bound:.2g} rad/s' if math.isfinite(bound) else reason
