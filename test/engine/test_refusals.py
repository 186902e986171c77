# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What is outside the subset is refused with file, line and reason."""

import pytest

from estimator_pkg.engine.entries import OBSERVERS
from estimator_pkg.engine.entries import entries as every
from estimator_pkg.engine.sources import RefusedError
from estimator_pkg.engine.translate import Entry, translate

HEAD = """\
import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.record import record

WORDS = 'text'
TABLE = (1.0, 2.0)
MIXED = (1, 2.0)
TWICE = 1.0
TWICE = 2.0
LOOP = 1 / 0


@record
class Inner:
    value: float
    seen: bool
    count: int
    steps: Annotated[list[float], 3]


@record
class Outer:
    inner: Inner
    state: 'observer.State'


class Plain:
    x: float


def bump(inner: Inner) -> float:
    inner.value += 1.0
    return inner.value


def pair(a: float) -> tuple[float, float]:
    return a, a


def number(a: float) -> float:
    return a


def half(a: float) -> Any:
    if a > 0.0:
        return a


def both(a: float) -> Any:
    if a > 0.0:
        return a
    return 1


def again(a: float) -> float:
    return again(a)


def spread(*a: float) -> float:
    return 0.0


"""
BELOW = [  # lines that are refused when the function that has them is called
    'def half(a: float) -> Any:',
    'return 1',
    'return again(a)',
    'def spread(*a: float) -> float:',
    'class Plain:',
    "WORDS = 'text'",
    'TWICE = 1.0',
    'TWICE = 2.0',
    'LOOP = 1 / 0',
]

BODIES = {  # the body of a function of inner: Inner, x: float, n: int, b: bool; and the reason
    'return x ** 2': 'write the product',
    'return n // x': 'is not translated: // and % are for ints, use math.floor',
    'return x % 2.0': 'is not translated: // and % are for ints, use math.floor',
    'return n ^ 3': "'n ^ 3' is not translated",
    'return n & x': "'n & x' is not translated",
    'return b | b': "'b' is bool, not a number",
    'return abs(complex(x))': 'give complex two floats',
    'return abs(complex(x, n))': 'give complex two floats',
    'return abs(1j / x)': "'1j / x' is not translated: complex numbers have +, - and *",
    'return 1j < x': 'a complex number is equal to a number or not',
    'return 1j == b': 'a complex number is equal to a number or not',
    'return math.sqrt(1j)': 'no function of floats in math that C has too',
    'return float(1j)': "'float(1j)' is not translated",
    'return abs(-1j)': "'-1j' is not translated",
    'x = 1j': "'x' is float and cannot become complex",
    'return ~n': "'~n' is not translated",
    'return b + 1': "'b' is bool, not a number",
    'return math.hypot(x, x)': 'no function of floats in math that C has too',
    'return math.floor(x)': 'whole number of math.floor or math.ceil is not returned',
    'return -math.floor(x) * x': "'math.floor(x)' is an int in Python: write float(math.floor(x))",
    'return 2 * math.floor(x)': 'is an int in Python',
    'inner.value = math.floor(x)': 'cannot become whole number',
    'return math.floor(n)': "'math.floor(n)' is not translated",
    'return math.sqrt(b)': 'no function of floats in math that C has too',
    'return np.sqrt(x)': "'np.sqrt(x)' is not translated: no function of floats in math",
    'return float("inf")': "'inf' is no number",
    'return max(0, x)': 'is not translated: give it only floats, or only ints',
    'return max(b, b)': 'give it only floats, or only ints',
    'return min(x)': "'min(x)' is not translated",
    'return abs(b)': "'abs(b)' is not translated",
    'return len(inner.steps)': 'vector of 3 float, not a number',
    'return sum(x)': "'sum(x)' is not translated",
    'if x:\n    pass': "'x' is float, not bool: write a comparison",
    'if n:\n    pass': "'n' is int, not bool: write a comparison",
    'while n:\n    pass': "'n' is int, not bool: write a comparison",
    'return x and b': "'x' is float, not bool",
    'return not n': "'n' is int, not bool",
    'return n < x': "an int meets a float in 'n < x': write float(...)",
    'return x == 9007199254740993': 'an int meets a float',
    'return b == 1': 'a bool is equal to a bool or not',
    'return b < b': 'a bool is equal to a bool or not',
    'return x is x': "'x is x' is not translated",
    'return x in (1.0, 2.0)': 'is not translated: unpack it at once, or use a record',
    'return inner < inner': "'inner' is record Inner, not compared",
    'return x if b else n': 'one of float and int: both must be of one type',
    'y = [x, x]': "'[x, x]' is not translated: declare a record with a vector",
    'y = {}': 'is not translated',
    'y = "text"': "'text' is no number",
    'y = None': 'None is no number',
    'y = (x, x)': 'is not translated: unpack it at once, or use a record',
    'y = [z for z in inner.steps]': 'is not translated',
    'y = lambda: x': 'is not translated',
    'y = f"{x}"': 'is not translated',
    'if (y := x) > 0.0:\n    pass': "'(y := x)' is not translated",
    'y = inner.steps[0:2]': "'0:2' is not translated: write a loop",
    'y = 1.0\ny = 2': "'y' is float and cannot become int: write float(...), or 0.0 for 0",
    'y = 1\ny = 2.0': "'y' is int and cannot become float",
    'n /= 2': "'n' is int and cannot become float",
    'n = x': "'n' is int and cannot become float",
    'inner.value = 0': "'inner.value' is float and cannot become int: write float(...), or 0.0",
    'inner.count = x': "'inner.count' is int and cannot become float",
    'inner.seen = 1': "'inner.seen' is bool and cannot become int",
    'inner = Inner()': "'inner' names a record Inner: assign it once",
    'other = inner\nother = inner': "'other' names a record Inner: assign it once",
    'if b:\n    other = inner\nx = other.value': 'assign it once, in a block with all its uses',
    'y = other.value\nother = inner': "'other' is used before it is assigned",
    'other = Inner(x)': 'without arguments',
    'other = Outer()': 'without arguments and observer',
    'inner.steps = inner.steps': 'which is not assigned: use take',
    'inner.steps[3] = x': 'index 3 is not in vector of 3 float',
    'inner.steps[-4] = x': 'index -4 is not in vector of 3 float',
    'inner.steps[x] = x': "index 'x' is float, not int",
    'x = inner.steps': "'x' names a vector of 3 float: assign it once",
    'inner.missing = x': "'inner' is record Inner, which has no field 'missing'",
    'x.real = 0.0': "'x' is float, which has no field 'real'",
    'y = x[0]': "'x' is float, which has no index",
    'TABLE[0] = x': "'TABLE[0]' cannot be assigned",
    'y = TABLE': 'cannot be assigned',
    'y = WORDS': "'WORDS' is no number, no tuple of numbers, or set twice",
    'y = MIXED[0]': 'its values are not of one type',
    'y = TWICE': "'TWICE' is no number, no tuple of numbers, or set twice",
    'y = LOOP': "'LOOP' has no value: division by zero",
    'y = 1 // 0': "'1 // 0' has no value: integer division or modulo by zero",
    'y = unknown': "'unknown' is no local, no constant of a module and nothing of math",
    'y = math.unknown': "'math.unknown' is no local, no constant",
    'y = unknown(x)': "'unknown(x)' is not translated",
    'y = 9223372036854775808': '9223372036854775808 does not fit into 64 bits',
    'y = 3000000000 * 4000000000': '12000000000000000000 does not fit into 64 bits',
    'y = x\nz = later\nlater = 1.0': "'later' is used before it is assigned",
    'y = number(1)': "'a' of number is float and cannot be int: write float(...), or 0.0 for 0",
    'y = number(inner)': "'a' of number is float and cannot be record Inner",
    'y = bump(x)': "'inner' of bump is record Inner and cannot be float",
    'y = number(x, x)': 'the call does not fit number(a)',
    'y = number()': 'the call does not fit number(a)',
    'y = number(a=x, b=x)': 'the call does not fit number(a)',
    'y = number(*x)': "'*x' is not translated",
    'y = spread(x)': 'spread has a decorator, * or **',
    'y = pair(x)': "'pair' returns several numbers: unpack them at once",
    'y = 2.0 * pair(x)': 'unpack them at once',
    'pair(x)': 'unpack them at once',
    'y, z, w = pair(x)': 'pair returns (float, float): unpack as many',
    'y, z = number(x)': 'number returns float: unpack as many',
    'y, z = x': 'only a tuple, or a call of a function of ours, is unpacked',
    'y, z = x, x, x': 'as many numbers as targets',
    'y, z = math.frexp(x)': 'only a tuple, or a call of a function of ours, is unpacked',
    'y, inner.steps[0] = pair(x)': 'an element is not unpacked into',
    '(y, z), w = x, x': "'(y, z)' cannot be assigned",
    'half(x)': 'half does not return a value on every path',
    'both(x)': 'both returned float before and int here',
    'return again(x)': 'again calls itself, which is not translated',
    'return inner': 'record Inner is not returned',
    'return bump(inner) + bump(inner)': "order of evaluation matters: assign 'bump(inner)'",
    'return bump(inner) + inner.value': 'order of evaluation matters',
    'return number(inner.value) * bump(inner)': 'order of evaluation matters',
    'inner.steps[inner.count] = bump(inner)': 'the call may change the index',
    'inner.steps[int(bump(inner))] = inner.value': 'a call in a target changes a record',
    'inner.value += bump(inner)': 'the call may change the target',
    'x, y = bump(inner), 1.0': 'without calls',
    'return x < bump(inner) < 3.0': 'a chain would call it twice',
    'inner.value.take(inner)': 'float takes one float, not record Inner',
    'inner.take(x)': 'record Inner takes one record Inner, not float',
    'inner.copy()': "'inner.copy()' is not translated",
    'x': "'x' has no effect",
    'x == 1.0': 'has no effect',
    'raise ValueError': 'raise is not translated',
    'assert b': 'assert is not translated',
    'try:\n    pass\nexcept OSError:\n    pass': 'try is not translated',
    'with x:\n    pass': 'with is not translated',
    'global TWICE': 'global is not translated',
    'del x': 'delete is not translated',
    'import os': 'import is not translated',
    'def inside():\n    pass': 'functiondef is not translated',
    'for i in inner.steps:\n    pass': 'a loop is over range(...) or over a tuple',
    'for i in range(x):\n    pass': 'range has one to three ints',
    'for i in range(0, 3, n):\n    pass': 'the step of range is a constant other than 0',
    'for i in range(0, 3, 0):\n    pass': 'the step of range is a constant other than 0',
    'for i in (x, n):\n    pass': 'all of one type',
    'for i, j in ((1, 2),):\n    pass': 'a loop has one name, and no else',
    'for i in range(3):\n    pass\nelse:\n    pass': 'a loop has one name, and no else',
    'for v in (x, x):\n    pass\ny = v': "'v' is used or assigned outside of loops over it",
    'while b:\n    pass\nelse:\n    pass': 'else of a loop is not translated',
    'y: int = n': 'annassign is not translated',
    'y = Plain()': 'Plain is no record: decorate it with @record',
}


@pytest.fixture
def refusal(tmp_path):
    def attempt(text, *entry):
        (tmp_path / 'tiny.py').write_text(text)
        with pytest.raises(RefusedError) as caught:
            translate([Entry(*(entry or ('tiny', 'case', {}, 'tiny_case')))], tmp_path)
        assert '\n' not in str(caught.value)
        return str(caught.value)

    return attempt


@pytest.mark.parametrize('body', BODIES)
def test_a_statement_is_refused(refusal, body):
    lines = ''.join(f'    {line}\n' for line in body.splitlines())
    text = f'{HEAD}def case(inner: Inner, x: float, n: int, b: bool):\n{lines}'
    message = refusal(text)
    place, line, reason = message.split(':', 2)
    assert BODIES[body] in reason
    assert place == 'tiny.py'
    refused = text.splitlines()[int(line) - 1].strip()
    assert refused in [item.strip() for item in body.splitlines()] + BELOW


DRIVER = """\
from typing import Any

from estimator_pkg.record import record


@record
class Track:
    state: 'observer.State'


def case(track: Track, observer: Any, x: float) -> float:
    observer.step(track.state, x)
    return x


def bare(track: Track, x) -> float:
    return x


def first(x: float) -> float:
    return second(x)


def second(x: float) -> float:
    return first(x)


def plain(x: float) -> float:
    return x
"""
WITHOUT = 'from estimator_pkg.record import record\n\n\n@record\nclass State:\n    x: float\n'
STATIC = {'observer': 'observed'}
ENTRIES = {  # the text of the module `observed`, the entries, and the error
    'function': ('', [('tiny', 'none', {}, 'c')], "tiny:1: there is no function 'none'"),
    'module': ('', [('nowhere', 'none', {}, 'c')], "nowhere:1: there is no function 'none'"),
    'static module': (
        '',
        [('tiny', 'case', {'observer': 'nowhere'}, 'c')],
        "tiny.py:11: no argument 'observer', or no module for it",
    ),
    'static argument': (
        '',
        [('tiny', 'plain', STATIC, 'c')],
        "tiny.py:28: no argument 'observer', or no module for it",
    ),
    'no annotation': (
        WITHOUT,
        [('tiny', 'bare', {}, 'c')],
        "tiny.py:16: annotate 'track' of the entry point bare, or make it static",
    ),
    'no observer': (
        '',
        [('tiny', 'case', {}, 'c')],
        "tiny.py:11: annotate 'track' of the entry point case, or make it static",
    ),
    'no state': ('', [('tiny', 'case', STATIC, 'c')], "tiny.py:8: observed.py has no 'State'"),
    'no record': (
        'class State:\n    x: float\n',
        [('tiny', 'case', STATIC, 'c')],
        'observed.py:1: State is no record: decorate it with @record',
    ),
    'no step': (WITHOUT, [('tiny', 'case', STATIC, 'c')], "tiny.py:12: observed.py has no 'step'"),
    'another step': (
        WITHOUT + '\n\ndef step(x: float) -> None:\n    pass\n',
        [('tiny', 'case', STATIC, 'c')],
        'tiny.py:12: the call does not fit step(x)',
    ),
    'no such import': (
        'from tiny import missing as step\n' + WITHOUT,
        [('tiny', 'case', STATIC, 'c')],
        "tiny.py:12: observed.py has no 'step'",
    ),
    'syntax': ('def (\n', [('tiny', 'case', STATIC, 'c')], 'observed.py:1: invalid syntax'),
    'circle': ('', [('tiny', 'first', {}, 'c')], 'tiny.py:25: first calls itself'),
    **{
        name: (
            f'def turn(x: {kind}) -> complex:\n    return x * complex(1.0, 0.0)\n',
            [('observed', 'turn', {}, 'turn')],
            'observed.py:1: the entry point turn takes or returns complex: use a record',
        )
        for name, kind in (('complex argument', 'complex'), ('complex result', 'float'))
    },
    'twice': (
        '',
        [('tiny', 'plain', {}, 'one'), ('tiny', 'plain', {}, 'two')],
        "tiny.py:28: plain is exported as 'one'",
    ),
    'vector': (
        WITHOUT.replace('float', "Annotated[list[float], 'n']"),
        [('tiny', 'case', STATIC, 'c')],
        'observed.py:6: "\'n\'" is no number',
    ),
    'size': (
        WITHOUT.replace('float', 'list[float]'),
        [('tiny', 'case', STATIC, 'c')],
        'observed.py:6: x has no size: annotate a number, a record',
    ),
    'field': (
        WITHOUT.replace('float', 'str'),
        [('tiny', 'case', STATIC, 'c')],
        "observed.py:6: 'str' is not translated: annotate a number, a record",
    ),
}


@pytest.mark.parametrize('name', ENTRIES)
def test_an_entry_is_refused(tmp_path, name):
    observed, entries, message = ENTRIES[name]
    (tmp_path / 'tiny.py').write_text(DRIVER)
    (tmp_path / 'observed.py').write_text(observed)
    with pytest.raises(RefusedError) as caught:
        translate([Entry(*entry) for entry in entries], tmp_path)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize('value', ['nowhere:OBSERVER', 'tiny:OBSERVER'])
def test_an_entry_point_to_nothing_is_refused(tmp_path, value):
    (tmp_path / 'tiny.py').write_text(DRIVER)
    with pytest.raises(RefusedError, match=f"setup.py:1: entry point 'mine = {value}' names no"):
        every({OBSERVERS: [f'mine = {value}']}, tmp_path)
