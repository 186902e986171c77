# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The errors of a wrong record declaration. test/engine tests the three forms of a record."""

from types import ModuleType
from typing import Annotated

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator_pkg.record import record


@record
class Track:
    """Generic over the observer."""

    state: 'observer.State'  # noqa: F821


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


@pytest.mark.parametrize('body', [{}, {'__annotations__': {'x': float}, 'x': 1.0}])
def test_values_and_methods_are_refused(body):
    with pytest.raises(TypeError, match='record Bad has fields only, without values'):
        record(type('Bad', (), body))


def test_a_generic_record_is_one_class_for_each_module():
    with pytest.raises(TypeError, match=r'observer.State is not known: use .of\(module\)'):
        Track()
    line, curve = ModuleType('line'), ModuleType('curve')
    line.State = curve.State = record(type('State', (), {'__annotations__': {'x': list[float]}}))
    assert Track.of(line) is Track.of(line) is not Track.of(curve)
    with pytest.raises(TypeError, match='a list without a length is for plain Python only'):
        Track.of(line).dtype  # noqa: B018


def test_an_array_is_taken_as_it_is_and_for_plain_python_only():
    kind = record(type('State', (), {'__annotations__': {'x': NDArray[np.float64], 'y': float}}))
    one, other = kind(), kind()
    one.x = np.array([1.0, 2.0])
    other.take(one)
    assert other.x is one.x
    with pytest.raises(TypeError, match=r'an array .* is for plain Python only'):
        kind.dtype  # noqa: B018
