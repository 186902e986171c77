# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Calls of the engine: the functions of an observer, and the memory that they update."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from functools import cache
from multiprocessing import parent_process
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.engine.entries import CHANNELS, c_name, path_of
from estimator_pkg.engine.load import LIBRARY, load
from estimator_pkg.optional import OWN
from estimator_pkg.printable import show
from estimator_pkg.record import values

ELEMENTS = {'f': np.float64, 'i': np.int64, 'c': np.complex128}  # of arrays


class Memory:
    """One record where compiled code updates it.

    Attributes
    ----------
    array : shape (1,), of the record's dtype. pointer : address of the record.
    """

    def __init__(self, record: Any, begin: Any = None) -> None:
        self.array: NDArray[Any] = np.zeros(1, record.dtype)
        if begin is not None:
            self.array[0] = values(record, begin)
        self.pointer = self.array.ctypes.data


class Functions:
    """The compiled functions of one observer."""

    take: Any
    write_estimate: Any
    write_deviation: Any
    message: Any
    deviations: Any
    batch: Any
    trace: Any

    def __init__(self, library: Any, observer: Any) -> None:
        for function in Functions.__annotations__:
            compiled = getattr(library, c_name(path_of(observer), function), None)
            if compiled is not None:
                setattr(self, function, compiled)

    def run(self, pointer: int, count: int, *columns: NDArray[Any]) -> None:
        """Take many samples, shape (count,) each column; see `channel.batch`."""
        self.batch(pointer, count, *(column.ctypes.data for column in columns))


def pointers(memories: Sequence[Memory]) -> Any:
    """Return the array of pointers to these records that `message` takes."""
    return (ctypes.c_void_p * len(memories))(*(memory.pointer for memory in memories))


def _loaded() -> Any:
    """Return the engine, or None; warn once if one was built and is refused."""
    library, reason = load()
    if library is None and reason:
        _refused(reason)
    return library


@cache
def _refused(reason: str) -> None:
    if LIBRARY.is_file() and parent_process() is None:  # workers say the same
        show(f'warning: {reason}; until then everything runs as plain Python', file=sys.stderr)


@cache
def functions_of(observer: Any) -> Functions | None:
    """Return the engine's functions of an observer; None: it runs as plain Python."""
    library = _loaded()
    found = Functions(library, observer)
    return found if vars(found) else None


def why_plain(observer: Any) -> str:
    """Return why an observer runs as plain Python; '': it is compiled.

    Parameters
    ----------
    observer : `observers.contract.Observer`.
    """
    package = observer.__module__.partition('.')[0]
    if package not in OWN:
        return f"the engine has observers of this package alone, and '{package}' is another"
    if observer.kind not in CHANNELS and not any(map(functions_of, observer.__mro__)):
        return 'the engine is for observers of one angle and of drives'
    return load()[1]


def available() -> bool:
    """Return True if the engine is there."""
    return _loaded() is not None


def run(function: Any, *arguments: Any) -> Any:
    """Call one of `entries.LOOPS`, compiled or as plain Python, and return its result.

    Parameters
    ----------
    arguments : numbers, arrays and records; the function gets arrays flat. It updates records and
        all arrays that can be written.
    """
    library = _loaded()
    given: list[Any] = list(arguments)
    for i, value in enumerate(arguments):
        if isinstance(value, np.ndarray):
            given[i] = np.ascontiguousarray(value, ELEMENTS[value.dtype.kind])
        elif library is not None and hasattr(value, 'take'):
            given[i] = Memory(type(value), value)
    if library is not None:
        compiled = getattr(library, c_name(function.__module__, function.__name__))
        result = compiled(*map(_address, given))
    else:  # lists contain Python numbers, which are several times faster than NumPy's
        given = [v.ravel().tolist() if isinstance(v, np.ndarray) else v for v in given]
        result = function(*given)
    for value, passed in zip(arguments, given):
        if isinstance(passed, Memory):
            value.take(type(value).read(passed.array[0]))
        elif isinstance(value, np.ndarray) and passed is not value and value.flags.writeable:
            value[...] = np.reshape(passed, value.shape)
    return result


def _address(value: Any) -> Any:
    """Return what the engine takes for an argument."""
    if isinstance(value, Memory):
        return value.pointer
    return value.ctypes.data if isinstance(value, np.ndarray) else value
