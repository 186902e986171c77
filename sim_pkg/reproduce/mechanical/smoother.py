"""An off-line reference from positions alone: smoothers (rows F and H5).

State (q, v) or (q, v, a) driven by white acceleration or white jerk of density qc, irregular
stamps; Rauch-Tung-Striebel. With white acceleration it is the cubic smoothing spline, whose density
is set so that the residual has the mean square of the quantisation (the discrepancy principle).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import compiled
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.lab import DT, QUANTA, truth
from sim_pkg.reproduce.mechanical.runs import quantise

Array = NDArray[np.float64]

SPAN = (-6.0, 7.0)  # log10 of the searched densities; the limit matters for H5.fixedR only, where
#                     the likelihood still grows at the end (0.44 rad/s without it)
ENDS = 0.25  # ignored at both ends [s]
SKIPPED = 5  # innovations that the start still affects
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
JITTER = 1e-3  # jitter of the stamps (row H5) [s]


class Smoothed(NamedTuple):
    """Positions, velocities, predicted standard deviation of the velocities, shape (N,), and
    log-likelihood of the innovations.
    """

    positions: Array
    velocities: Array
    deviations: Array
    likelihood: float


def forward(
    time, reading, noise, density, order, skipped, means, covariances, before, spread, leading
):
    """The Kalman filter; fills the arrays for `backward`, returns the log-likelihood."""
    x = np.zeros(order)
    x[0] = reading[0]
    p = np.zeros((order, order))
    p[0, 0] = 100.0 * noise
    for i in range(1, order):
        p[i, i] = 1e6
    f = np.zeros((order, order))
    q = np.zeros((order, order))
    total = 0.0
    for k in range(len(time)):
        if k > 0:
            h = time[k] - time[k - 1]
            fill(f, q, h, density, order)
            x = times(f, x, order)
            p = sandwich(f, p, order) + q
            leading[k] = f
        before[k] = x
        spread[k] = p
        s = p[0, 0] + noise
        innovation = reading[k] - x[0]
        if k > skipped:
            total -= 0.5 * (innovation * innovation / s + math.log(2.0 * math.pi * s))
        gain = p[:, 0] / s
        x = x + gain * innovation
        new = np.zeros((order, order))
        for i in range(order):
            for j in range(order):
                new[i, j] = p[i, j] - gain[i] * p[0, j]
        p = 0.5 * (new + new.T)
        means[k] = x
        covariances[k] = p
    return total


def fill(f, q, h, density, order):
    """Transition and process noise over h."""
    if order == 2:
        f[0, 0], f[0, 1], f[1, 0], f[1, 1] = 1.0, h, 0.0, 1.0
        q[0, 0], q[0, 1], q[1, 1] = h**3 / 3.0, h * h / 2.0, h
        q[1, 0] = q[0, 1]
    else:
        f[0, 0], f[0, 1], f[0, 2] = 1.0, h, 0.5 * h * h
        f[1, 1], f[1, 2], f[2, 2] = 1.0, h, 1.0
        q[0, 0], q[0, 1], q[0, 2] = h**5 / 20.0, h**4 / 8.0, h**3 / 6.0
        q[1, 1], q[1, 2], q[2, 2] = h**3 / 3.0, h * h / 2.0, h
        q[1, 0], q[2, 0], q[2, 1] = q[0, 1], q[0, 2], q[1, 2]
    for i in range(order):
        for j in range(order):
            q[i, j] *= density


def times(a, x, order):
    """A x."""
    y = np.zeros(order)
    for i in range(order):
        for k in range(order):
            y[i] += a[i, k] * x[k]
    return y


def sandwich(a, p, order):
    """A P A^T."""
    b = np.zeros((order, order))
    c = np.zeros((order, order))
    for i in range(order):
        for j in range(order):
            for k in range(order):
                b[i, j] += a[i, k] * p[k, j]
    for i in range(order):
        for j in range(order):
            for k in range(order):
                c[i, j] += b[i, k] * a[j, k]
    return c


def backward(order, means, covariances, before, spread, gains, x, p, out):
    """The smoother's way back; fills (position, velocity, variance of the velocity)."""
    for k in range(len(means) - 2, -1, -1):
        x = means[k] + times(gains[k], x - before[k + 1], order)
        p = covariances[k] + sandwich(gains[k], p - spread[k + 1], order)
        out[k, 0] = x[0]
        out[k, 1] = x[1]
        out[k, 2] = p[1, 1]


def smoothed(time: Array, reading: Array, noise: float, density: float, order: int) -> Smoothed:
    """Run the smoother at this noise variance and density."""
    count = len(time)
    means, before = np.zeros((count, order)), np.zeros((count, order))
    covariances, spread, leading = (np.zeros((count, order, order)) for _ in range(3))
    likelihood = compiled(forward)(
        time, reading, noise, density, order, SKIPPED, means, covariances, before, spread, leading
    )
    x, p = means[-1].copy(), covariances[-1].copy()
    out = np.zeros((count, 3))
    out[-1] = x[0], x[1], p[1, 1]
    gains = np.zeros_like(covariances)
    gains[:-1] = np.swapaxes(
        np.linalg.solve(
            spread[1:], np.swapaxes(covariances[:-1] @ np.swapaxes(leading[1:], 1, 2), 1, 2)
        ),
        1,
        2,
    )
    compiled(backward)(
        order, means, covariances, before, spread, np.ascontiguousarray(gains), x, p, out
    )
    return Smoothed(out[:, 0], out[:, 1], np.sqrt(np.maximum(out[:, 2], 0.0)), float(likelihood))


def likelihood(time: Array, reading: Array, noise: float, density: float, order: int) -> float:
    """Return the log-likelihood only."""
    count = len(time)
    return float(
        compiled(forward)(
            time,
            reading,
            noise,
            density,
            order,
            SKIPPED,
            np.zeros((count, order)),
            np.zeros((count, order, order)),
            np.zeros((count, order)),
            np.zeros((count, order, order)),
            np.zeros((count, order, order)),
        )
    )


def most_likely(time: Array, reading: Array, noise: float, order: int = 3) -> Smoothed:
    """The smoother whose density has the largest likelihood: golden section in its logarithm."""
    low, high = SPAN
    grid = np.linspace(low, high, 19)
    best = int(np.argmax([likelihood(time, reading, noise, 10.0**g, order) for g in grid]))
    low, high = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    fa, fb = (likelihood(time, reading, noise, 10.0**g, order) for g in (a, b))
    while high - low > 1e-3:
        if fa > fb:
            high, b, fb = b, a, fa
            a = high - GOLDEN * (high - low)
            fa = likelihood(time, reading, noise, 10.0**a, order)
        else:
            low, a, fa = a, b, fb
            b = low + GOLDEN * (high - low)
            fb = likelihood(time, reading, noise, 10.0**b, order)
    return smoothed(time, reading, noise, 10.0 ** (0.5 * (low + high)), order)


def spline(time: Array, reading: Array, mean_square: float) -> Smoothed:
    """Return the cubic smoothing spline with this mean square residual (bisects its density)."""
    low, high = SPAN
    for _ in range(24):
        middle = 0.5 * (low + high)
        found = smoothed(time, reading, mean_square, 10.0**middle, 2)
        if float(np.mean((reading - found.positions) ** 2)) > mean_square:
            low = middle
        else:
            high = middle
    return found


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
        for joint in (0, 1):
            y, true, at = readings[::step, joint], v[::step, joint], time[::step]
            name = f'{scenario}.q{joint + 1}'
            variance = QUANTA[scenario][joint] ** 2 / 12.0
            yield f'F1.{name}', rms(np.gradient(y, at) - true, step * DT)
            yield f'F2.{name}', rms(spline(at, y, variance).velocities - true, step * DT)
            found = most_likely(at, y, variance)
            yield f'F3.{name}', rms(found.velocities - true, step * DT)
            yield f'F4.{name}', rms(found.deviations, step * DT)


def jitter_values() -> Values:
    """Yield rows H5: stamps with errors of up to 1 ms."""
    q, v, _ = truth('nominal')
    time = DT * np.arange(len(q))
    y, true = quantise(q, QUANTA['HPM'])[:, 0], v[:, 0]
    stamps = time + np.random.default_rng(0).uniform(-JITTER, JITTER, len(time))
    variance = QUANTA['HPM'][0] ** 2 / 12.0
    yield 'H5.fixedR', rms(most_likely(stamps, y, variance).velocities - true)
    yield 'H5.R', rms(most_likely(stamps, y, 1.17e-3**2).velocities - true)
