# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One number in messages of any type: ``pose.position.x``, ``data[0]``, ``orientation.yaw``.

The type's definition lists the fields before the number. Fields of variable length (texts,
sequences) are measured once per layout, so messages with the same layout are decoded together.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.layouts import Layout, groups, numbers, stamps

HEADER = 'std_msgs/msg/Header'
QUATERNION = 'geometry_msgs/msg/Quaternion'
YAW = 'yaw'
CHILD = 'child_frame_id'
SEQUENCE = -1  # a length that each message has
MOST_FRAMES = 100  # that are remembered
DEEPEST = 30  # levels of messages within messages; a type that contains itself has more
MOST_FIELDS = 100_000  # of a type, those of its nested messages included

_CODES = {
    'bool': 'B',
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
BASES = {*_CODES, 'string', 'wstring'}
_STEP = re.compile(r'([A-Za-z_]\w*)(?:\[(\d+)\])?$')


class Kind(NamedTuple):
    """The type of a field.

    base : 'float64', 'string', ... or a message type, as in 'geometry_msgs/msg/Pose'.
    length : number of elements; None: not a list; `SEQUENCE`: as many as the message has.
    """

    base: str
    length: int | None = None

    @property
    def is_message(self) -> bool:
        """True for a message type."""
        return '/' in self.base


_HEADER = Kind(HEADER)
EMPTY = {'structure_needs_at_least_one_member': Kind('uint8')}  # of a message without fields
Definition = Callable[[str], Mapping[str, Kind]]  # message type -> its fields, in their order


class _Level(NamedTuple):
    """A step of the path: its field and element, and the fields before and after it."""

    name: str
    before: list[tuple[str, Kind]]
    kind: Kind
    element: int | None
    after: list[Kind]


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


class FieldValue(NamedTuple):
    """One message, as `FieldValues`."""

    stamp_ns: int | None
    frame_id: str
    value: float | None


class Field:
    """A number within messages of a type.

    Parameters
    ----------
    definition : returns the fields of a message type.
    type_name : of the messages, as in 'nav_msgs/msg/Odometry'.
    path : fields separated by dots, ``[i]`` for an element; `yaw` of an orientation [rad].

    Raises
    ------
    UsageError : the type has no such field (the message lists its fields), it is not a number, or
        the type has too many fields.

    Attributes
    ----------
    is_integer : the field is an integer, so it may be raw counts.
    type, path : the type and the path.
    frames : of the list elements that had the number, as in 'base -> tool'.
    """

    def __init__(self, definition: Definition, type_name: str, path: str) -> None:
        self._definition = definition
        self.type = type_name
        self.path = path
        self._extents: dict[str, tuple[int, int]] = {}
        self._extent(type_name)
        self._levels: list[_Level] = []
        self.is_integer = self._follow(path.split('.')) in INTEGERS
        self._stamped_by = self._find_header()
        self._known: _Layout | None = None
        self.frames: set[str] = set()
        self._longest = (0, '')  # of the sequences that are too short to contain the number

    def _extent(self, owner: str, level: int = 1) -> tuple[int, int]:
        """Return (number of fields, levels of messages) of a message type.

        Raises
        ------
        UsageError : it has more fields or levels than are read.
        """
        if owner not in self._extents:
            fields, levels = 0, 1
            for kind in self._definition(owner).values():
                inner = (1, 0)
                if kind.is_message:
                    inner = self._extent(kind.base, level + 1) if level < DEEPEST else (0, DEEPEST)
                    inner = inner[0] * max(kind.length or 1, 1), inner[1]
                fields, levels = fields + inner[0], max(levels, inner[1] + 1)
            if fields > MOST_FIELDS or levels > DEEPEST:
                raise UsageError(
                    f'{self.type} cannot be read: it has more than {MOST_FIELDS:,} fields or '
                    f'{DEEPEST} levels of messages within messages; name a topic of another type'
                )
            self._extents[owner] = fields, levels
        return self._extents[owner]

    def _follow(self, steps: list[str]) -> str:
        """Find the levels of the path; return the base type at its end."""
        owner = self.type
        for depth, step in enumerate(steps):
            last = depth + 1 == len(steps)
            match = _STEP.match(step)
            if match is None:
                raise UsageError(
                    f"'{self.path}' is not a field: write it as pose.position.x or data[0]"
                )
            name, index = match[1], int(match[2]) if match[2] else None
            known = self._definition(owner)
            if owner == QUATERNION and step == YAW:
                if not last:
                    raise UsageError(f"'{self.path}': yaw has no fields of its own")
                return YAW
            if name not in known:
                also = [YAW] if owner == QUATERNION else []
                raise UsageError(
                    f"{owner} has no field '{name}': " + suggestion(name, [*known, *also])
                )
            kind = known[name]
            wrong = ''
            if kind.length is None and index is not None:
                wrong = 'is not a list: omit the index'
            elif kind.length is not None and index is None:
                wrong = f"is a list: name an element, as in '{name}[0]'"
            elif index is not None and index >= (kind.length or 0) != SEQUENCE:
                wrong = f"has {kind.length} elements, so '{step}' does not exist"
            elif not kind.is_message and not last:
                wrong = 'has no fields of its own'
            elif not kind.is_message and kind.base not in _CODES:
                wrong = f'is a {kind.base}: name a numeric field'
            if wrong:
                raise UsageError(f"'{name}' of {owner} {wrong}")
            fields = list(known.items())
            place = fields.index((name, kind))
            after = [each for _, each in fields[place + 1 :]]
            self._levels.append(_Level(name, fields[:place], kind, index, after))
            owner = kind.base
        if owner in _CODES:
            return owner
        if owner == QUATERNION:
            raise UsageError(
                f"'{self.path}' is an orientation: take its yaw with '{self.path}.{YAW}'"
            )
        inner = ', '.join(self._definition(owner))
        raise UsageError(f"'{self.path}' is a {owner}: name one of its fields, {inner}")

    def _find_header(self) -> int:
        """Return the depth at which a header follows the number; -1: none is needed or there.

        The stamp is that of the last header before the number on the path's own levels, else of
        the first one after it.

        Raises
        ------
        UsageError : a field of a type that is not supported has to be skipped.
        """
        before = [kind for level in self._levels for _, kind in level.before]
        self._check_skipped(before)
        depths = [depth for depth, level in enumerate(self._levels) if _HEADER in level.after]
        if _HEADER in before or not depths:
            return -1
        after = self._levels[depths[-1]].after
        self._check_skipped(after[: after.index(_HEADER)])
        for level in self._levels[depths[-1] + 1 :]:
            self._check_skipped(level.after)
        return depths[-1]

    def _check_skipped(self, kinds: Iterable[Kind]) -> None:
        for kind in kinds:
            if kind.is_message:
                self._check_skipped(self._definition(kind.base).values())
            elif kind.base not in _CODES and kind.base != 'string':
                raise UsageError(
                    f"'{self.path}' of {self.type} cannot be read: a {kind.base}, a type that is "
                    'not supported, is before it or before its header'
                )

    def why_absent(self) -> str:
        """Return why messages lack the number, as "'position' has at most 2 elements"; or ''."""
        count, name = self._longest
        if not name:
            return ''
        return f"'{name}' " + (
            f'has at most {count} element{"s" * (count > 1)}' if count else 'is empty'
        )

    def decode_block(self, block: Block) -> tuple[list[FieldValues], list[int]]:
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

    def decode(self, raw: bytes) -> FieldValue:
        """Return the field of one message; raise MalformedMessageError if it has another type.

        It equals that of `decode_block` to the last bit.
        """
        layout = self._known
        if layout is None or not layout.fits(raw):
            layout = self._known = self._layout(raw)
        stamp_ns = None if layout.stamp_at is None else layout.stamp_ns(raw)
        return FieldValue(stamp_ns, layout.frame_id, layout.value(raw))

    def _layout(self, raw: bytes) -> _Layout:
        layout = _Layout(raw)
        self._go(layout, 0)
        layout.end()
        if layout.has_number and any(level.element is not None for level in self._levels[:-1]):
            names = filter(None, (layout.frame_id, layout.child_frame_id))
            if len(self.frames) < MOST_FRAMES:
                self.frames.add(' -> '.join(names))
        return layout

    def _go(self, layout: _Layout, depth: int) -> None:
        """Read the message up to the field, and on to the header that follows it."""
        if depth == len(self._levels):
            layout.found(4, 'd', turned=True)  # the yaw of a quaternion
            return
        name, before, kind, index, after = self._levels[depth]
        for field, each in before:
            if each == _HEADER:
                layout.header()
            elif field == CHILD and each == Kind('string'):
                layout.child_frame_id = layout.text()
            else:
                self._skip(layout, each)
        count, place = 1, 0
        if index is not None:
            count, place = layout.size() if kind.length == SEQUENCE else kind.length or 0, index
        self._skip_some(layout, kind.base, min(place, count))
        if place >= count:
            self._longest = max(self._longest, (count, name))
        elif kind.is_message:
            self._go(layout, depth + 1)
        else:
            layout.found(1, _CODES[kind.base])
        if 0 <= self._stamped_by <= depth:
            self._skip_some(layout, kind.base, max(count - place - 1, 0))
            for each in after:
                if each == _HEADER and depth == self._stamped_by:
                    layout.header()
                    return
                self._skip(layout, each)

    def _skip(self, layout: _Layout, kind: Kind) -> None:
        count = layout.size() if kind.length == SEQUENCE else kind.length
        self._skip_some(layout, kind.base, 1 if count is None else count)

    def _skip_some(self, layout: _Layout, base: str, count: int) -> None:
        if base in _CODES:
            layout.skip_numbers(_CODES[base], count)
            return
        for _ in range(count):
            if base == 'string':
                layout.skip_text()
            else:
                for kind in self._definition(base).values():
                    self._skip(layout, kind)


class _Layout(Layout):
    """Positions of the field and the header in messages with this layout."""

    child_frame_id = ''
    _at = _count = 0
    _code, _turned = 'B', False

    def end(self) -> None:
        """See `Layout`."""
        super().end()
        self._numbers = struct.Struct(f'{self.order}{self._count}{self._code}')

    def found(self, count: int, code: str, *, turned: bool = False) -> None:
        """Note the field at this position: `count` numbers; `turned`: a quaternion, for its yaw."""
        self._at = self.skip_numbers(code, count)
        self._count, self._code, self._turned = count, code, turned

    @property
    def has_number(self) -> bool:
        """False if a sequence is too short to contain the field."""
        return self._count > 0

    def value(self, raw: bytes) -> float | None:
        """Return the number of a message; None if it is not in it."""
        if not self._count:
            return None
        found = self._numbers.unpack_from(raw, self._at)
        return _yaw(*_sin_cos_of_yaw(*found)) if self._turned else float(found[0])

    def values(self, data: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """Return the numbers of these messages, shape (n,)."""
        if not self._count:
            return None
        found = numbers(data, self._at, self._count, self.order + self._code).astype(np.float64)
        if not self._turned:
            return found[:, 0]
        # NumPy's arctan2 differs from that of single numbers in the last bit on some processors.
        with np.errstate(all='ignore'):
            sin, cos = _sin_cos_of_yaw(*found.T)
        return np.fromiter(map(_yaw, sin.tolist(), cos.tolist()), np.float64, len(sin))


def _yaw(sin: float, cos: float) -> float:
    """Return the angle; NaN for a quaternion of zeros, which is no orientation."""
    return math.atan2(sin, cos) if sin or cos else math.nan


def _sin_cos_of_yaw(x: Any, y: Any, z: Any, w: Any) -> tuple[Any, Any]:
    """Return sine and cosine of the yaw, both times the same positive number.

    Parameters
    ----------
    x, y, z, w : of the quaternion: numbers, or arrays of equal shape.
    """
    return 2.0 * (w * z + x * y), w * w + x * x - y * y - z * z
