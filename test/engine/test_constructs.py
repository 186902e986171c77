# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Each construct of the subset: the same function plain and as C, equal to the last bit.

All constructs are one C file that is compiled once.
"""

import itertools
import math
import shutil

import pytest
from engine_build import bits, build, write

from estimator_pkg.engine.prelude import MATH, TESTS
from estimator_pkg.engine.translate import Entry, translate

FLOATS = [0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 1.5, 2.5, -2.5, 0.1, math.pi, 1e16, 4503599627370497.5]
FLOATS += [1e308, -1e308, 5e-324, -5e-324, 2.2e-308, math.inf, -math.inf, math.nan, 700.0]
INTS = [0, 1, -1, 2, -2, 3, 7, -7, 10, 2**31 - 1, 2**31, -(2**31) - 1, 2**53, 2**53 + 1]
INTS += [-(2**53) - 1, 2**62 - 1, -(2**62), 2**63 - 1, -(2**63), 999_999_999_999_999_999]
COUNTS = [-2, 0, 1, 3, 5]
VALUES = {'float': FLOATS, 'int': INTS, 'bool': [False, True], 'count': COUNTS}
VALUES['modest'] = [x for x in FLOATS if abs(x) < 1e17]  # whose int has 64 bits
HEAD = """\
import math


def three(x: float, y: float) -> tuple[float, float, float]:
    return x, x + y, x * y


"""

CASES = {  # name: (types of the arguments, body of the function with arguments a, b, c ...)
    'sum': ('float float', 'return a + b'),
    'difference': ('float float', 'return a - b'),
    'product': ('float float', 'return a * b'),
    'quotient': ('float float', 'return a / b'),
    'tree_kept': ('float float float', 'return a - (b - c) * (a / (b * c)) + -(a - b)'),
    'left_to_right': ('float float float', 'return a - b - c + a / b / c * a'),
    'minus_twice': ('float', 'return -(-a)'),
    'minus_minus': ('float float', 'return a - -b - -(-a)'),
    'minus_zero': ('float', 'return -0.0 * a'),
    'plus': ('float', 'return +a'),
    'minus_int': ('int', 'return -(-a) - -3'),
    'literals': ('float', 'return a * 1e22 + 5e-324 - 0.1 + 1e-7 * 123456789.123456789'),
    'infinity': ('float', 'return a * 1e999'),
    'big_int': ('int', 'return a + 3000000000 - -9223372036854775808'),
    'folded_ints': ('int', 'return a + 1000 * 1000 * 1000 * 1000'),
    'narrow_choices': ('bool bool', 'return (1 if a else 100000) * (3 if b else 100000)'),
    'int_of_bools': ('bool bool', 'return int(a) * 2147483647 + int(b) * 2'),
    'float_of_bool': ('bool', 'return float(a)'),
    'int_and_float': ('int float', 'return 2 * b + a - a * b'),
    'half': ('int', 'return 1 / 2 * float(a) + 7 / 2'),
    'floor': ('float', 'return float(math.floor(a))'),
    'ceil': ('float', 'return float(math.ceil(a))'),
    'floor_sign': ('float', 'return -float(math.floor(a)) * 0.5'),
    'wrap': ('float float', 'return a - b * math.floor(a / b + 0.5)'),
    'floor_to_int': ('modest', 'return int(math.floor(a)) % 3'),
    'whole_local': ('float float', 'turns = math.floor(a)\nreturn b * turns'),
    'whole_compared': ('float', 'return math.floor(a) > 2 and math.floor(a) < a'),
    'round': ('float', 'return round(a)'),
    'round_real': ('float float', 'return float(round(a)) - b * round(b)'),
    'round_added': ('modest', 'n = 1\nn += round(a)\nx = 1.0\nx += round(a)\nreturn n * x'),
    'round_int': ('int', 'return round(a) + int(a)'),
    'int': ('float', 'return int(a)'),
    'float_of_int': ('int', 'return float(a)'),
    'bool_of_float': ('float', 'return bool(a)'),
    'bool_of_int': ('int', 'return bool(a)'),
    'abs': ('float', 'return abs(a)'),
    'abs_int': ('int', 'return abs(a)'),
    'min': ('float float', 'return min(a, b)'),
    'max': ('float float', 'return max(a, b)'),
    'min_of_three': ('float float float', 'return min(a, b, c)'),
    'max_of_three': ('float float float', 'return max(a, b, c)'),
    'max_with_literal': ('float', 'return max(0.0, a) + max(a, 0.0) - min(-0.0, a)'),
    'min_int': ('int int', 'return min(a, b) - max(a, b, 3)'),
    'floor_divide': ('int int', 'return a // b'),
    'modulo': ('int int', 'return a % b'),
    'divide_ints': ('int int', 'return a / b'),
    'divide_by_constant': ('int', 'return a / 3 + a // -3 + a % 60'),
    'flags': ('int int int', 'return a & b | c | 5 & b'),
    'flags_tested': ('int int', 'return a & 6 != 0 and not a | b == 7 or a & b == a | 1'),
    'flags_added': ('int int', 'a |= b + 4\na &= b - 1 | 8\nreturn a + 1 & 31'),
    'overflow_wraps': ('int int', 'return a * b + a - b'),
    'not': ('float float', 'return not a < b'),
    'not_twice': ('bool', 'return not (not a)'),
    'chain': ('float float float', 'return a < b <= c != a'),
    'chain_of_equal': ('float float float', 'return a == b == c'),
    'and_or': ('bool bool bool', 'return a and b or c and not a'),
    'or_and': ('bool bool bool', 'return (a or b) and (b or c)'),
    'bools_compared': ('bool float', 'return (a == (b > 1.0)) != (b != b)'),
    'is_nan_compared': ('float float', 'return math.isnan(a) == math.isnan(b)'),
    'is_nan_counted': ('float', 'return int(math.isnan(a)) + 2 * int(math.isinf(a))'),
    'is_finite': ('float', 'return math.isfinite(a) and not math.isnan(a)'),
    'is_finite_int': ('int', 'return math.isfinite(a)'),
    'int_with_literal': ('int', 'return a > 5 and a != 9007199254740993'),
    'float_with_int_literal': ('float', 'return a > 0 or a == -3'),
    'choice': ('float float', 'return a if a > b else b if b > 0.0 else -1.0'),
    'choice_inside': ('float bool', 'return 2.0 * (a if b else -a) + 1.0'),
    'swap': ('float float', 'a, b = b, a\nreturn a - 2.0 * b'),
    'rotate': ('float float float', 'a, b, c = b, c, a\nreturn a - 2.0 * b + c'),
    'fibonacci': ('count', 'x, y = 0, 1\nfor _ in range(a):\n    x, y = y, x + y\nreturn x'),
    'results_unused': ('float float', 'x, _, _ = three(a, b)\n_, _, y = three(b, a)\nreturn x - y'),
    'tuple_independent': ('float float', 'x, y = a + b, a - b\nreturn x * y'),
    'several_targets': ('float', 'x = y = a * 2.0\nx += 1.0\nreturn x - 3.0 * y'),
    'several_zeros': ('float', 'x = y = 0.0\nx += a\nreturn x - y'),
    'augmented': ('float float', 'a += b\na -= 0.5\na *= b - 1.0\na /= b + 3.0\nreturn a'),
    'augmented_tree': ('float float', 'a -= a - b\na /= a * b\nreturn a'),
    'augmented_int': ('count count', 'a += b\na -= 3\na *= b\na //= 7\na %= 5\nreturn a'),
    'augmented_mixed': ('float count', 'a += b\na *= 2\na /= b\nreturn a'),
    'first_in_if': ('float', 'if a > 0.0:\n    x = a\nelse:\n    x = -a\nreturn x'),
    'first_in_nested_if': (
        'float bool',
        'if a > 0.0:\n    if b:\n        x = 1.0\n    else:\n        x = 2.0\n'
        'elif b:\n    x = 3.0\nelse:\n    x = 4.0\nreturn x * a',
    ),
    'assigned_before_if': ('float', 'x = 1.0\nif a > 0.0:\n    x = a\nreturn x'),
    'elif': ('float', 'if a < 0.0:\n    return 1\nelif a == 0.0:\n    return 2\nreturn 3'),
    'early_return': ('float', 'if a != a:\n    return 0.0\nreturn a'),
    'argument_assigned': ('float', 'if a > 1.0:\n    a = 1.0\nreturn a'),
    'loop': ('count float', 's = 0.0\nfor i in range(a):\n    s += b * i\nreturn s'),
    'loop_bounds': ('count', 's = 0\nfor i in range(-3, a):\n    s = 10 * s + i\nreturn s'),
    'loop_down': ('count', 's = 0\nfor i in range(a, -4, -2):\n    s = 10 * s + i\nreturn s'),
    'loop_twice': (
        'count',
        's = 0\nfor i in range(a):\n    s += i\nfor i in range(3):\n    s = 2 * s + i\nreturn s',
    ),
    'loop_bound_changes': ('count', 'n = a\nfor i in range(n):\n    n -= 1\nreturn n'),
    'loop_variable_after': ('count', 'i = 7\nfor i in range(a):\n    pass\nreturn i'),
    'loop_variable_set': (
        'count',
        's = 0\nfor i in range(a):\n    i = 2 * i\n    s += i\nreturn s',
    ),
    'loop_nested': (
        'count',
        's = 0\nfor i in range(a):\n    for j in range(i, a):\n        if j == 3:\n'
        '            break\n        if i == 1:\n            continue\n'
        '        s = 3 * s + i - j\nreturn s',
    ),
    'loop_of_tuple': (
        'float float',
        's = 0.0\nfor x in (a, b, 2.0):\n    s = 2.0 * s + x\nreturn s',
    ),
    'loop_of_ints': ('int', 's = 0\nfor k in (1, a, 3):\n    s = 2 * s + k\nreturn s'),
    'loop_unused': ('count', 's = 0\nfor k in (1, 2):\n    s += a\nreturn s'),
    'while': ('count', 'n = 0\nwhile n * n < a:\n    n += 1\nreturn n'),
    'while_true': ('count', 'n = 0\nwhile True:\n    n += 1\n    if n > a:\n        return n'),
    'while_break': (
        'count',
        'n = 10\nwhile n > 0:\n    n -= 1\n    if n == a:\n        break\nreturn n',
    ),
    'loop_carried': ('count', 'k = 0\nwhile k < a:\n    now = k * k\n    k += now + 1\nreturn k'),
    'unused_local': ('float', 'x = a\ny = 3.0\nif a > 0.0:\n    z = 2\nreturn a'),
    'unused_argument': ('float float', 'return a'),
    'keywords_as_names': ('float', 'new = a\ndouble = 2.0\nnew_ = 1.0\nreturn new * double + new_'),
    'names_of_the_prelude': (
        'float',
        'whole = a\nfabs = 2.0\nreturn abs(whole) + float(math.floor(fabs))',
    ),
    'capital_names': ('float', 'I = a\nS = I + 1.0\nreturn S'),
    'names_that_we_make': (
        'count',
        'i_end = 2\nb_next = 3\nn = a\nfor i in range(n + 1):\n    i_end += i\n'
        'for i in range(n + 2):\n    i_end -= 2 * i\nx, b = 1, 2\nx, b = b, x\n'
        'return i_end + b_next + x',
    ),
    'complex': (
        'float float float',
        'z = complex(a, b)\ny = z * 2.0 + complex(a, c) * z - 1j\ny += c\ny -= z\n'
        'y *= complex(c, b)\n'
        'x = y if a > b else 3 * z + 0.5j * c\nx, y = y, x\n'
        'return abs(x) + 3.0 * y.real - 5.0 * x.imag',
    ),
    'complex_compared': ('float float', 'return complex(a, b) == b + 0j or complex(a, b) == 1'),
    'complex_zero': ('float', 'z = 0j\nif a > 0.0:\n    z = complex(a, 1.0)\nreturn (z * 2).real'),
    'constants': ('float', 'return a * math.pi - math.tau + math.e'),
    'math_infinity': ('float', 'return a < math.inf and a > -math.inf'),
    'math_nan': ('float', 'return a + math.nan'),
    'dead_code': ('float', 'return a\nreturn unknown(a)'),
    'pass_only': ('float', 'if a > 0.0:\n    pass\nreturn a'),
    'exact_order': ('float', 'return a + 0.1 + 0.2 + 0.3 + (0.1 + 0.2 + 0.3)'),
    **{
        name: ('float', f'return math.{name}(a)')
        for name, count in MATH.items()
        if count == 1 and name not in ('floor', 'ceil', *TESTS)
    },
    **{
        name: ('float float', f'return math.{name}(a, b)')
        for name, count in MATH.items()
        if count == 2
    },
    'sqrt_of_int': ('int', 'return math.sqrt(a) + math.atan2(a, 2)'),
}
NAMES = 'abcd'
pytestmark = pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')


def function(name, types, body):
    kinds = [{'count': 'int', 'modest': 'float'}.get(kind, kind) for kind in types.split()]
    arguments = ', '.join(f'{n}: {kind}' for n, kind in zip(NAMES, kinds))
    lines = '\n'.join(f'    {line}' for line in body.splitlines())
    return f'def case_{name}({arguments}):\n{lines}\n'


@pytest.fixture(scope='module')
def both(tmp_path_factory):
    root = tmp_path_factory.mktemp('constructs')
    text = HEAD + '\n\n'.join(function(name, *case) for name, case in CASES.items())
    module = write(root, 'constructs', text)
    entries = [('constructs', f'case_{name}', {}, f'case_{name}') for name in CASES]
    _, library = build(root, *entries)
    return module, library


@pytest.mark.parametrize('name', CASES)
def test_plain_and_c_are_equal(both, name):
    plain, c = (getattr(side, f'case_{name}') for side in both)
    compared = 0
    for arguments in itertools.product(*(VALUES[kind] for kind in CASES[name][0].split())):
        try:
            expected = plain(*arguments)
        except (ArithmeticError, ValueError):
            continue  # Python refuses; the guard does so before
        if type(expected) is int and not -(2**63) <= expected < 2**63:
            if name not in ('int', 'round', 'float_of_bool'):  # saturated
                expected = (expected + 2**63) % 2**64 - 2**63
            else:
                expected = max(-(2**63), min(expected, 2**63 - 1))
        assert bits(c(*arguments)) == bits(expected), arguments
        compared += 1
    assert compared > 1


@pytest.mark.parametrize('line, call', [('from ..b import c', 'c'), ('from .. import b', 'b.c')])
def test_relative_imports_are_followed(tmp_path, line, call):
    (tmp_path / 'a' / 'd').mkdir(parents=True)
    head = f'{line}\n\n\ndef e(x: float) -> float:\n    return {call}(x)\n'
    texts = {'__init__': '', 'b': 'def c(x: float) -> float:\n    return 2.0 * x\n'}
    texts |= {'d/__init__': '', 'd/e': head}
    for name, text in texts.items():
        (tmp_path / 'a' / f'{name}.py').write_text(text)
    assert 'return 2.0 * x;' in translate([Entry('a.d.e', 'e', {}, 'e')], tmp_path)
