# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find when a device that samples regularly took its readings, from stamps that jitter.

    t_k = t_(k-1) + n_k period,       stamp_k = t_k + delay_k

Phase and period of the device's clock follow a growing-memory g-h filter (a recursive least-squares
line; Brookner, Tracking and Kalman Filtering Made Easy, 1998, section 1.2.10), whose memory ends at
`FIT_MEMORY` messages so that it follows a drift. Residuals count up to `CLIPPED` times their mean.

n_k is more than 1 where messages were lost. A late stamp may be a lost message or a delay. The
readings decide where they move fast enough. Otherwise a stamp that fits the grid of a quiet clock
was preceded by lost messages; any other one was delayed, until the stamps stay late.

Stamps that jitter and sampling that jitters look the same. So the readings decide here, too: the
residuals of linear interpolation are compared between the stamps and the fit, and the fit is used
only while its residuals are clearly smaller.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise
from statistics import median

from estimator_pkg.circle import LARGEST, wrap
from estimator_pkg.sensor.stamp_grid import COUNTED_PERIODS, Arrival, numbers_of

FIRST_FIT = 64  # messages before the first fit,
SLOW_FIRST_FIT, SLOW_NS = 16, 2_000_000_000  # or these, if they took so long [ns]
FIT_MEMORY = 10000.0  # messages that the fit remembers,
SECONDS = 10.0  # or messages of this time [s],
SHORTEST_FIT = 200.0  # but not fewer than these
CLIPPED = 3.0  # mean absolute residuals
QUIET_JITTER = 0.1  # periods: with less jitter than this a stamp shows the number of lost messages,
GRID_TOLERANCE = 5.0  # within this many mean residuals,
LATE_PERIODS = 0.5  # periods: a stamp later than this may follow lost messages,
ASKED = 0.3  # and one later than this if the readings show it
SURE_MOTION = 6.0  # residuals: readings that move by more in a period show their time
SPREAD, DELAY_SQUARE = 1.25, 12.0  # standard deviation over mean residual; a delay's squared one
AT_ONCE = 2.0  # periods: messages that are later, but followed at once, waited in a queue
PHASE_MEMORY = 64.0  # messages over which corrections of the phase are spread
YOUNG = 2000  # messages after which the period is known
PLENTY = 100  # messages after which stamps that stay early show that the period is too long
LATE_FOR_GOOD = 250.0  # messages that stay late, times (jitter / period)^2, show a shift
LEAST_SHIFT = 0.75  # periods: the median residual is beyond this
FEWEST_LATE, MOST_LATE = 3, 250  # but between these
LOSS_MEMORY = 8.0  # late stamps over which is learnt what they mean
REFIT_MESSAGES, OTHER = 128, 0.015  # messages that show a period so different, while stamps jitter;
LONGEST_PAUSE = 1024  # where they do not, the next look follows later, at most after these
BREAK = 0.5  # [s] a longer step of the stamps begins another stretch;
BREAK_PERIODS = 8.0  # or, if that is longer, one of this many periods; or one back by as many,
BACK_NS = 1e8  # but back by no more than this time [ns]
SPEED_GAIN, BEND_GAIN = 0.5, 0.1  # of the readings' steps
RESIDUAL_MEMORY = 100.0  # messages over which residuals are compared,
ESTABLISHED = 12.0  # of these in motion
WILD = 100.0  # each with at most this many times the mean square
FIT_BETTER, FIT_WORSE = 0.8, 1.0  # ratio of their squares to use the fit, and to leave it
SLIPPED = 30.0  # a revision counts as this many mean squares
SLOWLY = 50.0  # messages: over these the residuals of a regular device average to nothing;
WANDERS = 0.5  # this part of their mean square must not remain
FITTED = 0.5  # [s] of the fit before that, unless the stamps hardly jitter
USED_AGAIN_AFTER = 500.0  # messages in motion before it is used again, twice as many each time
MOVING_MESSAGES = 30.0  # messages in motion that allow to use it
FEWEST_PERIODS, MOST_PERIODS = 0.7, 1.6  # mean periods per message of a correct period
NOMINAL = 1e-3  # a rate so close to a whole number of Hz is meant to be that
BATCH_MEMORY = 1000  # messages for which equal stamps are remembered not to be one message
RECENT_MESSAGES = 8  # stamps that are known again when their message comes twice

COLLECTING, LEFT_ALONE, REPAIRED = 'fitting', 'left alone', 'repaired'


def longest_back(period: float) -> float:
    """Return by how much jitter, and no jump of the clock, may set stamps back, both in ns."""
    return min(BREAK_PERIODS * period, max(BACK_NS, 2.0 * period))


def is_break(step: int, period: float) -> bool:
    """Return True if a step of the stamps [ns] begins another stretch."""
    return not -longest_back(period) < step <= max(1e9 * BREAK, BREAK_PERIODS * period)


class _Joint:
    """Readings of one joint: speed, and residuals of interpolation in both times."""

    def __init__(self) -> None:
        self.last = self.step = 0.0  # newest reading, and its step [rad]
        self.speed = self.bend = 0.0  # its step per period, and the change of that [rad]
        self.squares = [0.0, 0.0]  # mean squared residuals: at the stamps, and at the fit [rad^2]
        self.residuals = [0.0, 0.0]
        self.counts = [0.0, 0.0]

    def after(self, periods: int) -> float:
        """Return the expected step over this number of periods [rad]."""
        return periods * self.speed + 0.5 * periods * (periods + 1) * self.bend


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
        self._joints: dict[str, _Joint] = {}
        self._out_ns = 0  # newest time returned
        self._batches = 0  # messages for which messages are thought to come in batches
        self._ahead = False  # it is later than it should be
        self._recent: deque[tuple[int, tuple[float, ...], int]] = deque(maxlen=RECENT_MESSAGES)
        self._restart()

    def _restart(self) -> None:
        self.state, self.period, self.jitter, self.offset = COLLECTING, 0.0, 0.0, 0.0
        self._first: list[Arrival] = []  # to be fitted
        self._at_ns = self._even_ns = 0.0  # the fit, and evenly; relative to the base [ns]
        self._base_ns = 0
        self._wander = 0.0, 0.0, 0.0  # slow mean of the residuals, its mean square, and theirs
        self._slips = 0.0  # fraction of messages that revised the number of lost ones
        self._unbroken = 0  # messages since one was missed
        self._lost = 0.0  # fraction of late stamps, as far as readings show it, after lost messages
        self._count = self._phases = 0.0  # messages of the fit, and of the stretch
        self._late: deque[float] = deque(maxlen=MOST_LATE)
        self._per_message = 1.0
        self._weight, self._ban = 0.0, USED_AGAIN_AFTER
        self._steps_ns = (0.0, 0.0)  # of the newest message: in the stamps, in the fit
        for joint in self._joints.values():
            joint.squares, joint.counts, joint.speed, joint.bend = [0.0, 0.0], [0.0, 0.0], 0.0, 0.0

    @property
    def drift(self) -> float:
        """Difference of the device's rate from a whole number of Hz, over it; nan: not close."""
        rate = 1.0 / self.period if self.period > 0.0 else 0.0
        nominal = round(rate)
        if not nominal or abs(rate / nominal - 1.0) > NOMINAL:
            return float('nan')
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
        newest_ns = self._recent[-1][0] if self._recent else 0
        if stamp_ns == newest_ns and readings != self._recent[-1][1]:
            self._batches = BATCH_MEMORY  # equal stamps are not one message
        elif self._batches:
            self._batches -= 1
        if stamp_ns != newest_ns or not self._batches:
            for known_ns, known, at_ns in self._recent:
                if known_ns == stamp_ns and known == readings:
                    return at_ns  # it came twice
        if self.state == COLLECTING:
            at_ns = self._collect(stamp_ns, names, readings)
        else:
            at_ns = self._follow(stamp_ns, names, readings)
        if self.state == REPAIRED or self._ahead:  # time goes on, but for a step of the clock
            least_ns = self._out_ns + max(1, round(0.1e9 * self.period))
            self._ahead = self._out_ns - longest_back(1e9 * self.period) < at_ns < least_ns
            if self._ahead:
                at_ns = least_ns
        self._out_ns = at_ns
        self._recent.append((stamp_ns, readings, at_ns))
        return at_ns

    def _collect(self, stamp_ns: int, names: Sequence[str], positions: Sequence[float]) -> int:
        first = self._first
        if first and is_break(stamp_ns - first[-1][0], self._mean()):
            first.clear()
        first.append((stamp_ns, names, positions))
        if len(first) >= (FIRST_FIT if stamp_ns - first[0][0] < SLOW_NS else SLOW_FIRST_FIT):
            self._fit()
        return stamp_ns

    def _mean(self) -> float:
        """Return the mean step of the collected stamps [ns]."""
        first = self._first
        return (first[-1][0] - first[0][0]) / (len(first) - 1) if len(first) > 1 else 0.0

    def _fit(self) -> None:
        """Fit a line to the collected stamps."""
        first, self._first = self._first, []
        stamps = [stamp for stamp, _, _ in first]
        base = stamps[0]
        steps = [b - a for a, b in pairwise(stamps)]
        middle = median(steps)
        scatter = median(abs(step - middle) for step in steps)
        quiet = middle > 0.0 and scatter < QUIET_JITTER * middle
        if quiet:
            numbers = [max(1, round(step / middle)) for step in steps]
        else:
            numbers = numbers_of(first, self._periods) or [1] * len(steps)
        counts = list(accumulate(numbers, initial=0))
        n = len(stamps)
        mean_count = sum(counts) / n
        mean_stamp = sum(stamp - base for stamp in stamps) / n
        square = sum((count - mean_count) ** 2 for count in counts)
        slope = (
            sum((c - mean_count) * (s - base - mean_stamp) for c, s in zip(counts, stamps)) / square
        )
        if slope <= 0.0:
            return
        self._base_ns, self._count, self._phases = base, float(n), float(n)
        self._at_ns = mean_stamp + slope * (counts[-1] - mean_count)
        residuals = [
            s - base - mean_stamp - slope * (c - mean_count) for c, s in zip(counts, stamps)
        ]
        self.period, self.jitter = slope * 1e-9, 1e-9 * sum(map(abs, residuals)) / n
        self.offset, self._even_ns = 1e-9 * residuals[-1], self._at_ns
        self.state = LEFT_ALONE
        self._last_ns = stamps[-1]
        self._wander, self._slips = (0.0, 0.0, 0.0), 0.0
        self._wait, self._pause = 0, REFIT_MESSAGES // 2
        self._lost = max(self._lost, float(sum(numbers) > len(steps)))
        self._joints.clear()
        self._see(*first[0][1:], (0.0, 0.0), 1)
        for (_, names, positions), step, number in zip(first[1:], steps, numbers):
            self._see(names, positions, (max(step, 0.05 * slope), number * slope), number)

    def _follow(self, stamp_ns: int, names: Sequence[str], positions: Sequence[float]) -> int:
        period = 1e9 * self.period
        since = stamp_ns - self._last_ns
        self._last_ns = stamp_ns
        if is_break(since, period):
            # the period remains; the phase is learnt anew
            self._at_ns = self._even_ns = float(stamp_ns - self._base_ns)
            self._phases = 1.0
            self._first = []
            self._late.clear()
            self._see(names, positions, (0.0, 0.0), 1)
            self.offset = 0.0
            return stamp_ns
        before = self._at_ns
        late = stamp_ns - self._base_ns - before - period
        number = self._number(late, period, names, positions)
        off = late - (number - 1) * period
        shift = 0
        if since > LATE_PERIODS * period or off < AT_ONCE * period:
            shift = self._shift(off, period)
        self._slips += ((shift != 0) - self._slips) / RESIDUAL_MEMORY
        self._unbroken = self._unbroken + 1 if number + shift == 1 else 0
        self._per_message += (number + shift - self._per_message) / RESIDUAL_MEMORY
        if not FEWEST_PERIODS < self._per_message < MOST_PERIODS:
            self._restart()
            return self._collect(stamp_ns, names, positions)
        off -= shift * period
        at = before + (number + shift) * period
        k = self._count = min(
            self._count + 1.0, FIT_MEMORY, max(SHORTEST_FIT, SECONDS / self.period, self._count)
        )
        self._phases += 1.0
        most = CLIPPED * 1e9 * self.jitter + 1.0
        clipped = min(max(off, -most), most)
        at += clipped * max(2.0 * (2.0 * k - 1.0) / (k * (k + 1.0)), 1.0 / self._phases)
        self.period += 1e-9 * clipped * 6.0 / (k * (k + 1.0))
        self.jitter += 1e-9 * (min(abs(off), 2.0 * most) - 1e9 * self.jitter) / min(k, 500.0)
        self.offset, self._at_ns = 1e-9 * off, at
        mean, wander, power = self._wander
        mean += (off - mean) / SLOWLY
        wander += (mean * mean - wander) / (10.0 * SLOWLY)
        power += (off * off - power) / (10.0 * SLOWLY)
        self._wander = mean, wander, power
        even = self._even_ns + (number + shift) * period
        self._even_ns = even + (at - even) / min(self._phases, PHASE_MEMORY)
        self._see(
            names,
            positions,
            (max(since, 0.05 * period), max(at - before, 0.1 * period)),
            number + shift,
        )
        self._judge()
        if self.state == REPAIRED:
            self._first = []
            return self._base_ns + round(self._even_ns)
        if 1e9 * self.jitter > QUIET_JITTER * period:
            self._look_again((stamp_ns, names, positions), period)
        return stamp_ns

    def _look_again(self, message: Arrival, period: float) -> None:
        """Fit anew if the messages show another period, as after lost ones while nothing moved."""
        self._wait -= 1
        if self._wait >= 0:
            return
        first = self._first
        first.append(message)
        if len(first) == REFIT_MESSAGES:
            self._wait = self._pause = min(2 * self._pause, LONGEST_PAUSE)
            numbers = numbers_of(first, self._periods)
            passed = first[-1][0] - first[0][0]
            if numbers and abs(passed / sum(numbers) - period) > OTHER * period:
                self._fit()
            self._first = []

    def _shift(self, off: float, period: float) -> int:
        """Return by how many periods the stamps stay late: messages were lost, or not.

        Parameters
        ----------
        off : residual of the newest stamp [ns].
        """
        window = self._late
        window.append(off)
        stays = round(LATE_FOR_GOOD * (1e9 * self.jitter / period) ** 2)
        stays = min(MOST_LATE, max(FEWEST_LATE, stays))
        if abs(off) <= LATE_PERIODS * period or len(window) < stays:
            return 0
        typical = median(list(window)[-stays:]) / period
        shift = round(typical) if abs(typical) > LEAST_SHIFT else 0
        if shift:
            window.clear()
            self._lost += (float(shift > 0) - self._lost) / LOSS_MEMORY
        if shift < 0 and PLENTY < self._unbroken < YOUNG and self._count < YOUNG:
            self.period *= 1.0 + shift / self._unbroken
            self._count = min(self._count, float(self._unbroken))
        return shift

    def _number(
        self, late: float, period: float, names: Sequence[str], positions: Sequence[float]
    ) -> int:
        """Return how many periods passed since the message before.

        Parameters
        ----------
        late : residual of the stamp, if it was one period [ns].
        """
        quiet = 1e9 * self.jitter < QUIET_JITTER * period
        if late <= ASKED * period:
            return 1
        most = 1 + round(late / period)
        sigma = SPREAD * 1e9 * self.jitter + 1.0
        stamps = [
            min(((late - n * period) / sigma) ** 2, DELAY_SQUARE) for n in range(COUNTED_PERIODS)
        ]
        shown = self._shown(names, positions, max(most, 2), stamps)
        if shown:
            self._lost += (float(shown > 1) - self._lost) / LOSS_MEMORY
            return shown
        if late <= LATE_PERIODS * period:
            return 1
        if (
            self._lost > 0.5
            and most <= COUNTED_PERIODS
            and CLIPPED * 1e9 * self.jitter < LATE_PERIODS * period
        ):
            return most
        off = abs(late - (most - 1) * period)
        if quiet and most <= COUNTED_PERIODS and off < GRID_TOLERANCE * 1e9 * self.jitter + 1e3:
            return most
        return 1

    # What the readings show

    def _shown(
        self, names: Sequence[str], positions: Sequence[float], most: int, stamps: Sequence[float]
    ) -> int:
        """Return how many periods passed, at most `most`, as the readings show; 0: they do not.

        Parameters
        ----------
        stamps : by one less than their number, the squared deviation of the stamp.
        """
        shown, certainty = 0, SURE_MOTION
        for name, position in zip(names, positions):
            joint = self._joints.get(name)
            if joint is None or joint.counts[1] < ESTABLISHED or math.isnan(position):
                continue
            residual = max(joint.squares[1], 1e-24) ** 0.5
            sure = (most - 1) * abs(joint.speed) / residual
            if sure <= certainty:
                continue
            certainty = sure
            step, turn = position - joint.last, self._periods(name)
            if most <= COUNTED_PERIODS:
                shown = min(
                    ((wrap(step - joint.after(n), turn) / residual) ** 2 + stamps[n - 1], n)
                    for n in range(1, most + 1)
                )[1]
            else:
                off = abs(wrap(step - joint.after(1), turn))
                shown = 1 if off < 0.5 * SURE_MOTION * residual else most
        return shown

    def _see(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        steps: tuple[float, float],
        number: int,
    ) -> None:
        """Follow the residuals of interpolation, in the stamps and in the fit."""
        joints, before = self._joints, self._steps_ns
        for name, position in zip(names, positions):
            if math.isnan(position):
                continue
            joint = joints.get(name)
            if joint is None:
                joint = joints[name] = _Joint()
                joint.last = position
                continue
            usual = joint.after(number) if number > 1 else 0.0  # it may be more than half a turn
            step = usual + wrap(position - joint.last - usual, self._periods(name))
            if step or joint.step:
                for i in (0, 1):
                    if before[i] <= 0.0 or steps[i] <= 0.0 or abs(number) > COUNTED_PERIODS:
                        continue
                    part = before[i] / (before[i] + steps[i])
                    residual = part * step - (1.0 - part) * joint.step
                    change = residual - joint.residuals[i]
                    joint.residuals[i] = residual
                    square, mean = change * change, joint.squares[i]
                    if square > WILD * mean > 0.0:
                        square = WILD * mean
                    joint.counts[i] = count = min(joint.counts[i] + 1.0, RESIDUAL_MEMORY)
                    joint.squares[i] += (square - mean) / count
            joint.step = step
            error = step / max(number, 1) - joint.speed - joint.bend
            joint.speed += joint.bend + SPEED_GAIN * error
            joint.bend += BEND_GAIN * error
            joint.last = position
        self._steps_ns = steps if abs(number) <= COUNTED_PERIODS else (0.0, 0.0)

    def _judge(self) -> None:
        """Decide between the stamps and the fit."""
        stamps = fit = 0.0
        moves = False
        for joint in self._joints.values():
            at_stamps, at_fit = joint.squares
            both = at_stamps + at_fit
            if both > 0.0:
                stamps += at_stamps / both
                fit += at_fit / both
                moves = moves or joint.step != 0.0
        fit *= 1.0 + SLIPPED * self._slips
        _, wander, power = self._wander
        if wander > WANDERS * power:
            stamps = 0.0
        self._weight += moves
        if self._weight < MOVING_MESSAGES:
            return
        sure = self.jitter < QUIET_JITTER * self.period or self._count * self.period >= FITTED
        if self.state == LEFT_ALONE and sure and fit < FIT_BETTER * stamps:
            self.state = REPAIRED
        elif self.state == REPAIRED and fit > FIT_WORSE * stamps:
            self.state, self._weight = LEFT_ALONE, -self._ban
            self._ban *= 2.0
