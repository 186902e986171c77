# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The causal laws of the field, each with one gain that is swept over a grid.

Our observers get the raw readings. The peers, installed libraries, get clean stamps and multi-turn
angles. A peer with one sample time predicts without a correction where a sample is missing.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column, published
from benchmarks.recorded import RAW
from estimator_pkg import registry
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.parameters import declared

Array = NDArray[np.float64]
Run = Callable[[Column, Any], Array]

OURS, PRACTICE, PEERS = 'ours', 'practice', 'peers'
GRID, COUNT = 13, 9  # settings of our observers and of each peer
JERK, ACCELERATION = 'variance of the jerk', 'variance of the acceleration'
LOOSE = np.diag([1e-6, 1e3, 1e5])  # variances at the start
LONGEST = 1000  # largest number of predictions without a correction in a gap


@dataclass(frozen=True)
class Law:
    """A row of the field.

    run : (column, value of the gain) -> velocity of each sample [rad/s], shape (n,); nan where none
        is published.
    values : the grid; (None,) without a gain.
    gain : name of the swept gain.
    group : OURS, PRACTICE or PEERS.
    """

    name: str
    run: Run
    values: tuple[Any, ...] = (None,)
    gain: str = ''
    group: str = OURS


def grid(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return `count` values at equal ratios."""
    return tuple(float(f'{each:.4g}') for each in np.geomspace(low, high, count))


def ours() -> list[Law]:
    """Return every observer of an angle, swept over its first gain, and the raw difference."""
    return [*(_angle(entry) for entry in at_defaults()), Law(RAW.label, _runner(RAW, ''))]


def _angle(entry: Entry) -> Law:
    gains = declared(registry.find(registry.OBSERVERS, entry.observer).gains)
    for each in gains.values():
        if each.search is not None:
            return Law(entry.label, _runner(entry, each.name), grid(*each.search, GRID), each.name)
    return Law(entry.label, _runner(entry, ''))


def _runner(entry: Entry, gain: str) -> Run:
    def run(column: Column, value: Any) -> Array:
        joint = entry.joint(wrap_period=column.period, **({gain: value} if gain else {}))
        out = joint.run(column.samples.stamps, column.samples.angle)
        return np.where(published(out), out.velocity, np.nan)

    return run


def peers() -> tuple[list[Law], list[str]]:
    """Return (laws of the installed libraries, names of the missing ones)."""
    return installed(_filterpy, _control, _pynumdiff)


def installed(*makers: Callable[[], Law]) -> tuple[list[Law], list[str]]:
    """Return (what is made, names of the missing libraries)."""
    found, missing = [], []
    for make in makers:
        try:
            found.append(make())
        except ImportError as error:
            missing.append(error.name or str(error))
    return found, missing


def _reading_variance(column: Column) -> float:
    return max(column.quantum, 1e-6) ** 2 / 12.0


def _transition(h: float) -> Array:
    return np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])


def _filterpy() -> Law:
    from filterpy.common import Q_discrete_white_noise
    from filterpy.kalman import KalmanFilter

    def run(column: Column, variance: float) -> Array:
        rows, time, angle = column.cleaned()
        kalman = KalmanFilter(3, 1)
        kalman.x = np.array([[angle[0]], [0.0], [0.0]])
        kalman.H, kalman.P = np.array([[1.0, 0.0, 0.0]]), LOOSE.copy()
        kalman.R = np.array([[_reading_variance(column)]])
        velocity = np.zeros(len(angle))
        for i, h in enumerate(np.diff(time).tolist(), 1):
            kalman.F = _transition(h)
            kalman.Q = Q_discrete_white_noise(3, dt=h, var=variance)
            kalman.predict()
            kalman.update(angle[i])
            velocity[i] = kalman.x[1, 0]
        return column.at_rows(rows, velocity)

    return Law('filterpy KalmanFilter', run, grid(1e-2, 1e6, COUNT), ACCELERATION, PEERS)


def _control() -> Law:
    import control

    def run(column: Column, intensity: float) -> Array:
        rows, time, angle = column.cleaned()
        h = float(np.median(np.diff(time)))
        pushed = np.array([[h**3 / 6.0], [h * h / 2.0], [h]])
        system = control.ss(_transition(h), pushed, np.array([[1.0, 0.0, 0.0]]), 0.0, h)
        made = control.create_estimator_iosystem(
            system,
            np.array([[intensity]]),
            np.array([[_reading_variance(column)]]),
            LOOSE,
            disturbance_indices=1,
        )
        state = np.concatenate([[angle[0], 0.0, 0.0], LOOSE.ravel()])
        # grid points without a sample; the peer has no input for the offset of a sample
        ticks = np.rint((time - time[0]) / h)
        missing = np.clip(np.diff(ticks).astype(int) - 1, 0, LONGEST).tolist()
        velocity, without, nothing = np.zeros(len(angle)), {'correct': False}, np.zeros(1)
        for i, reading in enumerate(angle):
            state = made.dynamics(i, state, np.array([reading]), {'correct': True})
            _, v, a, *_ = state
            velocity[i] = v - h * a  # it predicts one step ahead
            for _ in range(missing[i] if i < len(missing) else 0):
                state = made.dynamics(i, state, nothing, without)
        return column.at_rows(rows, velocity)

    return Law('python-control estimator', run, grid(1e1, 1e11, COUNT), JERK, PEERS)


def _pynumdiff() -> Law:
    """Return its only causal method."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # about optional packages
        import pynumdiff

    def run(column: Column, variance: float) -> Array:
        rows, time, angle = column.cleaned()
        steps = np.diff(time)
        moves = np.tile(np.eye(3), (len(steps), 1, 1))
        moves[:, 0, 1] = moves[:, 1, 2] = steps
        moves[:, 0, 2] = 0.5 * steps**2
        pushed = np.column_stack([steps**3 / 6.0, steps**2 / 2.0, steps])
        _, states, *_ = pynumdiff.kalman_filter(
            angle,
            np.array([angle[0], 0.0, 0.0]),
            LOOSE,
            moves,
            variance * np.einsum('ni,nj->nij', pushed, pushed),
            np.array([[1.0, 0.0, 0.0]]),
            np.array([[_reading_variance(column)]]),
        )
        return column.at_rows(rows, states[:, 1])

    return Law('PyNumDiff kalman_filter', run, grid(1e1, 1e11, COUNT), JERK, PEERS)
