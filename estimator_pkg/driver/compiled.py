# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Compile pure functions with Numba on demand, if the extra ``fast`` is installed.

The functions stay plain Python. Their compiled twins are made from the same code objects, with
every plain function that they call replaced by its twin. Plain and compiled agree to the last bit
(fast-math stays disabled), because they take no powers that the compiler makes products or roots,
and no hypot: a test finds them. Only Python 3.10 has an erfc of its own.
"""

from __future__ import annotations

import dis
import hashlib
import importlib
import math
import os
import pickle
import sys
import types
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

from estimator_pkg.errors import first_line
from estimator_pkg.observers.maths.seldom import is_seldom
from estimator_pkg.printable import printable


@lru_cache(None)  # disassembling takes most of the time of a fingerprint
def global_names(code: types.CodeType) -> set[str]:
    """Return the globals that the code reads, without attributes (`math.sin` is no global)."""
    names = {
        instruction.argval
        for instruction in dis.get_instructions(code)
        if instruction.opname == 'LOAD_GLOBAL'
    }
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= global_names(constant)
    return names


def fingerprint(function: types.FunctionType) -> str:
    """Return a digest of the function's code, its closure and the globals that it reads.

    It is equal in every process for the same sources. It changes with every function that it calls,
    and with every constant that one of them uses.
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
        yield f'of {value.__module__}'  # the cached code is loaded by importing this module
        yield f'seldom {is_seldom(value)}'
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
    elif isinstance(value, frozenset):  # its order differs between processes
        yield repr(sorted(map(repr, value)))
    elif isinstance(value, (types.ModuleType, types.BuiltinFunctionType, type)):
        yield f'{getattr(value, "__module__", "")} {value.__name__}'
    else:
        yield f'{type(value).__name__} {value!r}'


_twins: dict[Any, Callable] = {}
_faults: list[str] = []  # problems of the cache


@lru_cache
def available() -> bool:
    """Return True if Numba can be imported (this imports it)."""
    try:
        import numba  # noqa: F401  (checks that it is installed)
    except ModuleNotFoundError as error:
        if error.name == 'numba':
            return False
        broken: Exception = error
    except Exception as error:  # built for another NumPy, a library that does not load
        broken = error
    else:
        return True
    print(f'warning: Numba cannot be used: {printable(first_line(broken))}', file=sys.stderr)
    return False


def compiled(function: Callable) -> Callable:
    """Return the compiled twin of a pure function, or the function itself without Numba."""
    if not available():
        return function
    return _twin(function)


def is_compiled(function: Callable) -> bool:
    """Return True if this process has compiled the function, or loaded its twin from disk."""
    twin: Any = _twins.get((_key(function), False))
    return twin is not None and bool(twin.overloads)


def is_kept(function: Callable) -> bool:
    """Return True if its compiled twin is on disk, for this processor (this imports Numba)."""
    if not available():
        return False
    twin: Any = _twin(function)
    try:
        return twin._cache.holds(twin.targetctx.codegen())
    except Exception:  # Numba's cache where none of ours can be, or a damaged file
        return False


def cannot_compile(error: Exception) -> bool:
    """Return True if `error` is Numba's refusal of a function outside its subset of Python."""
    return type(error).__module__.startswith('numba.')


def _key(value: Any) -> Any:
    """Return the identity of a function for the compiler: its code and its closure."""
    if isinstance(value, types.FunctionType):
        return _key_of_function(value)
    if isinstance(value, tuple):
        return tuple(_key(item) for item in value)
    return (type(value), value)


@lru_cache  # a closure has dozens of functions, and short batches come often
def _key_of_function(function: types.FunctionType) -> Any:
    return (function.__code__, tuple(_key(c.cell_contents) for c in function.__closure__ or ()))


def _twin(function: Any, *, inner: bool = False) -> Callable:
    """Return the compiled twin; only compiled code calls `inner` ones.

    Without their Python wrappers, compiling takes two fifths less time.
    """
    import numba

    key = (_key(function), inner)
    if key not in _twins:
        code = function.__code__
        names = dict(function.__globals__)
        for name in global_names(code):
            if isinstance(names.get(name), types.FunctionType):
                names[name] = _twin(names[name], inner=True)
        cells = tuple(
            types.CellType(
                _twin(value, inner=True) if isinstance(value, types.FunctionType) else value
            )
            for value in (cell.cell_contents for cell in function.__closure__ or ())
        )
        copy = types.FunctionType(code, names, function.__name__, function.__defaults__, cells)
        # Code from several files on disk is linked by name: another closure needs another one.
        copy.__qualname__ = f'{function.__qualname__}_{fingerprint(function)[:16]}'
        options: dict[str, Any] = {'no_cpython_wrapper': inner, 'no_cfunc_wrapper': inner}
        options['forceinline'] = not is_seldom(function)
        if not inner:
            options['pipeline_class'] = _compiler()
        _twins[key] = numba.njit(copy, error_model='numpy', **options)
        if not inner:
            _keep_on_disk(_twins[key], copy, function)
    return _twins[key]


@lru_cache(1)
def _compiler() -> type:
    """Return Numba's compiler at LLVM's first level: it is done sooner, and its code is as fast."""
    from numba.core import compiler

    config: Any = importlib.import_module('numba.core.config')

    class FirstLevel(compiler.Compiler):
        def compile_extra(self, function: Any) -> Any:
            level = config.OPT
            config.OPT = type(level)(1)
            try:
                return super().compile_extra(function)
            finally:
                config.OPT = level

    return FirstLevel


def _keep_on_disk(twin: Any, copy: Any, function: Any) -> None:
    """Let Numba store compiled code next to the source, as its own ``cache=True`` does.

    Numba's cache checks one source file and the closure. Ours becomes stale as soon as any called
    function changes. Compiling takes seconds, loading does not. A function without a source file
    (typed interactively) is not stored, and a failure of the cache never raises.
    """
    if not os.path.exists(function.__code__.co_filename):
        return
    try:
        twin._cache = _cache_class()(copy, fingerprint(function))
    except Exception as error:  # RuntimeError: no folder is writable
        _not_kept(
            f'{type(error).__name__}: {first_line(error)}; set NUMBA_CACHE_DIR to a writable folder'
        )


@lru_cache(1)
def _cache_class() -> type:
    """Return the class of the caches; Numba's own raises for a full disk or a damaged file."""
    from numba.core.caching import FunctionCache, IndexDataCacheFile

    class Files(IndexDataCacheFile):
        """Loads only intact machine code: damaged code would crash the process."""

        def _save_data(self, name: str, data: Any) -> None:
            raw = self._dump(data)
            super()._save_data(name, (hashlib.sha256(raw).digest(), raw))

        def _load_data(self, name: str) -> Any:
            digest, raw = super()._load_data(name)
            if hashlib.sha256(raw).digest() != digest:
                raise ValueError(f'{name} is damaged')
            return pickle.loads(raw)

    class Cache(FunctionCache):
        def __init__(self, copy: Any, content: str) -> None:
            super().__init__(copy)
            self._content = content
            self._cache_file = Files(
                self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp()
            )

        def _index_key(self, sig: Any, codegen: Any) -> tuple:
            return (sig, codegen.magic_tuple(), self._content, 'sha256')  # and the file format

        def holds(self, codegen: Any) -> bool:
            """Return True if the function is on disk, for any types of its arguments."""
            last = self._index_key(None, codegen)[1:]
            return any(key[1:] == last for key in self._cache_file._load_index())

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            try:
                return super().load_overload(sig, target_context)
            except Exception as error:  # of damaged files: EOFError, UnpicklingError and others
                _not_kept(
                    f'a damaged file in {self._cache_path} is replaced '
                    f'({type(error).__name__}: {first_line(error)})'
                )
            try:
                self.flush()
            except Exception as error:
                self._stop(error)
            return None

        def save_overload(self, sig: Any, data: Any) -> None:
            try:
                super().save_overload(sig, data)
            except Exception as error:  # ENOSPC, EACCES and others
                self._stop(error)

        def _stop(self, error: Exception) -> None:
            _not_kept(f'{self._cache_path}: {first_line(error)}')
            self.disable()

    return Cache


def _not_kept(why: str) -> None:
    """Report the first problem of the cache: from now on each process compiles for seconds."""
    if not _faults:
        print(f'warning: compiled code is not loaded from disk: {printable(why)}', file=sys.stderr)
    _faults.append(why)


def longest_dt(limits: Callable[[float], str | None]) -> float:
    """Return the longest sample time [s] that an observer's `limits` accepts; inf for no limit.

    `limits` must be monotone: if it refuses a dt it refuses every longer one.
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
