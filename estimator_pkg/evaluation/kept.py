"""Long arrays wait in a temporary file, so that many observers of an hour need no more memory than
one.
"""

from __future__ import annotations

import ctypes
import tempfile
from contextlib import suppress
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

MMAP_THRESHOLD = -3     # glibc's malloc.h
LONG = 8_000_000    # bytes; shorter arrays stay in memory


def give_back_freed() -> None:
    """From now on, freed arrays go back to the system at once.

    The C library (glibc) learns to keep those of up to 32 MB, and then loses what lies between
    them to larger ones: of an hour at 1 kHz, a seventh of the memory.
    """
    with suppress(OSError, AttributeError, TypeError):  # another library, another system
        ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, LONG // 2)


class Kept:
    """An array, in a file without a name if it is long; gone when nobody refers to it.

    It stays in memory where the file cannot be written. Another process gets the array itself.

    Parameters
    ----------
    values : shape (n,).
    """

    def __init__(self, values: NDArray) -> None:
        self._values: NDArray | None = values
        self._type = values.dtype
        self._file: BinaryIO | None = None
        if values.nbytes >= LONG:
            try:
                file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  (open as long as this)
                values.tofile(file)
            except OSError:
                return
            self._file, self._values = file, None

    def get(self) -> NDArray:
        """The array; not to be written to."""
        if self._file is None:
            assert self._values is not None
            return self._values
        self._file.seek(0)
        return np.fromfile(self._file, self._type)

    def __reduce__(self) -> tuple[Any, ...]:
        return Kept, (self.get(),)
