# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interface of a simulator: parameters, topics, and a stream of messages.

The same stream is published live, each message when it is due, or written into a bag. Times are
nanoseconds from the start of the simulation. A message is encoded when the start is known, so
stamps may be anywhere in it: in a header, or in the rows of a batch of drive samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.parameters import structural

FASTEST = 2e4  # fastest rate of a plant that the simulator can integrate [1/s]
FOREVER = 0.0  # duration of a node that never ends


class Topic(NamedTuple):
    """A topic of a simulator.

    Attributes
    ----------
    name : relative, without a leading '/'; in a bag the namespace is the root.
    type : as in 'sensor_msgs/msg/JointState'.
    truth : True for a topic that a real plant would not publish.
    """

    name: str
    type: str
    truth: bool = False


class Message(NamedTuple):
    """One message of the stream.

    Attributes
    ----------
    due_ns : when it is published [ns from the start].
    topic : name of its topic.
    encode : (start_ns) -> CDR bytes, with stamps for a simulation that starts at `start_ns`.
    """

    due_ns: int
    topic: str
    encode: Callable[[int], bytes]


@dataclass(frozen=True)
class RunSettings:
    """Random seed and duration of a run, and the subscribers that it waits for.

    Every simulator node has them in addition to the parameters of its simulator.
    """

    seed: int = structural(
        1,
        range=(0, 2**31 - 1),  # a slider of rqt_reconfigure has 32 bits
        description='the same seed and parameters give the same values and the same stamps '
        "relative to the start, live and in 'velocity_estimator simulate'",
    )
    duration: float = structural(
        FOREVER, unit='s', range=(0.0, 1e9), description='the node ends after this time; 0: never'
    )
    wait_for_subscribers: int = structural(
        0,
        range=(0, 1000),
        description='number of subscribers of each measurement topic to wait for before the start, '
        'so that they miss nothing',
    )
    wait_for_truth_subscribers: int = structural(
        0,
        range=(0, 1000),
        description='the same for each truth topic (a recorder of all topics counts as 1 on each)',
    )


@dataclass(frozen=True)
class Simulator:
    """A simulator, as an entry point of the group ``velocity_estimator.simulators`` names it.

    Attributes
    ----------
    name : as users write it.
    summary : one line for ``velocity_estimator list``.
    parameters : the frozen dataclass that declares them (see `estimator_pkg.parameters`). Its
        ``__post_init__`` checks what a range cannot express and raises UsageError.
    topics : (parameters) -> the topics that this simulation publishes.
    generate : (parameters, duration, seed) -> chunks of messages. `duration` in s (math.inf:
        endless), `seed` an integer >= 0. Messages are sorted by their due time, within a chunk and
        from chunk to chunk. A live node makes each chunk on demand, so chunks are short and memory
        does not grow with the duration. Raises UsageError for inconsistent parameters, at once or
        with the first chunk, and UserError for a plant that diverges: no message carries NaN or
        infinity.
    SETTINGS : declares what its node has in addition to the parameters.
    """

    SETTINGS: ClassVar[type] = RunSettings

    name: str
    summary: str
    parameters: type
    topics: Callable[[Any], tuple[Topic, ...]]
    generate: Callable[[Any, float, int], Iterator[list[Message]]]


def check_rate(rate: float) -> None:
    """Raise UsageError if the fastest rate [1/s] of a plant exceeds `FASTEST`."""
    if not rate <= FASTEST:
        raise UsageError(
            f'the plant has a time constant of {1.0 / rate:.2g} s; the simulator needs at least '
            f'{1.0 / FASTEST:g} s: increase the inertia, or decrease damping or stiffness'
        )


def diverged(time: float) -> UserError:
    """Return the error for a plant whose state diverged at `time` [s]."""
    return UserError(
        f'the simulated plant diverged at {time:.3g} s: it is unstable, or faster than the '
        'simulator can integrate; check the gains and the parameters of the plant'
    )
