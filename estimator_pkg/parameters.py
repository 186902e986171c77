# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters declared once, as fields of a frozen dataclass.

ROS parameter descriptors, YAML files, command-line ``--set``, the tuner's search space and the
tables of docs/ are all made from these declarations.

>>> @dataclass(frozen=True)
... class Gains:
...     bandwidth_hz: float = parameter(15.0, unit='Hz', range=(0.01, 1e4), description='...')
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, TypeVar

from estimator_pkg import params_file, yaml_text
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.yaml_text import Word

T = TypeVar('T')


@dataclass(frozen=True)
class Parameter:
    """What is declared of one parameter.

    ``kind`` is float, int, bool, str, tuple (a list of texts) or list (of numbers, checked into a
    tuple of floats). ``default`` None means: follows from the others or from the data. ROS and YAML
    have no None and write ``automatic`` for it, a value of the same kind outside the range. A user
    must set a parameter whose default is None and which has no ``automatic``.
    ``structural`` ones cannot change while a node runs. ``search`` marks what the tuner
    varies, and between which numbers; ``among`` does so for a choice. The default is valid next to
    the choices.
    """

    name: str
    kind: type
    default: Any
    unit: str
    description: str
    automatic: Any = None
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    equation: str = ''
    structural: bool = False
    advanced: bool = False
    search: tuple[float, float] | None = None
    among: tuple[str, ...] = ()

    def check(self, value: Any) -> Any:
        """`value` as this parameter's type; the default for the automatic value.

        Raises
        ------
        UsageError : wrong type, not finite, out of range, or not among the choices.
        """
        if getattr(value, 'ndim', None) == 0:
            value = value.item()  # NumPy's numbers
        if value is None:
            if self.default is None:
                return None
            raise UsageError(f"parameter '{self.name}' needs a value")
        if self.is_automatic(value):
            return self.default
        if self.kind is bool:
            if isinstance(value, Word):
                value = value.truth
            if not isinstance(value, bool):
                raise UsageError(f"parameter '{self.name}' must be true or false, not {value!r}")
            return value
        if self.kind is str:
            if value != value and 'nan' in self.choices:
                value = 'nan'  # ROS reads this word as a number
            if not isinstance(value, str):
                kind = f'text, one of {", ".join(self.choices)}' if self.choices else 'text'
                raise UsageError(
                    f"parameter '{self.name}' must be {kind}, not {value!r}" + self._quotes(value)
                )
            if (
                self.choices
                and value not in self.choices
                and value != self.default
                and not self._open_choice(value)
            ):
                raise UsageError(
                    f"parameter '{self.name}': '{value}' is not one of {', '.join(self.choices)}"
                    + self._or_automatic()
                )
            return str(value)
        if self.kind is tuple:
            if not isinstance(value, (list, tuple)) or not all(isinstance(v, str) for v in value):
                raise UsageError(
                    f"parameter '{self.name}' must be a list of texts, not {value!r}"
                    + self._quotes(value)
                )
            return tuple(map(str, value))
        if self.kind is list:
            one = dataclasses.replace(self, kind=float, default=0.0, automatic=None)
            many = isinstance(value, Iterable) and not isinstance(value, str)
            try:
                return tuple(one.check(number) for number in (value if many else (value,)))
            except UsageError as error:
                raise UsageError(f'{error}{self._or_automatic()}') from None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise UsageError(f"parameter '{self.name}' must be a number, not {value!r}")
        if not abs(value) <= sys.float_info.max:  # NaN, infinite, or an int beyond any float
            raise UsageError(f"parameter '{self.name}' must be finite, not {value!r}")
        if self.kind is int:
            if value != int(value):
                raise UsageError(f"parameter '{self.name}' must be a whole number, not {value!r}")
            value = int(value)
        else:
            value = float(value)
        low, high = self.minimum, self.maximum
        if (low is not None and value < low) or (high is not None and value > high):
            raise UsageError(f"parameter '{self.name}' = {value:g} is outside {self.range_text()}")
        return value

    def plain(self, value: Any) -> Any:
        """`value`, as `check` returns it, for ROS and YAML: the automatic value instead of None.

        None remains where a user must set the parameter.
        """
        if self.automatic is not None and value in (None, ()):
            value = self.automatic
        return list(value) if isinstance(value, tuple) else value

    def text(self, value: Any) -> str:
        """`value`, as `check` returns it, as it is written in a parameter file."""
        return yaml_text.scalar(self.plain(value))

    @property
    def automatic_text(self) -> str:
        """What the automatic value means, for a person; '' where there is none."""
        if self.automatic is None:
            return ''
        return 'automatic' if self.default is None else 'none'

    def _or_automatic(self) -> str:
        """The automatic value and what it means, as the end of a sentence."""
        if self.automatic is None:
            return ''
        return f'; {self.text(self.automatic)}: {self.automatic_text}'

    def is_automatic(self, value: Any) -> bool:
        """True if `value`, from ROS or YAML, is the automatic one."""
        many = isinstance(value, Iterable) and not isinstance(value, str)
        if not isinstance(self.automatic, tuple):
            return self.automatic is not None and not many and _same(value, self.automatic)
        if not many and self.kind is tuple:
            return False
        items = list(value) if many else [value]
        return not items or (len(items) == 1 and _same(items[0], self.automatic[0]))

    def _open_choice(self, value: str) -> bool:
        """Choices that end in 'package.module:name' also admit a user's own."""
        return 'package.module:name' in self.choices and value.count(':') == 1

    def _quotes(self, value: Any) -> str:
        """How to write the text that YAML made `value` of; '' where nothing is known of it."""
        many = isinstance(value, (list, tuple))
        items = value if many else (value,)
        found = [each for each in items if not isinstance(each, str)]
        if not found or not all(isinstance(each, (bool, int, float)) for each in found):
            return ''
        if self.choices:  # which of them was meant is not known
            texts = [self.default or self.choices[0]]
        else:
            texts = [each if isinstance(each, str) else _text_of(each) for each in items]
        said = ', '.join(f"'{text}'" for text in texts)
        why = (
            'y, n, yes, no, on and off are booleans in YAML'
            if any(isinstance(each, bool) for each in found)
            else 'YAML reads a number'
        )
        if many or self.kind is tuple:
            said = f'[{said}]'
        return f': {why}; write texts in quotes, {self.name}: {said}'

    def range_text(self) -> str:
        """The admitted values, for a person."""
        return self._true_range() + self._or_automatic()

    def _true_range(self) -> str:
        """The admitted values apart from the automatic one."""
        if self.choices:
            return ' | '.join(self.choices)
        if self.kind is bool:
            return 'true | false'
        if self.kind is tuple:
            return 'a list of texts'
        each = 'each ' if self.kind is list else ''
        if self.minimum is None and self.maximum is None:
            return 'numbers' if each else 'any'
        low = '-inf' if self.minimum is None else f'{self.minimum:g}'
        high = 'inf' if self.maximum is None else f'{self.maximum:g}'
        return f'{each}[{low}, {high}]'


def parameter(
    default: Any,
    *,
    description: str,
    unit: str = '',
    range: tuple[float | None, float | None] | None = None,
    choices: tuple[str, ...] = (),
    equation: str = '',
    structural: bool = False,
    advanced: bool = False,
    search: tuple[float, float] | None = None,
    among: tuple[str, ...] = (),
    kind: type | None = None,
    required: bool = False,
) -> Any:
    """A dataclass field that carries its declaration (see `Parameter`).

    ``kind`` is needed only where the default is None (a value that follows from others).
    ``required``: None is the default and a user must set it. Without ``unit`` it has none.

    Raises
    ------
    ValueError : the default is None, and the range leaves no number for the automatic value.
    """
    low, high = range or (None, None)
    kind = kind or (float if default is None else type(default))
    automatic = None if required or default not in (None, ()) else _automatic(kind, low)
    declared = {
        'kind': kind,
        'default': default,
        'automatic': automatic,
        'unit': unit,
        'description': description,
        'minimum': low,
        'maximum': high,
        'choices': choices,
        'equation': equation,
        'structural': structural,
        'advanced': advanced,
        'search': search,
        'among': among,
    }
    return dataclasses.field(default=default, metadata={'parameter': declared})


structural = partial(parameter, structural=True)


def declared(cls: type) -> dict[str, Parameter]:
    """The parameters of a declaring dataclass by name: its own in their order, then inherited ones.

    What a class adds to those it shares with others is what users set first.
    """
    return dict(_declared(cls))


@cache
def _declared(cls: type) -> dict[str, Parameter]:
    own = inspect.get_annotations(cls)
    fields = sorted(dataclasses.fields(cls), key=lambda field: field.name not in own)
    return {
        field.name: Parameter(name=field.name, **field.metadata['parameter'])
        for field in fields
        if 'parameter' in field.metadata
    }


def build(cls: type[T], values: Mapping[str, Any], *, owner: str = '') -> T:
    """An instance of the declaring dataclass `cls` from checked `values`.

    Raises
    ------
    UsageError : an unknown name (the nearest one is suggested) or a bad value.
    """
    known = declared(cls)
    checked = {}
    for name, value in values.items():
        if name not in known:
            of = f' of {owner}' if owner else ''
            raise UsageError(f"unknown parameter '{name}'{of}: {suggestion(name, known)}")
        checked[name] = known[name].check(value)
    return cls(**checked)


def _automatic(kind: type, low: float | None) -> Any:
    """The value of this kind that ROS and YAML have instead of None and of an empty list.

    It is 0, or -1 where the range includes 0, or '', [''] or [nan].
    """
    texts: dict[type, Any] = {str: '', tuple: ('',), list: (math.nan,)}
    if kind in texts:
        return texts[kind]
    if low is None or low < 0.0 or kind is bool:
        raise ValueError('a parameter whose range has -1, or a boolean, needs a default')
    return kind(-1 if low == 0.0 else 0)


def _same(value: Any, other: Any) -> bool:
    """Whether both are equal, or both NaN."""
    if isinstance(value, bool):
        return False
    return bool(value == other or (value != value and other != other))


def _text_of(value: bool | float) -> str:
    """A text that YAML, unquoted, reads as `value`."""
    return {True: 'y', False: 'n'}[value] if isinstance(value, bool) else f'{value:g}'


_OF_JOINT = re.compile(rf'{params_file.OVERRIDES}\..+\.\w+\s*(?==)', re.DOTALL)


def parse_assignments(pairs: list[str]) -> dict[str, Any]:
    """``['bandwidth_hz=20', 'form=paper']`` as a dictionary; values are read as YAML.

    Texts need no quotes: off, y or 1:30 is a text where a text is needed. The name of a joint may
    contain '=' and '.', as in ``per_joint.=.bandwidth_hz=20``.

    Raises
    ------
    UsageError : a pair without '='.
    """
    values: dict[str, Any] = {}
    for pair in pairs:
        of_joint = _OF_JOINT.match(pair)
        end = of_joint.end() if of_joint else pair.find('=')
        name, text = pair[:end], pair[end + 1 :]
        if end <= 0:
            raise UsageError(f"'{pair}' is not key=value")
        values[name.strip()] = yaml_text.of_command_line(text)
    return values
