# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Times from elsewhere as stamps: int64 nanoseconds."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator_pkg.errors import UsageError

UNITS = {'s': 10**9, 'ms': 10**6, 'us': 10**3, 'ns': 1}  # [ns]
MOST_NS = 2**63 - 1
COARSEST = 0.05  # largest resolution of times, in sample times
TYPICAL_NS = 1e6  # sample time if all times are equal
MANY = 20  # times of which at least a third must differ from the one before
START_NS = 10**9  # first stamp of times that begin at 0, which would be no stamp
SINCE_1970_NS = 10**17  # times beyond are dates: a time of 0 among them is a missing one


def stamps_of(times: ArrayLike, unit: str = 's', after_zero: bool = False) -> NDArray[np.int64]:
    """Return times as stamps [ns]; 0, which is no stamp, where a time is NaN, NaT or masked.

    Parameters
    ----------
    times : shape (n,), numbers, datetime64 or timedelta64.
    unit : of numbers: s, ms, us or ns.
    after_zero : if the first of the times is 0 or before, move all by as much as it takes to have
        it at 1 s.

    Raises
    ------
    UsageError : they are neither, exceed int64 nanoseconds, or are too coarse for the sample time.
    """
    missing = np.ma.getmaskarray(times) if isinstance(times, np.ma.MaskedArray) else False
    values = np.asarray(times)
    if values.dtype.kind in 'Mm':
        missing = missing | np.isnat(values)
        scale = 10**9
        whole = values.astype(f'{values.dtype.kind}8[s]')
        rest = (values - whole).astype('m8[ns]').astype(np.int64)
        whole = whole.astype(np.int64)
    elif values.dtype.kind in 'iu':
        scale, whole, rest = UNITS[unit], values, 0
    elif values.dtype.kind == 'f':
        missing = missing | ~np.isfinite(values)
        scale = UNITS[unit]
        _check_resolution(values[~missing], unit)
        whole = np.floor(np.where(missing, 0.0, values))
        rest = np.rint((values - whole).astype(np.float64) * scale)
    elif values.size:
        raise UsageError(f'times must be numbers or datetime64 (not {values.dtype})')
    else:
        return np.zeros(values.shape, np.int64)
    known = np.broadcast_to(~np.asarray(missing), values.shape)
    beyond = known & ~((whole >= -(MOST_NS // scale)) & (whole < MOST_NS // scale))
    if beyond.any():
        raise UsageError(
            f'a time of {values[beyond][0]} is beyond 64 bits of nanoseconds: check the unit'
        )
    stamps = np.where(known, whole, 0).astype(np.int64) * scale
    stamps += np.where(known, rest, 0).astype(np.int64)
    if after_zero and known.any():
        first = int(stamps[known].min())
        if first <= 0 and np.median(stamps[known]) < SINCE_1970_NS:
            stamps += np.where(known, START_NS - first, 0)
    return stamps


def _check_resolution(values: NDArray[Any], unit: str) -> None:
    """Raise UsageError if floating-point times are too coarse for the sample time."""
    if len(values) < 2:
        return
    steps = np.abs(np.diff(values.astype(np.float64)))
    moved = steps[steps > 0.0]
    step = float(np.median(moved)) if len(moved) else TYPICAL_NS / UNITS[unit]
    resolution = float(np.spacing(np.abs(values).max()))
    remedy = 'keep more digits: subtract the first time before rounding, or use integers [ns]'
    if resolution > COARSEST * step:
        raise UsageError(
            f'times near {np.abs(values).max():g} {unit} have a resolution of {resolution:.2g} '
            f'{unit} as {values.dtype}, too coarse for steps of {step:.2g} {unit}: {remedy}'
        )
    if len(values) > MANY and 3 * len(moved) < len(steps):
        raise UsageError(
            f'{len(steps) - len(moved)} of {len(values)} times equal the one before: their '
            f'resolution is too coarse for the sample time: {remedy}'
        )
