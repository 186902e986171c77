# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The drive: pass many samples at once through guard and observer, and check the batches' order.

The same track (guard and observer) as for a joint; a measurement is the tuple
(i_alpha, i_beta, u_alpha, u_beta).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import available, cannot_compile, compiled
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.guard import AFTER_GAP, DUPLICATE, LATE, LATE_IN_A_ROW, MISCONFIGURED
from estimator_pkg.driver.joint import Joint
from estimator_pkg.driver.track import make_track, newest, replaced, with_state
from estimator_pkg.observers.contract import INITIALISING, NOT_OBSERVABLE, TRACKING, Observer
from estimator_pkg.observers.contract import MISCONFIGURED as STATUS_MISCONFIGURED
from estimator_pkg.observers.pmsm.watch import BLIND, LOW_EMF, describe

LONGEST_COAST = 10**9  # longest gap over which the angle is extrapolated [ns]

COLUMNS = ('electrical_angle', 'electrical_speed', 'flux_linkage', 'valid')


class DriveEstimates(NamedTuple):
    """One row per received sample.

    rows : shape (n, 4), `COLUMNS`: rad, rad/s, Wb, 0 or 1; nan where withheld or where the sample
        was dropped.
    status : shape (n,), see `observers.contract`.
    reasons : shape (n,), bits of `observers.pmsm_watch.REASONS`.
    verdict : shape (n,), see `guard`.
    """

    rows: NDArray[np.float64]
    status: NDArray[np.int8]
    reasons: NDArray[np.int16]
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
        np.full((count, len(COLUMNS)), np.nan),
        np.full(count, INITIALISING, np.int8),
        np.zeros(count, np.int16),
        np.zeros(count, np.int8),
    )


def make_drive_batch(functions: Any) -> Callable[..., tuple]:
    """Return a loop over samples through guard and observer; compile it, or call it as it is."""
    track_functions = make_track(functions)
    advance, row_of, coast = track_functions.advance, functions.row, functions.coast

    def batch(
        track: tuple,
        design: tuple,
        limits: tuple,
        stamps: NDArray[np.int64],
        samples: NDArray[np.float64],
        rows: NDArray[np.float64],
        status: NDArray[np.int8],
        reasons: NDArray[np.int16],
        verdict: NDArray[np.int8],
    ) -> tuple:
        for k in range(len(stamps)):
            sample = samples[k]
            measurement = (sample[0], sample[1], sample[2], sample[3])
            old_ns, old_coefficients, old_state = newest(track)
            track, said = advance(track, design, limits, stamps[k], measurement, 0.0)
            verdict[k] = said
            if said == AFTER_GAP:
                gap = stamps[k] - old_ns
                if gap <= LONGEST_COAST:  # extrapolate the angle over the gap
                    state = coast(old_state, old_coefficients, design, measurement, gap * 1e-9)
                    track = with_state(track, state)
            if said < DUPLICATE:
                _, coefficients, state = newest(track)
                row = rows[k]
                row[0], row[1], row[2], row[3], status[k], reasons[k] = row_of(
                    state, coefficients, design
                )
        return track

    return batch


@lru_cache(maxsize=16)
def _twin(batch: Callable[..., tuple]) -> Callable[..., tuple]:
    """As `compiled`, cached by identity: computing its key takes as long as a short batch."""
    return compiled(batch)


def run(
    batch: Callable[..., tuple],
    track: tuple,
    design: tuple,
    limits: tuple,
    stamps: NDArray[np.int64],
    samples: NDArray[np.float64],
    *,
    fast: bool,
) -> tuple[tuple, DriveEstimates]:
    """Return the track after these samples, and the estimates.

    Parameters
    ----------
    stamps : shape (n,), int64 nanoseconds.
    samples : shape (n, 4) [A, A, V, V].
    fast : compile, if Numba is installed.
    """
    out = empty(len(stamps))
    if fast:
        track = _twin(batch)(
            track,
            design,
            limits,
            np.ascontiguousarray(stamps, np.int64),
            np.ascontiguousarray(samples, float),
            *out,
        )
    else:  # lists contain Python floats, which are several times faster than numpy's
        columns = [values.tolist() for values in out]
        track = batch(
            track,
            design,
            limits,
            np.asarray(stamps).tolist(),
            np.asarray(samples).tolist(),
            *columns,
        )
        for name, values in zip(out._fields, columns):
            getattr(out, name)[:] = values
    return track, out


REMEMBERED = 64  # number of batches for the detection of repeated ones
GAP = 2.5  # this many sample periods without a sample are a gap
UNKNOWN_GAP = 0.01  # length of a gap while the sample period is unknown [s]
LASTS = 200_000_000  # what contradicts the motor data for this time is no start [ns],
KEPT = 10**10  # and is kept as the reason for this time [ns]
LONGEST_BATCH = 10**8  # longer times between two estimates are pauses [ns]
FITS = 0.01  # allowed relative difference of the sample period from the stamps


class DriveJoint(Joint):
    """A motor's observer, live: pass it batches of samples, read its estimate.

    A sample is (i_alpha, i_beta, u_alpha, u_beta). The estimate of the base class is the mechanical
    one.

    Parameters
    ----------
    observer : one of kind 'drive'.
    gains, settings : as in `Joint`.
    sample_period : s; 0: from the first batch.
    fast : compile, if Numba is installed.

    Attributes
    ----------
    misfit : why the sample period contradicts the stamps; '' if it does not.
    """

    def __init__(
        self,
        observer: Observer,
        gains: Any,
        settings: JointSettings,
        *,
        sample_period: float = 0.0,
        fast: bool = False,
    ) -> None:
        self.given_period = sample_period
        self._period = sample_period
        self.fast = fast and available()
        self.misfit = ''
        self._late_batches = 0
        self._contradiction = 0, 0, 0  # reasons without an estimate, their time, last stamp [ns]
        self._recent: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        super().__init__(observer, gains, settings)

    def _structure(self, gains: Any, twin: Joint | None) -> None:
        super()._structure(gains, twin)
        self._motor: Any = self.functions  # DriveFunctions
        self._drive_batch = make_drive_batch(self._motor)
        self._tighten()

    def set_settings(self, settings: JointSettings) -> None:
        """Use other guard settings from the next sample on; the state is kept."""
        super().set_settings(settings)
        self._tighten()

    def _tighten(self) -> None:
        """Shorten the guard's gap: the rotor turns far between two samples."""
        gap = GAP * self._period if self._period > 0.0 else UNKNOWN_GAP
        self._limits = self._limits._replace(gap_ns=min(self._limits.gap_ns, round(gap * 1e9)))

    def reset(self) -> None:
        """Reset the observer to its start; the counters continue."""
        super().reset()
        self._recent.clear()
        self._late_batches = 0
        self._contradiction = 0, 0, 0

    def warm_up(self) -> None:
        """Compile now, before samples arrive; functions without Numba support run as they are."""
        if not self.fast:
            return
        try:
            run(
                self._drive_batch,
                self._track,
                self._design,
                self._limits,
                np.zeros(1, np.int64),
                np.zeros((1, 4)),
                fast=True,
            )
        except Exception as error:
            if not cannot_compile(error):
                raise
            self.fast = False

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
            return self._dropped(count, MISCONFIGURED)
        fresh: Any = slice(None)
        last = self.last_ns
        old = (stamps <= last) & (stamps > 0)
        if self.running and old.any() and last - int(stamps.max()) <= self._limits.reorder_ns:
            if old.all():
                if (int(stamps[0]), int(stamps[-1])) in self._recent:
                    return self._dropped(count, DUPLICATE)
                self._late_batches += 1
                if self._late_batches < LATE_IN_A_ROW:
                    return self._dropped(count, LATE)
                self._track = replaced(self._track, late=LATE_IN_A_ROW - 1)
            else:
                fresh = np.flatnonzero(~old)
        self._late_batches = 0
        self._recent.append((int(stamps[0]), int(stamps[-1])))
        self._track, out = run(
            self._drive_batch,
            self._track,
            self._design,
            self._limits,
            stamps[fresh],
            samples[fresh],
            fast=self.fast,
        )
        if not isinstance(fresh, slice):
            whole = empty(count)
            whole.verdict[:] = DUPLICATE
            for name, rows in out._asdict().items():
                getattr(whole, name)[fresh] = rows
            out = whole
        self._count(out.verdict)
        used = np.flatnonzero(out.verdict < DUPLICATE)
        if len(used):
            before_ns, self.stamp_ns = self.stamp_ns, int(stamps[used[-1]])
            self._measurement = tuple(samples[used[-1]].tolist())
            status, reasons = int(out.status[used[-1]]), int(out.reasons[used[-1]])
            self._note(status, reasons, self.stamp_ns - before_ns)
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
        # the median; numpy's own takes as long as all compiled samples
        spacing = float(np.sort(stamps[1:] - stamps[:-1])[(len(stamps) - 1) // 2]) * 1e-9
        if self.given_period <= 0.0:
            if spacing > 0.0 and abs(spacing - self._period) > FITS * self._period:
                self._period = spacing
                self._limits = self._limits._replace(gap_ns=round(self.settings.gap_max * 1e9))
                self._tighten()
            return True
        if abs(spacing - self.given_period) <= FITS * self.given_period:
            self.misfit = ''
        else:
            self.misfit = (
                f'sample_period is {self.given_period:g} s, but the stamps are '
                f'{spacing:g} s apart: correct sample_period'
            )
        return not self.misfit

    def _dropped(self, count: int, verdict: int) -> DriveEstimates:
        out = empty(count)
        out.verdict[:] = verdict
        self._count(out.verdict)
        return out

    @property
    def needs_motion(self) -> bool:
        """See `Joint`."""
        return self.running and self._motor.reasons(self.state) & BLIND == LOW_EMF

    def estimate(self) -> tuple[float, float, float, int]:
        """Return (position, velocity, nan, status), mechanical, at the last used sample."""
        if self.misfit:
            return math.nan, math.nan, math.nan, STATUS_MISCONFIGURED
        return super().estimate()

    def electrical(self) -> tuple[float, float, float, float]:
        """Return (angle [rad], speed [rad/s], flux linkage [Wb], 1.0 if valid), electrical."""
        return self._motor.electrical(self.state, self.coefficients, self._design)

    def electrical_stddev(self) -> tuple[float, float, float]:
        """Return standard deviations of electrical angle, electrical speed and flux linkage."""
        return self._motor.electrical_stddev(self.state, self.coefficients, self._design)

    def speed_bound(self) -> float:
        """Return an upper bound of |mechanical speed| [rad/s] while not observable; inf: none."""
        return self._motor.speed_bound(self.state, self.coefficients, self._design)

    def why(self) -> str:
        """Return the meaning of the status as text."""
        if self.misfit or not self.running:
            return self.misfit
        limit = super().why()
        if limit:
            return limit
        reasons = self._motor.reasons(self.state)
        known, total, last_ns = self._contradiction
        if total > LASTS and self.stamp_ns - last_ns < KEPT:
            return describe(known | (reasons & ~LOW_EMF))
        if self.estimate()[3] != NOT_OBSERVABLE:
            return describe(reasons)
        reason, bound = describe(reasons & BLIND), self.speed_bound()
        return f'{reason}; |speed| is below {bound:.2g} rad/s' if math.isfinite(bound) else reason
