# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Small linear algebra on tuples, unrolled for one size.

In plain Python a loop over two or three numbers costs more than their arithmetic, and Numba cannot
build tuples in a loop. So the functions are generated as text without loops, once for each size,
and executed. A vector is a tuple of floats, a matrix a tuple of rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple


def written_out(lines: list[str], title: str, **known: Any) -> dict[str, Any]:
    """Return the functions that these lines of text define, by name.

    No other function of this package executes text.

    Parameters
    ----------
    lines : Python source, one line each.
    title : shown in tracebacks instead of a file's name.
    known : functions and numbers that the text uses, by name.
    """
    names: dict[str, Any] = dict(known)
    exec(compile('\n'.join(lines), f'<{title}>', 'exec'), names)
    return names


class Algebra(NamedTuple):
    """Functions for vectors of one size n and for n x n matrices."""

    dot: Callable[..., float]  # (x, y)
    add: Callable[..., tuple]  # (x, a, y) -> x + a y
    scale: Callable[..., tuple]  # (a, x) -> a x
    times: Callable[..., tuple]  # (x, y) -> elementwise product
    clip: Callable[..., tuple]  # (x, low, high), elementwise
    apply: Callable[..., tuple]  # (matrix, x) -> matrix x
    rank_one: Callable[..., tuple]  # (matrix, keep, a, x) -> keep matrix + a x x^T
    wider: Callable[..., bool]  # (matrix, other) -> is any diagonal entry larger than other's?
    limited: Callable[..., tuple]  # (covariance, most, part) -> rows and columns scaled so that its
    # diagonal does not exceed that of most, plus part times the diagonal of most
    exceeds: Callable[..., bool]  # (matrix, keep, a, floor) -> is matrix - a floor positive
    # definite, with the diagonal of matrix multiplied by keep?


@lru_cache
def algebra(size: int) -> Algebra:
    """Return the functions for vectors of `size` entries (at least one)."""
    index = range(size)

    def vector(entry: str) -> str:
        return '(' + ''.join(entry.format(i=i) + ', ' for i in index) + ')'

    def matrix(entry: str) -> str:
        return (
            '('
            + ''.join(
                '(' + ''.join(entry.format(i=i, j=j) + ', ' for j in index) + '), ' for i in index
            )
            + ')'
        )

    def product(row: str, x: str) -> str:
        return ' + '.join(f'{row}[{k}] * {x}[{k}]' for k in index)

    lines = [
        f'def dot(x, y): return {product("x", "y")}',
        f'def add(x, a, y): return {vector("x[{i}] + a * y[{i}]")}',
        f'def scale(a, x): return {vector("a * x[{i}]")}',
        f'def times(x, y): return {vector("x[{i}] * y[{i}]")}',
        f'def clip(x, low, high): return {vector("min(max(x[{i}], low[{i}]), high[{i}])")}',
        'def apply(m, x): return (' + ''.join(product(f'm[{i}]', 'x') + ', ' for i in index) + ')',
        f'def rank_one(m, keep, a, x): return {matrix("keep * m[{i}][{j}] + a * x[{i}] * x[{j}]")}',
        'def wider(m, x): return ' + ' or '.join(f'm[{i}][{i}] > x[{i}][{i}]' for i in index),
        'def limited(m, x, part):',
        *(
            f'    s{i} = sqrt(x[{i}][{i}] / m[{i}][{i}]) if m[{i}][{i}] > x[{i}][{i}] else 1.0'
            for i in index
        ),
        '    return ('
        + ''.join(
            '('
            + ''.join(
                f'm[{i}][{j}] * (s{i} * s{j})' + (f' + part * x[{i}][{i}], ' if i == j else ', ')
                for j in index
            )
            + '), '
            for i in index
        )
        + ')',
        'def exceeds(m, keep, a, floor):',  # true where Cholesky's factors exist
    ]
    for j in index:
        for i in range(j, size):
            taken = ''.join(f' - l{i}{k} * l{j}{k}' for k in range(j))
            if i == j:
                lines += [
                    f'    d{j} = keep * m[{j}][{j}] - a * floor[{j}][{j}]{taken}',
                    f'    if not d{j} > 0.0: return False',
                    f'    l{j}{j} = sqrt(d{j})',
                ]
            else:
                lines.append(f'    l{i}{j} = (m[{i}][{j}] - a * floor[{i}][{j}]{taken}) / l{j}{j}')
    lines.append('    return True')
    names = written_out(lines, f'unrolled for {size}', sqrt=math.sqrt)
    return Algebra(*(names[name] for name in Algebra._fields))
