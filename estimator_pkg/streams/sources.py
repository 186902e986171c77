# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages of the measurement to samples: joint states, and a number in any type."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from estimator_pkg.driver.raw_angle import RawAngle
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.field import Field
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.messages.joint_state_block import decode_block
from estimator_pkg.streams.arrays import Samples


class Sample(NamedTuple):
    """One message of the measurement in SI units; `efforts` is empty if it has none."""

    stamp_ns: int
    frame_id: str
    names: Sequence[str]
    positions: Sequence[float]
    efforts: Sequence[float] = ()


class Source(Protocol):
    """Converts the measurement's messages to samples."""

    type: str

    def sample(self, raw: bytes, publish_ns: int) -> Sample:
        """Convert one message; raise MalformedMessageError if it has another type."""

    def samples(self, block: Block) -> tuple[list[Samples], list[int]]:
        """Convert a block; return samples and malformed rows."""


class JointStates:
    """Samples from JointStates.

    Parameters
    ----------
    by_publisher : use the time of publishing, not the header stamp.
    """

    type = JOINT_STATE

    def __init__(self, by_publisher: bool = False) -> None:
        self._by_publisher = by_publisher
        self._layout = Decoder().layout

    def sample(self, raw: bytes, publish_ns: int) -> Sample:
        """See `Source`."""
        layout = self._layout(raw)
        return Sample(
            publish_ns if self._by_publisher else layout.stamp_ns(raw),
            layout.frame_id,
            layout.names,
            layout.numbers(raw, 0),
            layout.numbers(raw, 2),
        )

    def samples(self, block: Block) -> tuple[list[Samples], list[int]]:
        """See `Source`."""
        groups, malformed = decode_block(block)
        return [
            Samples(
                group.rows,
                group.frame_id,
                group.names,
                block.publish_ns[group.rows] if self._by_publisher else group.stamps_ns,
                group.arrays[0],
                group.arrays[2],
            )
            for group in groups
        ], malformed


class FieldSamples:
    """Samples of one joint from a number in messages of any type.

    Parameters
    ----------
    field : the number. joint : name of the joint. angle : conversion of the number to an angle.
    by_publisher : use the time of publishing also where the messages have a header.
    """

    def __init__(
        self, field: Field, joint: str, angle: RawAngle, by_publisher: bool = False
    ) -> None:
        self.type = field.type
        self._field, self._names, self._angle = field, (joint,), angle.angle
        self._by_publisher = by_publisher

    def sample(self, raw: bytes, publish_ns: int) -> Sample:
        """See `Source`; without a header the time is that of publishing."""
        stamp_ns, frame_id, value = self._field.decode(raw)
        return Sample(
            publish_ns if stamp_ns is None or self._by_publisher else stamp_ns,
            frame_id,
            self._names,
            () if value is None else (self._angle(value),),
        )

    def samples(self, block: Block) -> tuple[list[Samples], list[int]]:
        """See `Source`."""
        groups, malformed = self._field.decode_block(block)
        found = []
        for group in groups:
            stamps = group.stamps_ns
            if stamps is None or self._by_publisher:
                stamps = block.publish_ns[group.rows]
            positions = (
                np.zeros((len(group.rows), 0))
                if group.values is None
                else self._angle(group.values)[:, None]
            )
            found.append(
                Samples(
                    group.rows, group.frame_id, self._names, stamps, positions, positions[:, :0]
                )
            )
        return found, malformed

    def warnings(self, topic: str) -> list[str]:
        """Return the warning that the number is one of several frames in turn, if it is."""
        frames = sorted(self._field.frames)
        if len(frames) < 2:
            return []
        shown = ', '.join(frames[:3]) + (f' and {len(frames) - 3} more' if len(frames) > 3 else '')
        return [
            f"'{self._field.path}' of {topic} is not always of the same frame: {shown}; their "
            'values are mixed: name a topic that has one frame'
        ]

    def why_none(self, topic: str) -> str:
        """Return the text about a topic of which no message has the number."""
        why = self._field.why_absent()
        return f"no message of {topic} has '{self._field.path}'" + (why and f': {why}')
