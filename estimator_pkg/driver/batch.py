# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Process many samples of one joint at once, for replay, tuning and benchmarks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import cannot_compile, compiled
from estimator_pkg.driver.guard import DUPLICATE
from estimator_pkg.driver.track import TrackFunctions
from estimator_pkg.observers.contract import INITIALISING

COMPILE_FROM = 400_000  # number of samples from which compiling (a few seconds) pays


class Estimates(NamedTuple):
    """Arrays of shape (n,), one row per received sample; nan where the sample was dropped.

    position [rad or m], velocity, acceleration (SI), one standard deviation of position and of
    velocity, status (see `observers.contract`) and the guard's verdict (see `guard`).
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    position_stddev: NDArray[np.float64]
    velocity_stddev: NDArray[np.float64]
    status: NDArray[np.int8]
    verdict: NDArray[np.int8]

    @property
    def used(self) -> NDArray[np.bool_]:
        """True for each sample that was used, shape (n,)."""
        return self.verdict < DUPLICATE

    def put(self, row: int, estimate: tuple, stddev: tuple[float, float]) -> None:
        """Set (position, velocity, acceleration, status) and their deviations in one row."""
        self.position[row], self.velocity[row], self.acceleration[row], self.status[row] = estimate
        self.position_stddev[row], self.velocity_stddev[row] = stddev

    def part(self, rows: slice) -> Estimates:
        """Return views of these rows."""
        return Estimates._make(column[rows] for column in self)


def empty(count: int) -> Estimates:
    """Return arrays for `count` samples; what they contain is arbitrary."""
    return Estimates._make(np.empty(count, kind) for kind in 5 * (np.float64,) + 2 * (np.int8,))


def make_batch(track: TrackFunctions) -> Callable[..., tuple]:
    """Return a loop over samples; compile it with `compiled` or call it as it is."""
    advance, read, deviation = track.advance, track.read, track.deviation

    def batch(
        state: tuple,
        design: tuple,
        limits: tuple,
        stamps: NDArray[np.int64],
        measurements: NDArray[np.float64],
        known_input: NDArray[np.float64],
        position: NDArray[np.float64],
        velocity: NDArray[np.float64],
        acceleration: NDArray[np.float64],
        position_stddev: NDArray[np.float64],
        velocity_stddev: NDArray[np.float64],
        status: NDArray[np.int8],
        verdict: NDArray[np.int8],
    ) -> tuple:
        for i in range(len(stamps)):
            state, said = advance(state, design, limits, stamps[i], measurements[i], known_input[i])
            verdict[i] = said
            if said < DUPLICATE:
                position[i], velocity[i], acceleration[i], status[i] = read(
                    state, design, limits, measurements[i], known_input[i]
                )
                position_stddev[i], velocity_stddev[i] = deviation(state, design)
            else:
                position[i] = velocity[i] = acceleration[i] = math.nan
                position_stddev[i] = velocity_stddev[i] = math.nan
                status[i] = INITIALISING
        return state

    return batch


def run(
    batch: Callable[..., tuple],
    state: tuple,
    design: tuple,
    limits: tuple,
    stamps: NDArray[np.int64],
    measurements: NDArray[np.float64],
    known_input: NDArray[np.float64] | None = None,
    *,
    fast: bool | None = None,
    out: Estimates | None = None,
) -> tuple[tuple, Estimates]:
    """Return the track's state after these samples, and the estimates.

    Parameters
    ----------
    stamps : shape (n,), int64 nanoseconds.
    measurements : shape (n,) [rad or m].
    known_input : shape (n,), the known input; None: zero.
    fast : compile or not; None: if it pays. Functions that Numba does not support (a user's own)
        run as plain Python.
    out : arrays to fill; None: new ones.
    """
    count = len(stamps)
    out = empty(count) if out is None else out
    if known_input is None:
        known_input = np.zeros(count)
    if fast is None:
        fast = count >= COMPILE_FROM
    if fast:
        try:
            return (
                compiled(batch)(state, design, limits, stamps, measurements, known_input, *out),
                out,
            )
        except Exception as error:
            if not cannot_compile(error):
                raise
    # lists contain Python floats, which are several times faster than numpy's
    rows = (
        np.asarray(stamps).tolist(),
        np.asarray(measurements).tolist(),
        np.asarray(known_input).tolist(),
    )
    return batch(state, design, limits, *rows, *out), out
