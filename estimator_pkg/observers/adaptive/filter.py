# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Filters with a companion matrix A, unrolled for one order.

A is a_i in its first column and 1 above its diagonal (observable canonical form, C = [1 0 .. 0]).
A matrix M that commutes with A, such as exp(A h) or the filtered regressor (11), follows from its
first row C M: row i + 1 is row_i A - a_i row_1. So this module filters n numbers where the paper
filters n x n, and a product with A costs n multiplications.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from estimator_pkg.observers.maths.unroll import written_out

ENOUGH = 1e-18  # the series ends when its terms are smaller than this, relative to the first


class Companion(NamedTuple):
    """Functions for one order n. Vectors and rows are tuples of n floats."""

    rows: Callable[..., tuple]  # (first row, a) -> the whole commuting matrix, as rows
    left: Callable[..., tuple]  # (row, matrix) -> row matrix
    after: Callable[..., tuple]  # (row, a) -> row A
    times: Callable[..., tuple]  # (a, vector) -> A vector
    series: Callable[..., tuple]  # (a, size, h) -> first rows of F, G0, G1; see `companion`
    euler: Callable[..., tuple]  # (a, size, h) -> the same for the forward Euler step


@lru_cache
def companion(order: int) -> Companion:
    """Return the functions for this order (at least 1).

    `series` returns the first rows of F = exp(A h), G0 = int_0^h exp(A s) ds and
    G1 = (1/h) int_0^h exp(A (h - s)) s ds, the responses to a constant input and to a ramp. `size`
    is an upper bound of the magnitudes of A's eigenvalues [1/s].
    """
    index = range(order)

    def vector(entries: list[str]) -> str:
        return '(' + ''.join(f'{entry}, ' for entry in entries) + ')'

    def each(letter: str) -> str:
        return ', '.join(f'{letter}{i}' for i in index)

    def dot(x: str, y: str) -> str:
        return ' + '.join(f'{x}[{k}] * {y}[{k}]' for k in index)

    after = [dot('x', 'a'), *(f'x[{i - 1}]' for i in index[1:])]
    times = [f'a[{i}] * x[0]' + (f' + x[{i + 1}]' if i + 1 < order else '') for i in index]
    left = [' + '.join(f'x[{k}] * m[{k}][{i}]' for k in index) for i in index]
    first = ['1.0', *('0.0' for _ in index[1:])]

    lines = [
        f'def after(x, a): return {vector(after)}',
        f'def times(a, x): return {vector(times)}',
        f'def left(x, m): return {vector(left)}',
        'def rows(x, a):',
        '    r0 = x',
    ]
    for i in index[1:]:
        lines += [
            f'    x = after(r{i - 1}, a)',
            f'    r{i} = ' + vector([f'x[{k}] - a[{i - 1}] * r0[{k}]' for k in index]),
        ]
    lines += [f'    return {vector([f"r{i}" for i in index])}']

    next_v = ' + '.join(f'v{i} * a[{i}]' for i in index)
    lines += [
        'def series(a, size, h):',
        '    doublings = 0',
        '    while size * h > 0.5:',
        '        h = 0.5 * h',
        '        doublings += 1',
        f'    {each("v")} = {", ".join(first)}',
        f'    {each("f")} = {", ".join(first)}',
        '    j, term = 1.0, 1.0',
        f'    {each("g")} = {", ".join(f"h * {x}" for x in first)}',
        f'    {each("q")} = {", ".join(f"0.5 * h * {x}" for x in first)}',
        f'    while term > {ENOUGH}:',
        '        t = h / j',
        '        term *= size * t',
        f'        {each("v")} = '
        + ', '.join([f't * ({next_v})', *(f't * v{i - 1}' for i in index[1:])]),
        '        j += 1.0',
        '        w = h / j',
        '        s = w / (j + 1.0)',
        *(f'        f{i} += v{i}; g{i} += w * v{i}; q{i} += s * v{i}' for i in index),
        f'    f, g, q = ({each("f")},), ({each("g")},), ({each("q")},)',
        '    for _ in range(doublings):',
        '        m = rows(f, a)',
        '        x, y = left(g, m), left(q, m)',
        '        q = ' + vector([f'0.5 * (q[{i}] + g[{i}] + y[{i}])' for i in index]),
        '        g = ' + vector([f'g[{i}] + x[{i}]' for i in index]),
        '        f = left(f, m)',
        '    return f, g, q',
        'def euler(a, size, h):',
        '    f = ' + vector(['1.0 + h * a[0]', *('h' if i == 1 else '0.0' for i in index[1:])]),
        '    return f, '
        + vector(['h', *('0.0' for _ in index[1:])])
        + ', '
        + vector(['0.0'] * order),
    ]
    names = written_out(lines, f'companion of order {order}')
    return Companion(*(names[name] for name in Companion._fields))
