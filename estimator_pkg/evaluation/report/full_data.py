# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""All samples of a comparison in an .npz file, written array by array."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import destination, whole_file
from estimator_pkg.evaluation.compare.comparison import Comparison, Row

COMPRESSION = 1  # compression level: one second more saves a third


@contextmanager
def full_data(path: str) -> Iterator[Callable[[Comparison], None]]:
    """Write an .npz file, which appears when it is complete, by a function that adds one bag.

    It grows array by array, so that not all bags must be in memory at once.

    Raises
    ------
    UserError : the file cannot be written.
    """
    destination.check(path)
    with (
        whole_file.replacing(path) as temporary,
        zipfile.ZipFile(temporary, 'w', zipfile.ZIP_DEFLATED, compresslevel=COMPRESSION) as file,
    ):

        def add(comparison: Comparison) -> None:
            """Add every compared sample of one bag; ``numpy.load(path)[name]`` returns an array."""
            for name, values in _arrays(comparison):
                with file.open(f'{name}.npy', 'w', force_zip64=True) as stream:
                    np.lib.format.write_array(
                        stream, np.ascontiguousarray(values), allow_pickle=False
                    )

        yield add


def _arrays(comparison: Comparison) -> Iterator[tuple[str, NDArray]]:
    """Yield the names and arrays of one bag; times that are those of the row before only once."""
    for joint in dict.fromkeys(row.joint for row in comparison.rows):
        base = _name(comparison.bag, joint)
        if joint in comparison.measurement:
            series = comparison.measurement[joint]
            yield f'{base}/measurement/stamps_ns', series.stamps_ns
            yield f'{base}/measurement/position', series.position
        shared: Row | None = None
        for row in (row for row in comparison.rows if row.joint == joint):
            here = _name(base, row.source)
            if shared is None or not np.array_equal(shared.time, row.time):
                shared = row
                yield f'{here}/time', row.time
                yield f'{here}/reference', row.truth
            yield f'{here}/velocity', row.estimate
            if np.isfinite(row.stddev).any():
                yield f'{here}/velocity_stddev', row.stddev


def _name(*parts: str) -> str:
    """Return a name inside the .npz; no part of it can lead out of it."""
    return '/'.join(part.strip('/').replace('..', '_') for part in parts)
