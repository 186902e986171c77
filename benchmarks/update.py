# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``bench speed``, parts 1 and 2: one update in plain Python, and compiled batches.

Guard, low-speed bound and standard deviation are included. Stamps are integer nanoseconds with
jitter, so the coefficients are computed anew at nearly every sample.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.signals import RATE, Signal, sine
from estimator_pkg.circle import wrap
from estimator_pkg.driver.joint import Joint
from estimator_pkg.engine.calls import available
from estimator_pkg.evaluation.compare.timing import (
    Side,
    best_and_median,
    interleave,
    not_run,
    ratio,
    row,
)
from estimator_pkg.evaluation.entries import at_defaults
from estimator_pkg.progress import progress

SIGNAL = Signal('update', 'the sine, sampled with +-40 % jitter', sine(5.0, 2.0), jitter=0.4)
ROUNDS = 15
UPDATES = 4000  # per round
BATCH = 2_000_000  # samples per round
UPDATE_LIMIT = 2.5  # [us]
FILTERPY_FACTOR = 10.0
ADAPTIVE = 'edge_adaptive'  # it may cost more, because it needs no tuning:
ADAPTIVE_UPDATE = 4.0  # [us]
SAME_WORK = 'filterpy, same work'
BARE = 'filterpy, bare'
TURN = 2.0 * math.pi
MAIN = 'hybrid_angle'  # the observer with a required batch speed
BATCH_LIMITS = {MAIN: 25.0, ADAPTIVE: 8.0}  # million samples/s


def updates(rounds: int = ROUNDS) -> list[dict[str, Any]]:
    """Return rows: one update, estimate and standard deviation per observer [us], and filterpy."""
    samples = SIGNAL.samples(duration=(rounds + 1) * UPDATES / RATE)
    stamps, angles = samples.stamps.tolist(), samples.angle.tolist()

    def chunk(number: int) -> tuple[list[int], list[float]]:
        part = slice(number * UPDATES, (number + 1) * UPDATES)
        return stamps[part], angles[part]

    def observer_side(joint: Joint) -> Side:
        def side(number: int) -> float:
            update, estimate, stddev = joint.update, joint.estimate, joint.stddev
            some_stamps, some_angles = chunk(number)
            start = time.thread_time()
            for stamp, angle in zip(some_stamps, some_angles):
                update(stamp, angle)
                estimate()
                stddev()
            return (time.thread_time() - start) / UPDATES

        return side

    sides = {entry.label: observer_side(entry.joint()) for entry in at_defaults()}
    names = list(sides)
    peers = _filterpy(chunk)
    sides.update(peers)
    with progress('one update', (rounds + 1) * len(sides)) as advance:
        times = interleave(sides, rounds, advance)
    rows = []
    for name in names:
        least, median = best_and_median(times[name])
        rows.append(
            row(
                f'update {name}',
                least * 1e6,
                'us',
                median=median * 1e6,
                limit=ADAPTIVE_UPDATE if name == ADAPTIVE else UPDATE_LIMIT,
            )
        )
        for peer in peers:
            asked = peer == SAME_WORK and name != ADAPTIVE
            rows.append(
                row(
                    f'{peer} / {name}',
                    ratio(times[peer], times[name]),
                    'times',
                    limit=FILTERPY_FACTOR if asked else None,
                    at_least=True,
                )
            )
    for peer in peers:
        least, median = best_and_median(times[peer])
        rows.append(row(f'update {peer}', least * 1e6, 'us', median=median * 1e6))
    if not peers:
        rows.append(not_run('filterpy', 'filterpy is not installed'))
    return rows


def _filterpy(chunk: Callable[[int], tuple[list[int], list[float]]]) -> dict[str, Side]:
    """Return filterpy's KalmanFilter (position, velocity) on the same samples; {}: not installed.

    'same work': transition and process noise for the true sample time, wrapped innovation, velocity
    and its standard deviation read. 'bare': only the true sample time in the transition, `predict`
    and `update`.
    """
    try:
        from filterpy.common import Q_discrete_white_noise
        from filterpy.kalman import KalmanFilter
    except ImportError:
        return {}

    def make() -> Any:
        kalman = KalmanFilter(dim_x=2, dim_z=1)
        kalman.F = np.array([[1.0, 1.0 / RATE], [0.0, 1.0]])
        kalman.H = np.array([[1.0, 0.0]])
        kalman.R *= 1e-6
        kalman.Q = Q_discrete_white_noise(2, 1.0 / RATE, 1e4)
        return kalman

    same, bare = make(), make()

    def same_work(number: int) -> float:
        stamps, angles = chunk(number)
        last = stamps[0] - round(1e9 / RATE)
        start = time.thread_time()
        for stamp, angle in zip(stamps, angles):
            dt = (stamp - last) * 1e-9
            last = stamp
            same.F = np.array([[1.0, dt], [0.0, 1.0]])
            same.Q = Q_discrete_white_noise(2, dt, 1e4)
            same.predict()
            predicted = same.x[0, 0]
            same.update(predicted + wrap(angle - predicted, TURN))
            _ = same.x[1, 0], math.sqrt(same.P[1, 1])
        return (time.thread_time() - start) / UPDATES

    def alone(number: int) -> float:
        transition, predict, update = bare.F, bare.predict, bare.update
        stamps, angles = chunk(number)
        last = stamps[0] - round(1e9 / RATE)
        start = time.thread_time()
        for stamp, angle in zip(stamps, angles):
            transition[0, 1] = (stamp - last) * 1e-9
            last = stamp
            predict()
            update(angle)
        return (time.thread_time() - start) / UPDATES

    return {SAME_WORK: same_work, BARE: alone}


def batches(samples: int = BATCH, rounds: int = 7) -> list[dict[str, Any]]:
    """Return rows: compiled batches on one core [million samples/s], and `scipy.signal.lfilter`."""
    if not available():
        return [not_run('compiled batch', 'no engine was built')]
    signal = SIGNAL.samples(duration=samples / RATE)

    def observer_side(joint: Joint) -> Side:
        joint.run(signal.stamps[:1000], signal.angle[:1000], fast=True)  # compiles

        def side(number: int) -> float:
            joint.reset()
            start = time.thread_time()
            joint.run(signal.stamps, signal.angle, fast=True)
            return time.thread_time() - start

        return side

    entries = at_defaults()
    sides: dict[str, Side] = {}
    with progress('compiling', len(entries)) as advance:
        for entry in entries:
            sides[entry.label] = observer_side(entry.joint())
            advance(1)
    names = list(sides)
    peer = _lfilter(signal.angle)
    if peer is not None:
        sides['lfilter'] = peer
    with progress('batches', (rounds + 1) * len(sides)) as advance:
        times = interleave(sides, rounds, advance)

    def speed(seconds: float) -> float:
        return samples / seconds * 1e-6

    rows = []
    for name in [*names, *(['lfilter'] if peer is not None else [])]:
        least, median = best_and_median(times[name])
        title = 'scipy.signal.lfilter, second order' if name == 'lfilter' else f'batch {name}'
        rows.append(
            row(
                title,
                speed(least),
                'million samples/s',
                limit=BATCH_LIMITS.get(name),
                at_least=True,
                median=speed(median),
            )
        )
    if peer is None:
        rows.append(not_run('scipy.signal.lfilter', 'scipy is not installed'))
    return rows


def _lfilter(angle: np.ndarray) -> Side | None:
    """Return a second-order low-pass of the differenced angle: no guard, wrap or sample times."""
    try:
        from scipy.signal import butter, lfilter
    except ImportError:
        return None
    numerator, denominator = butter(2, 0.05)

    def side(number: int) -> float:
        start = time.thread_time()
        lfilter(numerator, denominator, angle)
        return time.thread_time() - start

    return side
