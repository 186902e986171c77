# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""All samples of a comparison in an .npz file, written array by array."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import destination, whole_file
from estimator_pkg.evaluation.compare.comparison import Comparison, Row

COMPRESSION = 1  # compression level: one second more saves a third


class FullData:
    """An .npz file that grows, so that not all bags must be in memory at once.

    Parameters
    ----------
    file : see `full_data`.
    """

    def __init__(self, file: zipfile.ZipFile) -> None:
        self._zip = file

    def add(self, comparison: Comparison) -> None:
        """Add every compared sample of one bag."""
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
        """Add an array of any shape, which ``numpy.load(path)[name]`` returns."""
        with self._zip.open(f'{name}.npy', 'w', force_zip64=True) as stream:
            np.lib.format.write_array(stream, np.ascontiguousarray(values), allow_pickle=False)


@contextmanager
def full_data(path: str) -> Iterator[FullData]:
    """Write an .npz file, which appears when it is complete.

    Raises
    ------
    UserError : the file cannot be written.
    """
    destination.check(path)
    with (
        whole_file.replacing(path) as temporary,
        zipfile.ZipFile(temporary, 'w', zipfile.ZIP_DEFLATED, compresslevel=COMPRESSION) as file,
    ):
        yield FullData(file)


def _name(*parts: str) -> str:
    """Return a name inside the .npz; no part of it can lead out of it."""
    return '/'.join(part.strip('/').replace('..', '_') for part in parts)
