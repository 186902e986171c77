# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Random values through one function of records, and random expressions: plain and C are equal."""

import random
import shutil

import numpy as np
import pytest
from engine_build import bits, build, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

pytestmark = pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')
FILTER = """
    import math
    from typing import Annotated

    from estimator_pkg.record import record

    SIZE = 4
    LIMIT = 1e6


    @record
    class Peak:
        value: float
        at: int


    @record
    class Filter:
        taps: Annotated[list[float], SIZE]
        p: Annotated[list[list[float]], SIZE, SIZE]
        peaks: Annotated[list[Peak], 2]
        low: Peak
        count: int
        started: bool


    def shift(taps: list[float], x: float) -> float:
        out = taps[SIZE - 1]
        for i in range(SIZE - 1, 0, -1):
            taps[i] = taps[i - 1]
        taps[0] = x
        return out


    Matrix = Annotated[list[list[float]], SIZE, SIZE]


    def spread(p: Matrix, taps: list[float]) -> tuple[float, bool]:
        worst = -math.inf
        for i in range(SIZE):
            for j in range(SIZE):
                if i == j:
                    p[i][j] = 0.5 * p[i][j] + abs(taps[i])
                    continue
                p[i][j] -= 0.25 * taps[i] * taps[j]
                worst = max(worst, p[i][j])
        return worst, worst > LIMIT


    def take(f: Filter, x: float, n: int) -> float:
        if not math.isfinite(x) or f.count >= 1000:
            f.count = 0
            return math.nan
        kept = Peak()
        kept.take(f.low)
        old = shift(f.taps, x)
        if not f.started:
            f.started, f.low.value, f.low.at = True, x, n
        elif x < f.low.value or f.low.value != f.low.value:
            f.low.value, f.low.at = x, f.count
            f.peaks[1].take(kept)
        worst, large = spread(f.p, f.taps)
        k = n % 2
        peak = f.peaks[k]
        while peak.at > 3 and not large:
            peak.at //= 2
            if peak.at == 7:
                break
        peak.value = min(peak.value, old, worst) if large else peak.value - x
        for one in (f.low, f.peaks[1 - k]):
            one.at += 1
        f.count += 1
        return peak.value + (x if n < 0 else -x)
"""
NUMBERS = st.floats() | st.floats(-1e3, 1e3) | st.sampled_from([0.0, -0.0, 5e-324, 1e300])


@pytest.fixture(scope='module')
def filters(tmp_path_factory):
    root = tmp_path_factory.mktemp('random')
    module = write(root, 'random_filter', FILTER)
    _, library = build(root, ('random_filter', 'take', {}, 'filter_take'))
    return module, library


@pytest.mark.long
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    start=st.lists(NUMBERS, min_size=4, max_size=4),
    samples=st.lists(st.tuples(NUMBERS, st.integers(-(2**62), 2**62)), min_size=1, max_size=20),
)
def test_records_are_equal_on_any_values(filters, start, samples):
    module, library = filters
    plain, array = module.Filter(), np.zeros(1, module.Filter.dtype)
    plain.taps[:] = start
    plain.peaks[0].value = start[0]
    plain.write(array[0])
    for x, n in samples:
        expected = module.take(plain, x, n)
        assert bits(library.filter_take(array.ctypes.data, x, n)) == bits(expected)
    assert repr(module.Filter.read(array[0])) == repr(plain)


def expression(rng, kind, depth):
    """Return a random expression of x, y (float), n, m (int) and b (bool)."""
    if depth == 0:
        leaves = {
            'float': ['x', 'y', '0.1', '-0.0', '2.5', 'TABLE[1]', 'LIMIT'],
            'int': ['n', 'm', '3', '-7', 'COUNT'],
            'bool': ['b', 'True', 'x < y', 'n == m'],
        }
        return rng.choice(leaves[kind])
    forms = {
        'float': [
            '({float} + {float})', '{float} - {float}', '({float} - {float}) * {float}',
            '-({float})', 'abs({float})', 'min({float}, {float})', 'max({float}, {float}, {float})',
            '({float} if {bool} else {float})', '({float}) * ({int})', 'float({int})',
            'math.atan2({float}, {float})', 'math.copysign({float}, {float})', 'float({bool})',
            '({float}) * math.floor({small})', 'float(round({small}))', 'double({float})',
        ],
        'int': [
            '({int} + {int})', '{int} - {int}', '({int}) % 5', '({int}) // -3', 'abs({int})',
            'min({int}, {int})', '({int} if {bool} else {int})', '-({int})', 'int({bool})',
            'round({small})', 'int({small})', 'int(math.ceil({small}))', 'count({int}, {bool})',
        ],
        'bool': [
            '({float}) < ({float})', '({float}) <= ({float}) < ({float})', '(({int}) != ({int}))',
            '({bool} and {bool})', '({bool} or {bool})', '(not ({bool}))', '({int}) > 4',
            'math.isnan({float})', '(({bool}) == ({bool}))', '({float}) == 0',
        ],
        'small': ['clip({float})', '(clip({float}) + 0.5)', '(2.5 if {bool} else -3.5)'],
    }  # fmt: skip
    text = rng.choice(forms[kind])
    for inner in ('float', 'int', 'bool', 'small'):
        while '{' + inner + '}' in text:
            made = expression(rng, inner, depth - 1 if inner != 'small' else max(1, depth - 1))
            text = text.replace('{' + inner + '}', made, 1)
    return text


@pytest.mark.long
def test_random_expressions_are_equal(tmp_path):
    rng = random.Random(5)
    lines = [
        'import math\n\nTABLE = (0.5, 1.5)\nLIMIT = -1e-3\nCOUNT = 6\n',
        'def double(x: float) -> float:\n    return x + x\n',
        'def clip(x: float) -> float:\n    return x if abs(x) < 1e3 else 2.5\n',
        'def count(n: int, b: bool) -> int:\n    if b:\n        n -= 1\n    return n\n',
    ]
    names = [f'case_{i}' for i in range(300)]
    for i, name in enumerate(names):
        made = expression(rng, ('float', 'int', 'bool')[i % 3], rng.choice([2, 3, 4]))
        arguments = 'x: float, y: float, n: int, m: int, b: bool'
        lines.append(f'def {name}({arguments}):\n    return {made}\n')
    module = write(tmp_path, 'random_cases', '\n\n'.join(lines))
    _, library = build(tmp_path, *(('random_cases', name, {}, name) for name in names), warnings=[])
    floats = [0.0, -0.0, 0.5, -1.5, 2.5, 3.7, -1e300, 5e-324, float('inf'), float('nan')]
    for name in names:
        for _ in range(60):
            x, y, n, m = *rng.choices(floats, k=2), rng.randint(-9, 9), rng.choice([0, 10**15, -4])
            arguments = x, y, n, m, rng.random() < 0.5
            expected = getattr(module, name)(*arguments)
            assert bits(getattr(library, name)(*arguments)) == bits(expected), (name, arguments)
