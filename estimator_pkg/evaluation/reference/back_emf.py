# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The electrical angle of a drive off-line, from currents and voltages: what judges its observers.

The back-EMF u - R i - L di/dt turns with the rotor, a quarter of an electrical turn before or
behind it. It is averaged in a frame that turns about as fast, over windows that reach into the
future too. The smoother then makes a velocity of these angles, as of the readings of an encoder.
It needs no flux linkage, and no gain of an observer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import Series
from estimator_pkg.bags.wiring import Setup
from estimator_pkg.driver.pairs import CURRENT, VOLTAGE, CurrentsAndVoltages, Phases
from estimator_pkg.evaluation.matching import PIECE_PAUSE, pieces
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.evaluation.signals import wrapped
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.models.motor import POWER_INVARIANT, MotorData, check_motor
from estimator_pkg.observers.pmsm.equations import phase_signs
from estimator_pkg.observers.pmsm.observer import EMF_SPEED
from estimator_pkg.parameters import declared
from estimator_pkg.streams.drive import ABC, DRIVE_SAMPLES, ELECTRICAL, DriveSettings

Array = NDArray[np.float64]
Vectors = NDArray[np.complex128]

ANGLE_RATE = 2000.0  # of the angles, at most [Hz]
ROUGH = 2e-3  # window of the rough speed of the frame [s]
ALIKE_TURNS = 0.3  # turns over one and two samples are clear if their sizes differ by less
FULL_PART = 0.7  # least part of a window with samples
RUN = 9  # angles in a row of which all are seen
CLEAR_EMF = 8.0  # the mean back-EMF must exceed its standard deviation by this factor


class Drive(NamedTuple):
    """The signals of a drive.

    stamps : shape (n,) [ns], ascending but where the clock jumps back. current : shape (n,) [A].
    voltage : shape (n,) [V], mean over the sample time before each stamp. Both are
    amplitude-invariant vectors alpha + j beta.
    """

    stamps: NDArray[np.int64]
    current: Vectors
    voltage: Vectors


class BackEmf(NamedTuple):
    """The back-EMF of a drive, averaged over windows.

    stamps : shape (m,) [ns]. angle : shape (m,), electrical, not wrapped [rad]; nan: too little
    back-EMF.
    size : shape (m,), its amplitude [V]. speed : shape (m,), rough [rad/s], electrical.
    current : shape (m,), along + j across the back-EMF [A].
    """

    stamps: NDArray[np.int64]
    angle: Array
    size: Array
    speed: Array
    current: Vectors

    def series(self) -> Series:
        """Return the angles as a measured position."""
        nothing = np.full(len(self.stamps), np.nan)
        return Series(self.stamps, self.angle, nothing, nothing)


def signals(bag: Bag, setup: Setup) -> Drive:
    """Return currents and voltages of the bag, without samples that the node would drop."""
    values = setup.values
    topics = [topic.name for topic in setup.topics if topic is not None]
    stamps: list[NDArray[np.int64]] = []
    rows: list[Array] = []
    batches = values.get('input', DRIVE_SAMPLES) == DRIVE_SAMPLES
    pairs = CurrentsAndVoltages(round(float(values.get('pair_tolerance', 2e-5)) * 1e9))
    phases = Phases(float(values.get('sum_tolerance', 0.1))) if values.get('frame') == ABC else None
    for message in bag.messages(topics):
        try:
            if batches:
                batch = drive_samples.decode(bytes(message.raw))
                stamps.append(batch.stamps_ns)
                rows.append(batch.values)
                continue
            found = vector3.decode(bytes(message.raw))
        except MalformedMessageError:
            continue
        kind = (CURRENT, VOLTAGE)[topics.index(message.topic)]
        vector: Any = (found.x, found.y)
        if phases is not None:
            turn = phases.current if kind == CURRENT else phases.voltage
            vector = turn(found.x, found.y, found.z)
        pair = vector and pairs.take(kind, found.stamp_ns, vector)
        if pair:
            stamps.append(np.array([pair[0]]))
            rows.append(np.array([pair[1]]))
    if not stamps:
        none = np.zeros(0, np.complex128)
        return Drive(np.zeros(0, np.int64), none, none)
    every, table = np.concatenate(stamps), np.concatenate(rows)
    good = np.flatnonzero((every > 0) & np.isfinite(table).all(axis=1))
    order = good[np.concatenate([good[:0], *pieces(every[good])])]
    scale = 1.0 / POWER_INVARIANT if values.get('scaling') == 'power' else 1.0
    vectors = np.ascontiguousarray(scale * table[order]).view(np.complex128)  # current, voltage
    return Drive(every[order], vectors[:, 0], vectors[:, 1])


def back_emf(drive: Drive, values: Mapping[str, Any]) -> BackEmf | None:
    """Return the back-EMF averaged over windows; None for too few samples.

    Parameters
    ----------
    values : parameters of `pmsm`: resistance, inductance, flux, pole_pairs, voltage_delay,
        dead_time_voltage, emf_min.

    Raises
    ------
    UsageError : motor data are missing; the message names them.
    """
    data = {name: values[name] for name in declared(MotorData) if name in values}
    resistance, inductance, flux, _ = check_motor(MotorData(**data), 'pmsm')
    if len(drive.stamps) < 100:
        return None
    steps = np.diff(drive.stamps) * 1e-9
    step = float(np.median(steps))
    hop = max(1, round(1.0 / (ANGLE_RATE * step)))
    back = steps <= 0.0
    steps = np.where(back, PIECE_PAUSE, steps)
    current, voltage = drive.current, _acting(drive.voltage, float(values.get('voltage_delay', 0)))
    mean = 0.5 * (current[1:] + current[:-1])
    dead = float(values.get('dead_time_voltage', 0.0))
    if dead > 0.0:
        signs = np.array([complex(*phase_signs(each.real, each.imag)) for each in 2.0 * mean])
        voltage = np.concatenate([voltage[:1], voltage[1:] - dead * signs])
    emf = voltage[1:] - resistance * mean - inductance * np.diff(current) / steps
    known = np.abs(steps - step) <= 0.5 * step  # over a gap the voltage is not known
    known &= np.convolve(back, np.ones(2 * hop + 1), 'same') < 0.5  # no window is of two runs
    middle = np.cumsum(steps) - 0.5 * steps
    speed = _rough_speed(emf, known, step)
    if speed is None:
        return None
    frame = np.cumsum(speed * np.diff(middle, prepend=middle[0]))  # turns about as fast
    window = np.hanning(2 * hop + 1)[1:]
    window /= np.sum(window)
    turned = np.where(known, emf * np.exp(-1j * frame), 0.0)
    share = np.convolve(known, window, 'same')
    slow = np.convolve(turned, window, 'same') / np.maximum(share, 1e-9)
    rest = np.where(known, np.abs(turned - slow) ** 2, 0.0)
    noise = np.sqrt(_averaged(rest, max(50, 4 * hop)).real * float(np.sum(window**2)))
    least = values.get('emf_min')
    least = EMF_SPEED * flux if least is None else float(least)
    at = np.arange(hop, len(emf) - hop, hop)
    size = np.abs(slow[at])
    seen = (size > least) & (size > CLEAR_EMF * noise[at]) & (share[at] > FULL_PART)
    run = np.convolve(seen, np.ones(RUN), 'same') > RUN - 0.5
    seen = np.convolve(run, np.ones(RUN), 'same') > 0.5  # without those that are seen by chance
    if np.count_nonzero(seen) < 12:
        return None
    pace = speed[at]
    turned_by = frame[at] + np.angle(slow[at])
    angle, last = np.full(len(at), np.nan), np.zeros(0, np.int64)
    for rows in np.split(
        np.flatnonzero(seen), np.flatnonzero(np.diff(np.flatnonzero(seen)) > 1) + 1
    ):
        times = middle[at][rows]
        own = _followed(turned_by[rows], pace[rows], times)
        fine = np.gradient(own, times)
        whole = _averaged(np.ones(len(rows)), min(RUN, len(rows)))
        pace[rows] = (_averaged(fine, min(RUN, len(rows))) / whole).real
        # where the rotor turns back it is not seen: the sign is that of the run
        own += (0.5 * step) * fine - 0.5 * np.pi * np.sign(own[-1] - own[0])
        if len(last):
            ends = np.mean(np.diff(angle[last[-RUN:]])), np.mean(np.diff(own[:RUN]))
            ahead = np.mean(ends) * (rows[0] - last[-1])
            turns = np.rint((angle[last[-1]] + ahead - own[0]) / (2.0 * np.pi))
            own += 2.0 * np.pi * turns
        angle[rows], last = own, rows
    turned = np.where(known, mean * np.exp(-1j * frame), 0.0)
    alike = np.convolve(turned, window, 'same')[at] * np.conj(slow[at])
    alike /= np.maximum(share[at] * size, 1e-300)
    size /= np.sinc(pace * step / (2.0 * np.pi))  # it turned during each sample
    return BackEmf(drive.stamps[1:][at], angle, size, pace, alike)


def _followed(angle: Array, speed: Array, time: Array) -> Array:
    """Return the angle without wraps, of a rotor that turns at about this speed."""
    steady = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time)
    moves = steady + wrapped(np.diff(angle) - steady, 2.0 * np.pi)
    return np.asarray(angle[0] + np.concatenate([[0.0], np.cumsum(moves)]))


def _rough_speed(emf: Vectors, known: NDArray[np.bool_], step: float) -> Array | None:
    """Return how fast the back-EMF turns [rad/s], shape (n,), over `ROUGH`; None without samples.

    The noise of neighbours is correlated, because it is that of the change of the current. So the
    turn over two samples counts. That over one decides about half turns, if both are clear.
    """
    count = max(3, round(ROUGH / step))

    def turned(lag: int) -> tuple[NDArray[np.bool_], Vectors]:
        whole = known[lag:] & known[:-lag]
        for between in range(1, lag):
            whole &= known[between : between - lag]
        return whole, _averaged(np.where(whole, emf[lag:] * np.conj(emf[:-lag]), 0.0), count)

    (_, one), (whole, two) = turned(1), turned(2)
    if not whole.any():
        return None
    one = one[1:]
    slow, fast = 0.5 * np.angle(two), np.angle(one)
    clear = np.abs(np.abs(one) / np.maximum(np.abs(two), 1e-300) - 1.0) < ALIKE_TURNS
    rough = (slow + np.pi * np.rint(np.where(clear, fast - slow, 0.0) / np.pi)) / step
    rows = np.arange(len(emf), dtype=float)
    return np.asarray(np.interp(rows, rows[1:-1][whole], rough[whole]))


def measured(bag: Bag, setup: Setup) -> dict[str, Series]:
    """Return the electrical angles of a drive as the positions of its electrical joint.

    Raises
    ------
    UsageError : motor data are missing.
    """
    found = back_emf(signals(bag, setup), setup.values)
    if found is None or not np.isfinite(found.angle).any():
        return {}
    return {f'{setup.values.get("joint", DriveSettings.joint)}{ELECTRICAL}': found.series()}


def of_angles(moved: ReferenceMotion) -> ReferenceMotion:
    """Return the motion that the angles of a back-EMF show.

    Their noise rises with the frequency, so what the smoother leaves is no vibration.
    """
    return replace(moved, velocity=moved.plain, vibration_hz=math.nan, of_emf=True)


def _acting(voltage: Vectors, delay: float) -> Vectors:
    """Return the voltages over the intervals in which they act, `delay` samples later."""
    late = math.floor(delay)
    part = delay - late
    rows = np.arange(len(voltage))
    one, other = np.maximum(rows - late, 0), np.maximum(rows - late - 1, 0)
    return np.asarray((1.0 - part) * voltage[one] + part * voltage[other])


def _averaged(values: NDArray, count: int) -> Vectors:
    """Return the moving average over `count` values."""
    return np.asarray(np.convolve(values, np.ones(count) / count, 'same'), np.complex128)


def needed(values: Mapping[str, Any]) -> list[str]:
    """Return the motor data that are missing."""
    return [name for name in declared(MotorData) if values.get(name) is None]
