"""What a simulator is: declared parameters, the topics it speaks, and a stream of messages.

The same stream is published live, each message when it is due, and written into a bag. Times are
nanoseconds from the start of the simulation; a message's bytes are made when the start is known, so
stamps may stand anywhere in it: in a header, or in the rows of a batch of drive samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple


class Topic(NamedTuple):
    """A topic of a simulator.

    Attributes
    ----------
    name : relative, without a leading '/'; a bag stands for the root namespace.
    type : as in 'sensor_msgs/msg/JointState'.
    truth : True where no real plant would publish it.
    """

    name: str
    type: str
    truth: bool = False


class Message(NamedTuple):
    """One message of the stream.

    Attributes
    ----------
    due_ns : when it leaves [ns from the start].
    topic : name of its topic.
    encode : (start_ns) -> CDR bytes, with stamps for a simulation that started at `start_ns`.
    """

    due_ns: int
    topic: str
    encode: Callable[[int], bytes]


@dataclass(frozen=True)
class Simulator:
    """What an entry point of the group ``velocity_estimator.simulators`` names.

    Attributes
    ----------
    name : as users write it.
    summary : one line for ``velocity_estimator list``.
    parameters : the frozen dataclass that declares them (see `estimator_pkg.parameters`); what a
        range cannot say is checked in its ``__post_init__``, which raises UsageError.
    topics : (parameters) -> the topics this simulation speaks.
    generate : (parameters, duration, seed) -> chunks of messages. `duration` in s (math.inf: for
        ever), `seed` a whole number from 0. Messages are in the order in which they are due,
        within a chunk and from chunk to chunk. A chunk is made on demand while the node runs live,
        so it is short, and nothing is kept that grows with the duration.
    """

    name: str
    summary: str
    parameters: type
    topics: Callable[[Any], tuple[Topic, ...]]
    generate: Callable[[Any, float, int], Iterator[list[Message]]]
