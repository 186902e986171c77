"""Compiling pure functions with Numba, lazily, where the ``fast`` extra is installed.

The functions stay ordinary Python; their compiled twins are made from the same code objects, with
every plain function they call replaced by its own twin. Plain and compiled agree to the last bit
except where the C library's exp, sin and so on differ (fast-math stays off).
"""

from __future__ import annotations

import contextlib
import math
import types
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from estimator_pkg.driver.fingerprint import fingerprint, global_names

_twins: dict[Any, Callable] = {}


@lru_cache
def available() -> bool:
    """True where Numba can be imported (this imports it)."""
    try:
        import numba  # noqa: F401  (only to see whether it is there)
    except ImportError:
        return False
    return True


def compiled(function: Callable) -> Callable:
    """The compiled twin of a pure function; the function itself where Numba is missing."""
    if not available():
        return function
    return _twin(function)


def cannot_compile(error: Exception) -> bool:
    """True if `error` is Numba's refusal of a function outside its subset of Python."""
    return type(error).__module__.startswith('numba.')


def _key(value: Any) -> Any:
    """What makes two functions the same for the compiler: code and what it closes over."""
    if isinstance(value, types.FunctionType):
        return (value.__code__, tuple(_key(cell.cell_contents) for cell in value.__closure__ or ()))
    if isinstance(value, tuple):
        return tuple(_key(item) for item in value)
    return (type(value), value)


def _twin(function: Any, *, inner: bool = False) -> Callable:
    """The compiled twin; `inner` ones are called by compiled code alone.

    Leaving out what makes them callable from Python saves two fifths of the compiling.
    """
    import numba
    key = (_key(function), inner)
    if key not in _twins:
        code = function.__code__
        names = dict(function.__globals__)
        for name in global_names(code):
            if isinstance(names.get(name), types.FunctionType):
                names[name] = _twin(names[name], inner=True)
        cells = tuple(types.CellType(_twin(value, inner=True)
                                     if isinstance(value, types.FunctionType) else value)
                      for value in (cell.cell_contents for cell in function.__closure__ or ()))
        copy = types.FunctionType(code, names, function.__name__, function.__defaults__, cells)
        copy.__qualname__ = function.__qualname__
        options: dict[str, Any] = {'no_cpython_wrapper': inner, 'no_cfunc_wrapper': inner}
        _twins[key] = numba.njit(copy, error_model='numpy', forceinline=True, **options)
        if not inner:
            _keep_on_disk(_twins[key], copy, function)
    return _twins[key]


def _keep_on_disk(twin: Any, copy: Any, function: Any) -> None:
    """Lets Numba keep what it compiles beside the source, as its own ``cache=True`` does.

    That would know one source file and what the function closes over; ours is stale as soon as
    anything changes that the function calls. Compiling takes seconds, loading does not.
    """
    from numba.core.caching import FunctionCache

    class Cache(FunctionCache):
        def _index_key(self, sig: Any, codegen: Any) -> tuple:
            return (sig, codegen.magic_tuple(), content)

    content = fingerprint(function)
    # RuntimeError: the function has no source file, or nothing can be written anywhere
    with contextlib.suppress(RuntimeError):
        twin._cache = Cache(copy)


def longest_dt(limits: Callable[[float], str | None]) -> float:
    """The longest sample time [s] that an observer's `limits` admits; inf where all do.

    `limits` must be monotone: what fails at one dt fails at every longer one.
    """
    low, high = 1e-7, 100.0
    if limits(high) is None:
        return math.inf
    if limits(low) is not None:
        return 0.0
    while high / low > 1.0 + 1e-9:
        middle = math.sqrt(low * high)
        if limits(middle) is None:
            low = middle
        else:
            high = middle
    return low
