# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""std_msgs/Float64MultiArray from and to CDR bytes: plain numbers, or a table of two dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.messages.cdr import MalformedMessageError, Reader, Writer

TYPE = 'std_msgs/msg/Float64MultiArray'


def decode(raw: bytes, labels: Sequence[str], columns: int) -> NDArray[np.float64]:
    """Return the table, shape (n, columns); it may share its memory with `raw`.

    Parameters
    ----------
    labels : labels of the two dimensions.
    columns : required size of the second one.

    Raises
    ------
    MalformedMessageError : not a Float64MultiArray, or another layout; the message says which.
    """
    reader = Reader(raw)
    count = reader.number('I')
    if count != 2:
        raise MalformedMessageError(f'the layout has {count} dimensions; it needs 2')
    sizes, strides = [], []
    for label in labels:
        found, size, stride = reader.text(), *reader.numbers('I', 2)
        if found != label:
            raise MalformedMessageError(f"a dimension has the label '{found}', not '{label}'")
        sizes.append(size)
        strides.append(stride)
    rows, width = sizes
    if width != columns:
        raise MalformedMessageError(f"dimension '{labels[1]}' has size {width}, not {columns}")
    # a stride of 0 is unset; the first one is the total size by definition, and is not needed
    if strides[1] not in (0, columns) or strides[0] not in (0, rows * columns):
        raise MalformedMessageError(f'strides {strides} do not fit {rows} rows of {columns}')
    first = reader.number('I')
    numbers = reader.number('I')
    if numbers < first + rows * columns:
        raise MalformedMessageError(f'{numbers} numbers are too few for {rows} rows of {columns}')
    if not rows:
        return np.zeros((0, columns))
    reader.align(8)
    start = reader.at + 8 * first
    if start + 8 * rows * columns > len(raw):
        raise MalformedMessageError('message is too short')
    table = np.frombuffer(raw, f'{reader.order}f8', rows * columns, start)
    return table.astype(np.float64, copy=False).reshape(rows, columns)


def numbers(raw: bytes) -> tuple[float, ...]:
    """Return all numbers after the layout's offset, for any dimensions.

    Raises
    ------
    MalformedMessageError : not a Float64MultiArray, or an offset beyond its end.
    """
    reader = Reader(raw)
    for _ in range(reader.number('I')):
        reader.text()
        reader.numbers('I', 2)
    first = reader.number('I')
    found = reader.doubles()
    if first > len(found):
        raise MalformedMessageError(f'data offset {first} is beyond the {len(found)} values')
    return found[first:]


def encode(table: NDArray[np.float64], labels: Sequence[str]) -> bytes:
    """Encode a table of shape (n, columns) as CDR."""
    rows, columns = table.shape
    return _head(rows, columns, tuple(labels)) + np.ascontiguousarray(table, '<f8').tobytes()


@lru_cache(maxsize=64)
def _head(rows: int, columns: int, labels: tuple[str, ...]) -> bytes:
    """Return all bytes before the numbers."""
    writer = Writer()
    writer.numbers('I', (2,))
    for label, size, stride in zip(labels, (rows, columns), (rows * columns, columns)):
        writer.text(label)
        writer.numbers('I', (size, stride))
    writer.numbers('I', (0, rows * columns))
    if rows:
        writer.raw += b'\0' * (-(len(writer.raw) - 4) % 8)
    return bytes(writer.raw)
