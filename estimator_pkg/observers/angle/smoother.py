# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A fixed-lag smoother of one angle: position and velocity a moment ago, from later readings too.

    x' = v,  v' = a,  a' = w,       w white jerk of density `jerk` that is learnt

Readings wait until the oldest is `lag` old. Then all that wait are smoothed together: a Kalman
filter forward from the last result, and the adjoint form of the Rauch-Tung-Striebel smoother
backward (Bryson and Frazier 1963; Bierman 1973), which inverts no covariance. The older half
becomes results, so that each has used readings of at least half the lag after it, and a reading is
passed twice in either direction.

The value of a reading: while the angle passes less than a quantum per sample, an unchanged reading
is no news, and a changed one shows the angle in the part of its quantum next to the edge that it
just crossed. Otherwise its variance is quantum^2/12. The variance of further noise is added.

What is learnt, from the results alone: the quantum is the smallest step; the noise explains the
smoothed residuals (expectation maximisation, Shumway and Stoffer 1982); the density makes the score
of the likelihood zero (Koopman and Shephard 1992), which compares the adjoint's square with its
variance. A motion that the density cannot explain raises it at once, and its window is smoothed
again.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

from estimator_pkg.circle import wrap
from estimator_pkg.observers.angle.adjoint import NO_NEWS, News, Result, State, backward, widened
from estimator_pkg.sensor.convention import Convention, begin_convention, follow_convention, present
from estimator_pkg.sensor.noise import BLUR

FEWEST_MOVES = 4  # moves from which the density is guessed
FEWEST = 3  # readings since a start that show a velocity
COARSE = 0.3  # quanta of noise from which edges are no times any more
SPEED_SIGMAS = 2.0  # of the speed, in the part of the quantum that an edge leaves open
STRAY = 6.0  # standard deviations, and
QUANTA = 3.0  # quanta: an innovation beyond both is a stray reading, if the next one shows it
CLOSE = 0.9  # of the quantum: a smaller step is a finer one
MANY, COARSER = 40, 1.5  # moves that show that a given quantum is too small, by this factor
TRUSTED = 3  # windows with such steps show that a given quantum is too large
GRAIN = 1e-6  # of a reading: smaller steps are rounding [rad or m],
LEAST_STEP = 1e-9  # or smaller than this [rad or m]
HELD_VARIANCE = 1.0  # square quanta, of a reading whose prediction lies outside its quantum
VAGUE = 4.0  # square quanta: a prediction vaguer than this takes an unchanged reading, too
START_BANDWIDTH = 60.0  # bandwidth at a start [1/s], 1 per sample, and at most
REST = 2.0  # this over the time of the rest before it
JERK_MEMORY = 20.0  # degrees of freedom of the jerk over which its density is learnt
NOISE_READINGS = 2000.0  # the same for the noise [readings]
LESS = 0.1  # of the noise remains at least in a window
LEAN = 1.5  # their squares must exceed their variance by this factor: motions are smooth
GAIN = 2.0  # of the density's logarithm in the relative score
SURPRISE = 2.0  # mean of the normalised squared innovations of a window that no chance explains,
SURPRISE_SUM = 12.0  # if their sum also exceeds its mean by this
MOST_PASSES = 20  # times at most that a window is filtered again
RISE = 10.0  # of the density at a time
SLOWEST = 2.0  # longest memory [s]: the least density
LOOSE = 1e6  # variance of the acceleration at a start

NO_RESULT: Result = (math.nan, math.nan, math.nan, math.nan)


class Smoother:
    """Smooths the readings of one joint.

    Parameters
    ----------
    lag : [s]. period : wrap period [rad]; 0: none.
    quantum : smallest step of the readings [rad or m]; 0: learnt.
    unwrap : the positions count turns.

    Attributes
    ----------
    jerk : density of the white jerk [rad^2/s^5]; 0: no reading was smoothed yet.
    noise : variance of a reading beyond its quantisation [rad^2].
    quantum : as given, or as learnt so far [rad]; 0: not known.
    """

    def __init__(
        self, lag: float, period: float, quantum: float = 0.0, unwrap: bool = False
    ) -> None:
        self._half_ns = round(0.5e9 * lag)
        self._period, self._unwrap = float(period), unwrap
        # windows that may have a finer step than a given quantum: strays
        self._trusted, self._finer = TRUSTED if quantum > 0.0 else 0, 0
        self._coarsest, self._moved = math.inf, 0  # the smallest step, of how many
        self.quantum = float(quantum)
        self.jerk = self.noise = 0.0
        self._freedom = self._readings = 0.0  # what the density and the noise were learnt from
        self._state: State | None = None  # filtered, at the last result of this stretch
        self._before = 0.0, 0  # reading and stamp at that result
        self._seen: list[tuple[float, float]] = []  # steps and moves, until the density is guessed
        self._rest = 0.0  # time without any move [s]
        self._age = 0  # readings of this stretch that became results
        self._stamps: list[int] = []  # of the readings that wait
        self._waiting: list[float] = []
        self._shown: deque[float] = deque()  # readings in the published convention
        self._results: deque[tuple[float, Result]] = deque()  # with their readings
        self._convention, self._any = Convention(), False

    def add(self, stamp_ns: int, reading: float, shown: float, fresh: bool) -> None:
        """Take a reading.

        Parameters
        ----------
        reading : [rad or m]. shown : the same in the published convention.
        fresh : the motion before it is too old, or its clock another.
        """
        if fresh:
            if self._stamps:
                self._smooth(len(self._stamps))
            self._state, self._age = None, 0
        self._stamps.append(stamp_ns)
        self._waiting.append(reading)
        self._shown.append(shown)

    def result(self) -> Result:
        """Return the result of the oldest reading without one; nan where it shows no velocity."""
        if not self._results:
            newest = self._stamps[-1] - self._half_ns
            due = sum(stamp <= newest for stamp in self._stamps)
            self._smooth(max(1, due))
        reading, (x, v, of_x, of_v) = self._results.popleft()
        shown = self._shown.popleft()
        period = self._period
        if not self._any:
            begin_convention(self._convention, shown)
            self._any = True
        if period > 0.0 and not self._unwrap:
            follow_convention(self._convention, shown, period)
        if math.isnan(v):
            return NO_RESULT
        if period > 0.0 and not self._unwrap:
            return present(self._convention, x, period, False), v, of_x, of_v
        return shown + wrap(x - reading, period), v, of_x, of_v

    # One window

    def _smooth(self, count: int) -> None:
        """Smooth the readings that wait; the first `count` become results."""
        readings, stamps = self._waiting, self._stamps
        last, last_ns = self._before
        if self._state is None:
            last, last_ns = readings[0], stamps[0]
        steps = [(b - a) * 1e-9 for a, b in zip([last_ns, *stamps], stamps)]
        moves = self._moves(last, readings)
        if self.quantum == 0.0:
            self._rest += sum(steps[:count])
        self._learn_quantum(moves, last)
        if self.jerk == 0.0:
            self._seen += (pair for pair in zip(steps[:count], moves[:count]) if pair[0] > 0.0)
            self._begin([*self._seen, *zip(steps[count:], moves[count:])])
        density = self.jerk
        for _ in range(MOST_PASSES):
            state = self._state or self._start(readings[0], steps, moves)
            if density > self.jerk > 0.0 and self._state:
                state = widened(state, (density / self.jerk) ** (1.0 / 6.0))
            states, news, size, used = self._forward(state, density, steps, readings, moves)
            if size <= SURPRISE * used or size - used < SURPRISE_SUM:
                break
            density *= RISE
        results, score, residuals = backward(steps, states, news, density, count)
        fastest = math.inf  # no readings show a larger speed
        if self._period > 0.0 and len(steps) > 1:
            fastest = 0.5 * self._period / min(steps[1:])
        astray = not all(abs(v) <= fastest for _, v, _, _ in results)
        known = self.jerk > 0.0 and self._age + len(readings) >= FEWEST and not astray
        floor = self.quantum * self.quantum / 12.0
        for reading, (x, v, of_x, of_v) in zip(readings, results):
            # the adjoint is larger than the density makes it, and so are the errors
            result = (x, v, math.sqrt(of_x + floor), math.sqrt(LEAN * of_v))
            self._results.append((reading, result if known else NO_RESULT))
        if not astray:
            self._learn(density, score, residuals, steps)
        self._state = None if astray else states[count - 1]
        self._before = readings[count - 1], stamps[count - 1]
        self._age += count
        del readings[:count], stamps[:count]

    def _moves(self, last: float, readings: list[float]) -> list[float]:
        """Return by how much each reading changed."""
        moves = [b - a for a, b in zip([last, *readings], readings)]
        half = 0.5 * self._period
        if half > 0.0 and (max(moves) >= half or min(moves) < -half):
            return [wrap(move, self._period) for move in moves]
        return moves

    def _start(self, reading: float, steps: list[float], moves: list[float]) -> State:
        """Return the state at the first reading of a stretch; its speed is of the moves' size."""
        quantum = self.quantum
        step = min(steps[1:], default=1e-3)
        fastest = 2.0 * (max(map(abs, moves[1:]), default=1.0) + quantum + LEAST_STEP) / step
        return (
            reading,
            0.0,
            0.0,
            max(quantum * quantum / 12.0 + self.noise, LEAST_STEP * LEAST_STEP),
            0.0,
            0.0,
            fastest * fastest,
            0.0,
            min(LOOSE, (fastest / step) ** 2),
        )

    def _forward(
        self,
        state: State,
        density: float,
        steps: list[float],
        readings: list[float],
        moves: list[float],
    ) -> tuple[list[State], list[News], float, int]:
        """Filter; return the state after each reading, what it brought, and the sum and number
        of the normalised squared innovations.
        """
        x, v, a, p00, p01, p02, p11, p12, p22 = state
        quantum, noise, period = self.quantum, self.noise, self._period
        square, half, turn = quantum * quantum, 0.5 * quantum, 0.5 * period or math.inf
        noise = max(noise, LEAST_STEP * LEAST_STEP)
        plain = square / 12.0 + noise
        times = quantum > 0.0 and noise < COARSE * COARSE * square
        blurred = noise + BLUR * BLUR * square
        k20, k8, k6, k3 = density / 20.0, density / 8.0, density / 6.0, density / 3.0
        states, news = [], []
        size, used = 0.0, 0
        last = len(readings) - 1
        for i, h in enumerate(steps):
            k = 0.5 * h * h
            q2 = h * h
            q3 = q2 * h
            x += h * v + k * a
            v += h * a
            a0 = p00 + h * p01 + k * p02
            a1 = p01 + h * p11 + k * p12
            a2 = p02 + h * p12 + k * p22
            b1 = p11 + h * p12
            b2 = p12 + h * p22
            p00 = a0 + h * a1 + k * a2 + k20 * q3 * q2
            p01 = a1 + h * a2 + k8 * q2 * q2
            p02 = a2 + k6 * q3
            p11 = b1 + h * b2 + k3 * q3
            p12 = b2 + density * k
            p22 += density * h
            e = readings[i] - x
            if e >= turn or e < -turn:
                e = wrap(e, period)
            r, shows = plain, True
            if times:
                move = moves[i]
                if -half < move < half:
                    shows = False
                    inside = -half <= e <= half
                    if not inside and p00 <= VAGUE * square:
                        r = HELD_VARIANCE * square
                    elif p00 <= VAGUE * square:
                        states.append((x, v, a, p00, p01, p02, p11, p12, p22))
                        news.append(NO_NEWS)
                        continue
                elif -1.5 * quantum < move < 1.5 * quantum:
                    part = (abs(v) + SPEED_SIGMAS * math.sqrt(p11)) * h
                    if part < quantum:
                        e += 0.5 * (part - quantum) if move > 0.0 else 0.5 * (quantum - part)
                        r = part * part / 12.0 + blurred
            s = p00 + r
            if (
                e * e > STRAY * STRAY * s
                and abs(e) > QUANTA * quantum
                and (  # the newest one waits for the next
                    i == last
                    or 4.0 * abs(wrap(readings[i + 1] - x - v * steps[i + 1], period)) < abs(e)
                )
            ):
                states.append((x, v, a, p00, p01, p02, p11, p12, p22))
                news.append(NO_NEWS)
                continue
            g = 1.0 / s
            d = e * g
            size += d * e
            used += 1
            x += p00 * d
            v += p01 * d
            a += p02 * d
            g1, g2, kept = g * p01, g * p02, r * g
            p22 -= g2 * p02
            p12 -= g1 * p02
            p11 -= g1 * p01
            p00 *= kept
            p01 *= kept
            p02 *= kept
            states.append((x, v, a, p00, p01, p02, p11, p12, p22))
            news.append((d, g, 1.0 / r, shows))
        return states, news, size, used

    # What is learnt

    def _learn_quantum(self, moves: list[float], size: float) -> None:
        """Take the smallest step for the quantum, or the smallest difference of two of them."""
        grain = max(LEAST_STEP, GRAIN * abs(size))
        least, before, count = math.inf, 0.0, 0
        for move in moves:
            if move != 0.0:
                move = abs(move)
                if grain < move < least:
                    least = move
                if grain < abs(move - before) < least:
                    least = abs(move - before)
                before = move
                count += 1
        if self.quantum == 0.0:
            if least < math.inf:
                self.quantum, self.jerk = least, 0.0  # what rested shows no noise
        elif least < CLOSE * self.quantum:
            self._finer += 1
            if self._finer > self._trusted:
                self.quantum = least
        elif self._trusted and count:
            self._coarsest = min(self._coarsest, least)
            self._moved += count
            if self._moved >= MANY and self._coarsest > COARSER * self.quantum:
                self.quantum, self._trusted = self._coarsest, 0

    def _begin(self, seen: list[tuple[float, float]]) -> None:
        """Guess noise and density from the first steps and moves, if they are enough."""
        steps, moves = zip(*seen) if seen else ((), ())
        if len(moves) < FEWEST_MOVES:
            return
        # residuals of linear interpolation; of white noise their change has five variances
        rest = [
            (move * k - after * h) / (h + k)
            for (h, move), (k, after) in pairwise(zip(steps, moves))
        ]
        changes = sorted(abs(b - a) for a, b in pairwise(rest))
        floor = self.quantum * self.quantum / 12.0
        typical = changes[len(changes) // 2] / 1.5
        self.noise = max(typical * typical - floor, LEAST_STEP * LEAST_STEP)
        step = sorted(steps)[len(steps) // 2]
        band = min(
            START_BANDWIDTH, 1.0 / step, REST / self._rest if self._rest else START_BANDWIDTH
        )
        self.jerk = (floor + self.noise) * step * band**6
        self._state, self._seen = None, []

    def _learn(
        self,
        density: float,
        score: tuple[float, float],
        residuals: tuple[float, float, int],
        steps: list[float],
    ) -> None:
        """Learn density and noise from the results of a window; see `backward`."""
        if self.jerk == 0.0:
            return
        square, freedom = score
        self._freedom = min(self._freedom + freedom, JERK_MEMORY)
        change = GAIN * (square - LEAN * freedom) / (self._freedom + 1.0)
        least = (self.quantum * self.quantum / 12.0 + self.noise) * steps[-1] / SLOWEST**6
        self.jerk = max(density * math.exp(min(1.0, max(-1.0, change))), least)
        above, weights, count = residuals
        if count:
            self._readings = min(self._readings + count, NOISE_READINGS)
            noise = self.noise + above / weights * count / self._readings
            self.noise = max(noise, LESS * self.noise, LEAST_STEP * LEAST_STEP)
