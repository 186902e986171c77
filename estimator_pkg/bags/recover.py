# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Make a bag of the files of a recorder that was killed, or of a truncated file.

A truncated MCAP file is read record by record (`mcap_file`). An sqlite3 file is restored to its
state before the crash with its journal or write-ahead log (`sqlite_file`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator_pkg import interrupts
from estimator_pkg.bags import unpacking
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.writer import BagWriter, in_use
from estimator_pkg.errors import UserError


def recover(path: str, out: str, unpack_limit: int = unpacking.LIMIT) -> dict[str, int]:
    """Write every complete message at `path` into a new bag.

    Parameters
    ----------
    path : a file, or a folder with the files of one bag.
    unpack_limit : bytes that a compressed chunk or message may unpack to.

    Returns
    -------
    The number of messages by topic.

    Raises
    ------
    UserError : the path does not exist, is still being written, or has no complete message.
    """
    for file in [Path(path), *Path(path).glob('*')]:
        if file.is_file() and in_use(file):
            raise UserError(f'{file} is still being written: end its recorder first')
    with (
        interrupts.gently(),
        open_bag(path, unpack_limit) as bag,
        BagWriter(out, keep=True) as writer,
    ):
        numbers = np.array([writer.add(topic) for topic in bag.topics.values()])
        for _, block in bag.blocks():
            writer.write_block(replace(block, topic=numbers[block.topic]))
            if interrupts.came():
                raise KeyboardInterrupt
        counts = writer.counts()
        if not any(counts.values()):
            raise UserError(f'{path} contains no complete message: there is nothing to recover')
    return counts
