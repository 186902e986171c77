# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock of `sample_time.py` with a longer memory, for a device that samples regularly.

    t_k = t_(k-1) + n_k period,       stamp_k = t_k + delay_k

Phase and period follow a recursive least-squares line (growing-memory g-h filter; Brookner,
Tracking and Kalman Filtering Made Easy, 1998, section 1.2.10), whose memory ends at `FIT_MEMORY`
messages so that it follows a drift. Residuals count up to `CLIPPED` times their mean.

n_k is more than 1 where messages were lost. It is the most likely number, given the stamp and the
reading of the joint that moves most clearly. Stamps that stay late, or early, shift the line.

Stamps that jitter and sampling that jitters look the same. So the readings decide: they are
predicted at the stamps and on the line, and the line is used only while it predicts clearly better.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from itertools import accumulate
from statistics import median

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import LARGEST, wrap
from estimator_pkg.sensor.sample_time import Prediction, begin_prediction, correct, miss

FIRST_FIT = 64  # messages before the first fit,
SLOW_FIRST_FIT, SLOW_NS = 16, 2_000_000_000  # or these, if they took so long [ns]
LOWEST_RATE, HIGHEST_RATE = 0.98, 1.6  # periods per message, of the rates that it tries
LINE = 0.4  # of the stamps' spectrum, over its largest possible value
FIT_MEMORY, SECONDS = 10000.0, 10.0  # messages that the line remembers, or of this time [s],
SHORTEST_FIT = 200.0  # but not fewer than these
PHASE_MEMORY = 64.0  # messages over which corrections of the phase are spread
CLIPPED = 3.0  # mean absolute residuals
FITTED = 0.5  # [s] of the line before it is used, unless the stamps hardly jitter:
QUIET = 0.1  # periods
SPREAD = 1.25  # standard deviation over mean residual
DELAY, WILD = 12.0, 36.0  # log odds, doubled: of a delay, of a stray reading
STRAY = 100.0  # times the mean square: a residual of interpolation counts no more
USUAL, RARE = 6.0, 12.0  # the same of lost messages, where late ones follow these or not
LOSS_MEMORY = 8.0  # late stamps over which is learnt what they mean
COUNTED = 4  # largest number of periods that a prediction shows,
FAR = 15.0  # and the log odds, doubled, of more
ASKED = 0.3  # periods: a later stamp may follow lost messages
SURE_MOTION = 3.0  # deviations of the prediction: readings that move by more show their time
AT_ONCE = 2.0  # periods: messages that are later, but followed at once, waited in a queue
LATE_FOR_GOOD = 250.0  # messages that stay late, times (jitter / period)^2, show a shift
FEWEST_LATE, MOST_LATE = 3, 250  # but between these,
LEAST_SHIFT = 0.75  # periods: of their median
BREAK_NS = 500_000_000  # a longer step of the stamps begins another stretch;
BREAK_PERIODS = 8.0  # or, if that is longer, one of this many periods; or one back by as many,
BACK_NS = 1e8  # but back by no more than this time [ns]
FEWEST_PERIODS, MOST_PERIODS = 0.7, 1.6  # mean periods per message of a correct period
MESSAGES = 100.0  # memory of this mean, and of the residuals of a joint [messages]
ESTABLISHED, MOVING = 12.0, 30.0  # changes that show a joint's motion; messages in motion
BETTER, WORSE = 0.8, 1.0  # ratio of squares to use the line, and to leave it,
SLIPPED = 30.0  # where a shift counts as this many
SLOWLY, WANDERS = 50.0, 0.5  # messages: over these residuals average to nothing, but for this part
NOMINAL = 1e-3  # a rate so close to a whole number of Hz is meant to be that
RECENT_MESSAGES = 8  # stamps that are known again when their message comes twice

COLLECTING, LEFT_ALONE, REPAIRED = 'fitting', 'left alone', 'repaired'

Steps = tuple[float, float]  # of time, by the stamps and on the line [s]
Message = tuple[int, Sequence[str], Sequence[float]]  # stamp [ns], joints, readings [rad or m]


def longest_back(period: float) -> float:
    """Return by how much jitter, and no jump of the clock, may set stamps back, both in ns."""
    return min(BREAK_PERIODS * period, max(BACK_NS, 2.0 * period))


def is_break(step: int, period: float) -> bool:
    """Return True if a step of the stamps [ns] begins another stretch."""
    return not -longest_back(period) < step <= max(BREAK_NS, BREAK_PERIODS * period)


def numbers_of(since: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the periods between messages, shape (n-1,), from their stamps, shape (n,) [ns].

    The device's rate is the largest line in the spectrum of the stamps. Lost messages leave it
    where it is, and jitter of up to 0.7 periods leaves enough of it; with more, none was lost.
    """
    ones = np.ones(len(since) - 1, np.int64)
    if since[-1] <= 0.0:
        return ones
    rate = len(ones) / since[-1]
    rates = np.arange(LOWEST_RATE * rate, HIGHEST_RATE * rate, 0.4 / since[-1])
    lines = np.exp(2j * np.pi * np.outer(rates, since)).mean(1)
    best = np.argmax(np.abs(lines))
    phase = np.angle(lines[best]) / (2.0 * np.pi)
    numbers = np.diff(np.rint(rates[best] * since - phase)).astype(np.int64)
    return numbers if abs(lines[best]) > LINE and min(numbers) > 0 else ones


class _Joint:
    """Readings of one joint: their prediction, and residuals of interpolation in both times."""

    def __init__(self, reading: float) -> None:
        self.last, self.step, self.changes = reading, 0.0, 0.0
        self.prediction = Prediction()
        self.residuals, self.squares = [0.0, 0.0], [0.0, 0.0]  # by the stamps, and on the line

    def change(self, reading: float, dt: float, turn: float) -> float:
        """Return the change to a reading that was taken `dt` [s] later, on the likely turn."""
        usual = self.prediction.velocity * dt
        return usual + wrap(reading - self.last - usual, turn)

    def see(self, reading: float, before: Steps, steps: Steps, turn: float) -> None:
        """Take a reading, `steps` after the one before."""
        dt, step = steps[1], self.change(reading, steps[1], turn)
        if self.changes:
            correct(self.prediction, dt, step, self.changes, dt)
        else:
            begin_prediction(self.prediction, dt, step)
        if step != 0.0 or self.step != 0.0:
            self.changes = min(self.changes + 1.0, MESSAGES)
            for i in (0, 1):
                part = before[i] / (before[i] + steps[i])
                residual = part * step - (1.0 - part) * self.step
                square, mean = (residual - self.residuals[i]) ** 2, self.squares[i]
                if mean > 0.0:
                    square = min(square, STRAY * mean)
                self.squares[i] += (square - mean) / self.changes
                self.residuals[i] = residual
        self.last, self.step = reading, step


class StampRepair:
    """Repairs the stamps of one device, message by message.

    Parameters
    ----------
    periods : (joint) -> its wrap period [rad]; 0: none.

    Attributes
    ----------
    state : `COLLECTING`, `LEFT_ALONE` or `REPAIRED`.
    period : of the device, in the clock of the stamps [s]; 0: not known.
    jitter : mean absolute residual of the stamps [s]. offset : the newest one [s].
    """

    def __init__(self, periods: Callable[[str], float]) -> None:
        self._periods = periods
        self._out_ns = 0  # newest time returned
        self._batches = False  # messages with equal stamps were not one
        self._recent: deque[tuple[int, tuple[float, ...], int]] = deque(maxlen=RECENT_MESSAGES)
        self._restart()

    def _restart(self) -> None:
        self.state, self.period, self.jitter, self.offset = COLLECTING, 0.0, 0.0, 0.0
        self._first: list[Message] = []  # to be fitted
        self._joints: dict[str, _Joint] = {}
        self._steps = 0.0, 0.0  # of the newest message
        self._late: deque[float] = deque(maxlen=MOST_LATE)
        self._per_message, self._moving, self._slips = 1.0, 0.0, 0.0
        # slow mean of the residuals [ns], its mean square, and theirs
        self._mean = self._wander = self._power = 0.0
        self._lost = 0.0  # fraction of late stamps, as far as it is known, after lost messages

    @property
    def drift(self) -> float:
        """Difference of the device's rate from a whole number of Hz, over it; nan: not close."""
        rate = 1.0 / self.period if self.period > 0.0 else 0.0
        nominal = round(rate)
        if not nominal or abs(rate / nominal - 1.0) > NOMINAL:
            return math.nan
        return rate / nominal - 1.0

    def __call__(self, stamp_ns: int, names: Sequence[str], positions: Sequence[float]) -> int:
        """Return when the readings of a message were taken [ns].

        Parameters
        ----------
        stamp_ns : its stamp [ns]; 0 or less: none, and it is returned.
        names, positions : of its joints [rad or m].
        """
        if stamp_ns <= 0 or len(names) != len(positions):
            return stamp_ns
        readings = tuple(each if abs(each) < LARGEST else math.nan for each in positions)
        for known_ns, known, at_ns in self._recent:
            if known_ns == stamp_ns:
                self._batches = self._batches or known != readings
                if not self._batches:
                    return at_ns  # it came twice
        message = stamp_ns, names, readings
        at_ns = self._collect(message) if self.state == COLLECTING else self._follow(message)
        if self.state == REPAIRED:  # time goes on, but for a step of the clock
            least_ns = self._out_ns + max(1, round(0.1e9 * self.period))
            if self._out_ns - longest_back(1e9 * self.period) < at_ns < least_ns:
                at_ns = least_ns
        self._out_ns = at_ns
        self._recent.append((stamp_ns, readings, at_ns))
        return at_ns

    def _collect(self, message: Message) -> int:
        first, stamp_ns = self._first, message[0]
        mean = (first[-1][0] - first[0][0]) / (len(first) - 1) if len(first) > 1 else 0.0
        if first and is_break(stamp_ns - first[-1][0], mean):
            first.clear()
        first.append(message)
        if len(first) >= (FIRST_FIT if stamp_ns - first[0][0] < SLOW_NS else SLOW_FIRST_FIT):
            self._fit()
        return stamp_ns

    def _fit(self) -> None:
        """Fit a line to the collected stamps."""
        messages, self._first = self._first, []
        self._base_ns = messages[0][0]
        since = np.array([stamp - self._base_ns for stamp, _, _ in messages], float)
        numbers = numbers_of(since)
        counts = np.array([0, *accumulate(numbers.tolist())], float)
        off, middle = counts - counts.mean(), float(since.mean())
        slope = float(off @ since / (off @ off))
        residuals = since - middle - slope * off
        if slope <= 0.0:
            return
        self._count = self._phases = float(len(since))  # messages of the line, and of the stretch
        # the newest reading on the line, relative to the base, and evenly after the others [ns]
        self._at_ns = self._even_ns = middle + slope * float(off[-1])
        self.period, self.jitter = 1e-9 * slope, 1e-9 * float(np.mean(np.abs(residuals)))
        self.offset, self.state = 1e-9 * float(residuals[-1]), LEFT_ALONE
        self._last_ns = messages[-1][0]
        self._lost = float(numbers.sum() > len(numbers))
        for message, step, number in zip(messages, [0.0, *np.diff(since)], [1, *numbers]):
            self._see(message, 1e-9 * float(step), int(number) * self.period)

    def _follow(self, message: Message) -> int:
        stamp_ns, period = message[0], 1e9 * self.period
        since, self._last_ns = stamp_ns - self._last_ns, stamp_ns
        if is_break(since, period):  # the period remains; the phase is learnt anew
            self._at_ns = self._even_ns = float(stamp_ns - self._base_ns)
            self._phases = 1.0
            self._late.clear()
            self._joints.clear()
            self._see(message, self.period, self.period)
            self.offset = 0.0
            return stamp_ns
        late = stamp_ns - self._base_ns - self._at_ns - period
        number = self._number(message, 1e-9 * late)
        off = late - (number - 1) * period
        if since > 0.5 * period or off < AT_ONCE * period:
            shift = self._shift(off / period)
            self._slips += ((shift != 0) - self._slips) / MESSAGES
            number, off = number + shift, off - shift * period
        self._per_message += (number - self._per_message) / MESSAGES
        if not FEWEST_PERIODS < self._per_message < MOST_PERIODS:
            self._restart()
            return self._collect(message)
        k = self._count = min(
            self._count + 1.0, FIT_MEMORY, max(SHORTEST_FIT, SECONDS / self.period, self._count)
        )
        self._phases += 1.0
        most = CLIPPED * 1e9 * self.jitter + 1.0
        clipped = min(max(off, -most), most)
        passed = number * period
        passed += clipped * max(2.0 * (2.0 * k - 1.0) / (k * (k + 1.0)), 1.0 / self._phases)
        self._at_ns += passed
        even = self._even_ns + number * period
        self._even_ns = even + (self._at_ns - even) / min(self._phases, PHASE_MEMORY)
        self.period += 1e-9 * clipped * 6.0 / (k * (k + 1.0))
        self.jitter += 1e-9 * (min(abs(off), 2.0 * most) - 1e9 * self.jitter) / min(k, 500.0)
        self.offset = 1e-9 * off
        self._mean += (off - self._mean) / SLOWLY
        self._wander += (self._mean**2 - self._wander) / (10.0 * SLOWLY)
        self._power += (off * off - self._power) / (10.0 * SLOWLY)
        self._see(message, 1e-9 * since, 1e-9 * passed)
        self._judge()
        return self._base_ns + round(self._even_ns) if self.state == REPAIRED else stamp_ns

    def _shift(self, off: float) -> int:
        """Return by how many periods the stamps stay late; `off`: the newest residual [periods]."""
        window, stays = self._late, round(LATE_FOR_GOOD * (self.jitter / self.period) ** 2)
        window.append(off)
        stays = min(MOST_LATE, max(FEWEST_LATE, stays))
        if abs(off) <= 0.5 or len(window) < stays:
            return 0
        typical = median(list(window)[-stays:])
        if abs(typical) <= LEAST_SHIFT:
            return 0
        window.clear()
        self._lost += ((typical > 0.0) - self._lost) / LOSS_MEMORY
        return round(typical)

    def _number(self, message: Message, late: float) -> int:
        """Return how many periods passed since the message before; `late`: if it was one [s]."""
        period = self.period
        if late <= ASKED * period:
            return 1
        most = max(1 + round(late / period), 2)
        sigma = SPREAD * self.jitter + 1e-9
        clearest, certainty = None, SURE_MOTION
        for name, reading in zip(*message[1:]):
            joint = self._joints.get(name)
            if joint and joint.changes >= ESTABLISHED and not math.isnan(reading):
                line = joint.prediction
                shown = (most - 1) * abs(line.velocity) * period / math.sqrt(line.variance)
                if shown > certainty:
                    clearest, certainty = (joint, reading, self._periods(name)), shown

        quiet = self.jitter < QUIET * period
        loss = USUAL if quiet or self._lost > 0.5 else RARE

        def unlikely(number: int) -> float:
            square = min(((late - (number - 1) * period) / sigma) ** 2, DELAY)
            square += loss if number > 1 else 0.0
            if clearest is not None:
                joint, reading, turn = clearest
                line, dt = joint.prediction, number * period
                missed = miss(line, dt, joint.change(reading, dt, turn)) / line.variance
                square += min(missed, WILD) if number <= COUNTED else FAR
            return square

        if clearest is None:
            return min((1, most), key=unlikely) if most <= COUNTED else 1
        number = min(range(1, most + 1) if most <= COUNTED else (1, most), key=unlikely)
        if late > 0.5 * period:
            self._lost += ((number > 1) - self._lost) / LOSS_MEMORY
        return number

    def _see(self, message: Message, by_stamp: float, on_line: float) -> None:
        """Let the readings judge the times since the message before, both in s."""
        steps = max(by_stamp, 0.05 * self.period), max(on_line, 0.1 * self.period)
        before, self._steps = self._steps, steps
        for name, reading in zip(*message[1:]):
            if math.isnan(reading):
                continue
            joint = self._joints.get(name)
            if joint is None:
                self._joints[name] = _Joint(reading)
            else:
                joint.see(reading, before, steps, self._periods(name))

    def _judge(self) -> None:
        """Decide between the stamps and the line."""
        squares = [joint.squares for joint in self._joints.values() if all(joint.squares)]
        stamps = sum(by_stamp / (by_stamp + on_line) for by_stamp, on_line in squares)
        line = (len(squares) - stamps) * (1.0 + SLIPPED * self._slips)
        if self._wander > WANDERS * self._power:
            stamps = 0.0
        self._moving += any(joint.step for joint in self._joints.values())
        sure = self.jitter < QUIET * self.period or self._count * self.period >= FITTED
        if self.state == LEFT_ALONE and sure and self._moving > MOVING and line < BETTER * stamps:
            self.state = REPAIRED
        elif self.state == REPAIRED and line > WORSE * stamps:
            self.state, self._moving = LEFT_ALONE, 0.0
