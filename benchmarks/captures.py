# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Captures of a motor with Hall sensors, as columns.

moteus (Apache-2.0, github.com/mjbots/moteus, commit db1a762, fw/test/data) tests its velocity
estimator on them. The true velocity is constant between two neighbouring falling edges.
bags/README.md has the format.
"""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column
from benchmarks.signals import START_NS, Samples
from estimator_pkg.errors import UserError

FOLDER = 'moteus_hall'  # of the bags
RATE = 30_000  # [Hz]
QUANTUM = 2.0 * math.pi / 90  # [rad]
MARK = 0x5A  # first byte of a record
RECORD = 3  # bytes
HEADERS = 5  # in a row, where a capture starts
SECTOR = np.array([0, 0, 2, 1, 4, 5, 3, 0])  # of the six codes of three Hall lines


def codes(data: bytes) -> NDArray[np.int64]:
    """Return the Hall lines of each record, three bits each; broken records are left out."""
    raw = np.frombuffer(data, np.uint8)
    marked = np.append(raw == MARK, np.zeros(HEADERS * RECORD, bool))
    starts = np.all([marked[RECORD * k : RECORD * k + len(raw)] for k in range(HEADERS)], axis=0)
    found, at = [], 0
    while starts[at:].any():
        at += int(np.argmax(starts[at:]))
        chain = marked[at : len(raw) : RECORD]
        length = len(chain) if chain.all() else int(np.argmin(chain))
        rows = at + RECORD * np.arange(length)
        found.append(raw[rows[rows + RECORD <= len(raw)] + 1] & 7)
        at += RECORD * length
    return np.concatenate(found).astype(np.int64) if found else np.zeros(0, np.int64)


def capture(lines: NDArray[np.int64]) -> Samples:
    """Return the readings [rad], and the velocity between neighbouring falling edges [rad/s]."""
    steps = (np.diff(SECTOR[lines], prepend=0) + 3) % 6 - 3
    count = np.cumsum(steps)
    fell, changed = lines[:-1] & ~lines[1:], lines[:-1] ^ lines[1:]
    falling = 1 + np.flatnonzero((fell == changed) & np.isin(changed, (1, 2, 4)))
    velocity = np.zeros(len(lines))
    if len(falling):
        speeds = QUANTUM * np.diff(count[falling]) * RATE / np.diff(falling)
        velocity[falling[0] : falling[-1]] = np.repeat(speeds, np.diff(falling))
    stamps = START_NS + np.rint(np.arange(len(lines)) * (1e9 / RATE)).astype(np.int64)
    return Samples(stamps, count.astype(np.float64) * QUANTUM, velocity)


def captures(bags: Path) -> list[Column]:
    """Return the captures below the folder of the bags; raise UserError if there is none."""
    paths = sorted((bags / FOLDER).glob('*.dat.gz'))
    if not paths:
        raise UserError(f'{bags / FOLDER} has no capture (*.dat.gz): give the folder with --bags')
    return [
        Column(
            path.name.removesuffix('.dat.gz'),
            capture(codes(gzip.decompress(path.read_bytes()))),
            QUANTUM,
            skip=0.0,
        )
        for path in paths
    ]
