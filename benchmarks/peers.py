# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The peers of the field: installed libraries, each with the input that it takes.

All of them get clean stamps and multi-turn angles; our observers get the raw readings. Peers that
need even sample times get readings interpolated to a grid, and their velocity is interpolated back.
A recursive one predicts without a correction where a sample is missing.

Of PyNumDiff only `kalman_filter` is causal. Not included: `splinediff`, whose noise estimate finds
none in quantised readings, so that it interpolates them; `rbfdiff`, whose cost grows too fast for
the long recordings; methods that need CVXPY.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column, driven_by
from benchmarks.ours import AHEAD, INFORMED, PEERS, Estimator, Run, grid

Array = NDArray[np.float64]

JERK, ACCELERATION = 'variance of the jerk', 'variance of the acceleration'
COUNT = 9  # settings of each peer
LOOSE = np.diag([1e-6, 1e3, 1e5])  # variances at the start
LONGEST = 1000  # largest number of predictions without a correction in a gap


def peers() -> tuple[list[Estimator], list[str]]:
    """Return (estimators of the installed libraries, names of the missing ones)."""
    found, missing = [], []
    for make in (_filterpy, _control, _pynumdiff):
        try:
            found += make()
        except ImportError as error:
            missing.append(error.name or str(error))
    return found, missing


def _reading_variance(column: Column) -> float:
    return max(column.quantum, 1e-6) ** 2 / 12.0


def _transition(h: float) -> Array:
    return np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])


def _filterpy() -> list[Estimator]:
    from filterpy.common import Q_discrete_white_noise
    from filterpy.kalman import KalmanFilter

    def acceleration(column: Column, variance: float) -> Array:
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

    def driven(column: Column, variance: float) -> Array:
        pushed = driven_by(column)
        rows, time, angle = column.cleaned()
        if pushed is None:
            return column.at_rows(rows, np.full(len(rows), np.nan))
        pushed = pushed[rows]
        kalman = KalmanFilter(2, 1, 1)
        kalman.x = np.array([[angle[0]], [0.0]])
        kalman.H, kalman.P = np.array([[1.0, 0.0]]), LOOSE[:2, :2].copy()
        kalman.R = np.array([[_reading_variance(column)]])
        velocity = np.zeros(len(angle))
        for i, h in enumerate(np.diff(time).tolist(), 1):
            kalman.F = np.array([[1.0, h], [0.0, 1.0]])
            kalman.B = np.array([[0.5 * h * h], [h]])
            kalman.Q = Q_discrete_white_noise(2, dt=h, var=variance)
            kalman.predict(np.array([[pushed[i]]]))
            kalman.update(angle[i])
            velocity[i] = kalman.x[1, 0]
        return column.at_rows(rows, velocity)

    return [
        Estimator(
            'filterpy KalmanFilter', acceleration, grid(1e-2, 1e6, COUNT), ACCELERATION, PEERS
        ),
        Estimator(
            'filterpy KalmanFilter, driven',
            driven,
            grid(1e-4, 1e4, COUNT),
            ACCELERATION,
            INFORMED,
            'torque and the parameters of the joint',
        ),
    ]


def _control() -> list[Estimator]:
    import control

    def estimator(column: Column, intensity: float) -> Array:
        rows, time, angle = column.cleaned()
        h = float(np.median(np.diff(time)))
        system = control.ss(
            _transition(h),
            np.array([[h**3 / 6.0], [h * h / 2.0], [h]]),
            np.array([[1.0, 0.0, 0.0]]),
            0.0,
            h,
        )
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

    return [Estimator('python-control estimator', estimator, grid(1e1, 1e11, COUNT), JERK, PEERS)]


def even(column: Column, method: Callable[[Array, float], Array]) -> Array:
    """Apply a method for even sample times, with interpolation to a grid and back."""
    rows, time, angle = column.cleaned()
    h = float(np.median(np.diff(time)))
    if np.max(np.abs(np.diff(time) - h)) < 1e-3 * h:
        return column.at_rows(rows, method(angle, h))
    ticks = np.arange(time[0], time[-1], h)
    found = method(np.interp(ticks, time, angle), h)
    return column.at_rows(rows, np.interp(time, ticks, found))


def _pynumdiff() -> list[Estimator]:
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # about optional packages
        import pynumdiff

    def on_grid(call: Callable[[Array, float, Any], Any]) -> Run:
        def run(column: Column, value: Any) -> Array:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                return even(column, lambda angle, h: call(angle, h, value)[1])

        return run

    def uneven(call: Callable[[Array, Array, Any], Any]) -> Run:
        def run(column: Column, value: Any) -> Array:
            rows, time, angle = column.cleaned()
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                return column.at_rows(rows, call(angle, time - time[0], value)[1])

        return run

    def kalman(column: Column, variance: float, both_ways: bool) -> Array:
        """Run PyNumDiff's forward pass, and with `both_ways` its smoother after it."""
        rows, time, angle = column.cleaned()
        steps = np.diff(time)
        moves = np.tile(np.eye(3), (len(steps), 1, 1))
        moves[:, 0, 1] = moves[:, 1, 2] = steps
        moves[:, 0, 2] = 0.5 * steps**2
        pushed = np.column_stack([steps**3 / 6.0, steps**2 / 2.0, steps])
        forward = pynumdiff.kalman_filter(
            angle,
            np.array([angle[0], 0.0, 0.0]),
            LOOSE,
            moves,
            variance * np.einsum('ni,nj->nij', pushed, pushed),
            np.array([[1.0, 0.0, 0.0]]),
            np.array([[_reading_variance(column)]]),
        )
        states = (
            pynumdiff.rts_smooth(moves, *forward, compute_P_smooth=False)
            if (both_ways)
            else forward[1]
        )
        return column.at_rows(rows, states[:, 1])

    def odd(low: float, high: float) -> tuple[int, ...]:
        return tuple(sorted({2 * round(each / 2.0) + 1 for each in grid(low, high, COUNT)}))

    def ahead(name: str, run: Run, values: tuple[Any, ...], gain: str) -> Estimator:
        return Estimator(f'PyNumDiff {name}', run, values, gain, AHEAD)

    p = pynumdiff
    wide, jerks = odd(5, 301), grid(1e1, 1e11, COUNT)
    return [
        Estimator(
            'PyNumDiff kalman_filter',
            lambda column, v: kalman(column, v, False),
            jerks,
            JERK,
            PEERS,
        ),
        ahead(
            'finitediff',
            on_grid(lambda x, h, n: p.finitediff(x, h, n, 2)),
            (1, 3, 10, 30, 100, 300),
            'iterations',
        ),
        ahead(
            'kerneldiff',
            on_grid(lambda x, h, n: p.kerneldiff(x, h, 'friedrichs', n)),
            wide,
            'window',
        ),
        ahead(
            'butterdiff',
            on_grid(lambda x, h, c: p.butterdiff(x, h, 2, c)),
            grid(0.004, 0.4, COUNT),
            'cutoff',
        ),
        ahead('savgoldiff', on_grid(lambda x, h, n: p.savgoldiff(x, h, 3, n, n)), wide, 'window'),
        ahead(
            'polydiff',
            uneven(lambda x, t, n: p.polydiff(x, t, 3, n, stride=max(1, n // 8))),
            odd(21, 301),
            'window',
        ),
        ahead(
            'spectraldiff',
            on_grid(lambda x, h, c: p.spectraldiff(x, h, c)),
            grid(0.004, 0.4, COUNT),
            'cutoff',
        ),
        ahead(
            'waveletdiff',
            on_grid(lambda x, h, s: p.waveletdiff(x, h, threshold=s)),
            grid(0.1, 30.0, COUNT),
            'threshold',
        ),
        ahead('rts_smooth', lambda column, v: kalman(column, v, True), jerks, JERK),
    ]
