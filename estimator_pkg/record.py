# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Records: named numbers that functions update in place. One declaration, three forms.

::

    @record
    class Motion:
        position: float  # [rad]
        seen: bool
        steps: Annotated[list[float], 8]  # a vector; Annotated[list[list[float]], 3, 3] is a matrix
        poles: list[float]  # as long as the user's numbers make it, in plain Python only
        gain: NDArray  # in plain Python only; replaced as a whole, never changed in place
        inner: Bias  # a record
        state: 'observer.State'  # of the observer's module: `Motion.of(module)` is the class

- plain: ``Motion()`` is an object with slots, all zeros;
- arrays: an element of an array of ``Motion.dtype`` is the C struct;
- C99: :mod:`estimator_pkg.engine` reads the same declaration.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

Declared = TypeVar('Declared')
SCALARS: dict[Any, str] = {float: 'f8', int: 'i8', bool: '?', complex: 'c16'}
ARRAY = object  # the kind of a field that is a numpy array


class Vector(NamedTuple):
    """The kind of a field of ``size`` values of one kind."""

    size: int  # 0: as many as `start` or `design` makes, in plain Python only
    kind: Any  # float, int, bool, a record or a Vector


class _Observer:
    """What ``observer`` is in an annotation, and ``observer.State``, which `_bound` replaces."""

    generic = True

    def __init__(self, name: str = '') -> None:
        self.name = name

    def __getattr__(self, name: str) -> _Observer:
        return _Observer(name)

    def __call__(self) -> Any:
        raise TypeError(f'observer.{self.name} is not known: use .of(module) of this record')


class _RecordClass(type):
    """The class of record classes."""

    fields: dict[str, Any]  # kind of each field
    generic: bool
    _bindings: dict[Any, Any]
    _dtype: Any

    @property
    def dtype(cls) -> Any:
        """Numpy dtype with the layout of the C struct; the only place that imports numpy."""
        if cls._dtype is None:
            import numpy as np

            fields = [(name, _numpy_type(kind)) for name, kind in cls.fields.items()]
            cls._dtype = np.dtype(fields, align=True)
        return cls._dtype

    def of(cls, module: Any) -> Any:
        """Return the class with the records of an observer's module; itself if it needs none."""
        if not cls.generic:
            return cls
        if module not in cls._bindings:
            fields = {name: _bound(kind, module) for name, kind in cls.fields.items()}
            name = f'{cls.__name__}.of({module.__name__})'
            cls._bindings[module] = _class(name, fields, cls.__module__, cls.__doc__)
        return cls._bindings[module]

    def read(cls, element: Any) -> Any:
        """Return a new record with the values of an element of an array of `dtype`."""
        return cls.made(element.tolist())

    def made(cls, values: Any) -> Any:
        """Return a new record with these values, as the function `values` returns them."""
        return _made(cls, values)

    def view(cls, element: Any) -> Any:
        """Return a `View` of an element of an array of `dtype`."""
        return View(cls, element)


class View:
    """A record in an array: a field is read when it is named, and cannot be set."""

    __slots__ = ('_element', '_kind')

    def __init__(self, kind: Any, element: Any) -> None:
        self._kind, self._element = kind, element

    def __getattr__(self, name: str) -> Any:
        kind, value = self._kind.fields[name], self._element[name]
        if isinstance(kind, Vector):
            return _made(kind, value.tolist())
        return View(kind, value) if isinstance(kind, _RecordClass) else value.item()


class _Record:
    __slots__ = ()

    def write(self, element: Any) -> None:
        """Write all values to an element of an array of `dtype`."""
        kind: Any = type(self)
        for name, value in zip(kind.fields, values(kind, self)):
            element[name] = value

    def __repr__(self) -> str:
        kind: Any = type(self)
        fields = ', '.join(f'{name}={getattr(self, name)!r}' for name in kind.fields)
        return f'{kind.__name__}({fields})'


def _kind(hint: Any) -> Any:
    """Return the kind that an annotation says."""
    if get_origin(hint) is list:
        return Vector(0, _kind(*get_args(hint)))
    if getattr(get_origin(hint), '__name__', '') == 'ndarray':
        return ARRAY
    inner, *counts = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    for count in counts:
        if get_origin(inner) is not list or type(count) is not int or count < 1:
            raise TypeError(f'{hint} is no vector: write Annotated[list[float], N], an int N > 0')
        (inner,) = get_args(inner)
    if isinstance(inner, str) and inner.startswith('observer.'):  # Python 3.10 leaves it as text
        inner = _Observer(inner[9:])
    if not (inner in SCALARS or isinstance(inner, (_Observer, _RecordClass))):
        raise TypeError(f'{inner} is no number, record or Annotated[list[...], N]')
    for count in reversed(counts):
        inner = Vector(count, inner)
    return inner


def _bound(kind: Any, module: Any) -> Any:
    if isinstance(kind, Vector):
        return Vector(kind.size, _bound(kind.kind, module))
    if isinstance(kind, _Observer):
        kind = getattr(module, kind.name)
    return kind.of(module) if isinstance(kind, _RecordClass) else kind


def _numpy_type(kind: Any) -> Any:
    if kind is ARRAY or (isinstance(kind, Vector) and kind.size == 0):
        raise TypeError('an array or a list without a length is for plain Python only')
    if isinstance(kind, Vector):
        return _numpy_type(kind.kind), (kind.size,)
    return kind.dtype if isinstance(kind, _RecordClass) else SCALARS[kind]


def values(kind: Any, value: Any) -> Any:
    """Return a value as numpy assigns it: records as tuples, vectors as lists."""
    if isinstance(kind, Vector):
        return [values(kind.kind, item) for item in value]
    if isinstance(kind, _RecordClass):
        return tuple(values(inner, getattr(value, name)) for name, inner in kind.fields.items())
    return value


def _made(kind: Any, values: Any) -> Any:
    """Return a value from what numpy's ``tolist`` makes of it."""
    if isinstance(kind, Vector):
        return [_made(kind.kind, item) for item in values]
    if kind is ARRAY:
        return values
    if not isinstance(kind, _RecordClass):
        return kind(values)
    made = kind()
    for (name, inner), value in zip(kind.fields.items(), values):
        setattr(made, name, _made(inner, value))
    return made


def _zeros(kind: Any, name: str) -> str:
    """Return the expression of a zero; ``name`` is that of its record class, if it has one."""
    if isinstance(kind, Vector) and kind.kind in SCALARS:
        return f'[{kind.kind()}] * {kind.size}'
    if isinstance(kind, Vector):
        return f'[{_zeros(kind.kind, name)} for _ in range({kind.size})]'
    if kind is ARRAY:
        return 'None'
    return str(kind()) if kind in SCALARS else f'{name}()'


def _copy(kind: Any, to: str, of: str, pad: str = '    ') -> str:
    """Return the statements that copy a field in place."""
    if isinstance(kind, Vector) and kind.kind in SCALARS:
        return f'{pad}{to}[:] = {of}\n'
    if isinstance(kind, Vector) and kind.size == 0:
        return f'{pad}{to} = deepcopy({of})\n'
    if isinstance(kind, Vector):
        inner = _copy(kind.kind, 'a', 'b', pad + '    ')
        return f'{pad}for a, b in zip({to}, {of}):\n{inner}'
    return f'{pad}{to} = {of}\n' if kind in SCALARS or kind is ARRAY else f'{pad}{to}.take({of})\n'


def _class(name: str, fields: dict[str, Any], module: str, doc: str | None) -> Any:
    """Return the class of a record.

    Two methods are compiled from text, as those of a dataclass are: a loop over the names of the
    fields takes ten times as long, and `take` runs for each sample.
    """
    start, copy, leaves = '', '', {}
    for field, kind in fields.items():
        start += f'    self.{field} = {_zeros(kind, field)}\n'
        copy += _copy(kind, f'self.{field}', f'other.{field}')
        while isinstance(kind, Vector):
            kind = kind.kind
        leaves[field] = kind
    made: dict[str, Any] = {}
    names: dict[str, Any] = {**leaves, 'deepcopy': deepcopy}
    exec(f'def __init__(self):\n{start}\ndef take(self, other):\n{copy}', names, made)
    made['take'].__doc__ = 'Copy all fields of another record of this class.'
    made |= {'__slots__': tuple(fields), '__module__': module, '__doc__': doc}
    cls: Any = _RecordClass(name, (_Record,), made)
    cls.generic = any(getattr(kind, 'generic', False) for kind in leaves.values())
    cls.fields, cls._bindings, cls._dtype = fields, {}, None
    return cls


def record(declared: type[Declared]) -> type[Declared]:
    """Make a record of a class whose body has annotations and nothing else."""
    hints = get_type_hints(declared, localns={'observer': _Observer()}, include_extras=True)
    others = [name for name in vars(declared) if not name.startswith('__')]
    if others or not hints:
        raise TypeError(f'record {declared.__name__} has fields only, without values: {others}')
    fields = {}
    for name, hint in hints.items():
        try:
            fields[name] = _kind(hint)
        except TypeError as error:
            raise TypeError(f'{declared.__name__}.{name}: {error}') from None
    made: type[Declared] = _class(declared.__name__, fields, declared.__module__, declared.__doc__)
    made.__qualname__ = declared.__qualname__
    return made


def plain(function: Declared) -> Declared:
    """Mark a function that is no part of the engine: there it gives nan, and is never reached."""
    return function
