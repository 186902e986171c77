# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Laws of 2023 to 2025 that claim to need little or no tuning, each from its paper.

Each is in the field twice: at its authors' settings, and swept like every other law. They get clean
stamps and multi-turn angles, like the peers, in radians and seconds.

References
----------
AIE/ASE: Verma, Sanjeevini, Sumer, Bernstein, "Real-time numerical differentiation of sampled data
using adaptive input and state estimation", Int. J. of Control 97, 2024 (arXiv 2308.08074). Only its
abstract was at hand: equations and settings were written from memory of the authors' papers of 2023
to 2025 and not compared with a text.
Maximum-likelihood spline: Avrachenkov, Freidovich, "Derivative estimation from coarse, irregular,
noisy samples: an MLE-spline approach", arXiv 2507.22176, 2025; settings: the authors' code.
Optimal robust exact differentiator: Aldana-Lopez, Seeber, Haimovich, Gomez-Gutierrez, "Optimal
robust exact first-order differentiators with Lipschitz-continuous output", IEEE TAC, 2025 (arXiv
2404.05863); settings: the authors' code.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column
from benchmarks.laws import COUNT, PEERS, Law, grid
from benchmarks.practice import length, made

Array = NDArray[np.float64]

PAST, FILTER = 25, 50  # n_e, n_f of AIE: past values in the input estimate, terms of the filter
RETROSPECTIVE = 10.0**-0.1, 1e-6  # R_theta and R_d of AIE, over R_z
ETA, BETA = (1e-6, 0.1), 0.55  # bounds of V1 [rad^2], and between the extremes of V2, of ASE
LAMBDA = 1e-4  # weight of the spline's curvature [s^3]
NOISE, LONGEST = 2.0, 100  # bound of the noise [quanta], and of the window [samples], of ORE
STEEPEST = 1.96  # Lipschitz constant of ORE's output over the bound of the acceleration
OVER = 0.02  # [s] over which the bound of a column's acceleration is taken


def rivals() -> list[Law]:
    """Return the laws at their authors' settings and swept."""
    pairs = tuple(product((1e-4, 1e-6, 1e-7), (1e-7, 1e-6, 1e-5)))
    return [
        made('AIE/ASE, authors', adaptive_input, (RETROSPECTIVE,), '', PEERS),
        made('AIE/ASE', adaptive_input, pairs, 'R_theta, R_d', PEERS),
        made('maximum-likelihood spline, authors', spline, (LAMBDA,), '', PEERS),
        made('maximum-likelihood spline', spline, grid(1e-11, 1e-3, COUNT), 'lambda [s^3]', PEERS),
        Law('optimal robust exact, authors', _bounded, group=PEERS),
        made('optimal robust exact', robust_exact, grid(1.0, 1e5, COUNT), 'acceleration', PEERS),
    ]


def _bounded(column: Column, _: None) -> Array:
    """Run ORE with the bound that it presumes: the largest acceleration of the reference."""
    rows, time, angle = column.cleaned()
    n = length(time, OVER)
    true = column.samples.velocity[rows]
    bound = np.nanmax(np.abs(true[n:] - true[:-n]) / (time[n:] - time[:-n]))
    found = robust_exact(time, angle, max(column.quantum, 1e-6), max(float(bound), 1.0))
    return column.at_rows(rows, found)


def adaptive_input(time: Array, angle: Array, quantum: float, gain: tuple[float, float]) -> Array:
    """Return the input d of x' = x + h d, estimated from past inputs and residuals.

    d = Phi theta with Phi = (d_1 .. d_ne, z_0 .. z_ne), z = x - y; theta minimises the sum of
    R_z (z - G(q) d + G(q) Phi theta)^2 + R_d (Phi theta)^2, recursively, where G is the response of
    z to past inputs. The Kalman gain K of x follows from V1 and V2 that match the variance of z.
    """
    count = len(angle)
    phi = np.zeros((FILTER + count, 2 * PAST + 1))
    d, z, through = np.zeros((3, FILTER + count))
    theta, covariance = np.zeros(2 * PAST + 1), np.eye(2 * PAST + 1) / gain[0]
    weights = np.diag([1.0, 1.0 / gain[1]])
    state = known = total = squares = 0.0
    steps = np.diff(time, prepend=2.0 * time[0] - time[1]).tolist()
    for k, (h, reading) in enumerate(zip(steps, (angle - angle[0]).tolist())):
        i = k + FILTER
        z[i] = residual = state - reading
        total, squares = total + residual, squares + residual * residual
        spare = squares / (k + 1) - (total / (k + 1)) ** 2 - known
        v1, v2 = ETA[0], 0.0
        if spare > ETA[0]:
            v2 = BETA * max(spare - ETA[1], 0.0) + (1.0 - BETA) * (spare - ETA[0])
            v1 = spare - v2
        through[i] = v2 / (known + v1 + v2)  # 1 + K
        known = through[i] * (known + v1)
        phi[i] = np.concatenate([d[i - PAST : i][::-1], z[i - PAST : i + 1][::-1]])
        d[i] = phi[i] @ theta
        response = h * np.cumprod(np.append(1.0, through[i - FILTER + 1 : i][::-1]))
        past = slice(i - FILTER, i)
        rows = np.array([response @ phi[past][::-1], phi[i]])
        pulled = covariance @ rows.T
        inner = np.linalg.inv(weights + rows @ pulled)
        wrong = np.array([residual - response @ d[past][::-1], 0.0]) + rows @ theta
        theta = theta - pulled @ (inner @ wrong)
        covariance = covariance - pulled @ inner @ pulled.T
        covariance = 0.5 * (covariance + covariance.T)
        state += (through[i] - 1.0) * residual + h * d[i]
    return d[FILTER:]


def spline(time: Array, angle: Array, quantum: float, weight: float) -> Array:
    """Return the end slope z of the x that minimises sum (y - x)^2 + weight integral z'^2.

    z is a quadratic spline with a knot at each sample and z'' = 0 in the first and last interval.
    The optimum is the authors'; instead of matrices that grow with each sample, the cost of the
    past is carried as s M s - 2 b s with s = (x - y, z, z'), scaled by the median step.
    """
    unit = float(np.median(np.diff(time)))
    penalty = weight / unit**3
    m, b = np.diag([1.0, 0.0, 0.0]), np.zeros(3)
    found = [0.0]
    for first, (h, moved) in enumerate(zip((np.diff(time) / unit).tolist(), np.diff(angle))):
        b = b - m[:, 0] * moved  # x is relative to the newest reading
        # the old s = back (x, z, z', old z')
        back = np.array(
            [[1.0, -h, h * h / 3.0, h * h / 6.0], [0.0, 1.0, -h / 2, -h / 2], [0.0, 0.0, 0.0, 1.0]]
        )
        last = back[:, :3].copy()
        last[:, 2] += back[:, 3]  # z'' = 0: the old z' is the new one
        m_last, b_last = last.T @ m @ last, last.T @ b
        m_last[2, 2] += penalty * h
        m_last[0, 0] += 1.0
        found.append(float(np.linalg.solve(m_last, b_last)[1]) / unit)
        if not first:
            m, b = m_last, b_last
            continue
        whole, right = back.T @ m @ back, back.T @ b
        whole[2:, 2:] += penalty * h / 3.0 * np.array([[1.0, 0.5], [0.5, 1.0]])
        whole[0, 0] += 1.0
        out = whole[:3, 3] / whole[3, 3]
        m, b = whole[:3, :3] - np.outer(out, whole[3, :3]), right[:3] - out * right[3]
    return np.array(found)


def robust_exact(time: Array, angle: Array, quantum: float, bound: float) -> Array:
    """Return the slope of the chord whose length fits the noise that the readings show.

    A chord over t misses the readings between by at most 2 N + L u (t - u) / 2, where u is the age
    of a reading, L the bound of the acceleration and N that of the noise; so the chords show the
    least N. The slope over 2 sqrt(N / L) has the least worst error; its change is limited.
    """
    h, count = float(np.median(np.diff(time))), len(angle)
    most = min(math.ceil(math.sqrt(2.0 * NOISE * quantum / bound) / h) + 1, LONGEST, count - 1)
    noise = np.zeros(count)
    for n in range(2, most + 1):
        t, y = time[n:], angle[n:]
        slope = (y - angle[:-n]) / (t - time[:-n])
        for j in range(1, n):
            age = t - time[n - j : count - j]
            off = np.abs(angle[n - j : count - j] - y + slope * age)
            needed = 0.5 * (off - 0.5 * bound * age * (t - time[:-n] - age))
            np.maximum(noise[n:], needed, out=noise[n:])
    wanted = np.searchsorted(time, time - 2.0 * np.sqrt(noise / bound), side='right') - 1
    newest = np.arange(count)
    oldest = np.maximum(np.clip(wanted, newest - most, newest - 1), 0)
    oldest[0] = 0
    with np.errstate(invalid='ignore'):
        raw = (angle - angle[oldest]) / (time - time[oldest])
    found, last = [], 0.0
    for i, (each, step) in enumerate(zip(raw.tolist(), np.diff(time, prepend=0.0).tolist())):
        limit = STEEPEST * bound * step if i > most else math.inf
        last += min(max(each - last, -limit), limit) if i else 0.0
        found.append(last)
    return np.array(found)
