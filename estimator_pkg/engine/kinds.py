# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What an expression may be: numbers, records, vectors, arrays and modules."""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .sources import Found, Module, Outside, Sources

REMEDY = 'annotate a number, a record, Annotated[list[...], N], list[...] or NDArray[...]'


@dataclass(frozen=True)
class Kind:
    """A number; ``c`` is its type in C and ``code`` its letter for `load`."""

    text: str
    c: str
    code: str = ''

    def __str__(self) -> str:
        return self.text


FLOAT = Kind('float', 'double', 'd')
INT = Kind('int', 'int64_t', 'q')
BOOL = Kind('bool', 'bool', '?')
COMPLEX = Kind('complex', 'Complex')
VALUES = FLOAT, INT, BOOL, COMPLEX
WHOLE = Kind('whole number of math.floor or math.ceil', 'double')  # an int that C has as a double
NOTHING = Kind('nothing', 'void')
NUMBERS = {'float': FLOAT, 'int': INT, 'bool': BOOL, 'complex': COMPLEX}
ELEMENTS = {'float64': FLOAT, 'int64': INT, 'bool_': BOOL, 'complex128': COMPLEX}  # of numpy arrays
ELEMENTS |= {name: Kind('int', f'{name}_t') for name in ('int32', 'int8', 'uint8')}


@dataclass(frozen=True)
class Record:
    """A record class, and the observer's module where it is generic."""

    module: Module
    node: ast.ClassDef
    observer: Module | None

    def __str__(self) -> str:
        return f'record {self.node.name}'

    @property
    def declared(self) -> list[Any]:
        """The nodes of its fields."""
        return [item for item in self.node.body if isinstance(item, ast.AnnAssign)]


@dataclass(frozen=True)
class Vector:
    """A vector of a record, or a row of a matrix."""

    count: int
    of: Any

    def __str__(self) -> str:
        return f'vector of {self.count} {self.of}'


@dataclass(frozen=True)
class Array:
    """A pointer to the first of some numbers, or of some pointers to records."""

    of: Any

    def __str__(self) -> str:
        return f'array of {self.of}'


@dataclass(frozen=True)
class Static:
    """A module, known at translation."""

    module: Module

    def __str__(self) -> str:
        return f'module {self.module.name}'


POINTERS = (Record, Vector, Array)
ALIASES = (ast.Subscript, ast.Name, ast.Attribute)


def is_matrix(kind: Any) -> bool:
    """Whether it is a vector of vectors, to which C99 has no pointer that adds a const."""
    return isinstance(kind, Vector) and isinstance(kind.of, Vector)


class Kinds:
    """Annotations as kinds."""

    def __init__(self, sources: Sources) -> None:
        self.sources = sources
        self._fields: dict[Record, dict[str, Any]] = {}

    def of(self, node: Any, module: Module, static: Mapping[str, Module]) -> Any:
        """Return the kind that an annotation says; None for Any and for what needs an observer."""
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node = ast.copy_location(ast.parse(node.value, mode='eval').body, node)
        if isinstance(node, ast.Subscript):
            return self._subscript(node, module, static)
        found = self.sources.dotted(module, node, {'observer': None, **static})
        if found is None and ast.unparse(node).startswith('observer.'):
            return None
        if found is None and ast.unparse(node) in NUMBERS:
            return NUMBERS[ast.unparse(node)]
        if found == Outside('typing.Any'):
            return None
        if isinstance(found, Found) and isinstance(found.node, ast.ClassDef):
            return self._record(found, static.get('observer'))
        if isinstance(found, Found) and isinstance(found.node, ALIASES):
            return self.of(found.node, found.module, static)  # an alias
        return module.refuse(node, f'{ast.unparse(node)!r} is not translated: {REMEDY}')

    def fields(self, record: Record) -> dict[str, Any]:
        """Return the kind of each field of a record, None for one that needs an observer."""
        if record not in self._fields:
            static = {'observer': record.observer} if record.observer else {}
            self._fields[record] = {
                node.target.id: self.of(node.annotation, record.module, static)
                for node in record.declared
            }
            for node in record.declared:
                if isinstance(self._fields[record][node.target.id], Array):
                    record.module.refuse(node, f'{node.target.id} has no size: {REMEDY}')
        return self._fields[record]

    def _record(self, found: Found, observer: Module | None) -> Record | None:
        if not any(ast.unparse(mark) == 'record' for mark in found.node.decorator_list):
            found.module.refuse(found.node, f'{found.name} is no record: decorate it with @record')
        for chosen in (None, observer):
            record = Record(found.module, found.node, chosen)
            if all(self.fields(record).values()):
                return record
        return None

    def _subscript(self, node: ast.Subscript, module: Module, static: Mapping[str, Module]) -> Any:
        name, inner = ast.unparse(node.value).split('.')[-1], node.slice
        if name == 'NDArray' and ast.unparse(inner).split('.')[-1] in ELEMENTS:
            return Array(ELEMENTS[ast.unparse(inner).split('.')[-1]])
        if name == 'list':
            kind = self.of(inner, module, static)
            return kind and Array(kind)
        if name == 'Annotated' and isinstance(inner, ast.Tuple):
            kind, *counts = inner.elts
            for _ in counts:  # list[list[float]] to float
                kind = kind.slice if isinstance(kind, ast.Subscript) else kind
            kind = self.of(kind, module, static)
            for item in reversed(counts):
                count = self.sources.constant(Found(module, ast.unparse(item), item))
                kind = kind and Vector(count, kind)
            return kind
        return module.refuse(node, f'{ast.unparse(node)!r} is not translated: {REMEDY}')
