# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The motion of a joint from its readings alone: the reference where there is no ground truth.

The off-line smoother, with three additions. Readings that are older than their stamps are left out
(`fresh`). A vibration that the smoother took for noise is added (`vibration`). Readings that lie on
a straight line within their noise are a constant speed, and not the tones of the quantiser.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.matching import match, pieces
from estimator_pkg.evaluation.reference.fresh import Fresh, fresh
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.reference.smoother.pieces import Piece, cut
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed, outliers, smooth
from estimator_pkg.evaluation.reference.vibration import needed, recover_vibration
from estimator_pkg.evaluation.signals import low_passed, wrapped

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

ABOVE = 3.0  # the reference is low-passed at this multiple of the highest frequency of the motion
UP_TO = 1.25  # a vibration whose mean frequency is below this multiple of it is motion
TURN_SIDE = 60  # readings before and after a turn added by the smoother that are left out
LINE_QUANTA = 1.1  # readings on a straight line leave it by at most this many quanta, end to end,
WHITE = 2.0  # or by white noise: a spectrum below this multiple of its median
SPECTRUM_WINDOW = 256  # readings in a window of that spectrum
NOISE_RATIO = 1.2  # and their rms is at most this multiple of the noise that the smoother finds
MOTION_BINS = 5  # windows of the spectrum below this are those of a motion
TONES = 4  # number of the quantiser's tones that are left out of it
LINE_FEWEST = 200  # smallest number of readings that show a constant speed


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
    followed = _followed(smoothed, position[rows[smoothed.rows]], period)
    if not followed.all():
        rows = rows[smoothed.rows[followed]]
        smoothed = smooth(stamps[rows], position[rows], period)
        if not len(smoothed.stamps):
            return None
    used = rows[smoothed.rows]
    plain = velocity = smoothed.velocity
    places = smoothed.position
    firm = smoothed.firm
    stddev = float(np.sqrt(np.mean(smoothed.velocity_stddev[firm] ** 2)))
    at_hz = math.nan
    lines = None if smoothed.seldom else _lines(smoothed, position[used], period)
    if lines is not None:
        plain = velocity = lines[0]
        stddev, firm = lines[1], np.ones(len(velocity), bool)
    elif not smoothed.seldom and needed(smoothed):
        rest = wrapped(position[used] - smoothed.position, period)
        rest[outliers(rest, smoothed.noise.quantum)] = 0.0
        more, at_hz = recover_vibration(smoothed, rest)
        if not math.isnan(at_hz):
            velocity = smoothed.velocity + more
    at = match(stamps[good], smoothed.stamps, velocity, places, 0.0)
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
        lines is not None,
        smoothed.seldom,
        kept,
        smoothed,
        unseen=1.0 - len(at.rows) / sum(map(len, pieces(stamps[good]))),
    )


def _followed(smoothed: Smoothed, readings: Array, period: float) -> NDArray[np.bool_]:
    """Return False around the readings between which the smoother adds whole turns.

    After a gap or a flip by half a turn it may follow the readings by turns that the joint did not
    make. A joint that makes more than half a turn per reading does so at most of them.
    """
    steps = np.diff(smoothed.position, prepend=smoothed.position[0])
    moves = wrapped(np.diff(readings, prepend=readings[0]), period)
    turns = np.abs(steps - moves) > 0.5 * period if period > 0.0 else np.zeros(len(steps), bool)
    turns[_firsts(smoothed)] = False
    if not turns.any() or np.mean(turns) > 0.5:
        return np.ones(len(turns), bool)
    near = np.convolve(turns, np.ones(2 * TURN_SIDE + 1))[TURN_SIDE : TURN_SIDE + len(turns)]
    return near < 0.5


def _firsts(smoothed: Smoothed) -> NDArray[np.int64]:
    """Return the first row of each piece."""
    return np.array([part.rows[0] for part in cut(smoothed.stamps, smoothed.position)], np.int64)


def _lines(smoothed: Smoothed, readings: Array, period: float) -> tuple[Array, float] | None:
    """Return (velocity, its standard deviation) if every piece is a straight line; else None."""
    velocity, variances = np.zeros(len(readings)), []
    for part in cut(smoothed.stamps, readings):
        found = _line(part, period, smoothed)
        if found is None:
            return None
        velocity[part.rows] = found[0]
        variances.append(found[1] ** 2)
    return (velocity, math.sqrt(max(variances))) if variances else None


def _line(part: Piece, period: float, smoothed: Smoothed) -> tuple[float, float] | None:
    """Return (slope, its standard deviation) if the readings lie on a straight line; else None.

    Either they stay within one quantum of it, as counts of a constant speed do, or they scatter
    about it as white noise, but for the tones of the quantiser.
    """
    count = len(part.readings)
    if count < LINE_FEWEST:
        return None
    time = np.cumsum(part.steps)
    time -= time.mean()
    angle = part.readings
    if period > 0.0:
        smooth_ = smoothed.position[part.rows]
        angle = smooth_ + wrapped(angle - smooth_, period)
    inertia = float(time @ time)
    slope = float(time @ (angle - angle.mean())) / inertia
    rest = angle - angle.mean() - slope * time
    step = smoothed.noise.quantum
    spread = float(np.std(rest))
    inside = step > 0.0 and float(np.ptp(rest)) <= LINE_QUANTA * step
    tone = abs(slope) / step * float(np.median(part.steps[1:])) if step > 0.0 else 0.0
    noise = spread <= NOISE_RATIO * smoothed.noise.reading and _is_white(rest, tone)
    if not inside and not noise:
        return None
    return slope, spread / math.sqrt(inertia)


def _is_white(rest: Array, tone: float) -> bool:
    """Return True if no frequency stands out of the spectrum but the quantiser's.

    Parameters
    ----------
    tone : quanta per reading; the quantiser's tones are its multiples, modulo the sample rate.
    """
    windows = rest[: len(rest) // SPECTRUM_WINDOW * SPECTRUM_WINDOW].reshape(-1, SPECTRUM_WINDOW)
    if len(windows) < 4:
        return False
    power = np.mean(np.abs(np.fft.rfft(np.hanning(SPECTRUM_WINDOW) * windows)) ** 2, axis=0)
    own = np.zeros(len(power), bool)
    own[[0, -1]] = True
    for multiple in tone * np.arange(1, TONES + 1) if tone else ():
        place = abs(multiple - round(multiple)) * SPECTRUM_WINDOW
        own[MOTION_BINS:] |= np.abs(np.arange(MOTION_BINS, len(power)) - place) < 3.0
    margin = 1.0 + (WHITE - 1.0) * max(1.0, math.sqrt(32.0 / len(windows)))
    return float(np.max(power[~own])) <= margin * float(np.median(power))
