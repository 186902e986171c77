# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part speed``: one update, and batches.

Guard, low-speed bound and standard deviation are included. Stamps are integer nanoseconds with
jitter, so the coefficients are computed anew at nearly every sample.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.signal import butter, lfilter

from benchmarks.signals import RATE, Signal, sine
from benchmarks.timing import Side, compared, interleave, not_run
from estimator_pkg.circle import wrap
from estimator_pkg.driver.joint import Joint
from estimator_pkg.evaluation.entries import at_defaults
from estimator_pkg.progress import progress

Rows = list[dict[str, Any]]
Chunk = Callable[[int], tuple[list[int], list[float]]]  # round -> stamps, angles

SIGNAL = Signal('update', 'the sine, sampled with +-40 % jitter', sine(5.0, 2.0), jitter=0.4)
UPDATES = 4000  # per round
FILTERPY, SCIPY = 'filterpy, same work', 'numpy difference, scipy low-pass'
FILTERPY_FACTOR = 10.0  # required cost of filterpy's update over ours
# required time of the vectorised difference over that of a batch, which has guard and sigma too
BATCH_FACTORS = {'hybrid_angle': 0.15, 'edge_adaptive': 0.1}
LOW_PASS = butter(2, 20.0, fs=RATE)


def updates(rounds: int) -> Rows:
    """Return rows: one update, estimate and standard deviation per observer [us], and filterpy."""
    samples = SIGNAL.samples(duration=(rounds + 1) * UPDATES / RATE)
    stamps, angles = samples.stamps.tolist(), samples.angle.tolist()

    def chunk(number: int) -> tuple[list[int], list[float]]:
        part = slice(number * UPDATES, (number + 1) * UPDATES)
        return stamps[part], angles[part]

    def observer_side(joint: Joint) -> Side:
        def side(number: int) -> float:
            update, estimate, stddev = joint.update, joint.estimate, joint.stddev
            some = zip(*chunk(number))
            start = time.thread_time()
            for stamp, angle in some:
                update(stamp, angle)
                estimate()
                stddev()
            return (time.thread_time() - start) / UPDATES

        return side

    sides = {entry.label: observer_side(entry.joint()) for entry in at_defaults()}
    peer = _filterpy(chunk)
    with progress('one update', (rounds + 1) * (len(sides) + len(peer))) as advance:
        times = interleave({**sides, **peer}, rounds, advance)
    factors = dict.fromkeys(sides, FILTERPY_FACTOR)
    rows = compared('update', times, lambda seconds: 1e6 * seconds, 'us', FILTERPY, factors)
    return rows if peer else [*rows, not_run(f'update {FILTERPY}', 'filterpy is not installed')]


def _filterpy(chunk: Chunk) -> dict[str, Side]:
    """Return filterpy's KalmanFilter (position, velocity) on the same samples; {}: not installed.

    It does the same work: transition and process noise for the true sample time, wrapped
    innovation, velocity and its standard deviation read.
    """
    try:
        from filterpy.common import Q_discrete_white_noise
        from filterpy.kalman import KalmanFilter
    except ImportError:
        return {}

    same = KalmanFilter(dim_x=2, dim_z=1)
    same.H = np.array([[1.0, 0.0]])
    same.R *= 1e-6

    def side(number: int) -> float:
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
            same.update(predicted + wrap(angle - predicted, 2.0 * math.pi))
            _ = same.x[1, 0], math.sqrt(same.P[1, 1])
        return (time.thread_time() - start) / UPDATES

    return {FILTERPY: side}


def batches(samples: int, rounds: int) -> Rows:
    """Return rows: batches on one core [million samples/s], and the same difference, vectorised."""
    signal = SIGNAL.samples(duration=samples / RATE)

    def observer_side(joint: Joint) -> Side:
        def side(number: int) -> float:
            joint.reset()
            start = time.thread_time()
            joint.run(signal.stamps, signal.angle)
            return time.thread_time() - start

        return side

    def peer(number: int) -> float:
        start = time.thread_time()
        lfilter(*LOW_PASS, np.diff(np.unwrap(signal.angle)) / np.diff(1e-9 * signal.stamps))
        return time.thread_time() - start

    joints = {entry.label: entry.joint() for entry in at_defaults()}
    if any(joint.memory is None for joint in joints.values()):
        return [not_run('batches', 'the engine was not built: install a C compiler')]
    sides = {name: observer_side(joint) for name, joint in joints.items()}
    with progress('batches', (rounds + 1) * (len(sides) + 1)) as advance:
        times = interleave({**sides, SCIPY: peer}, rounds, advance)
    unit = 'million samples/s'
    return compared('batch', times, lambda s: 1e-6 * samples / s, unit, SCIPY, BATCH_FACTORS)
