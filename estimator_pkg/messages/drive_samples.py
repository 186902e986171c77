# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Batches of a drive, as std_msgs/Float64MultiArray: currents and voltages in, estimates out.

Stamps are two integers in each row (sec, nanosec), because one double cannot represent nanoseconds
since 1970.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages import multi_array
from estimator_pkg.messages.cdr import MalformedMessageError

TYPE = multi_array.TYPE
LABELS = ('sample', 'channel')
CHANNELS = ('sec', 'nanosec', 'i_alpha', 'i_beta', 'u_alpha', 'u_beta')
SECOND = 1_000_000_000  # [ns]
LARGEST_SECOND = 2.0**31  # largest seconds of a stamp [s]


class Batch(NamedTuple):
    """Rows of a batch.

    stamps_ns : shape (n,), int64.
    values : shape (n, 4): i_alpha, i_beta [A], u_alpha, u_beta [V]; or of estimates: electrical
        angle [rad] and speed [rad/s], flux linkage [Wb], valid (0 or 1).
    """

    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]


def decode(raw: bytes) -> Batch:
    """Decode a batch of samples or of estimates: both have six channels.

    Raises
    ------
    MalformedMessageError : another layout, or invalid stamps; the message describes which.
    """
    table = multi_array.decode(raw, LABELS, len(CHANNELS))
    sec, nanosec = table[:, 0], table[:, 1]
    # comparisons are false for nan
    good = (
        (np.abs(sec) < LARGEST_SECOND)
        & (sec == np.floor(sec))
        & (nanosec >= 0.0)
        & (nanosec < SECOND)
        & (nanosec == np.floor(nanosec))
    )
    if not good.all():
        row = int(np.argmin(good))
        raise MalformedMessageError(
            f'row {row} has an invalid time stamp: sec {sec[row]:g}, nanosec '
            f'{nanosec[row]:g}; both must be integers'
        )
    stamps = sec.astype(np.int64) * SECOND + nanosec.astype(np.int64)
    return Batch(stamps, table[:, 2:])


def encode(stamps_ns: NDArray[np.int64], values: NDArray[np.float64]) -> bytes:
    """Encode stamps [ns], shape (n,), and samples or estimates, shape (n, 4), as CDR."""
    table = np.empty((len(stamps_ns), len(CHANNELS)))
    sec = np.asarray(stamps_ns) // SECOND
    table[:, 0] = sec
    table[:, 1] = stamps_ns - sec * SECOND
    table[:, 2:] = values
    return multi_array.encode(table, LABELS)
