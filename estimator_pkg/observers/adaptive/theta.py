# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Functions of the parameters of the adaptive observer: free and known ones, and their signals."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from estimator_pkg.observers.maths.unroll import written_out


class Theta(NamedTuple):
    """Functions written out for one set of free parameters.

    psi_y, psi_u, psi_1, psi_s are the first rows of the filtered regressor for the angle, the
    input, a constant and the sine of the angle.

    pick : (psi_y, psi_u, psi_1, psi_s) -> the free parameters' entries of C Upsilon.
    explained : (psi_y, psi_u, psi_1, psi_s, fixed) -> contribution of the known parameters to y.
    parts : (free, fixed) -> (L, B, load, gravity).
    """

    pick: Callable[..., tuple]
    explained: Callable[..., float]
    parts: Callable[..., tuple]


@lru_cache
def unrolled_theta(order: int, load: bool, gravity: bool, free: tuple[int, ...]) -> Theta:
    """Return the functions for this structure; `free` are indices in theta."""
    last = order - 1
    signals = [
        *(f'y[{i}]' for i in range(order)),
        *(f'u[{i}]' for i in range(order)),
        *([f'one[{last}]'] if load else []),
        *([f'sine[{last}]'] if gravity else []),
    ]
    known = [i for i in range(len(signals)) if i not in free]
    values = [f'x[{free.index(i)}]' if i in free else f'fixed[{i}]' for i in range(len(signals))]

    def vector(entries: list[str]) -> str:
        return '(' + ''.join(f'{entry}, ' for entry in entries) + ')'

    lines = [
        f'def pick(y, u, one, sine): return {vector([signals[i] for i in free])}',
        'def explained(y, u, one, sine, fixed): return '
        + (' + '.join(f'fixed[{i}] * {signals[i]}' for i in known) or '0.0'),
        f'def parts(x, fixed): return ({vector(values[:order])}, '
        f'{vector(values[order : 2 * order])}, {values[2 * order] if load else "0.0"}, '
        f'{values[-1] if gravity else "0.0"})',
    ]
    names = written_out(lines, 'parameters')
    return Theta(names['pick'], names['explained'], names['parts'])
