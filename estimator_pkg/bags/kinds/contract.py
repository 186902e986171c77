"""What a kind of observer is to replay, `evaluate` and `tune`.

A `Kind` settles parameters and topics (`prepare`) and starts a `Replay`, which takes the messages
of a bag block by block and gives the messages that the live node would have published. A
`Recording` is what the observer needs of a bag, taken out once, so that it can be run with one set
of gains after the other.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.block import Block
from estimator_pkg.bags.reader import Bag, Topic
from estimator_pkg.bags.series import Series, positions
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UserError, plainly
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.observers.contract import STATUS_NAMES
from estimator_pkg.parameters import Parameter

ESTIMATE, STDDEV = 'estimate', 'estimate_stddev'
OUTPUTS = {ESTIMATE: TYPE, STDDEV: TYPE}    # of every kind, in this order
GAP = 'gap'                                 # time without samples, beside the statuses
PUBLISHER = 'publisher'                     # of 'stamp_source'
WHY_DROPPED = {
    'duplicate': 'stamps that repeat: the driver publishes faster than it stamps',
    'late': 'stamps older than the one before: messages overtake each other',
    'zero_stamp': "no stamp: use 'stamp_source: publisher'",
    'non_finite': 'NaN or infinite positions',
    'misconfigured': 'gains that are unstable at this sample rate: lower bandwidth_hz',
    'repeated': 'readings that are published again: the sensor is slower than its driver'}


class Request(NamedTuple):
    """What a user says of the input, beside parameters; empty: as usual.

    measurement : topic. angle : ``TOPIC:FIELD``. joints : names.
    """

    measurement: str | None = None
    angle: str | None = None
    joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Setup:
    """What a replay starts from; plain data, so that it can go to another process.

    values : parameters of the node. topics : what it listens to. path : of the number in them, for
    observers of one number in messages of any type.
    """

    values: Mapping[str, Any]
    topics: tuple[Topic, ...]
    path: str = ''

    def having(self, values: Mapping[str, Any]) -> Setup:
        """The same with these parameters over those it has."""
        return replace(self, values={**self.values, **values})


class Answers(NamedTuple):
    """Messages on one output that answer messages of a block.

    output : which of `Replay.outputs`. rows : shape (n,), the messages of the block that they
    answer, ascending. rank : their order among the answers to one message, shape (n,) or one for
    all; answers // 8 are equal in messages that belong together. raw : shape (n, bytes).
    """

    output: int
    rows: NDArray[np.int64]
    rank: NDArray[np.int64] | int
    raw: NDArray[np.uint8]


class Estimate(NamedTuple):
    """One joint's estimates, those that were published, and what became of its samples.

    velocity_stddev : shape (n,); nan where it is not known.
    validity : seconds by status, or published and withheld.
    status_stamps, status : shape (k,), of every sample that was used; empty where it is not known.
    due : shape (m,), stamps at which an estimate might have been published; empty where it is not
    known.
    """

    stamps: NDArray[np.int64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    velocity_stddev: NDArray[np.float64]
    samples: dict[str, Any]
    validity: dict[str, float]
    status_stamps: NDArray[np.int64]
    status: NDArray[np.int8]
    due: NDArray[np.int64] = np.zeros(0, np.int64)


@dataclass
class System:
    """One joint, or the joints that one observer estimates together, and its time by status.

    joint : of the driver. names : of its joints in the estimates.
    """

    joint: Joint
    names: tuple[str, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    stamps: list[int] = field(default_factory=list)
    statuses: list[int] = field(default_factory=list)
    _used: int = 0
    _gap: float = 0.0   # before the last sample [s]; 0: none

    def note(self) -> None:
        """Once after every message: if its sample was used, what the status is."""
        joint = self.joint
        if joint.used == self._used:
            return
        self._used = joint.used
        status = joint.estimate()[3]
        passed = joint.stamp_ns - self.stamps[-1] if self.stamps else 0
        if passed < 0 and self._gap and joint.stamp_ns > self.stamps[-2]:
            self._count(GAP, -self._gap)    # that sample's stamp was a stray
            passed = joint.stamp_ns - self.stamps[-2]
        seconds = max(passed, 0) * 1e-9     # a clock that jumped back tells none
        self._gap = seconds if seconds > joint.settings.gap_max else 0.0
        self._count(GAP if self._gap else STATUS_NAMES[status], seconds)
        self.stamps.append(joint.stamp_ns)
        self.statuses.append(status)

    def _count(self, name: str, seconds: float) -> None:
        if seconds:
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds

    def counts(self) -> dict[str, Any]:
        """Its samples: received, used, dropped by kind."""
        return {'received': self.joint.received, 'used': self.joint.used,
                'dropped': self.joint.dropped()}


    def why(self) -> str:
        """What a person should know where this has no estimates."""
        for kind, count in self.joint.dropped().items():
            if count == self.joint.received:
                return f'every sample of {", ".join(self.names)} was dropped: {WHY_DROPPED[kind]}'
        return self.joint.why()


class Replay(ABC):
    """One node's observers, fed with the messages of a bag.

    Attributes
    ----------
    outputs : what it writes: name below the node's -> message type. The first two are `OUTPUTS`.
    batches : number of an output with batches of estimates (`messages.drive_samples`) -> the joint
        whose every sample they tell.
    """

    outputs: Mapping[str, str] = OUTPUTS
    batches: Mapping[int, str] = MappingProxyType({})

    @abstractmethod
    def feed(self, names: Sequence[str], block: Block) -> Iterable[Answers]:
        """The answers to a block of messages of the topics it listens to.

        Parameters
        ----------
        names : the bag's topics, as the block counts them.
        """

    def answers(self, names: Sequence[str], block: Block) -> list[Answers]:
        """As `feed`.

        Raises
        ------
        UserError : the observer failed, as a model or an observer of the user's own may.
        """
        with plainly('the observer'):
            return list(self.feed(names, block))

    @abstractmethod
    def systems(self) -> dict[str, System]:
        """What it estimates, by name, once it has seen samples."""

    @abstractmethod
    def messages(self) -> dict[str, Any]:
        """How many messages were 'received', 'used', and 'dropped' by kind."""

    @abstractmethod
    def read(self) -> dict[str, tuple[int, int]]:
        """(messages, malformed ones among them) of every topic that came."""

    def end(self, path: str) -> list[str]:
        """As `finish`.

        Raises
        ------
        UserError : also where no message of one of the topics can be read.
        """
        for topic, (count, malformed) in self.read().items():
            if count == malformed:
                raise UserError(f"no message of '{topic}' of {path} can be read: all {count} are "
                                f'malformed{self.complaint()}')
        return self.finish(path)

    def complaint(self) -> str:
        """What is wrong with malformed messages, behind a colon; '' where it is not known."""
        return ''

    def finish(self, path: str) -> list[str]:
        """Once at the end: warnings. Raises UserError if what was asked for never came.

        Parameters
        ----------
        path : of the bag.
        """
        return []

    def why(self) -> str:
        """What a person should know where there are no estimates."""
        said = (system.why() for system in self.systems().values())
        return '; '.join(dict.fromkeys(filter(None, said)))

    def summary(self) -> dict[str, Any]:
        """What happened to every message and every sample."""
        return {'messages': self.messages(),
                'joints': {name: {**system.counts(), **_state(system)}
                           for name, system in self.systems().items()}}


def _state(system: System) -> dict[str, Any]:
    joint = system.joint
    return {'events': joint.events(), 'status_s': dict(system.seconds),
            'rate_hz': 1.0 / joint.mean_dt if joint.mean_dt > 0.0 else None, 'why': joint.why()}


class Recording(ABC):
    """What observers of one kind need of a bag; can go to another process."""

    @abstractmethod
    def run(self, observer: str, values: Mapping[str, Any], fast: bool | None = None
            ) -> dict[str, Estimate]:
        """What this observer publishes with these parameters, by joint.

        Parameters
        ----------
        fast : compile or not, where that can be chosen; None: where it pays.

        Raises
        ------
        UserError, UsageError : a parameter is wrong, or the bag lacks what the observer needs.
        """

    @abstractmethod
    def split(self, held_out: float) -> tuple[Recording, Recording]:
        """All but the last part, and what gives the estimates of the last part.

        The latter may begin earlier, for observers that have to run in.
        """

    def apart(self) -> dict[str, Recording]:
        """What can have gains of its own, by joint; one without a name: only the whole."""
        return {'': self}

    def per_sample(self) -> Recording:
        """The same with an estimate of every sample, where messages hold many of them."""
        return self

    def size(self) -> int:
        """Samples."""
        return 0


class Kind(ABC):
    """What an entry point of the group ``velocity_estimator.kinds`` names.

    Attributes
    ----------
    node : default name of the node, whose section of a parameter file is meant.
    settings : declares what is set of the node as a whole.
    usual : names of the topics it listens to.
    wraps : whether its joints take `wrap_period`.
    """

    node: str
    settings: type
    usual: tuple[str, ...] = ('/joint_states',)
    wraps: bool = True

    @abstractmethod
    def parameters(self, observer: str) -> dict[str, Parameter]:
        """What can be set beside `settings`, by name."""

    @abstractmethod
    def prepare(self, bag: Bag, values: Mapping[str, Any], request: Request) -> Setup:
        """Parameters and topics, as far as the bag says.

        Raises
        ------
        UserError, UsageError : a topic is not there, or the request makes no sense for this kind.
        """

    @abstractmethod
    def start(self, setup: Setup) -> Replay:
        """A replay from the beginning; raises UserError or UsageError for wrong parameters."""

    @abstractmethod
    def recording(self, bag: Bag, setup: Setup, measured: Mapping[str, Series]) -> Recording:
        """What observers of this kind need of the bag.

        Parameters
        ----------
        measured : what `measured` gave, if it was read already.
        """

    def measured(self, bag: Bag, setup: Setup) -> dict[str, Series]:
        """The positions that are measured, at the times that the observer takes; {}: none are."""
        topic = setup.topics[0]
        if topic.type != TYPE:
            return {}
        return positions(bag, topic.name, setup.values.get('stamp_source') == PUBLISHER)

    def recognises(self, bag: Bag) -> bool:
        """True if a bag can be for nothing else."""
        return False
