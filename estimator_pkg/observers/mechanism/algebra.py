# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Algebra on tuples for observers of mechanisms, written out for one number of positions.

The functions are generated as text without loops, for the reasons in `maths.unroll`. A vector is a
tuple of floats, a matrix a tuple of rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

from estimator_pkg.observers.circle import LARGEST, wrap
from estimator_pkg.observers.convention import begin, follow, present
from estimator_pkg.observers.maths.unroll import written_out


class MechanicalAlgebra(NamedTuple):
    """Functions for mechanisms of one size n."""

    apply: Callable[..., tuple]  # (A, x) -> A x
    turned: Callable[..., tuple]  # (A, x) -> A^T x
    product_t: Callable[..., tuple]  # (A, B) -> A B^T
    product: Callable[..., tuple]  # (A, B) -> A B
    transposed: Callable[..., tuple]  # (A) -> A^T
    scaled_t: Callable[..., tuple]  # (g, A) -> diag(g) A^T
    times: Callable[..., tuple]  # (x, y) -> elementwise product
    scale: Callable[..., tuple]  # (a, x) -> a x
    zeros_like: Callable[..., tuple]  # (x) -> zero vector
    minus: Callable[..., tuple]  # (x, y) -> x - y
    towards: Callable[..., tuple]  # (x, a, y) -> x + a y
    between: Callable[..., tuple]  # (y, x, periods) -> y - x, each wrapped
    solve: Callable[..., tuple]  # (A, x) -> A^-1 x if x'Ax > 0 for all x, else nan
    divided: Callable[..., tuple]  # (A, B) -> A^-1 B, on the same condition
    blend: Callable[..., tuple]  # (A, w, B) -> A + w B
    finite: Callable[..., bool]  # (x) -> are all |x_i| below LARGEST?
    beyond: Callable[..., bool]  # (x, bounds) -> is any |x_i| above its bound?
    begin: Callable[..., tuple]  # (y) -> conventions
    follow: Callable[..., tuple]  # (conventions, y, periods) -> conventions
    present: Callable[..., tuple]  # (conventions, q, periods, unwrap) -> q in the convention of y
    squares: Callable[..., tuple]  # (p, w, x) -> p + w (x^2 - p), elementwise


def column(entry: str, size: int) -> str:
    """Return the text '(entry(0), entry(1), ...)'; {i} in `entry` is the index."""
    return '(' + ''.join(entry.format(i=i) + ', ' for i in range(size)) + ')'


def total(entry: str, size: int, **fixed: Any) -> str:
    """Return the text 'entry(0) + entry(1) + ...'; {k} in `entry` is the index."""
    return ' + '.join(entry.format(k=k, **fixed) for k in range(size))


@lru_cache
def mechanical_algebra(size: int) -> MechanicalAlgebra:
    """Return the functions for mechanisms of `size` positions (at least one)."""
    n = size
    rows = range(n)

    def vector(entry: str) -> str:
        return column(entry, n)

    apply = ''.join(total('a[{i}][{k}] * x[{k}]', n, i=i) + ', ' for i in rows)
    turned = ''.join(total('a[{k}][{i}] * x[{k}]', n, i=i) + ', ' for i in rows)
    product_t = ''.join(
        '(' + ''.join(total('a[{i}][{k}] * b[{j}][{k}]', n, i=i, j=j) + ', ' for j in rows) + '), '
        for i in rows
    )
    plain = ''.join(
        '(' + ''.join(total('a[{i}][{k}] * b[{k}][{j}]', n, i=i, j=j) + ', ' for j in rows) + '), '
        for i in rows
    )
    flipped = ''.join('(' + ''.join(f'a[{j}][{i}], ' for j in rows) + '), ' for i in rows)
    scaled = ''.join('(' + ''.join(f'g[{i}] * a[{j}][{i}], ' for j in rows) + '), ' for i in rows)
    columns = ''.join('solve(a, (' + ''.join(f'b[{i}][{j}], ' for i in rows) + ')), ' for j in rows)
    blended = ''.join(
        '(' + ''.join(f'a[{i}][{j}] + w * b[{i}][{j}], ' for j in rows) + '), ' for i in rows
    )
    lines = [
        f'def product(a, b): return ({plain})',
        f'def transposed(a): return ({flipped})',
        f'def scaled_t(g, a): return ({scaled})',
        f'def times(x, y): return {vector("x[{i}] * y[{i}]")}',
        f'def scale(a, x): return {vector("a * x[{i}]")}',
        f'def zeros_like(x): return {vector("0.0")}',
        f'def apply(a, x): return ({apply})',
        f'def turned(a, x): return ({turned})',
        f'def product_t(a, b): return ({product_t})',
        f'def minus(x, y): return {vector("x[{i}] - y[{i}]")}',
        f'def towards(x, a, y): return {vector("x[{i}] + a * y[{i}]")}',
        f'def between(y, x, periods): return {vector("wrap(y[{i}] - x[{i}], periods[{i}])")}',
        'def finite(x): return ' + ' and '.join(f'-LARGEST < x[{i}] < LARGEST' for i in rows),
        'def beyond(x, bounds): return '
        + ' or '.join(f'not -bounds[{i}] <= x[{i}] <= bounds[{i}]' for i in rows),
        f'def begin_all(y): return {vector("begin(y[{i}])")}',
        f'def follow_all(c, y, periods): return {vector("follow(c[{i}], y[{i}], periods[{i}])")}',
        'def present_all(c, q, periods, unwrap): return '
        + vector('present(c[{i}], q[{i}], periods[{i}], unwrap[{i}])'),
        f'def squares(p, w, x): return {vector("p[{i}] + w * (x[{i}] * x[{i}] - p[{i}])")}',
        'def solve(m, x):',
        *_elimination(n),
        f'def divided(a, b): return transposed(({columns}))',
        f'def blend(a, w, b): return ({blended})',
    ]
    names = written_out(
        lines,
        f'mechanisms of {n}',
        wrap=wrap,
        begin=begin,
        follow=follow,
        present=present,
        LARGEST=LARGEST,
        nan=math.nan,
    )
    return MechanicalAlgebra(
        *(
            names[name]
            for name in (
                'apply',
                'turned',
                'product_t',
                'product',
                'transposed',
                'scaled_t',
                'times',
                'scale',
                'zeros_like',
                'minus',
                'towards',
                'between',
                'solve',
                'divided',
                'blend',
                'finite',
                'beyond',
                'begin_all',
                'follow_all',
                'present_all',
                'squares',
            )
        )
    )


def _elimination(n: int) -> list[str]:
    """Return the body of `solve` as text: m = L U, then two substitutions.

    There is no pivoting: the pivots of a matrix with x'mx > 0 are positive.
    """
    lines = []
    for i in range(n):
        lines += [
            f'    u{i}{j} = m[{i}][{j}]' + ''.join(f' - l{i}{k} * u{k}{j}' for k in range(i))
            for j in range(i, n)
        ]
        lines += [f'    if not u{i}{i} > 0.0:', '        return ' + column('nan', n)]
        lines += [
            f'    l{j}{i} = (m[{j}][{i}]'
            + ''.join(f' - l{j}{k} * u{k}{i}' for k in range(i))
            + f') / u{i}{i}'
            for j in range(i + 1, n)
        ]
    for i in range(n):
        lines.append(f'    y{i} = x[{i}]' + ''.join(f' - l{i}{k} * y{k}' for k in range(i)))
    for i in reversed(range(n)):
        lines.append(
            f'    z{i} = (y{i}'
            + ''.join(f' - u{i}{k} * z{k}' for k in range(i + 1, n))
            + f') / u{i}{i}'
        )
    return [*lines, '    return ' + column('z{i}', n)]
