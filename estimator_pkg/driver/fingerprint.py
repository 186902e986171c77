"""What a function is, down to all that it calls: the key under which its compiled form is kept."""

from __future__ import annotations

import dis
import hashlib
import types
from collections.abc import Iterator
from typing import Any


def global_names(code: types.CodeType) -> set[str]:
    """The globals that the code reads. Attributes do not count: `math.sin` is no global `sin`."""
    names = {instruction.argval for instruction in dis.get_instructions(code)
             if instruction.opname == 'LOAD_GLOBAL'}
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= global_names(constant)
    return names


def fingerprint(function: types.FunctionType) -> str:
    """A digest of the function's code, of what it closes over and of the globals it reads.

    Equal in every process for the same sources; another one as soon as any function that it calls,
    or a constant that one of them uses, has changed.
    """
    digest = hashlib.sha256()
    for part in _parts(function, set()):
        digest.update(part.encode('utf-8', 'surrogatepass') + b'\0')
    return digest.hexdigest()


def _parts(value: Any, seen: set[int]) -> Iterator[str]:
    if isinstance(value, types.FunctionType):
        if id(value) in seen:
            yield f'seen {value.__qualname__}'
            return
        seen.add(id(value))
        yield f'of {value.__module__}'  # what is kept is loaded by importing this module
        yield from _parts(value.__code__, seen)
        yield from _parts(value.__defaults__, seen)
        for cell in value.__closure__ or ():
            yield from _parts(cell.cell_contents, seen)
        for name in sorted(global_names(value.__code__)):
            yield name
            yield from _parts(value.__globals__.get(name), seen)
    elif isinstance(value, types.CodeType):
        yield value.co_code.hex()
        yield repr((value.co_names, value.co_varnames, value.co_freevars, value.co_argcount))
        for constant in value.co_consts:
            yield from _parts(constant, seen)
    elif isinstance(value, tuple):
        yield f'{type(value).__name__} of {len(value)}'
        for item in value:
            yield from _parts(item, seen)
    elif isinstance(value, frozenset):  # whose order differs from process to process
        yield repr(sorted(map(repr, value)))
    elif isinstance(value, (types.ModuleType, types.BuiltinFunctionType, type)):
        yield f'{getattr(value, "__module__", "")} {value.__name__}'
    else:
        yield f'{type(value).__name__} {value!r}'
