"""All the numbers behind a page, in an .npz beside it, written array by array."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

LEVEL = 1  # of compression: a second more saves a third


class FullData:
    """An .npz that grows, so that not every bag has to be in memory at once.

    Parameters
    ----------
    path : of the file; it appears there when all is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._beside = path.with_name(f'.{path.name}.part')
        self._zip = zipfile.ZipFile(self._beside, 'w', zipfile.ZIP_DEFLATED, compresslevel=LEVEL)

    def add(self, name: str, values: NDArray) -> None:
        """One array, as ``numpy.load(path)[name]`` will give it."""
        with self._zip.open(f'{name}.npy', 'w', force_zip64=True) as stream:
            np.lib.format.write_array(stream, np.ascontiguousarray(values), allow_pickle=False)

    def __enter__(self) -> FullData:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Complete: under its name. Broken off: gone."""
        try:
            self._zip.close()
            if kind is None:
                os.replace(self._beside, self.path)
        finally:
            self._beside.unlink(missing_ok=True)
