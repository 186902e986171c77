"""All the numbers of a comparison in an .npz, written array by array."""

from __future__ import annotations

import zipfile
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import destination
from estimator_pkg.evaluation.compare.comparison import Comparison, Row

LEVEL = 1  # of compression: a second more saves a third


class FullData:
    """An .npz that grows, so that not every bag has to be in memory at once.

    Parameters
    ----------
    path : of the file; it appears there when all is written.

    Raises
    ------
    UserError : no file can be written there.
    """

    def __init__(self, path: str) -> None:
        destination.check(path)
        self.path = path
        self._whole = destination.replacing(path)
        self._zip = zipfile.ZipFile(
            self._whole.__enter__(), 'w', zipfile.ZIP_DEFLATED, compresslevel=LEVEL
        )

    def add(self, comparison: Comparison) -> None:
        """Every sample of one bag that was compared."""
        for joint in dict.fromkeys(row.joint for row in comparison.rows):
            base = _name(comparison.bag, joint)
            if joint in comparison.measurement:
                series = comparison.measurement[joint]
                self.write(f'{base}/measurement/stamps_ns', series.stamps_ns)
                self.write(f'{base}/measurement/position', series.position)
            shared: Row | None = None
            for row in (row for row in comparison.rows if row.joint == joint):
                here = _name(base, row.source)
                if (
                    shared is None
                    or len(shared.time) != len(row.time)
                    or not np.array_equal(shared.time, row.time)
                ):
                    shared = row
                    self.write(f'{here}/time', row.time)
                    self.write(f'{here}/reference', row.truth)
                self.write(f'{here}/velocity', row.estimate)
                if np.isfinite(row.stddev).any():
                    self.write(f'{here}/velocity_stddev', row.stddev)

    def write(self, name: str, values: NDArray) -> None:
        """One array, as ``numpy.load(path)[name]`` will give it."""
        with self._zip.open(f'{name}.npy', 'w', force_zip64=True) as stream:
            np.lib.format.write_array(stream, np.ascontiguousarray(values), allow_pickle=False)

    def __enter__(self) -> FullData:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Complete: under its name. Broken off: gone."""
        try:
            self._zip.close()
        except BaseException as problem:
            self._whole.__exit__(type(problem), problem, problem.__traceback__)
            raise
        self._whole.__exit__(kind, error, trace)


def _name(*parts: str) -> str:
    """A name inside the .npz: no part of it can leave it."""
    return '/'.join(part.strip('/').replace('..', '_') for part in parts)
