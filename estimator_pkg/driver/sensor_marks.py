# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The marks of a turn: when a shaft passed them, and what that shows of its sensor's errors.

See `sensor_map` for the equations. Everything here is called only where a mark is passed. The
memory holds arrays that are changed in place; Numba can compile the functions. Angles are in rad,
times in s.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from estimator_pkg.driver.guard import AFTER_GAP, AFTER_STRAY_STAMP

MOST = 128  # counts of a turn of a coarse sensor, at most
FEWEST, USUAL = 32, 64  # marks of a fine sensor's turn: at least; at most, and usually
LEAST = 6  # counts of a turn, at least
SHOWN = 16  # marks whose steps show the quantum
WHOLE = 0.01  # as close is a number of counts to a whole one
RESIDUE = 1e-9  # [rad] a smaller step is none
SPAN, SHORTEST = 8.0, 5  # marks over which a ripple is proven; its shortest period
PAIR = 3  # marks before a cell between which there are two
RING = 256  # times that are kept
SLOWER = 0.7  # of the highest speed: a slower turn is not learnt from
STEADY = 0.1  # of a turn's time: its halves take the same time but for this
LOCAL = 12  # marks around one, over which a search takes the speed to be constant
SEARCHED = 2  # turns after which a period is found, once one has passed
ALIKE, STRIKING = 1.5, 0.7  # of mean squares: as small as the smallest; a smallest that is small
BETTER, WORSE = 0.5, 0.8  # mean squared error with the map, over that without it
TURNS = 3.0  # in a row that have to be better, at first
LONGEST = 64.0  # the same, at most
SLOWLY = 4.0  # turns over which these errors are averaged
WILD = 4.0  # times its mean: a mean squared error counts no more
KEPT = 12.0  # turns over which the map is averaged
# of the angle within a sample: a smaller error cannot be attributed to the sensor. Edges are times,
# and have to be known better than by a sample before a filter may trust them more
RESOLVED, RESOLVED_EDGES = 0.5, 1.0

# Memory: `course`, `pace`, and arrays: times of the marks, shape (RING,), the newest at the number
# of marks in a row; what cells are larger than they should be in this turn, over their size,
# shape (MOST,); tables, shape (2, 4, MOST); proofs, shape (2, 8); search, shape
# (3, RING); ripples, shape (2, MOST + 1): mean squared errors of the times in cells as predicted
# with a ripple of each period, and without
Memory = tuple[Any, Any, Any, Any, Any, Any, Any, Any]

# course, int64. kind of the sensor; marks of a turn; marks after which the errors repeat, 0: not
# known; index of the cell: that of the mark at its lower end; the newest mark; direction: 1, -1, 0:
# none yet; marks in a row with known times; new ones of them since a turn was learnt; marks since
# the start; what times are relative to [ns]; marks after which the speed's ripple repeats, 0: none
# now, and those of the last one that was foreseen
KIND, TURN, MARKS, CELL, FRONT, HEADING, RUN, FILLED, STEPS, BASE, LAG, FORESEEN = range(12)
# kinds: not known yet; marks are edges; marks are edges of some counts; marks are no edges
NONE, COARSE, FINE, LOOSE = 0, 1, 2, 3
# pace, float64. smallest step, or difference of steps; newest step at a mark; speed [marks/s], and
# that in units of which b counts; what a sample leaves open of the angle at a mark; quantum as
# given, 0: not; share of the ripple that is foreseen; 1: a ripple is looked for
QUANTUM, STEP, SPEED, UNIT, OPEN, GIVEN, SHARE, FORESEES = range(8)
# rows of the table of a direction: a and b of each mark as learnt, and as used
A, B, USED_A, USED_B = range(4)
# columns of its proof: turns learnt; mean squared errors without and with the map; good turns in a
# row, of which as many are required; marks since it is in use, at most a turn; in use
LEARNT, WITHOUT, WITH, GOOD, REQUIRED, AGE, IN_USE, FASTEST = range(8)
# rows of the search: pairs of cells over their usual size, the newest at FILLED; squared
# differences over lags; their number
CELLS, SQUARES, COUNTS = range(3)


def blank_memory(quantum: float, foresees: bool) -> Memory:
    """Return the memory of a sensor of which its quantum [rad] may be known; 0: not known.

    Parameters
    ----------
    foresees : look for a ripple of the speed.
    """
    memory = (
        np.zeros(12, np.int64),
        np.array([0.0, 0.0, 0.0, 0.0, 0.0, quantum, 0.0, 1.0 if foresees else 0.0]),
        np.zeros(RING),
        np.zeros(MOST),
        np.zeros((2, 4, MOST)),
        np.zeros((2, 8)),
        np.zeros((3, RING)),
        np.zeros((2, MOST + 1)),
    )
    forget(memory)
    return memory


def forget(memory: Memory) -> None:
    """Forget what was learnt."""
    course, _, _, _, tables, proofs, search, ripples = memory
    course[FILLED] = 0
    tables[:] = 0.0
    proofs[:] = 0.0
    proofs[:, REQUIRED] = TURNS
    search[:] = 0.0
    ripples[:] = 1.0


def grid(period: float, quantum: float) -> tuple[int, int]:
    """Return (kind, marks of a turn) of a sensor with this quantum [rad]; 0: not known."""
    if quantum <= 0.0:
        return NONE, USUAL
    counts = period / quantum
    whole = math.floor(counts + 0.5) if counts < 1e6 else 0
    if LEAST <= whole <= MOST and abs(counts - whole) < WHOLE:
        return COARSE, whole
    if whole > MOST and abs(counts - whole) < WHOLE:
        for turn in range(USUAL, FEWEST - 1, -1):
            if whole % turn == 0:
                return FINE, turn
    return LOOSE, USUAL


def begin(
    memory: Memory, measurement: float, stamp_ns: int, period: float, quantum: float
) -> tuple[float, float]:
    """Return (lower end, size) of the first cell. Marks of counts lie between two readings.

    Parameters
    ----------
    quantum : [rad]; 0: not known yet.
    """
    course, pace, _, _, _, _, _, _ = memory
    kind, turn = grid(period, quantum)
    forget(memory)
    course[:] = 0
    course[KIND], course[TURN], course[BASE] = kind, turn, stamp_ns
    course[MARKS] = turn if kind == FINE or kind == LOOSE else 0
    pace[:GIVEN] = 0.0
    pace[QUANTUM] = quantum if quantum > 0.0 else math.inf
    size = period / turn
    return float(measurement - 0.5 * (quantum if kind == COARSE or kind == FINE else size)), size


def learn(memory: Memory, table: int, size: float, speed: float) -> None:
    """Learn from a turn, and decide whether the map is used.

    Parameters
    ----------
    speed : in its unit, less 1; 0: b is not learnt.
    """
    course, pace, _, cells, tables, proofs, _, _ = memory
    marks = course[MARKS]
    left = pace[OPEN] * (RESOLVED_EDGES if course[KIND] == COARSE else RESOLVED)
    total = mean = 0.0
    for k in range(marks):
        total += cells[k]
    error = 0.0
    for k in range(marks):  # of each mark, less that of mark 0
        mean += error / marks
        error += size * (cells[k] - total / marks)
    proof = proofs[table]
    n = proof[LEARNT]
    share = 1.0 / (min(n + 1.0, KEPT) * (1.0 + speed * speed))
    error, without, within = -mean, 0.0, 0.0
    for k in range(marks):
        missed = error - tables[table, A, k] - speed * tables[table, B, k]
        without += error * error / marks
        within += missed * missed / marks
        error += size * (cells[k] - total / marks)
    if n > 1.0 and within > proof[WITH]:  # not as steady as other turns: it counts less
        share *= proof[WITH] / within
    error = -mean
    for k in range(marks):
        missed = error - tables[table, A, k] - speed * tables[table, B, k]
        tables[table, A, k] += share * missed
        tables[table, B, k] += share * speed * missed
        error += size * (cells[k] - total / marks)
    proof[LEARNT] = n + 1.0
    if n == 0.0:
        return
    weight = 1.0 / min(n, SLOWLY)
    if n > 1.0 and within > WILD * proof[WITH]:
        weight *= WILD * proof[WITH] / within
    proof[WITHOUT] += weight * (without - proof[WITHOUT])
    proof[WITH] += weight * (within - proof[WITH])
    good = within < BETTER * without and without > left * left
    proof[GOOD] = proof[GOOD] + 1.0 if good else 0.0
    if proof[IN_USE] == 0.0:
        if proof[GOOD] >= proof[REQUIRED] and proof[WITH] < BETTER * proof[WITHOUT]:
            proof[IN_USE] = 1.0
    elif proof[WITH] > WORSE * proof[WITHOUT]:
        proof[IN_USE], proof[LEARNT] = 0.0, 1.0
        proof[REQUIRED] = min(2.0 * proof[REQUIRED], LONGEST)


def look(memory: Memory, time: float) -> None:
    """Look for the number of marks after which the errors of a coarse sensor repeat.

    It need not be the turn of the joint: those of a motor behind a gear repeat with its own turn.
    It is the smallest lag over which pairs of cells are as alike as over any (of pairs, because the
    edges of Hall sensors come late by turns).
    """
    course, _, times, _, _, _, search, _ = memory
    turn, run, filled = course[TURN], course[RUN], course[FILLED]
    every = 2 - turn % 2  # an even number of edges comes in pairs
    course[FILLED] = 0
    if run < LOCAL:
        return
    middle, start = times[(run - LOCAL // 2) % RING], times[(run - LOCAL) % RING]
    if not abs(2.0 * middle - start - time) < STEADY * (time - start):
        return
    before, after = times[(run - LOCAL // 2 - 1) % RING], times[(run - LOCAL // 2 + 1) % RING]
    cell = 0.5 * LOCAL * (after - before) / (time - start)
    search[CELLS, filled % RING] = cell
    if filled >= turn:
        for lag in range(turn, 1, -every):
            difference = cell - search[CELLS, (filled - lag) % RING]
            search[SQUARES, lag] += difference * difference
        search[COUNTS, 0] += 1.0
    course[FILLED] = filled + 1
    if search[COUNTS, 0] < SEARCHED * turn:
        return
    smallest, total = math.inf, 0.0
    for lag in range(turn, 1, -every):
        total += search[SQUARES, lag]
        smallest = min(smallest, search[SQUARES, lag])
    course[MARKS], course[FILLED] = turn, 0
    if smallest * ((turn - 1) // every) < STRIKING * total:
        for lag in range(turn, 1, -every):
            if search[SQUARES, lag] <= ALIKE * smallest:
                course[MARKS] = lag


def take_mark(memory: Memory, size: float, mark: int, time: float, left: float) -> None:
    """Take the time [s] at which the shaft passed a mark; learn, where a turn ends.

    Parameters
    ----------
    left : what the sample leaves open of the angle.
    """
    course, pace, times, cells, tables, proofs, _, _ = memory
    kind, heading, run, marks = course[KIND], course[HEADING], course[RUN], course[MARKS]
    times[run % RING] = time
    table = 1 if kind == COARSE and heading < 0 else 0
    if run > 0:
        some = min(run, course[TURN] // 4)
        passed = time - times[(run - some) % RING]
        pace[SPEED] = some / passed if passed > 0.0 else pace[SPEED]
    if kind == COARSE and marks == 0:
        look(memory, time)
    elif 0 < marks <= run:
        half = marks // 2
        middle, start = times[(run - half) % RING], times[(run - marks) % RING]
        whole = time - start
        if whole > 0.0 and abs(time - middle - whole * half / marks) < STEADY * whole:
            speed = marks / whole
            there = mark - half if heading > 0 else mark + half - 1
            cells[there % marks] = (times[(run - half + 1) % RING] - middle) * speed - 1.0
            pace[SPEED] = speed
            pace[OPEN] = max(left, pace[OPEN] if course[FILLED] > 0 else 0.0)
            course[FILLED] += 1
        else:
            course[FILLED] = 0
        if course[FILLED] == marks:
            course[FILLED] = 0
            if pace[UNIT] == 0.0:
                pace[UNIT] = speed
            if speed > SLOWER * proofs[table, FASTEST]:  # else a torque ripples more than before
                proofs[table, FASTEST] = max(speed, proofs[table, FASTEST])
                learn(memory, table, size, speed / pace[UNIT] - 1.0 if kind == COARSE else 0.0)
    if marks > 0:
        was = proofs[table, AGE]
        age = min(max(was + 2.0 * proofs[table, IN_USE] - 1.0, 0.0), float(marks))
        if age > 0.0 or was > 0.0:
            far = (mark + marks // 2) % marks
            tables[table, USED_A, far] = age / marks * tables[table, A, far]
            tables[table, USED_B, far] = age / marks * tables[table, B, far]
        proofs[table, AGE] = age
        if kind == COARSE and run > 0 and pace[FORESEES] > 0.0:
            prove_ripple(memory, table, size, mark, left)
    course[FRONT], course[RUN] = mark, run + 1
    course[STEPS] += 1


def marks_of(lag: int) -> int:
    """Return how many marks in a row a ripple of this period takes."""
    return lag + lag // 2 + 1


def ripple_before(memory: Memory, first: int, lag: int) -> float:
    """Return by how much longer than usual was the cell `lag` marks before that from `first` on."""
    _, _, times, _, _, _, _, _ = memory
    here = first - lag
    start = here - (lag - 1) // 2
    whole = times[(start + lag) % RING] - times[start % RING]
    if whole <= 0.0:
        return 0.0
    return float(lag * (times[(here + 1) % RING] - times[here % RING]) / whole - 1.0)


def mispredicted(cell: float, guess: float) -> float:
    """Return the squared ratio of the error of a predicted time in a cell to the sum of both."""
    both = cell + guess
    return float((cell - guess) ** 2 / both**2) if both > 0.0 else 1.0


def prove_ripple(memory: Memory, table: int, size: float, mark: int, left: float) -> None:
    """Find the period after which the times in the cells repeat, from the newest cell.

    Its time is predicted by that a period ago; without it by the mean of a period, or that of the
    two cells before, and the sensor's errors.
    """
    course, pace, times, _, tables, proofs, _, ripples = memory
    marks, run, heading = course[MARKS], course[RUN], course[HEADING]
    of_b = pace[SPEED] / pace[UNIT] - 1.0 if pace[UNIT] > 0.0 else 0.0
    here = (mark - 1 if heading > 0 else mark) % marks
    beyond = (here + 1) % marks
    rise = tables[table, USED_A, beyond] - tables[table, USED_A, here]
    rise += of_b * (tables[table, USED_B, beyond] - tables[table, USED_B, here])
    cell = times[run % RING] - times[(run - 1) % RING]
    unseen = (0.5 * left / size) ** 2  # by a clock of these samples
    slow = pace[SPEED] < SLOWER * proofs[table, FASTEST]
    course[LAG], best = 0, BETTER
    if run < PAIR:
        return
    recent = (times[(run - 1) % RING] - times[(run - PAIR) % RING]) * (1.0 + rise / size)
    ripples[1, 0] += (mispredicted(cell, recent / (PAIR - 1)) - ripples[1, 0]) / SPAN
    for lag in range(SHORTEST, marks + 1):
        if marks % lag == 0 and marks_of(lag) <= run:
            mean = (times[(run - 1) % RING] - times[(run - 1 - lag) % RING]) / lag
            with_it = mean * (1.0 + ripple_before(memory, run - 1, lag))
            without = mean * (1.0 + rise / size)
            ripples[0, lag] += (mispredicted(cell, with_it) - ripples[0, lag]) / SPAN
            ripples[1, lag] += (mispredicted(cell, without) - ripples[1, lag]) / SPAN
            least = min(ripples[1, lag], ripples[1, 0])
            if slow and ripples[0, lag] < best * least and least > unseen:
                course[LAG], best = lag, ripples[0, lag] / least
    pace[SHARE] = min(pace[SHARE] + 1.0 / course[LAG], 1.0) if course[LAG] > 0 else 0.0
    if pace[SHARE] == 1.0:
        course[FORESEEN] = course[LAG]


def turned(memory: Memory, cell: int) -> int:
    """Return the direction in this cell: it turns a mark later where noise may cross a mark."""
    course, _, _, _, tables, proofs, _, _ = memory
    heading, front = course[HEADING], course[FRONT]
    slack = 0 if course[KIND] == COARSE else 1
    if heading == 0:
        now = 1 if cell > course[CELL] else -1
    elif heading > 0:
        now = -1 if cell < front - slack else 1
    else:
        now = 1 if cell >= front + slack else -1
    if now != heading and course[KIND] == COARSE:
        # nothing is known of this direction: begin with what is known of the other one
        table = 1 if now < 0 else 0
        if proofs[table, LEARNT] == 0.0 and proofs[1 - table, IN_USE] > 0.0:
            tables[table, A] = tables[1 - table, A]
            tables[table, USED_A] = tables[1 - table, USED_A]
            proofs[table] = proofs[1 - table]
            proofs[table, LEARNT] = 1.0
    return now


def interrupt(memory: Memory, verdict: int) -> None:
    """Pass over a gap; after a new start the map is proven again before it is used."""
    course, _, _, _, tables, proofs, _, _ = memory
    course[HEADING] = course[RUN] = course[FILLED] = 0
    if verdict == AFTER_GAP or verdict == AFTER_STRAY_STAMP:
        return
    course[FORESEEN] = 0
    tables[:, USED_A:] = 0.0
    proofs[:, IN_USE] = 0.0
    proofs[:, AGE] = 0.0
    proofs[:, GOOD] = proofs[:, REQUIRED] - 1.0
    if course[MARKS] > 0 and course[TURN] % course[MARKS] != 0:  # turns may be lost, and count
        forget(memory)
        course[MARKS] = 0


def follow(
    memory: Memory,
    cell: int,
    heading: int,
    at: tuple[float, float, float],
    change: float,
    last_ns: int,
    stamp_ns: int,
) -> None:
    """Take each mark that the shaft passed on its way into a cell.

    Parameters
    ----------
    at : lower end of the cell, its size, and the reading [rad].
    change : of the reading [rad], since `last_ns`.
    """
    course, pace, _, _, _, _, _, _ = memory
    low, size, reading = at
    moved = abs(change)
    for step in (moved, abs(moved - pace[STEP])):
        if RESIDUE < step < pace[QUANTUM]:
            pace[QUANTUM] = step
    pace[STEP] = moved
    if heading != course[HEADING]:
        course[RUN] = course[FILLED] = 0
    last = cell if heading > 0 else cell + 1
    first = course[FRONT] + heading if course[RUN] > 0 else last
    if (last - first) * heading >= course[TURN] // 4:  # no motion between two readings
        course[RUN] = course[FILLED] = 0
        first = last
    course[CELL], course[HEADING] = cell, heading
    now, dt = 1e-9 * (stamp_ns - course[BASE]), 1e-9 * (stamp_ns - last_ns)
    left = pace[QUANTUM]
    if course[KIND] != LOOSE:
        left = min(left, pace[SPEED] * size * dt)
    for k in range((last - first) * heading + 1):
        mark = first + heading * k
        ago = (reading - low - (mark - cell) * size) / change
        take_mark(memory, size, mark, now - min(max(ago, 0.0), 1.0) * dt, left)


def refined(memory: Memory, period: float) -> bool:
    """Return True if the steps since the start show that the marks do not fit the quantum."""
    course, pace, _, _, _, _, _, _ = memory
    kind, turn, quantum = course[KIND], course[TURN], pace[QUANTUM]
    unknown = quantum == math.inf or (kind == NONE and course[STEPS] < SHOWN)
    if pace[GIVEN] > 0.0 or unknown:
        return False
    right, marks = grid(period, quantum)
    return right != kind or marks != turn
