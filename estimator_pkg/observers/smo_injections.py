"""The injections of the sliding-mode observers, as forward Euler and as an implicit step take them.

super_twisting: first sqrt|e| sgn e into the position, second sgn e into the velocity.
uniform: first (m1 |e|^(1/2) + m2 |e|^(3/2)) sgn e, second (m1^2/2 sgn e + 2 m1 m2 e + 3/2 m2^2 e^2
sgn e).
"""

from __future__ import annotations

import math
from typing import Any

from estimator_pkg.observers.mechanical_algebra import column
from estimator_pkg.observers.twisting import implicit_step, injections
from estimator_pkg.observers.unrolled import written_out

NEWTON = 60  # steps at most; from above they fall monotonically


def twisting(e: float, first: float, second: float, m1: float, m2: float) -> tuple[float, float]:
    """The two injections of super_twisting at e."""
    return injections(e, first, second)


def uniform(e: float, first: float, second: float, m1: float, m2: float) -> tuple[float, float]:
    """The two injections of uniform at e."""
    if e == 0.0:
        return 0.0, 0.0
    size = abs(e)
    root = math.sqrt(size)
    one = first * (m1 * root + m2 * root * size)
    two = second * (0.5 * m1 * m1 + 2.0 * m1 * m2 * size + 1.5 * m2 * m2 * size * size)
    return (one, two) if e > 0.0 else (-one, -two)


def implicit_twisting(free: float, h: float, first: float, second: float, m1: float, m2: float
                      ) -> tuple[float, float]:
    """(e, second injection) after an implicit step: e + h first sqrt|e| sgn e + h^2 second sgn e
    = free, with sgn 0 anything in [-1, 1].
    """
    return implicit_step(free, h, first, second)


def implicit_uniform(free: float, h: float, first: float, second: float, m1: float, m2: float
                     ) -> tuple[float, float]:
    """As `implicit_twisting`, for `uniform`: a quartic in sqrt|e|, by Newton from above."""
    size = abs(free)
    held = h * h * second * 0.5 * m1 * m1
    if size <= held:
        return 0.0, free / (h * h)
    over = size - held
    a1, a3 = h * first * m1, h * first * m2
    a2 = 1.0 + h * h * second * 2.0 * m1 * m2
    a4 = h * h * second * 1.5 * m2 * m2
    root = math.sqrt(over)
    for _ in range(NEWTON):
        value = root * (a1 + root * (a2 + root * (a3 + root * a4))) - over
        slope = a1 + root * (2.0 * a2 + root * (3.0 * a3 + root * 4.0 * a4))
        change = value / slope
        root -= change
        if change <= 1e-16 * root:
            break
    e = root * root
    two = second * (0.5 * m1 * m1 + 2.0 * m1 * m2 * e + 1.5 * m2 * m2 * e * e)
    return (e, two) if free > 0.0 else (-e, -two)


def make_inject(n: int, one: Any) -> Any:
    """inject(e, first, second, m1, m2) -> two vectors, of one channel's injections `one`."""
    body = (['def inject(e, first, second, m1, m2):']
            + [f'    a{i}, b{i} = {one.__name__}(e[{i}], first[{i}], second[{i}], m1, m2)'
               for i in range(n)]
            + [f'    return {column("a{i}", n)}, {column("b{i}", n)}'])
    title = f'injections of {n}, {one.__name__}'
    return written_out(body, title, **{one.__name__: one})['inject']


def make_settle(n: int, one: Any) -> Any:
    """settle(free, h, first, second, m1, m2) -> (e, second injections): `one` for each channel."""
    body = (['def settle(free, h, first, second, m1, m2):']
            + [f'    a{i}, b{i} = {one.__name__}(free[{i}], h, first[{i}], second[{i}], '
               'm1, m2)'
               for i in range(n)]
            + [f'    return {column("a{i}", n)}, {column("b{i}", n)}'])
    title = f'implicit steps of {n}, {one.__name__}'
    return written_out(body, title, **{one.__name__: one})['settle']
