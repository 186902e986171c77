# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The exact step of the linear part of GESO.

With the terms that depend on the configuration frozen, the observer is linear over one sample:

    e' = calM p - L e - r        e = qh - y, r the rate of the measurement over the interval
    p' = f - B e - F p + Psi^T d     B = Gamma calM^T P0, F = Psi^T D calM
    d' = -E e                        the disturbance state, a generalised force

so x(dt) = x + dt phi1(A dt) (A x + c) with phi1(z) = (exp(z) - 1)/z. The series of phi1 is applied
to the vector, term by term until the sum no longer changes. For two positions this takes a few
hundred multiplications, a matrix exponential of the same system a thousand. For large z the terms
of the series cancel, so a fast observer at a low rate makes the step in equal parts, which give the
same exact result. One and two positions are written out: without the engine a loop over them costs
more than their arithmetic.
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.models.mechanics import Matrix, Vector
from estimator_pkg.observers.mechanism.state import Core, Design, Work

LARGEST_PART = 3.0  # largest dt (|L| + sqrt(trace K)) of a step in one part
MOST_PARTS = 1000.0  # gains that need more parts are refused: they do not fit the sample rate
NEGLIGIBLE = 1e-17  # the series ends when its terms are smaller than this, relative to the sum
LAST_TERM = 60.0  # number of the last term


def flow(
    model: Any,
    core: Core,
    calm: Matrix,
    psi: Matrix,
    b: Matrix,
    work: Work,
    design: Design,
    dt: float,
) -> bool:
    """Advance e, p and d by dt [s], with `work.w` = F, `work.f` and `work.rate`.

    It returns False, and does nothing, if the step would take more than `MOST_PARTS` parts.
    """
    n = model.JOINTS
    parts = parts_of(n, calm, b, design.L, work.w, dt)
    if parts == 0:
        return False
    h = dt / float(parts)
    for _ in range(parts):
        if n == 1:
            advance_one(core, calm, psi, b, work, design, h)
        elif n == 2:
            advance_two(core, calm, psi, b, work, design, h)
        else:
            advance_all(n, core, calm, psi, b, work, design, h)
    return True


def parts_of(n: int, calm: Matrix, b: Matrix, L: Matrix, w: Matrix, dt: float) -> int:
    """Return the number of equal parts of a step of dt [s]; 0: too many."""
    if n == 1:
        speed = abs(L[0][0]) + math.sqrt(abs(calm[0][0] * b[0][0])) + abs(w[0][0])
    else:
        most, trace, slowing = 0.0, 0.0, 0.0
        for i in range(n):
            most += abs(L[i][i])
            slowing += abs(w[i][i])
            for j in range(n):
                trace += calm[i][j] * b[j][i]
        speed = most + math.sqrt(abs(trace)) + slowing
    if dt * speed <= LARGEST_PART:
        return 1
    if not dt * speed <= LARGEST_PART * MOST_PARTS:
        return 0
    return int(dt * speed / LARGEST_PART) + 1


def advance_one(
    core: Core, calm: Matrix, psi: Matrix, b: Matrix, work: Work, design: Design, h: float
) -> None:
    """Advance one position by h [s]."""
    e, p = core.e[0], core.x[0]
    m, b0, l0, w = calm[0][0], b[0][0], design.L[0][0], work.w[0][0]
    s, g, d = 0.0, 0.0, 0.0
    if design.disturbed:
        s, g, d = psi[0][0], design.E[0][0], core.d[0]
    x = (m * p - l0 * e - work.rate[0]) * h
    y = (-(b0 * e + w * p) + s * d + work.f[0]) * h
    z = -(g * e) * h
    u, v, q = x, y, z
    k = 2.0
    while k <= LAST_TERM:
        c = h / k
        x, y, z = (m * y - l0 * x) * c, (-(b0 * x + w * y) + s * z) * c, -(g * x) * c
        u += x
        v += y
        q += z
        if (
            abs(x) <= NEGLIGIBLE * abs(u)
            and abs(y) <= NEGLIGIBLE * abs(v)
            and abs(z) <= NEGLIGIBLE * abs(q)
        ):
            break
        k += 1.0
    core.e[0], core.x[0] = e + u, p + v
    if design.disturbed:
        core.d[0] = d + q


def advance_two(
    core: Core, calm: Matrix, psi: Matrix, b: Matrix, work: Work, design: Design, h: float
) -> None:
    """Advance two positions by h [s]."""
    L, w, E, disturbed, resisted = design.L, work.w, design.E, design.disturbed, design.resisted
    e0, e1, p0, p1, d0, d1 = core.e[0], core.e[1], core.x[0], core.x[1], core.d[0], core.d[1]
    m00, m01, m10, m11 = calm[0][0], calm[0][1], calm[1][0], calm[1][1]
    b00, b01, b10, b11 = b[0][0], b[0][1], b[1][0], b[1][1]
    l00, l01, l10, l11 = L[0][0], L[0][1], L[1][0], L[1][1]
    w00, w01, w10, w11 = w[0][0], w[0][1], w[1][0], w[1][1]
    s00, s01, s10, s11 = psi[0][0], psi[0][1], psi[1][0], psi[1][1]
    g00, g01, g10, g11 = E[0][0], E[0][1], E[1][0], E[1][1]
    x0 = (m00 * p0 + m01 * p1 - (l00 * e0 + l01 * e1) - work.rate[0]) * h
    x1 = (m10 * p0 + m11 * p1 - (l10 * e0 + l11 * e1) - work.rate[1]) * h
    y0 = -(b00 * e0 + b01 * e1 + w00 * p0 + w01 * p1)
    y1 = -(b10 * e0 + b11 * e1 + w10 * p0 + w11 * p1)
    z0, z1 = 0.0, 0.0
    if disturbed:
        y0, y1 = y0 + s00 * d0 + s10 * d1, y1 + s01 * d0 + s11 * d1
        z0, z1 = -(g00 * e0 + g01 * e1) * h, -(g10 * e0 + g11 * e1) * h
    y0, y1 = (y0 + work.f[0]) * h, (y1 + work.f[1]) * h
    t0, t1, u0, u1, v0, v1 = x0, x1, y0, y1, z0, z1  # the sums
    k = 2.0
    while k <= LAST_TERM:
        c = h / k
        a0, a1 = b00 * x0 + b01 * x1, b10 * x0 + b11 * x1
        if resisted:
            a0, a1 = a0 + w00 * y0 + w01 * y1, a1 + w10 * y0 + w11 * y1
        a0, a1 = -a0, -a1
        if disturbed:
            a0, a1 = a0 + s00 * z0 + s10 * z1, a1 + s01 * z0 + s11 * z1
            z0, z1 = -(g00 * x0 + g01 * x1) * c, -(g10 * x0 + g11 * x1) * c
            v0 += z0
            v1 += z1
        x0, x1, y0, y1 = (
            (m00 * y0 + m01 * y1 - (l00 * x0 + l01 * x1)) * c,
            (m10 * y0 + m11 * y1 - (l10 * x0 + l11 * x1)) * c,
            a0 * c,
            a1 * c,
        )
        t0 += x0
        t1 += x1
        u0 += y0
        u1 += y1
        if (
            abs(x0) + abs(x1) <= NEGLIGIBLE * (abs(t0) + abs(t1))
            and abs(y0) + abs(y1) <= NEGLIGIBLE * (abs(u0) + abs(u1))
            and abs(z0) + abs(z1) <= NEGLIGIBLE * (abs(v0) + abs(v1))
        ):
            break
        k += 1.0
    core.e[0], core.e[1] = e0 + t0, e1 + t1
    core.x[0], core.x[1] = p0 + u0, p1 + u1
    if disturbed:
        core.d[0], core.d[1] = d0 + v0, d1 + v1


def set_rates(
    n: int,
    x: Vector,
    y: Vector,
    z: Vector,
    e: Vector,
    p: Vector,
    d: Vector,
    calm: Matrix,
    psi: Matrix,
    b: Matrix,
    w: Matrix,
    design: Design,
) -> None:
    """Set the right-hand sides without constants: x of e, y of p, z of d."""
    for i in range(n):
        m_i, l_i, b_i = calm[i], design.L[i], b[i]
        of_p, of_l, of_b = m_i[0] * p[0], l_i[0] * e[0], b_i[0] * e[0]
        for k in range(1, n):
            of_p += m_i[k] * p[k]
            of_l += l_i[k] * e[k]
            of_b += b_i[k] * e[k]
        if design.resisted:
            for k in range(n):
                of_b += w[i][k] * p[k]
        of_d = -of_b
        if design.disturbed:
            of_g = design.E[i][0] * e[0]
            for k in range(1, n):
                of_g += design.E[i][k] * e[k]
            for k in range(n):
                of_d += psi[k][i] * d[k]
            z[i] = -of_g
        x[i], y[i] = of_p - of_l, of_d


def advance_all(
    n: int, core: Core, calm: Matrix, psi: Matrix, b: Matrix, work: Work, design: Design, h: float
) -> None:
    """Advance any number of positions by h [s]."""
    x, y, z, sum_x, sum_y, sum_z = work.x, work.y, work.z, work.sum_x, work.sum_y, work.sum_z
    next_x, next_y, next_z = work.next_x, work.next_y, work.next_z
    set_rates(n, x, y, z, core.e, core.x, core.d, calm, psi, b, work.w, design)
    for i in range(n):
        x[i] = (x[i] - work.rate[i]) * h
        y[i] = (y[i] + work.f[i]) * h
        z[i] = z[i] * h if design.disturbed else 0.0
        sum_x[i], sum_y[i], sum_z[i] = x[i], y[i], z[i]
    k = 2.0
    while k <= LAST_TERM:
        c = h / k
        set_rates(n, next_x, next_y, next_z, x, y, z, calm, psi, b, work.w, design)
        of_x, of_y, of_z, all_x, all_y, all_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            x[i], y[i] = next_x[i] * c, next_y[i] * c
            sum_x[i] += x[i]
            sum_y[i] += y[i]
            of_x += abs(x[i])
            of_y += abs(y[i])
            all_x += abs(sum_x[i])
            all_y += abs(sum_y[i])
            if design.disturbed:
                z[i] = next_z[i] * c
                sum_z[i] += z[i]
                of_z += abs(z[i])
                all_z += abs(sum_z[i])
        if of_x <= NEGLIGIBLE * all_x and of_y <= NEGLIGIBLE * all_y and of_z <= NEGLIGIBLE * all_z:
            break
        k += 1.0
    for i in range(n):
        core.e[i] += sum_x[i]
        core.x[i] += sum_y[i]
        if design.disturbed:
            core.d[i] += sum_z[i]
