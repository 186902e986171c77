# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Records as plain objects and as elements of arrays."""

import copy
import math
import pickle
import subprocess
import sys
from types import ModuleType
from typing import Annotated

import numpy as np
import pytest

from estimator_pkg.record import record

SIZE = 3


@record
class Inner:
    """A record in a record."""

    a: float  # [rad]
    seen: bool


@record
class Outer:
    """All kinds of fields."""

    x: float
    flag: bool
    n: int
    steps: Annotated[list[float], SIZE]
    marks: Annotated[list[int], 2]
    p: Annotated[list[list[float]], 2, SIZE]
    inner: Inner
    each: Annotated[list[Inner], 2]
    grid: Annotated[list[list[Inner]], 2, 2]


@record
class Track:
    """Generic over the observer."""

    state: 'observer.State'  # noqa: F821
    states: 'Annotated[list[observer.State], 2]'  # noqa: F821
    kept: Annotated[list['observer.State'], 2]  # noqa: F821


@record
class Joint:
    """Generic by a field."""

    track: Track
    inner: Inner


def filled():
    made = Outer()
    made.x, made.flag, made.n = math.pi, True, 2**62 + 1
    made.steps[1], made.marks[0], made.p[1][2] = -0.0, -(2**63), 5e-324
    made.inner.seen, made.each[1].a, made.grid[1][0].a = True, math.inf, 7.0
    return made


def test_a_new_record_is_all_zeros():
    assert repr(Outer()) == (
        'Outer(x=0.0, flag=False, n=0, steps=[0.0, 0.0, 0.0], marks=[0, 0], '
        'p=[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], inner=Inner(a=0.0, seen=False), '
        'each=[Inner(a=0.0, seen=False), Inner(a=0.0, seen=False)], '
        'grid=[[Inner(a=0.0, seen=False), Inner(a=0.0, seen=False)], '
        '[Inner(a=0.0, seen=False), Inner(a=0.0, seen=False)]])'
    )
    rows = Outer().p
    assert rows[0] is not rows[1]


def test_a_record_has_slots():
    with pytest.raises(AttributeError):
        Outer().other = 1.0
    assert not hasattr(Outer(), '__dict__') and Outer.__doc__ == 'All kinds of fields.'


def test_take_copies_all_in_place():
    made, kept = filled(), Outer()
    places = kept.steps, kept.p[1], kept.inner, kept.each[1], kept.grid[1][0]
    kept.take(made)
    assert repr(kept) == repr(made)
    assert all(
        a is b
        for a, b in zip(places, (kept.steps, kept.p[1], kept.inner, kept.each[1], kept.grid[1][0]))
    )
    made.steps[0], made.p[0][0], made.grid[1][0].a, made.inner.a = 1.0, 2.0, 3.0, 4.0
    assert kept.steps[0] == kept.p[0][0] == kept.inner.a == 0.0 and kept.grid[1][0].a == 7.0


def test_an_element_of_an_array_has_the_same_values():
    array = np.zeros(2, Outer.dtype)
    filled().write(array[1])
    assert array['n'].tolist() == [0, 2**62 + 1]
    again = Outer.read(array[1])
    assert repr(again) == repr(filled()) and type(again.n) is int and type(again.flag) is bool
    assert repr(Outer.read(array[0])) == repr(Outer())
    assert array.dtype.isalignedstruct and array.dtype['inner'].itemsize == 16


def test_a_generic_record_is_bound_to_a_module():
    line, curve = ModuleType('line'), ModuleType('curve')
    line.State, curve.State = Inner, Outer
    assert Joint.of(line) is Joint.of(line) and Joint.of(line) is not Joint.of(curve)
    assert Inner.of(line) is Inner
    made = Joint.of(curve)()
    made.track.kept[1].n = 3
    array = np.zeros(1, Joint.of(curve).dtype)
    made.write(array[0])
    assert repr(Joint.of(curve).read(array[0])) == repr(made)
    assert repr(Joint.of(line)()).startswith(
        'Joint.of(line)(track=Track.of(line)(state=Inner(a=0.0'
    )


def test_a_generic_record_without_module_is_refused():
    with pytest.raises(TypeError, match=r'observer.State is not known: use .of\(module\)'):
        Joint()


def test_records_are_copied_and_sent_to_processes():
    assert (
        repr(copy.deepcopy(filled()))
        == repr(pickle.loads(pickle.dumps(filled())))
        == repr(filled())
    )


def test_numpy_is_imported_with_the_first_dtype():
    code = (
        'import sys\nfrom estimator_pkg.record import record\n'
        '@record\nclass A:\n    x: float\n'
        "A().x = 1.0\nassert 'numpy' not in sys.modules\n"
        "print(A.dtype, 'numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith(' True\n')


@pytest.mark.parametrize(
    ('hint', 'message'),
    [
        (str, 'is no number, record or Annotated'),
        (list[str], 'is no number, record or Annotated'),
        (Annotated[list[float], 0], r'write Annotated\[list\[float\], N\], an int N > 0'),
        (Annotated[list[float], 2.5], 'an int N > 0'),
        (Annotated[float, 2], 'is no vector'),
        (Annotated[list[float], 2, 2], 'is no vector'),
        (Annotated[list[str], 2], 'is no number, record'),
    ],
)
def test_a_field_that_c_does_not_have_is_refused(hint, message):
    with pytest.raises(TypeError, match=rf'Bad.x: .*{message}'):
        record(type('Bad', (), {'__annotations__': {'x': hint}}))


def test_a_list_without_a_length_is_copied_whole_and_has_no_c():
    hints = {'steps': list[float], 'rows': list[list[float]]}
    made = record(type('Free', (), {'__annotations__': hints}))
    one, other = made(), made()
    assert one.steps == one.rows == []
    one.steps, one.rows = [1.0, 2.0], [[3.0], [4.0, 5.0]]
    other.take(one)
    one.steps[0], one.rows[1][0] = 0.0, 0.0
    assert other.steps == [1.0, 2.0] and other.rows == [[3.0], [4.0, 5.0]]
    with pytest.raises(TypeError, match='a list without a length is for plain Python only'):
        made.dtype  # noqa: B018


@pytest.mark.parametrize('body', [{}, {'__annotations__': {'x': float}, 'x': 1.0}])
def test_values_and_methods_are_refused(body):
    with pytest.raises(TypeError, match='record Bad has fields only, without values'):
        record(type('Bad', (), body))
