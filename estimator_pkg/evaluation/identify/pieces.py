# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A recording of a mechanism, and the pieces into which `identify` cuts it."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UserError

Array = NDArray[np.float64]

FIT_FRACTION = 0.6  # fraction of the recording for the fit
PIECES = 30  # number of pieces in that part, if the recording is long enough
SHORTEST_PIECE, LONGEST_PIECE = 0.2, 1.0  # length of a piece [s]
FEWEST_PIECES = 10  # smallest number of pieces for the fit
LONGEST_GAP = 5.0  # longest gap within a piece, in median sample times
PLAIN_STEP = 1e-2  # sample time for models in plain Python [s]


class MechanismSamples(NamedTuple):
    """One mechanism: times, shape (N,), positions, (N, n), not wrapped, and inputs, (N, m).

    Row k of the inputs acted from sample k - 1 to sample k.
    """

    time: Array
    positions: Array
    inputs: Array


def thinned(recording: MechanismSamples) -> MechanismSamples:
    """Return samples `PLAIN_STEP` apart, inputs averaged: a model in plain Python is slow."""
    time = recording.time
    every = max(1, round(PLAIN_STEP / float(np.median(np.diff(time)))))
    keep = np.arange(0, len(time), every)
    total = accumulated(time, recording.inputs)[keep]
    inputs = np.zeros((len(keep), recording.inputs.shape[1]))
    inputs[1:] = np.diff(total, axis=0) / np.diff(time[keep])[:, None]
    return MechanismSamples(time[keep], recording.positions[keep], inputs)


def accumulated(time: Array, inputs: Array) -> Array:
    """Return the integral of the inputs, shape (n, k), up to each sample [input s]."""
    steps = np.diff(time, prepend=time[0])[:, None]
    return np.cumsum(np.where(steps > 0.0, inputs * steps, 0.0), axis=0)


def cut(recording: MechanismSamples) -> tuple[list[slice], list[slice]]:
    """Return the rows of the pieces for the fit and of those for validation; raise UserError."""
    time = recording.time
    if len(time) < 2:
        raise UserError('the recording has fewer than two usable samples: record longer')
    usual = float(np.median(np.diff(time)))
    split = time[0] + FIT_FRACTION * (time[-1] - time[0])
    length = min(max((split - time[0]) / PIECES, SHORTEST_PIECE), LONGEST_PIECE)
    holes = np.flatnonzero(np.diff(time) > LONGEST_GAP * usual) + 1
    parts: tuple[list[slice], list[slice]] = ([], [])
    for begin, end in itertools.pairwise([0, *holes, len(time)]):
        edges = np.arange(time[begin], time[end - 1] + 0.5 * usual, length)
        rows = np.searchsorted(time[begin:end], edges) + begin
        for left, right in itertools.pairwise(rows.tolist()):
            stop = min(right + 1, end)  # neighbours share their common sample
            if stop - left >= 8 and time[stop - 1] <= split:
                parts[0].append(slice(left, stop))
            elif stop - left >= 8 and time[left] >= split:
                parts[1].append(slice(left, stop))
    if len(parts[0]) < FEWEST_PIECES or len(parts[1]) < FEWEST_PIECES // 3:
        raise UserError(
            f'the recording is too short to identify a model: it has {len(parts[0])} pieces '
            f'of {length:.2g} s without a gap and needs {FEWEST_PIECES}: record longer'
        )
    return parts
