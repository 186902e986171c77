"""What a simulator is: declared parameters, the topics it speaks, and a stream of messages.

The same stream is published live, each message when it is due, and written into a bag. Times are
nanoseconds from the start of the simulation; a message's bytes are made when the start is known, so
stamps may stand anywhere in it: in a header, or in the rows of a batch of drive samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from estimator_pkg.errors import UsageError, UserError

FASTEST = 2e4  # 1/s, of a plant that can still be followed live


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
        so it is short, and nothing is kept that grows with the duration. Raises UsageError for
        parameters that do not go together, at once or with the first chunk, and UserError for a
        plant that runs away: no message carries numbers that are none.
    """

    name: str
    summary: str
    parameters: type
    topics: Callable[[Any], tuple[Topic, ...]]
    generate: Callable[[Any, float, int], Iterator[list[Message]]]


def followed(rate: float) -> None:
    """Raises UsageError where the fastest rate [1/s] of a plant is more than `FASTEST`."""
    if not rate <= FASTEST:
        raise UsageError(
            f'the plant has a time constant of {1.0 / rate:.2g} s, but none below '
            f'{1.0 / FASTEST:g} s can be followed: its inertia is too small for its '
            'damping or stiffness'
        )


def ran_away(time: float) -> UserError:
    """What is told of a plant whose numbers grew beyond all bounds at `time` [s]."""
    return UserError(
        f'the simulated plant ran away at {time:.3g} s: it is unstable, or quicker '
        'than the simulator can follow'
    )
