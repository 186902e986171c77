# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The motion of a joint from its readings alone: the reference where there is no ground truth.

The off-line smoother, with three additions. Readings that are older than their stamps are left out
(`fresh`). A vibration that the smoother took for noise is added (`residual`). A velocity that
stays within its own standard deviation is constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.matching import match, pieces
from estimator_pkg.evaluation.reference.fresh import Fresh, fresh
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.reference.smoother.pieces import cut
from estimator_pkg.evaluation.reference.smoother.residual import recover_vibration
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed, outliers, smooth
from estimator_pkg.evaluation.signals import low_passed, wrapped

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

ABOVE = 3.0  # the reference is low-passed at this multiple of the highest frequency of the motion
UP_TO = 1.25  # a vibration whose mean frequency is below this multiple of it is motion
STEADY = 2.0  # a constant velocity deviates by at most this many of its standard deviations, in
STEADY_READINGS = 200  # this many readings at least
UNEXPLAINED_PART = 0.5  # a vibration is at least this fraction of the uncertainty,
LEAST_NOISE = 12.0**-0.5  # and the noise beyond the quantisation, in quanta: else it is tones


@dataclass(frozen=True)
class ReferenceMotion:
    """The velocity of a joint at its readings' stamps, and what it rests on.

    stamps : shape (n,) [ns], of the readings, in order, without those at the same stamp.
    time : shape (n,), strictly increasing [s].
    velocity : shape (n,) [rad/s], with the vibration that was recovered.
    plain : shape (n,) [rad/s], without it; the same array if nothing was recovered.
    position : shape (n,) [rad or m], of the smoother, without wraps.
    firm : shape (n,), False near the ends of a piece, where the reference is less accurate.
    stddev : rms of the smoother's own standard deviation where `firm` [rad/s].
    vibration_hz : mean frequency of the vibration that was recovered; nan: none was.
    constant : the readings show one constant speed.
    seldom : the reading changes too rarely to show the motion.
    fresh : which readings are new.
    smoothed : result of the smoother.
    motion_hz : highest frequency at which the joint moves [Hz], see `below`; None: not known.
    of_emf : the readings are angles of a back-EMF.
    unseen : fraction of the readings at which there is no reference.
    """

    stamps: Stamps
    time: Array
    velocity: Array
    plain: Array
    position: Array
    firm: NDArray[np.bool_]
    stddev: float
    vibration_hz: float
    constant: bool
    seldom: bool
    fresh: Fresh
    smoothed: Smoothed
    motion_hz: float | None = None
    of_emf: bool = False
    unseen: float = 0.0

    @property
    def vibrates(self) -> bool:
        """True if there are two references: with the vibration, and without."""
        return self.plain is not self.velocity

    @property
    def uncertainty(self) -> float:
        """Expected rms error of `velocity` where `firm` [rad/s]; infinite if `seldom`."""
        if self.vibrates or self.constant:
            return self.stddev
        return self.smoothed.uncertainty

    def below(self, motion_hz: float) -> ReferenceMotion:
        """Return the motion of a joint that moves at most at `motion_hz` [Hz].

        The velocities are low-passed at three times that. A vibration near or below `motion_hz` is
        motion. One above three times it is an error of the sensor. In between it is a question.
        """
        rate = 1.0 / float(np.median(np.diff(self.time)))
        vibration = self.vibration_hz if self.vibrates else 0.0
        whole = self.plain if vibration > ABOVE * motion_hz else self.velocity
        velocity = plain = low_passed(whole, rate, ABOVE * motion_hz)
        if UP_TO * motion_hz < vibration <= ABOVE * motion_hz:
            plain = low_passed(self.plain, rate, ABOVE * motion_hz)
        return replace(self, velocity=velocity, plain=plain, motion_hz=motion_hz)

    def between(self, first: int, last: int) -> ReferenceMotion:
        """Return the part with first < stamp <= last [ns]."""
        kept = (self.stamps > first) & (self.stamps <= last)
        cut_ = {name: getattr(self, name)[kept] for name in ('stamps', 'time', 'position', 'firm')}
        velocity = self.velocity[kept]
        plain = self.plain[kept] if self.vibrates else velocity
        return replace(self, velocity=velocity, plain=plain, **cut_)


def needed(smoothed: Smoothed) -> bool:
    """Return True if the residual has a motion that is not the quantiser's own tones."""
    noise = smoothed.noise
    room = math.sqrt(max(noise.reading**2 - noise.quantum**2 / 12.0, 0.0))
    return (
        smoothed.unexplained > UNEXPLAINED_PART * smoothed.uncertainty
        and room >= LEAST_NOISE * noise.quantum
    )


def motion(stamps: Stamps, position: Array, period: float) -> ReferenceMotion | None:
    """Return the motion that the readings show; None for too few readings.

    Parameters
    ----------
    stamps : shape (n,) [ns], as recorded.
    position : shape (n,) [rad or m]; nan: none.
    period : wrap period [rad]; 0: none.
    """
    good = np.flatnonzero(np.isfinite(position) & (stamps > 0))
    readings = position[good]
    seconds = (stamps[good] - stamps[good[0]]) * 1e-9 if len(good) else np.zeros(0)
    kept = fresh(seconds, readings, period, quantum(readings))
    rows = good[kept.new]
    smoothed = smooth(stamps[rows], position[rows], period)
    if not len(smoothed.stamps):
        return None
    used = rows[smoothed.rows]
    plain = velocity = smoothed.velocity
    firm = smoothed.firm
    stddev = float(np.sqrt(np.mean(smoothed.velocity_stddev[firm] ** 2)))
    steady = float(np.std(velocity[firm])) <= STEADY * stddev and len(velocity) >= STEADY_READINGS
    more, at_hz = np.zeros(0), math.nan
    if not smoothed.seldom and needed(smoothed):
        rest = wrapped(position[used] - smoothed.position, period)
        rest[outliers(rest, smoothed.noise.quantum)] = 0.0
        speed = float(np.mean(velocity[firm])) if steady else math.nan
        parts = cut(smoothed.stamps, rest)
        more, at_hz = recover_vibration(parts, len(rest), smoothed.noise.quantum, speed)
    if not math.isnan(at_hz):
        velocity = smoothed.velocity + more
    constant = steady and not smoothed.seldom and math.isnan(at_hz)
    if constant:
        plain = velocity = np.full(len(velocity), float(np.mean(velocity[firm])))
        firm = np.ones(len(velocity), bool)
    at = match(stamps[good], smoothed.stamps, velocity, smoothed.position, 0.0)
    other = match(stamps[good], smoothed.stamps, plain, firm.astype(float), 0.0)
    if not len(at.rows):
        return None
    return ReferenceMotion(
        stamps[good][at.rows],
        at.time,
        at.velocity,
        at.velocity if plain is velocity else other.velocity,
        at.position,
        other.position > 0.99,
        stddev,
        at_hz,
        constant,
        smoothed.seldom,
        kept,
        smoothed,
        unseen=1.0 - len(at.rows) / sum(map(len, pieces(stamps[good]))),
    )
