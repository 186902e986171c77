# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The causal laws of the field, each with one gain that is swept over a grid.

Our observers get the raw readings. The laws that practitioners name, from their papers or kept
libraries, get clean stamps and multi-turn angles.

References
----------
Windowed slopes: Janabi-Sharifi, Hayward, Chen, "Discrete-time adaptive windowing for velocity
estimation", IEEE TCST 8(6), 2000. Edges: Merry, van de Molengraft, Steinbuch, "Velocity and
acceleration estimation for optical incremental encoders", Mechatronics 20, 2010. Robust exact
filtering differentiator: Levant, Livne, "Robust exact filtering differentiators", European Journal
of Control 55, 2020; its implicit form: Carvajal-Rubio, Defoort, Sanchez-Torres, Djemai, Loukianov,
"Implicit and explicit discrete-time realizations of the robust exact filtering differentiator",
Journal of the Franklin Institute 359, 2022. Algebraic differentiators: Othmane, Kiltz, Rudolph,
"Survey on algebraic numerical differentiation", Int. J. of Systems Science 53, 2022. Rolling mean:
the odometry of ros2_controllers' diff_drive_controller.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from benchmarks.columns import Column, published
from benchmarks.recorded import RAW
from estimator_pkg import registry
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.parameters import declared

Array = NDArray[np.float64]
Run = Callable[[Column, Any], Array]
Slope = Callable[[Array, Array, float, Any], Array]  # (time, angle, quantum, gain) -> velocity

SLOW = ('Hall captures',)  # 30 kHz, too fast for a law that steps in Python
GRID, COUNT = 13, 9  # settings of our observers and of each peer
JERK, ACCELERATION = 'variance of the jerk', 'variance of the acceleration'
LOOSE = np.diag([1e-6, 1e3, 1e5])  # variances at the start
MOST = 3000.0  # [Hz] of the readings in adaptive windows, whose cost grows with its square
LONGEST = 0.1  # [s] of the adaptive windows at most
EVEN = 1e-3  # relative difference of sample times that are taken for equal
BLOCK = 2_000_000  # numbers that are fitted at once
LAMBDA = (3.0, 4.16, 3.06, 1.1)  # Levant's parameters for n = 3, from the first equation on
ALPHA = BETA = 4.0  # of the Jacobi polynomials, as in the library's examples
SILENT = 3  # an edge that is late by more of its periods than this ends the fit's validity


@dataclass(frozen=True)
class Law:
    """A row of the field.

    run : (column, value of the gain) -> velocity of each sample [rad/s], shape (n,); nan where none
        is published.
    values : the grid; (None,) without a gain.
    gain : name of the swept gain.
    without : names of the sets that it is not run on.
    """

    name: str
    run: Run
    values: tuple[Any, ...] = (None,)
    gain: str = ''
    without: tuple[str, ...] = ()


def grid(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return `count` values at equal ratios."""
    return tuple(float(f'{each:.4g}') for each in np.geomspace(low, high, count))


WINDOWS = grid(0.002, 0.3, COUNT + 2)


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
    """Return (laws that practitioners name, names of the missing libraries)."""
    bounds, quanta = grid(1e2, 1e7, COUNT), grid(0.5, 20.0, COUNT)
    own = [
        made('rolling mean', rolling_mean, WINDOWS, 'window [s]'),
        made('adaptive windows, best fit', thinned, quanta, 'quanta'),
        made('time-stamped edges', edges, tuple(range(3, 36, 4)), 'edges'),
        made('filtering differentiator', filtering, bounds, 'bound of the jerk'),
    ]
    found, missing = installed(_savitzky_golay, _algebraic, _filterpy, _pynumdiff)
    return [*own, *found], missing


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

    return Law('filterpy KalmanFilter', run, grid(1e-2, 1e6, COUNT), ACCELERATION, SLOW)


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

    return Law('PyNumDiff kalman_filter', run, grid(1e1, 1e11, COUNT), JERK, SLOW)


def made(name: str, slope: Slope, values: tuple[Any, ...], gain: str) -> Law:
    """Return the law that runs a slope on a column's clean stamps and multi-turn angles."""

    def run(column: Column, value: Any) -> Array:
        rows, time, angle = column.cleaned()
        return column.at_rows(rows, slope(time, angle, max(column.quantum, 1e-6), value))

    return Law(name, run, values, gain)


def _savitzky_golay() -> Law:
    from scipy.signal import fftconvolve, savgol_coeffs

    def slope(time: Array, angle: Array, quantum: float, window: float) -> Array:
        """Return the slope at the end of a parabola through the last samples."""
        n = max(2, length(time, window)) + 1
        found, steps = np.full(len(angle), np.nan), np.diff(time)
        if len(angle) < n:
            return found
        if np.ptp(steps) < EVEN * steps[0]:  # the same weights everywhere
            weights = savgol_coeffs(n, 2, deriv=1, delta=float(np.mean(steps)), pos=n - 1)
            found[n - 1 :] = fftconvolve(angle - angle[0], weights, 'valid')  # n up to 9000
        else:
            past = sliding_window_view(time, n), sliding_window_view(angle, n)
            found[n - 1 :] = fitted(*past, order=2)[:, 1]
        return found

    return made('Savitzky-Golay, causal', slope, WINDOWS, 'window [s]')


def _algebraic() -> Law:
    from AlgDiff import AlgebraicDifferentiator

    def slope(time: Array, angle: Array, quantum: float, window: float) -> Array:
        """Return the slope from readings at even times, interpolated where they are not."""
        h = float(np.median(np.diff(time)))
        even = np.max(np.abs(np.diff(time) - h)) < EVEN * h
        ticks = time if even else np.arange(time[0], time[-1], h)
        library = AlgebraicDifferentiator(
            ts=h, alpha=ALPHA, beta=BETA, N=1, T=max(window, 4.0 * h), display=False
        )
        found: Array = library.estimateDer(1, angle if even else np.interp(ticks, time, angle))
        return found if even else np.interp(time, ticks, found)

    return made('algebraic, AlgDiff', slope, WINDOWS, 'window [s]')


def length(time: Array, window: float) -> int:
    """Return the number of steps that a window [s] has."""
    return max(1, round(window / float(np.median(np.diff(time)))))


def fitted(time: Array, angle: Array, order: int) -> Array:
    """Return the polynomials fitted to windows, around their newest time.

    Parameters
    ----------
    time, angle : shape (windows, samples), the newest sample last.

    Returns
    -------
    shape (windows, order + 1): angle less the newest one, slope, half the curvature.
    """
    found = np.empty((len(time), order + 1))
    for rows in np.array_split(np.arange(len(time)), 1 + time.size // BLOCK):
        span = np.maximum(time[rows, -1:] - time[rows, :1], 1e-12)
        powers = ((time[rows] - time[rows, -1:]) / span)[:, :, None] ** np.arange(order + 1)
        moments = np.einsum('kni,knj->kij', powers, powers)
        moved = np.einsum('kni,kn->ki', powers, angle[rows] - angle[rows, -1:])
        found[rows] = np.linalg.solve(moments, moved[:, :, None])[:, :, 0]
        found[rows] /= span ** np.arange(order + 1)
    return found


def rolling_mean(time: Array, angle: Array, quantum: float, window: float) -> Array:
    """Return the mean of the last finite differences."""
    slopes = np.diff(angle) / np.diff(time)
    sums = np.concatenate([[0.0], np.cumsum(slopes)])
    newest = np.arange(1, len(sums))
    oldest = np.maximum(newest - length(time, window), 0)
    return np.concatenate([[np.nan], (sums[newest] - sums[oldest]) / (newest - oldest)])


def thinned(time: Array, angle: Array, quantum: float, quanta: float) -> Array:
    """Return `adaptive_windows` of readings at `MOST` at most, held between them."""
    every = length(time, 1.0 / MOST)
    return np.repeat(adaptive_windows(time[::every], angle[::every], quantum, quanta), every)[
        : len(time)
    ]


def adaptive_windows(time: Array, angle: Array, quantum: float, quanta: float) -> Array:
    """Return the slope of the longest window whose chord stays within the noise of each sample.

    The chord from sample k - n to k passes all samples between within d if its slope lies in each
    of their cones; the window is as long as that holds (end-fit), and the slope is that of the
    least-squares line over it (best-fit-FOAW).
    """
    d, count = quanta * quantum, len(angle)
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    longest = np.ones(count, int)
    k = np.arange(1, count)
    for n in range(1, min(length(time, LONGEST), count - 1) + 1):
        k = k[k >= n]
        passed, moved = time[k] - time[k - n], angle[k] - angle[k - n]
        inside = (low[k] <= moved / passed) & (moved / passed <= high[k])
        k, passed, moved = k[inside], passed[inside], moved[inside]
        longest[k] = n
        low[k] = np.maximum(low[k], (moved - d) / passed)
        high[k] = np.minimum(high[k], (moved + d) / passed)
    found = np.full(count, np.nan)
    for n in np.unique(longest):
        k = np.flatnonzero((longest == n) & (np.arange(count) >= n))
        rows = k[:, None] + np.arange(-n, 1)
        found[k] = fitted(time[rows], angle[rows], order=1)[:, 1]
    return found


def edges(time: Array, angle: Array, quantum: float, count: float) -> Array:
    """Return the slope now of a parabola through the last edges between counts.

    The newest edge lies half a quantum before the new reading, at that part of the step between the
    last two stamps. Where the next edge is late, the speed is at most one quantum over the time
    since the newest one; where it is later than `SILENT` of its periods, the joint is at rest.
    """
    n, moved = int(count), np.diff(angle)
    at = np.flatnonzero(np.abs(moved) > 0.25 * quantum) + 1
    if len(at) < n:
        return np.full(len(angle), np.nan)
    step = np.maximum(np.abs(moved[at - 1]), quantum)
    when = time[at] - 0.5 * quantum / step * (time[at] - time[at - 1])
    where = angle[at] - 0.5 * quantum * np.sign(moved[at - 1])
    _, slope, bent = fitted(sliding_window_view(when, n), sliding_window_view(where, n), order=2).T
    newest = np.searchsorted(at, np.arange(len(angle)), side='right') - 1
    rows = np.flatnonzero(newest >= n - 1)
    k = newest[rows]
    since = time[rows] - when[k]
    velocity = slope[k - n + 1] + 2.0 * bent[k - n + 1] * since
    late = np.where(rows == at[k], np.inf, quantum / since)
    velocity = np.clip(velocity, -late, late)
    velocity[since > SILENT * (when[k] - when[k - 1])] = 0.0
    found = np.full(len(angle), np.nan)
    found[rows] = velocity
    return found


def filtering(time: Array, angle: Array, quantum: float, bound: float) -> Array:
    """Return z1 of the filtering differentiator (nd = 2, nf = 1) by the implicit Euler scheme.

    With s = (w1, z0, z1, z2) and a = lambda L^(1/4, 2/4, 3/4, 1), backward Euler gives for the new
    w1 = x^4 sign(b) the equation x^4 + h a1 x^3 + h^2 a2 x^2 + h^3 a3 x + h^4 a4 xi = |b| with xi
    in [0, 1], and xi = 1 where x > 0. Its left side grows with x, so that it has one root.
    """
    a1, a2, a3, a4 = (gain * bound ** ((i + 1) / 4.0) for i, gain in enumerate(LAMBDA))
    w1, z0, z1, z2 = 0.0, float(angle[0]), 0.0, 0.0
    found = [0.0]
    for h, reading in zip(np.diff(time).tolist(), angle[1:].tolist()):
        b = w1 + h * (z0 - reading) + h * h * z1 + h**3 * z2
        sign, rest = math.copysign(1.0, b), abs(b) - h**4 * a4
        if rest <= 0.0:
            x, xi = 0.0, b / (h**4 * a4)
        else:
            x, xi = _root(h * a1, h * h * a2, h**3 * a3, rest), sign
        w1 = sign * x**4
        z2 -= h * a4 * xi
        z1 += h * (z2 - a3 * sign * x)
        z0 += h * (z1 - a2 * sign * x * x)
        found.append(z1)
    return np.array(found)


def _root(c3: float, c2: float, c1: float, rest: float) -> float:
    """Return the positive root of x^4 + c3 x^3 + c2 x^2 + c1 x = rest, by Newton from above."""
    x = min(rest**0.25, *((rest / c) ** p for c, p in ((c3, 1 / 3), (c2, 0.5), (c1, 1.0))))
    for _ in range(50):
        value = (((x + c3) * x + c2) * x + c1) * x - rest
        step = value / (((4.0 * x + 3.0 * c3) * x + 2.0 * c2) * x + c1)
        x -= step
        if abs(step) <= 1e-12 * x:
            break
    return x
