# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""All samples of comparisons in an .npz file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from estimator_pkg import whole_file
from estimator_pkg.evaluation.compare.comparison import Comparison


def write(path: str, comparisons: Iterable[Comparison]) -> None:
    """Write every compared sample; ``numpy.load(path)[name]`` returns an array."""
    arrays: dict[str, Any] = {}
    for comparison in comparisons:
        for row in comparison.rows:
            base = _name(comparison.bag, row.joint)
            series, here = comparison.measurement.get(row.joint), _name(base, row.source)
            if series is not None:
                arrays[f'{base}/measurement/stamps_ns'] = series.stamps_ns
                arrays[f'{base}/measurement/position'] = series.position
            arrays[f'{here}/time'], arrays[f'{here}/reference'] = row.time, row.truth
            arrays[f'{here}/velocity'] = row.estimate
            if np.isfinite(row.stddev).any():
                arrays[f'{here}/velocity_stddev'] = row.stddev
    with whole_file.replacing(path) as temporary, open(temporary, 'wb') as file:
        np.savez_compressed(file, **arrays)


def _name(*parts: str) -> str:
    """Return a name inside the .npz; no part of it can lead out of it."""
    return '/'.join(part.strip('/').replace('..', '_') for part in parts)
