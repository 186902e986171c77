# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The built engine: found, compared with the sources, and loaded by ctypes."""

from __future__ import annotations

import ctypes
import struct
from functools import cache
from pathlib import Path
from typing import Any

from .sources import digest

PACKAGE = Path(__file__).resolve().parents[1]
LIBRARY = PACKAGE / '_engine.so'
CODES: dict[str, Any] = {'': None, 'p': ctypes.c_void_p, 'd': ctypes.c_double}
CODES |= {'q': ctypes.c_int64, '?': ctypes.c_bool}


@cache
def load(path: Path = LIBRARY, root: Path = PACKAGE.parent) -> tuple[ctypes.PyDLL | None, str]:
    """Return the engine, whose functions have their types, or None and the reason in one line.

    Parameters
    ----------
    path : the library.
    root : folder of the sources that it was made from.
    """
    if not path.is_file():
        return None, 'no engine was built: install a C compiler, then the package again'
    try:
        if not _is_whole(path.read_bytes()):
            raise OSError('the file is cut short')
        library = ctypes.PyDLL(str(path))  # keeps Python's lock: most calls take microseconds
        made, sources, functions = (_words(library, n) for n in ('digest', 'sources', 'functions'))
    except (OSError, AttributeError) as error:
        reason = str(error).replace('\n', ' ')
        return None, f'{path.name} cannot be loaded ({reason}): install the package again'
    try:
        current = digest(root, sources)
    except OSError:  # a source is no longer there
        current = ''
    if [current] != made:
        return None, f'{path.name} was made from other sources: install the package again'
    for name, result, arguments in (line.split(':') for line in functions):
        function = getattr(library, name)
        function.restype, function.argtypes = CODES[result], [CODES[code] for code in arguments]
    return library, ''


def _words(library: ctypes.PyDLL, name: str) -> list[str]:
    """Return the words of a text in the library."""
    function = getattr(library, f'velocity_estimator_{name}')
    function.restype = ctypes.c_char_p
    return (function() or b'').decode(errors='replace').split()


def _is_whole(data: bytes) -> bool:
    """Whether an ELF file reaches to the end of its section table: a shorter one could crash."""
    if data[:4] != b'\x7fELF' or len(data) < 64:
        return data[:4] != b'\x7fELF'  # ctypes says what is wrong with it
    form, at, sizes = ('<Q', 40, 58) if data[4] == 2 else ('<I', 32, 46)
    (table,), (size, count) = (
        struct.unpack_from(form, data, at),
        struct.unpack_from('<HH', data, sizes),
    )
    return bool(table + size * count <= len(data))
