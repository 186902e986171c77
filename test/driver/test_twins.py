# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What is compiled, and what its digest depends on; without Numba."""

import dis
import math
import sys
import types

import pytest
from motors import made as motor_functions
from observer_cases import found, label, make, variants

from estimator_pkg.driver import compiled
from estimator_pkg.driver.drive import empty, make_drive_batch
from estimator_pkg.observers.maths.seldom import seldom

SOURCE = """
import math

SCALE = 2.0
WORDS = frozenset(('a', 'b'))

def innermost(x):
    return math.sin(x) * SCALE

def inner(x, by=1.0):
    return innermost(x) * by if x in {1.0, 2.0} else len(WORDS)

def make(gain, then):
    def outer(x):
        return sum([inner(y) * gain + then(y) for y in (x, 2.0)])
    return outer

def own(x):
    return own(x - 1.0) if x > 0.0 else x

outer = make(3.0, innermost)
"""


def module(source=SOURCE, name='sample'):
    made = types.ModuleType(name)
    exec(compile(source, 'no file', 'exec'), made.__dict__)
    return made


@pytest.mark.parametrize(
    'old, new',
    [
        ('SCALE = 2.0', 'SCALE = 2.5'),
        ('SCALE = 2.0', 'SCALE = 2'),
        ("('a', 'b')", "('a', 'c')"),
        ('math.sin', 'math.cos'),
        ('* SCALE', '/ SCALE'),
        ('by=1.0', 'by=1.5'),
        ('{1.0, 2.0}', '{1.0, 3.0}'),
        ('(x, 2.0)', '(x, 4.0)'),
        ('make(3.0, innermost)', 'make(3.5, innermost)'),
        ('make(3.0, innermost)', 'make(3.0, inner)'),
    ],
)
def test_a_digest_follows_everything_that_a_function_calls_and_uses(old, new):
    assert old in SOURCE
    before = compiled.fingerprint(module().outer)
    assert compiled.fingerprint(module().outer) == before and len(before) == 64
    assert compiled.fingerprint(module(SOURCE.replace(old, new)).outer) != before


def test_a_digest_follows_the_module_and_nothing_that_is_not_used():
    one = module()
    assert compiled.fingerprint(one.own) == compiled.fingerprint(module().own)
    assert compiled.fingerprint(one.own) != compiled.fingerprint(module(name='other').own)
    more = module(SOURCE + 'def another(x):\n    return x + 1.0\n')
    assert compiled.fingerprint(more.outer) == compiled.fingerprint(one.outer)
    assert compiled.global_names(one.outer.__code__) == {'sum', 'inner'}
    assert compiled.global_names(one.innermost.__code__) == {'math', 'SCALE'}


@pytest.fixture
def compiler(monkeypatch):
    """Stands in for Numba: keeps what it is to compile, and returns a function that says so."""
    asked = []

    def njit(function, **options):
        def twin(*given):
            return function(*given)

        twin.of, twin.options = function, options
        asked.append(twin)
        return twin

    monkeypatch.setitem(sys.modules, 'numba', types.SimpleNamespace(njit=njit))
    monkeypatch.setattr(compiled, '_compiler', lambda: None)
    monkeypatch.setattr(compiled, '_twins', {})
    monkeypatch.setattr(compiled, '_keep_on_disk', lambda *given: None)
    compiled.available.cache_clear()
    yield asked
    compiled.available.cache_clear()


def test_every_function_that_is_called_is_compiled_once_and_nothing_else(compiler, monkeypatch):
    kept = []
    monkeypatch.setattr(compiled, '_keep_on_disk', lambda *given: kept.append(given))
    made = module()
    twin = compiled.compiled(made.outer)
    assert kept == [(twin, twin.of, made.outer)]  # the code of the others is in it
    names = sorted(each.of.__name__ for each in compiler)
    assert names == ['inner', 'innermost', 'outer']
    for each in compiler:
        inside = each is not twin
        assert each.options['no_cpython_wrapper'] is inside
        assert each.options['no_cfunc_wrapper'] is inside
        assert each.options['error_model'] == 'numpy'
        assert each.of.__globals__ is not made.__dict__
    inner = next(each for each in compiler if each.of.__name__ == 'inner')
    assert twin.of.__globals__['inner'] is inner  # calls in compiled code stay in it
    assert twin.of.__qualname__.startswith(f'{made.outer.__qualname__}_')
    assert inner.of.__defaults__ == (1.0,) and inner.of.__globals__['WORDS'] is made.WORDS
    cells = [cell.cell_contents for cell in twin.of.__closure__]
    assert 3.0 in cells and inner.of.__globals__['innermost'] in cells
    assert twin(1.0) == made.outer(1.0)
    assert compiled.compiled(made.outer) is twin and len(compiler) == 3
    assert compiled.compiled(made.make(3.0, made.innermost)) is twin  # the same code and closure
    other = compiled.compiled(made.make(4.0, made.innermost))
    assert other is not twin and len(compiler) == 4
    assert other.of.__qualname__ != twin.of.__qualname__  # code from disk is linked by name
    same = compiled.compiled(made.make(3, made.innermost))  # of another type: another function
    assert same is not twin and len(compiler) == 5


def test_what_few_samples_reach_is_called_and_all_else_is_part_of_the_loop(compiler):
    made, other = module(), module()
    seldom(made.inner)
    compiled.compiled(made.outer)
    assert {each.of.__name__ for each in compiler if not each.options['forceinline']} == {'inner'}
    assert compiled.fingerprint(made.outer) != compiled.fingerprint(other.outer)


def test_without_numba_a_function_is_its_own_twin(monkeypatch):
    monkeypatch.setattr(compiled, 'available', lambda: False)
    assert compiled.compiled(math.hypot) is math.hypot


def test_refusals_of_the_compiler_are_distinguished_from_other_errors():
    refusal = type('TypingError', (Exception,), {'__module__': 'numba.core.errors'})
    assert compiled.cannot_compile(refusal())
    assert not compiled.cannot_compile(ValueError())


def test_a_fault_of_the_cache_is_reported_once(monkeypatch, capsys):
    monkeypatch.setattr(compiled, '_faults', [])
    compiled._not_kept('the disk is full')
    compiled._not_kept('and still is')
    said = capsys.readouterr().err
    assert said == 'warning: compiled code is not loaded from disk: the disk is full\n'
    assert len(compiled._faults) == 2


def test_estimates_of_a_drive_name_their_columns():
    found = empty(2)
    found.rows[:] = [[0.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 7.0]]
    assert found.electrical_angle.tolist() == [0.0, 4.0]
    assert found.electrical_speed.tolist() == [1.0, 5.0]
    assert found.flux_linkage.tolist() == [2.0, 6.0]


def batches(variant):
    """The loops of this observer that are compiled."""
    name, gains = variant
    if name == 'pmsm':
        return [make_drive_batch(motor_functions())]
    return [way[-1] for way in make(name, gains)._ways]


def called(value, seen):
    """Every function that this one reaches by its closure and its globals, itself included."""
    if isinstance(value, types.FunctionType) and value not in seen:
        seen.add(value)
        for cell in value.__closure__ or ():
            called(cell.cell_contents, seen)
        for name in compiled.global_names(value.__code__):
            called(value.__globals__.get(name), seen)
    return seen


def rounds_otherwise(code):
    """What the compiler computes in another way, with another last bit than plain Python."""
    before = None
    for each in dis.get_instructions(code):
        if each.opname == 'BINARY_POWER' or (each.opname == 'BINARY_OP' and each.argrepr == '**'):
            if isinstance(before, (int, float)) and (2.0 * before).is_integer():
                yield f'** {before}'  # products, or a square root
        elif each.argval == 'hypot':
            yield 'hypot'
        before = each.argval if each.opname in ('LOAD_CONST', 'LOAD_SMALL_INT') else None


@pytest.mark.parametrize(
    'variant',
    [*variants(), *((name, {}) for name in ('adaptive', 'pmsm') if name in found())],
    ids=label,
)
def test_nothing_that_is_compiled_rounds_otherwise(variant):
    for batch in batches(variant):
        functions = called(batch, set())
        assert len(functions) > 10
        where = {each.__qualname__: list(rounds_otherwise(each.__code__)) for each in functions}
        assert {name: found for name, found in where.items() if found} == {}


@pytest.mark.parametrize(
    'text, seen',
    [
        ('x**2', ['** 2']),
        ('(x + 1.0) ** 2.0', ['** 2.0']),
        ('x**0.5', ['** 0.5']),
        ('x ** (1.0 / 3.0)', []),
        ('x**y', []),
        ('x * 2', []),
        ('math.hypot(x, y)', ['hypot']),
    ],
)
def test_what_rounds_otherwise_is_found(text, seen):
    assert list(rounds_otherwise(compile(text, 'no file', 'eval'))) == seen
