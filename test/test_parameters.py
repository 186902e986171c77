# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters: declared once, checked wherever they come from."""

import math
from array import array
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator_pkg import observers, params_file, streams, yaml_text
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.models.motor import MotorData
from estimator_pkg.parameters import build, declared, parameter, parse_assignments


@dataclass(frozen=True)
class Sample:
    rate: float = parameter(
        10.0, unit='Hz', range=(0.1, 100.0), description='a number', search=(1.0, 50.0)
    )
    count: int = parameter(3, unit='', range=(1, 9), description='a whole number')
    on: bool = parameter(True, unit='', description='a flag')
    form: str = parameter(
        'one',
        unit='',
        choices=('one', 'two', 'package.module:name'),
        description='a choice',
        structural=True,
    )
    scale: float | None = parameter(None, unit='s', range=(1e-6, 1.0), description='follows')
    names: tuple = parameter((), unit='', description='texts')


@pytest.mark.parametrize(
    'name, given_value, value',
    [
        ('rate', 20, 20.0),
        ('rate', 0.1, 0.1),
        ('rate', 100, 100.0),
        ('count', 4.0, 4),
        ('on', False, False),
        ('form', 'my.module:thing', 'my.module:thing'),
        ('scale', None, None),
        ('scale', 1, 1.0),
        ('names', ['a', 'b'], ('a', 'b')),
    ],
)
def test_good_values_come_out_in_their_type(name, given_value, value):
    got = getattr(build(Sample, {name: given_value}), name)
    assert got == value and type(got) is type(value)


@pytest.mark.parametrize(
    'name, value, words',
    [
        ('rate', 'fast', 'a number'),
        ('rate', True, 'a number'),
        ('rate', None, 'needs a value'),
        ('rate', math.nan, 'finite'),
        ('rate', math.inf, 'finite'),
        ('rate', 10**400, 'finite'),
        ('rate', 0.0999, 'outside [0.1, 100]'),
        ('rate', [1.0], 'a number'),
        ('count', 3.5, 'whole'),
        ('count', 10, 'outside [1, 9]'),
        ('on', 1, 'true or false'),
        ('form', 'three', 'one, two'),
        ('form', 3, 'text'),
        ('form', 'a:b:c', 'not one of'),
        ('names', 'a', 'list of texts'),
        ('names', [1], 'list of texts'),
    ],
)
def test_bad_values_are_refused_in_one_line_that_says_why(name, value, words):
    with pytest.raises(UsageError) as caught:
        build(Sample, {name: value})
    text = str(caught.value)
    assert f"'{name}'" in text and words in text and '\n' not in text
    assert caught.value.exit_code == 2


@dataclass(frozen=True)
class Automatic:
    """One parameter of each kind that may be left to the node."""

    above: float | None = parameter(None, unit='', range=(1e-6, 1.0), description='above 0')
    zero: float | None = parameter(None, unit='', range=(0.0, 1.0), description='0 or more')
    count: int | None = parameter(None, unit='', kind=int, range=(2, 3), description='whole')
    choice: str | None = parameter(None, unit='', kind=str, choices=('a', 'b'), description='one')
    texts: tuple | None = parameter(None, unit='', kind=tuple, description='texts')
    none: tuple = parameter((), unit='', description='texts')
    numbers: tuple | None = parameter(
        None, unit='', kind=list, range=(-1.0, 1.0), description='numbers'
    )


AUTOMATIC = {
    'above': '0.0',
    'zero': '-1.0',
    'count': '0',
    'choice': "''",
    'texts': "['']",
    'none': "['']",
    'numbers': '[.nan]',
}


def test_each_kind_has_a_value_that_means_automatic():
    known = declared(Automatic)
    assert {name: one.text(one.default) for name, one in known.items()} == AUTOMATIC
    for name, one in known.items():
        written = yaml_text.read(AUTOMATIC[name])
        assert type(written) is (list if one.kind is tuple else one.kind)
        assert one.check(written) is one.default
        assert one.range_text().endswith(f'; {AUTOMATIC[name]}: {one.automatic_text}')
    assert known['none'].automatic_text == 'none' and known['zero'].automatic_text == 'automatic'
    assert known['numbers'].check(array('d', [math.nan])) is None  # as a ROS message has it
    assert build(Automatic, {'above': 0, 'zero': -1, 'texts': [], 'numbers': []}) == Automatic()


@pytest.mark.parametrize(
    'name, value',
    [
        ('above', 5e-7),
        ('above', -1.0),
        ('zero', -0.5),
        ('count', 1),
        ('count', False),
        ('choice', 'c'),
        ('texts', ''),
        ('numbers', [math.nan, 1.0]),
        ('numbers', [-1.5]),
        ('above', math.nan),
    ],
)
def test_what_lies_between_the_range_and_the_automatic_value_is_refused(name, value):
    with pytest.raises(UsageError, match=f"'{name}'"):
        build(Automatic, {name: value})


def test_a_required_parameter_has_no_automatic_value():
    resistance = declared(MotorData)['resistance']
    assert resistance.automatic is None and resistance.plain(None) is None
    with pytest.raises(UsageError, match='outside'):
        resistance.check(0.0)
    with pytest.raises(ValueError, match='needs a default'):
        parameter(None, unit='', range=(-2.0, 2.0), description='no number is left')


def values_of(one):
    """Values of a parameter as they may come from a file, admitted or automatic."""
    low, high = one.minimum, one.maximum
    numbers = st.floats(low if low is not None else -1e9, high if high is not None else 1e9)
    admitted = {
        float: numbers,
        int: st.integers(int(low or 0), int(high or 0)),
        bool: st.booleans(),
        str: st.sampled_from([word for word in one.choices if ':' not in word] or ['a']),
        tuple: st.lists(st.text(), min_size=1),
        list: st.lists(numbers, min_size=1),
    }[one.kind]
    return admitted if one.automatic is None else admitted | st.just(one.plain(None))


EVERY = [
    (f'{cls.__module__}.{name}', one)
    for cls in [
        Automatic,
        *(stream.SETTINGS for stream in streams.every()),
        *(stream.PER_JOINT for stream in streams.every()),
        *(observers.find(name).gains for name in observers.names()),
    ]
    for name, one in declared(cls).items()
]


@pytest.mark.long
@given(st.data())
def test_what_a_file_says_comes_back_whatever_the_parameter(data):
    """File to Python and back, and through YAML: nothing changes but an automatic value's name."""
    _, one = data.draw(st.sampled_from(EVERY))
    written = data.draw(values_of(one))
    value = one.check(written)
    back = one.plain(value)
    assert type(back) is (list if one.kind is tuple else one.kind)
    assert repr(one.plain(one.check(back))) == repr(back)
    again = one.check(yaml_text.read(one.text(value)))
    assert again == value and type(again) is type(value)
    if one.automatic is None or repr(written) != repr(one.plain(None)):
        assert written == value or list(written) == list(value) or one.is_automatic(written)


def test_an_unknown_name_suggests_the_nearest_or_lists_all():
    with pytest.raises(UsageError, match=r"^unknown parameter 'rte' of my: did you mean 'rate'\?$"):
        build(Sample, {'rte': 1.0}, owner='my')
    assert suggestion('xyz', ['one', 'two']) == 'known: one, two'
    assert suggestion('xyz', []) == 'none is known'


@pytest.mark.parametrize(
    'text, value',
    [
        ('rate=20', 20),
        ('rate=1e-3', 1e-3),
        ('rate=1E3', 1000.0),
        ('form=one', 'one'),
        ('on=true', True),
        ('scale=', None),
        ('names=[a, b]', ['a', 'b']),
        ('form=a=b', 'a=b'),
        ('form=a: b: c', 'a: b: c'),
        (' rate =3', 3),
    ],
)
def test_assignments_are_read_as_yaml(text, value):
    (got,) = parse_assignments([text]).values()
    assert got == value and type(got) is type(value)


@pytest.mark.parametrize('text', ['rate', '=3', ''])
def test_assignments_without_a_name_or_value_are_refused(text):
    with pytest.raises(UsageError) as caught:
        parse_assignments([text])
    assert 'key=value' in str(caught.value)


@pytest.mark.parametrize('joint', ['=', 'a=b', '=a.b=', 'a.b', 'rate=3', ' ', "it's\n"])
def test_the_name_of_a_joint_may_have_any_character(joint):
    name = f'per_joint.{joint}.rate'
    assert parse_assignments([f'{name}=2', 'form=a=b']) == {name: 2, 'form': 'a=b'}
    assert params_file.override(name) == (joint, 'rate')
