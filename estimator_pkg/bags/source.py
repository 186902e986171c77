# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a file of a bag contains: its topics, and its messages in pieces.

A file has `topics`, and `pieces(places)` with the messages of the topics at these places, and maybe
others. If it `sorts`, its pieces are known in advance and can be sorted with those of other files.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from estimator_pkg.errors import UserError
from estimator_pkg.messages.block import Block

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

CDR = 'cdr'
REPAIR = (
    'to repair it, use `mcap recover FILE -o NEW` (.mcap) or '
    '`sqlite3 FILE .recover | sqlite3 NEW` (.db3)'
)  # of a file whose recorder was killed


class UnreadableError(UserError):
    """A topic exists, but none of its messages can be decoded."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes
    ----------
    name, type : as in '/joint_states', 'sensor_msgs/msg/JointState'.
    count : messages in the bag.
    qos : the profiles that its publishers offered.
    definition, type_hash : the message definition and RIHS01 hash; empty if the bag has none.
    definition_format : 'ros2msg' or 'ros2idl'.
    serialization : 'cdr', or another format of a foreign recorder.
    """

    name: str
    type: str
    count: int = 0
    qos: tuple[Qos, ...] = ()
    definition: str = field(default='', repr=False)
    type_hash: str = ''
    definition_format: str = 'ros2msg'
    serialization: str = CDR


def full_type(name: str) -> str:
    """Return the name of a message type with its '/msg/', which some recorders leave out."""
    package, slash, short = name.partition('/')
    return f'{package}/msg/{short}' if slash and '/' not in short else name


class PendingBlock(NamedTuple):
    """Messages that are read together.

    start_ns : time of the first one. size : bytes when they are read.
    load : reads them; the blocks' `topic` are places in the topics of their file.
    """

    start_ns: int
    size: int
    load: Callable[[], Block]
