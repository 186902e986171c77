# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The exact step of the linear part of GESO, written out for one number of positions.

With the terms that depend on the configuration frozen, the observer is linear over one sample:

    e' = calM p - L e - r        e = qh - y, r the rate of the measurement over the interval
    p' = f - B e - F p + Psi^T d     B = Gamma calM^T P0, F = Psi^T D calM
    d' = -E e                        the disturbance state, a generalised force

so x(dt) = x + dt phi1(A dt) (A x + c) with phi1(z) = (exp(z) - 1)/z. The series of phi1 is applied
to the vector, term by term until the sum no longer changes. For two positions this takes about a
hundred multiplications, a matrix exponential of the same system about a thousand. For large z the
terms of the series cancel, so a fast observer at a low rate makes the step in equal parts, which
give the same exact result.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

from estimator_pkg.observers.maths.unroll import written_out
from estimator_pkg.observers.mechanism.algebra import total

LARGEST_PART = 3.0  # largest dt (|L| + sqrt(trace K)) of a step in one part
MOST_PARTS = 1000.0  # gains that need more parts are refused: they do not fit the sample rate
NEGLIGIBLE = 1e-17  # the series ends when its terms are smaller than this, relative to the sum


@lru_cache
def make_flow(n: int, *, diagonal: bool, damped: bool, disturbed: bool) -> Callable[..., tuple]:
    """Return flow(e, p, d, calm, psi, b, gains, damping, gain_d, f, r, dt) -> (e, p, d, done).

    `gains` is the diagonal of L if it is `diagonal`, else the matrix. `done` is False if the step
    would take more than `MOST_PARTS` parts. Without a disturbance state d is returned unchanged.
    """
    rows = range(n)
    lines = [
        'def flow(e, p, d, calm, psi, b, gains, damping, gain_d, f, r, dt):',
        '    ' + _unpack('e', n) + ' = e',
        '    ' + _unpack('p', n) + ' = p',
    ]
    if disturbed:
        lines.append('    ' + _unpack('d', n) + ' = d')
    lines += [
        '    ' + _matrix('m', n) + ' = calm',
        '    ' + _matrix('b', n) + ' = b',
        '    ' + (_unpack('l', n) if diagonal else _matrix('l', n)) + ' = gains',
        '    ' + _unpack('f', n) + ' = f',
        '    ' + _unpack('r', n) + ' = r',
    ]
    if damped:
        lines.append('    ' + _matrix('w', n) + ' = damping')
    if disturbed:
        lines += ['    ' + _matrix('s', n) + ' = psi', '    ' + _matrix('g', n) + ' = gain_d']
    trace = ' + '.join(f'm{i}{j} * b{j}{i}' for i in rows for j in rows)
    most = ' + '.join(f'abs(l{i})' if diagonal else f'abs(l{i}{i})' for i in rows)
    lines += [f'    speed = {most} + sqrt(abs({trace}))']
    if damped:
        lines.append('    speed += ' + ' + '.join(f'abs(w{i}{i})' for i in rows))
    lines += [
        '    h = dt',
        '    parts = 1',
        f'    if not dt * speed <= {LARGEST_PART!r}:',
        f'        if not dt * speed <= {LARGEST_PART * MOST_PARTS!r}:',
        '            return (e, p, d, False)',
        f'        parts = int(dt * speed / {LARGEST_PART!r}) + 1',
        '        h = dt / parts',
        '    for part in range(parts):',
    ]
    body = _rates(n, 'e', 'p', 'd', diagonal, damped, disturbed)
    for i in rows:
        body[f'x{i}'] += f' - r{i}'
        body[f'y{i}'] += f' + f{i}'
    lines += [f'        {name} = ({rate}) * h' for name, rate in body.items()]
    states = [('x', 'u', 'e'), ('y', 'v', 'p')] + ([('z', 'q', 'd')] if disturbed else [])
    for term, sum_, _ in states:
        lines += [f'        {sum_}{i} = {term}{i}' for i in rows]
    lines += ['        k = 2.0', '        while True:', '            c = h / k']
    again = _rates(n, 'x', 'y', 'z', diagonal, damped, disturbed)
    left = ', '.join(again)
    lines.append(f'            {left} = ' + ', '.join(f'({rate}) * c' for rate in again.values()))
    for term, sum_, _ in states:
        lines += [f'            {sum_}{i} += {term}{i}' for i in rows]
    small = [
        ' + '.join(f'abs({term}{i})' for i in rows)
        + f' <= {NEGLIGIBLE!r} * ('
        + ' + '.join(f'abs({sum_}{i})' for i in rows)
        + ')'
        for term, sum_, _ in states
    ]
    lines += [
        f'            if {" and ".join(small)}:',
        '                break',
        '            k += 1.0',
        '            if k > 60.0:',
        '                break',
    ]
    for _, sum_, state in states:
        lines += [f'        {state}{i} += {sum_}{i}' for i in rows]
    out = [_unpack(name, n) for name in ('e', 'p')] + [_unpack('d', n) if disturbed else 'd']
    lines.append(f'    return ({", ".join(out)}, True)')
    return written_out(lines, f'flow of {n}', sqrt=math.sqrt)['flow']


def _unpack(name: str, n: int) -> str:
    return '(' + ''.join(f'{name}{i}, ' for i in range(n)) + ')'


def _matrix(name: str, n: int) -> str:
    return '(' + ''.join(_unpack(f'{name}{i}', n) + ', ' for i in range(n)) + ')'


def _rates(
    n: int, e: str, p: str, d: str, diagonal: bool, damped: bool, disturbed: bool
) -> dict[str, str]:
    """Return the right-hand sides without constants as text: x for e, y for p, z for d."""
    rates = {}
    for i in range(n):
        own = f'l{i} * {e}{i}' if diagonal else '(' + total('l{i}{k} * {e}{k}', n, i=i, e=e) + ')'
        rates[f'x{i}'] = total('m{i}{k} * {p}{k}', n, i=i, p=p) + f' - {own}'
    for i in range(n):
        rate = '-(' + total('b{i}{k} * {e}{k}', n, i=i, e=e)
        if damped:
            rate += ' + ' + total('w{i}{k} * {p}{k}', n, i=i, p=p)
        rate += ')'
        if disturbed:
            rate += ' + ' + total('s{k}{i} * {d}{k}', n, i=i, d=d)
        rates[f'y{i}'] = rate
    if disturbed:
        for i in range(n):
            rates[f'z{i}'] = '-(' + total('g{i}{k} * {e}{k}', n, i=i, e=e) + ')'
    return rates
