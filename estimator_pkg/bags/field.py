# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One number in messages of any type: ``pose.position.x``, ``data[0]``, ``orientation.yaw``.

The type's definition lists the fields before the number. Fields of variable length (texts,
sequences) are measured once per layout, so messages with the same layout are decoded together.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.messages.cdr import MalformedMessageError, Reader
from estimator_pkg.messages.layouts import Messages, groups, numbers, stamps

HEADER = 'std_msgs/msg/Header'
QUATERNION = 'geometry_msgs/msg/Quaternion'
YAW = 'yaw'

_CODES = {
    'bool': '?',
    'byte': 'B',
    'octet': 'B',
    'char': 'B',
    'int8': 'b',
    'uint8': 'B',
    'int16': 'h',
    'uint16': 'H',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
    'float32': 'f',
    'float64': 'd',
}
INTEGERS = frozenset(name for name in _CODES if 'int' in name)
_STEP = re.compile(r'([A-Za-z_]\w*)((?:\[\d+\])?)$')


class FieldValues(NamedTuple):
    """Messages of one layout.

    rows : shape (n,), indices of these messages in the block, ascending.
    frame_id : of their header; empty without a header.
    stamps_ns : shape (n,), the header's stamps; None: no header.
    values : shape (n,); None: the messages' sequences are too short to contain the number.
    """

    rows: NDArray[np.int64]
    frame_id: str
    stamps_ns: NDArray[np.int64] | None
    values: NDArray[np.float64] | None


class Field:
    """A number within messages of a type.

    Parameters
    ----------
    path : fields separated by dots, ``[i]`` for an element; `yaw` of an orientation [rad].

    Raises
    ------
    UsageError : the type has no such field (the message lists its fields), or it is not a number.

    Attributes
    ----------
    is_integer : the field is an integer, so it may be raw counts.
    type, path : the type and the path.
    """

    def __init__(self, store: Typestore, type_name: str, path: str) -> None:
        self._store = store
        self.type = type_name
        self.path = path
        steps: list[tuple[str, int | None]] = []
        for step in path.split('.'):
            match = _STEP.match(step)
            if match is None:
                raise UsageError(f"'{path}' is not a field: write it as pose.position.x or data[0]")
            steps.append((match[1], int(match[2][1:-1]) if match[2] else None))
        self._steps = steps
        self.is_integer = self._check() in INTEGERS

    def _check(self) -> str:
        """Return the base type at the end of the path."""
        owner = self.type
        for depth, (name, index) in enumerate(self._steps):
            known = {field: (kind, what) for field, kind, what in self._fields(owner)}
            if owner == QUATERNION and name == YAW and index is None:
                if depth + 1 < len(self._steps):
                    raise UsageError(f"'{self.path}': yaw has no fields of its own")
                return YAW
            if name not in known:
                also = [YAW] if owner == QUATERNION else []
                raise UsageError(
                    f"{owner} has no field '{name}': " + suggestion(name, [*known, *also])
                )
            kind, what = known[name]
            if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                if index is None:
                    raise UsageError(
                        f"'{name}' of {owner} is a list: name an element, as in '{name}[0]'"
                    )
                if kind == Nodetype.ARRAY and index >= what[1]:
                    raise UsageError(
                        f"'{name}' of {owner} has {what[1]} elements, so "
                        f"'{name}[{index}]' does not exist"
                    )
                kind, what = what[0]
            elif index is not None:
                raise UsageError(f"'{name}' of {owner} is not a list: omit the index")
            if kind == Nodetype.NAME:
                owner = what
                continue
            if depth + 1 < len(self._steps):
                raise UsageError(f"'{name}' of {owner} has no fields of its own")
            if what[0] not in _CODES:
                raise UsageError(f"'{name}' of {owner} is a {what[0]}: name a numeric field")
            return what[0]
        if owner == QUATERNION:
            raise UsageError(
                f"'{self.path}' is an orientation: take its yaw with '{self.path}.{YAW}'"
            )
        inner = ', '.join(name for name, _, _ in self._fields(owner))
        raise UsageError(f"'{self.path}' is a {owner}: name one of its fields, {inner}")

    def _fields(self, owner: str) -> list[tuple[str, Nodetype, Any]]:
        """Return (name, kind, parameter of the kind) of a message type's fields."""
        return [(name, kind, what) for name, (kind, what) in self._store.fielddefs[owner][1]]

    def decode_block(self, block: Messages) -> tuple[list[FieldValues], list[int]]:
        """Return the field of many messages by layout, and the malformed rows."""
        malformed: list[int] = []
        found = []
        for group in groups(block, self._layout, malformed):
            rows, data, layout = group.rows, group.data, group.layout
            header = None
            if layout.stamp_at is not None:
                header = stamps(data, layout.stamp_at, layout.order)
            found.append(FieldValues(rows, layout.frame_id, header, layout.values(data)))
        return found, malformed

    def _layout(self, raw: bytes) -> _Layout:
        layout = _Layout(raw)
        self._go(layout, self.type, 0)
        return layout

    def _go(self, layout: _Layout, owner: str, depth: int) -> None:
        """Read the message up to the field."""
        name, index = self._steps[depth]
        last = depth + 1 == len(self._steps)
        if owner == QUATERNION and name == YAW:
            layout.found(4, 'd', turned=True)
            return
        for field, kind, what in self._fields(owner):
            if (kind, what) == (Nodetype.NAME, HEADER) and field != name:
                layout.header()
            elif field != name:
                self._skip(layout, kind, what)
            else:
                if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                    assert index is not None
                    count = what[1] if kind == Nodetype.ARRAY else layout.size()
                    if index >= count:
                        layout.absent()
                        return
                    kind, what = what[0]
                    if kind == Nodetype.BASE:
                        layout.skip_numbers(_CODES[what[0]], index)
                    else:
                        for _ in range(index):
                            self._skip(layout, kind, what)
                if last:
                    layout.found(1, _CODES[what[0]])
                else:
                    self._go(layout, what, depth + 1)
                return

    def _skip(self, layout: _Layout, kind: Nodetype, what: Any) -> None:
        if kind == Nodetype.BASE:
            if what[0] in _CODES:
                layout.skip_numbers(_CODES[what[0]], 1)
            elif what[0] == 'string':
                layout.skip_text()
            else:
                raise UsageError(
                    f"'{self.path}' follows a {what[0]}, a type that is not supported: name a "
                    'field before it'
                )
        elif kind == Nodetype.NAME:
            for _, inner, of in self._fields(what):
                self._skip(layout, inner, of)
        else:
            count = what[1] if kind == Nodetype.ARRAY else layout.size()
            inner, of = what[0]
            if inner == Nodetype.BASE and of[0] in _CODES:
                layout.skip_numbers(_CODES[of[0]], count)
            else:
                for _ in range(count):
                    self._skip(layout, inner, of)


class _Layout:
    """Positions of the field and the header in messages with this layout."""

    def __init__(self, raw: bytes) -> None:
        self._reader = Reader(raw)
        self._decides = [(0, 2)]  # byte ranges: byte order, lengths, the frame_id
        self.order = self._reader.order
        self.stamp_at: int | None = None
        self.frame_id = ''
        self._at = 0
        self._kind = ''
        self._count = 0
        self._turned = False

    @property
    def length(self) -> int:
        return self._reader.at

    def deciding(self) -> NDArray[np.bool_]:
        mask = np.zeros(self.length, bool)
        for start, end in self._decides:
            mask[start:end] = True
        return mask

    def size(self) -> int:
        """Read the length before a sequence or text."""
        count = self._reader.number('I')
        self._decides.append((self._reader.at - 4, self._reader.at))
        if count > len(self._reader.raw):
            raise MalformedMessageError('message is too short')
        return count

    def skip_numbers(self, code: str, count: int) -> None:
        self._reader.numbers(code, count)

    def skip_text(self) -> None:
        self._reader.numbers('B', self.size())

    def header(self) -> None:
        """Read a std_msgs/Header: its stamp is that of the measurement."""
        self._reader.numbers('I', 2)
        self.stamp_at = self._reader.at - 8
        start = self._reader.at
        self.skip_text()
        text = self._reader.raw[start : self._reader.at]
        padding = -(start - 4) % 4
        self.frame_id = bytes(text[padding + 4 : -1]).decode('utf-8', 'replace')
        self._decides.append((start + padding, self._reader.at))

    def found(self, count: int, code: str, *, turned: bool = False) -> None:
        """Note the field at this position: `count` numbers; `turned`: a quaternion, for its yaw."""
        self._reader.numbers(code, count)
        self._kind = np.dtype(self.order + code).str
        self._at = self._reader.at - count * np.dtype(self._kind).itemsize
        self._count, self._turned = count, turned

    def absent(self) -> None:
        """Note that the field is not in this message."""
        self._count = 0

    def values(self, data: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """Return the numbers of these messages, shape (n,)."""
        if not self._count:
            return None
        found = numbers(data, self._at, self._count, self._kind).astype(np.float64)
        if not self._turned:
            return found[:, 0]
        x, y, z, w = found.T
        return np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
