# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""An off-line reference from positions alone (rows F and H5).

The cubic smoothing spline is the paper's own: the least mean square acceleration with a residual of
the mean square of the quantisation (the discrepancy principle). The smoother for white jerk is the
reference of ``evaluate``, with the variance of the readings given and its density of jerk the most
likely one. Arrays have shape (n,), one position [rad or m] and its velocity; times are in s.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.evaluation.reference.smoother.noise import Noise
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.lab import DT, QUANTA, truth
from sim_pkg.reproduce.mechanical.runs import quantise

Array = NDArray[np.float64]

WEIGHTS = (-14.0, 4.0)  # log10 of the searched weights of the spline [s^3]
ENDS = 0.25  # ignored at both ends [s]
JITTER = 1e-3  # jitter of the stamps (row H5) [s]
DENSEST = 1e7  # largest density of jerk for row H5.fixedR, whose likelihood grows beyond it (there
#                the error is 0.44 rad/s)


def spline(reading: Array, h: float, weight: float) -> tuple[Array, Array]:
    """Return positions and velocities, shape (n,), of a cubic smoothing spline (Reinsch 1967).

    It has the least sum of squared residuals + `weight` times the integral of its acceleration
    squared. With u, the accelerations at the inner readings, and the tridiagonal matrices of second
    differences Q and of integrals R, (R + weight Q'Q) u = Q'y, and the residual is weight Q u.

    Parameters
    ----------
    h : time between readings [s].
    """
    a, b, c = 2.0 * h / 3.0 + 6.0 * weight / h**2, h / 6.0 - 4.0 * weight / h**2, weight / h**2
    # the factors L D L' of the matrix, whose diagonals are a, b and c, and L^-1 Q'y
    first, second, pivots, z = [0.0, 0.0], [0.0, 0.0], [math.inf, math.inf], [0.0, 0.0]
    for right in (np.diff(reading, 2) / h).tolist():
        e = b - c * first[-1]
        first.append(e / pivots[-1])
        second.append(c / pivots[-2])
        pivots.append(a - first[-1] * e - second[-1] * c)
        z.append(right - first[-1] * z[-1] - second[-1] * z[-2])
    first, second, u = [*first, 0.0], [*second, 0.0, 0.0], [0.0, 0.0]
    for i in range(len(z) - 1, 1, -1):
        u.append(z[i] / pivots[i] - first[i + 1] * u[-1] - second[i + 2] * u[-2])
    acceleration = np.array([*u, 0.0, 0.0])[::-1]
    position = reading - weight * np.diff(acceleration, 2) / h
    at = acceleration[1:-1]  # all readings; 0 at the ends
    velocity = np.diff(position) / h - h / 6.0 * (2.0 * at[:-1] + at[1:])
    return position, np.append(velocity, velocity[-1] + 0.5 * h * at[-2])


def spline_velocity(reading: Array, h: float, mean_square: float) -> Array:
    """Return the velocities of the spline with this mean square residual (bisects its weight)."""
    low, high = WEIGHTS
    for _ in range(30):
        middle = 0.5 * (low + high)
        position, velocity = spline(reading, h, 10.0**middle)
        if float(np.mean((reading - position) ** 2)) > mean_square:
            high = middle
        else:
            low = middle
    return velocity


def stamps(time: Array) -> NDArray[np.int64]:
    """Return times [s] as stamps [ns], from 1 s on."""
    return np.round(1e9 * (1.0 + time)).astype(np.int64)


def rms(values: Array, dt: float = DT) -> float:
    """Return the root mean square without the ends."""
    cut = round(ENDS / dt)
    return math.sqrt(float(np.mean(values[cut:-cut] ** 2)))


def values() -> Values:
    """Rows F."""
    q, v, _ = truth('nominal')
    time = DT * np.arange(len(q), dtype=np.float64)
    for scenario in ('HPM', 'LPM'):
        readings = quantise(q, QUANTA[scenario])
        step = 2 if scenario == 'LPM' else 1
        h = step * DT
        for joint in (0, 1):
            y, true, at = readings[::step, joint], v[::step, joint], time[::step]
            name = f'{scenario}.q{joint + 1}'
            variance = QUANTA[scenario][joint] ** 2 / 12.0
            yield f'F1.{name}', rms(np.gradient(y, at) - true, h)
            yield f'F2.{name}', rms(spline_velocity(y, h, variance) - true, h)
            found = smooth(stamps(at), y, 0.0, reading=math.sqrt(variance))
            yield f'F3.{name}', rms(found.velocity - true, h)
            yield f'F4.{name}', rms(found.velocity_stddev, h)


def jitter_values() -> Values:
    """Yield rows H5: stamps with errors of up to 1 ms."""
    q, v, _ = truth('nominal')
    y, true = quantise(q, QUANTA['HPM'])[:, 0], v[:, 0]
    jitter = np.random.default_rng(0).uniform(-JITTER, JITTER, len(y))
    at = stamps(DT * np.arange(len(y)) + jitter)
    held = Noise(QUANTA['HPM'][0] / math.sqrt(12.0), DENSEST, 0.0, True)
    yield 'H5.fixedR', rms(smooth(at, y, 0.0, noise=held).velocity - true)
    yield 'H5.R', rms(smooth(at, y, 0.0, reading=1.17e-3).velocity - true)
