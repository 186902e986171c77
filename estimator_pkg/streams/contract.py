# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The interface of a stream, the ROS-free core of a node: messages in, messages out.

A `Stream` takes the bytes of messages on its input ports and returns the bytes of messages on its
output ports. A node connects the ports to subscriptions and publishers, a replay to the topics of a
bag, so both give the same bytes. A new family of observers is one file here and one in `observers`,
each found through its entry point.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import params_file
from estimator_pkg.circle import Circle
from estimator_pkg.driver.configuration import SELECT_OBSERVER, Configuration, JointSettings
from estimator_pkg.driver.joint import Joint, Tried
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages import joint_state
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.field import Field
from estimator_pkg.observers import find, instead
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import Parameter, build, declared, parameter, structural
from estimator_pkg.sensor.guard import why_dropped
from estimator_pkg.streams.history import History

TYPICAL_DT = 1e-3  # [s]
NO_NUMBERS = 'numbers become too large or too small for these gains'
HEADER, PUBLISHER = 'header', 'publisher'  # of the parameter stamp_source
NAN, SKIP = 'nan', 'skip'  # of the parameter no_estimate

T = TypeVar('T')
Values = Mapping[str, Any]
Answer = dict[int, bytes]  # CDR bytes by number of the output; one left out has nothing to say


class Port(NamedTuple):
    """An input.

    topic : name, relative or absolute. type : as in 'sensor_msgs/msg/JointState'. answered :
    estimates answer its messages. optional : the stream works without it. any_number : in a bag
    the topic may have any type with a number. field : path of the number in its messages, for
    `Stream.read_field`; '': the stream reads the type itself.
    """

    topic: str
    type: str
    answered: bool = True
    optional: bool = False
    any_number: bool = False
    field: str = ''

    @property
    def in_bag(self) -> str:
        """Name of the topic in a bag, in which the namespace is the root."""
        return f'/{self.topic.lstrip("/")}'


class Output(NamedTuple):
    """An output below the node's name.

    on_demand : only made while there is a subscriber. latched : late joiners get the last message.
    extra : replay makes it only on request.
    """

    name: str
    type: str
    on_demand: bool = False
    latched: bool = False
    extra: bool = False


ESTIMATE = Output('estimate', joint_state.TYPE)
STDDEV = Output('estimate_stddev', joint_state.TYPE, on_demand=True)


class Answers(NamedTuple):
    """Messages on one output that answer messages of a block.

    output : number of the output. rows : shape (n,), the answered messages of the block, ascending.
    rank : their order among the answers to one message, shape (n,) or one for all; messages of one
    answer have equal ranks // 8. raw : shape (n, bytes).
    """

    output: int
    rows: NDArray[np.int64]
    rank: NDArray[np.int64] | int
    raw: NDArray[np.uint8]


class Reply(NamedTuple):
    """The reply of an action; `parameters` are to be set, and may be refused."""

    success: bool
    message: str
    parameters: Mapping[str, Any] = {}


class Action(NamedTuple):
    """A service below the node's name: std_srvs/SetBool if it takes a flag, else Trigger."""

    name: str
    flag: bool
    call: Callable[[bool], Reply]


class Request(NamedTuple):
    """The user's choice of a bag's topics, without parameters; empty: the defaults.

    measurement : topic. angle : ``TOPIC:FIELD``. joints : names.
    """

    measurement: str | None = None
    angle: str | None = None
    joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class StreamSettings:
    """Base of the dataclasses that declare the parameters of a node as a whole."""

    no_estimate: str = parameter(
        NAN,
        choices=(NAN, SKIP),
        description='content of ~/estimate while a joint of a message has no estimate: nan (its '
        'velocity is NaN, its position as measured), or skip (no message leaves until every joint '
        'of it has an estimate)',
    )
    wait_for_subscriber: float = structural(
        5.0,
        unit='s',
        range=(0.0, 60.0),
        description='time after the inputs are connected in which the estimates wait for their '
        'first subscriber, which then gets the last ones at once, at most the depth of the topic; '
        '0: they do not wait',
    )

    groups: Mapping[str, Any] = field(default_factory=dict, kw_only=True)  # see `Stream.groups`

    def find_observer(self) -> type[Observer]:
        """Return the observer; raise UsageError for inconsistent settings."""
        raise NotImplementedError


@dataclass(frozen=True)
class JointsSettings(StreamSettings):
    """Parameters of a node that estimates each joint of its messages by itself."""

    joints: tuple[str, ...] | None = structural(
        None,
        kind=tuple,
        description='names of the joints to estimate; automatic: every joint that appears',
    )
    joints_max: int = structural(
        512,
        range=(1, 1_000_000),
        description='largest number of joints; further names get no estimate and are counted. '
        'Joints that the parameters name do not count',
    )
    expiry: float = structural(
        600.0,
        unit='s',
        range=(0.0, 1e9),
        description='after this time without a sample a joint is removed, unless the parameters '
        'name it; 0: never',
    )

    @property
    def only(self) -> tuple[str, ...]:
        """The joints to estimate; empty: all. YAML writes an empty list as an empty text."""
        return tuple(name for name in self.joints or () if name)


class Stream(ABC):
    """Computes the messages that answer one family's input messages.

    Parameters
    ----------
    settings : an instance of `SETTINGS`.
    observer : of kind `KIND`.
    bank : the joints; see `estimator_pkg.driver.bank.Bank`.
    inputs, outputs : the ports; the first input is the measurement, the first two outputs are
        `ESTIMATE` and `STDDEV`.

    Attributes
    ----------
    KIND : kind of the family's observers. NODE : name of its node.
    SETTINGS, PER_JOINT : declare the parameters of the node and of each joint.
    OVERRIDES : joints can have their own parameters.
    WRAPS : joints have `wrap_period`.
    SEPARATE : each joint can be estimated without the others.
    IN_ARRAYS : `run` takes all samples of a joint at once.
    USUAL : usual topics of the family in a bag.
    KEPT, NAMED_IN, UNUSED, MISMATCH, NAME_THEM : texts: the word for a joint, the parameters that
        name joints, why messages are unused by the kind of `unused`, why they are mismatched, and
        how a command names the joints.
    wanted : True for each output that is to be made.
    received, malformed : numbers of messages by port. answered : messages with an estimate.
    skip : True if a message with a joint that has no estimate is not answered.
    complaint : (topic, error) of the newest malformed message.
    topics : names of the connected topics by port; '' for none.
    history : time by status of each joint; None: not recorded.
    """

    KIND: ClassVar[str]
    NODE: ClassVar[str]
    SETTINGS: ClassVar[type[StreamSettings]]
    PER_JOINT: ClassVar[type[JointSettings]] = JointSettings
    OVERRIDES: ClassVar[bool] = True
    WRAPS: ClassVar[bool] = True
    SEPARATE: ClassVar[bool] = False
    IN_ARRAYS: ClassVar[bool] = False
    USUAL: ClassVar[tuple[str, ...]] = ('/joint_states',)
    KEPT: ClassVar[str] = 'joint'
    NAMED_IN: ClassVar[str] = "'joints'"
    UNUSED: ClassVar[Mapping[str, str]] = {
        'empty': 'carry no position and are dropped: publish positions, or remap the input to a '
        'topic that has them'
    }
    MISMATCH: ClassVar[str] = 'their names and positions differ in number'
    NAME_THEM: ClassVar[str] = "name the joints with --set 'joints=[...]'"

    def __init__(
        self,
        settings: Any,
        observer: type[Observer],
        bank: Any,
        inputs: Sequence[Port],
        outputs: Sequence[Output] = (ESTIMATE, STDDEV),
    ) -> None:
        self.settings, self.observer, self.bank = settings, observer, bank
        self.inputs, self.outputs = tuple(inputs), tuple(outputs)
        self.wanted = [not output.extra for output in self.outputs]
        self.received, self.malformed = [0] * len(self.inputs), [0] * len(self.inputs)
        self.answered = 0
        self.complaint = ('', '')
        self.topics = [port.in_bag for port in self.inputs]
        self.history: dict[str, History] | None = None
        self._notices: list[str] = []

    # Construction

    @classmethod
    def parameters(cls, observer: str | type[Observer]) -> dict[str, Parameter]:
        """Return all parameters except `SETTINGS` by name: gains first; raise UsageError."""
        found = find(observer) if isinstance(observer, str) else observer
        return cls.configure(found, None, {}, {}).parameters()

    @classmethod
    def configure(
        cls,
        observer: type[Observer],
        settings: Any,
        common: Values,
        overrides: Mapping[str, Values],
    ) -> Configuration:
        """Return gains and settings per joint; raise UsageError for a wrong one."""
        return Configuration(observer, common, overrides, cls.PER_JOINT)

    @classmethod
    def groups(cls, settings: Any) -> dict[str, type]:
        """Return the declarations of parameters that these settings name, by prefix."""
        return {}

    @classmethod
    def start(cls, settings: Any, configuration: Any) -> Stream:
        """Return a stream; raise UserError for problems beyond ranges."""
        family: Any = cls  # each takes settings and configuration
        stream: Stream = family(settings, configuration)
        stream.try_gains(configuration)
        return stream

    @classmethod
    def of(cls, values: Values) -> Stream:
        """Return a stream with these parameters by name.

        Raises
        ------
        UserError, UsageError : an unknown name, a wrong value, a model that cannot be used.
        """
        common, overrides = params_file.split(values)
        of_node = {name: common.pop(name) for name in declared(cls.SETTINGS) if name in common}
        settings = build(cls.SETTINGS, of_node)
        groups = cls.groups(settings)
        settings = replace(
            settings, groups={name: _taken(common, name, each) for name, each in groups.items()}
        )
        observer = settings.find_observer()
        common.pop('observer', None)  # of a node with a single observer
        known = cls.parameters(observer)
        for name in common:
            if name not in known:
                every = {**known, **declared(cls.SETTINGS)}
                raise UsageError(
                    f"unknown parameter '{name}': "
                    + (
                        instead(name, every, observer, SELECT_OBSERVER)
                        or params_file.parameter_suggestion(
                            name, every, known if cls.OVERRIDES else ()
                        )
                    )
                )
        if overrides and not cls.OVERRIDES:
            raise UsageError(
                f"'{params_file.OVERRIDES}.<joint>.<parameter>': {cls.NODE} has one set of "
                'parameters'
            )
        return cls.start(settings, cls.configure(observer, settings, common, overrides))

    # Messages

    def feed(self, port: int, raw: bytes, publish_ns: int) -> Iterable[Answer]:
        """Return the answers to one message; what the first does not need is made after it.

        The caller takes all of them, one by one, and publishes each before it takes the next.

        Parameters
        ----------
        port : number of the input. raw : CDR bytes. publish_ns : when it was published [ns].
        """
        self.received[port] += 1
        try:
            answers = self.take(port, raw, publish_ns)
        except MalformedMessageError as error:
            self.malformed[port] += 1
            self.complaint = self.topics[port], str(error)
            return ()
        if self.history is not None:
            self._note(self.history)
        return answers

    @abstractmethod
    def take(self, port: int, raw: bytes, publish_ns: int) -> Iterable[Answer]:
        """As `feed`; raise MalformedMessageError if the bytes are not a message of the port."""

    def feed_block(self, ports: Sequence[int], block: Block) -> Iterable[Answers] | None:
        """As `feed` for a block of messages in arrays; None if the family does not support it.

        Parameters
        ----------
        ports : port by number of the block's topic.
        """
        return None

    def read_field(self, field: Field, port: int = 0) -> None:
        """Take the measurement, or another input, from a number in messages of any type.

        Raises
        ------
        UsageError : the family needs more than a number, or the number cannot be used.
        """
        raise UsageError(f'--angle is for observers of single angles, and {self.NODE} needs more')

    def _note(self, history: dict[str, History]) -> None:
        for name, joint in self.bank.joints.items():
            if name not in history:
                history[name] = History()
            history[name].note(joint)

    # Parameters

    def check(self, configuration: Any) -> None:
        """Raise UsageError for gains that do not work at the measured rates and present states.

        Raises
        ------
        UsageError : the message has the gain, the joint, and the reason.
        """
        try:
            self.try_gains(configuration)
            built, tried = None, None
            for name, joint in self.bank.joints.items():
                wanted = configuration.for_joint(name)
                if wanted != built:  # most joints have what the one before has
                    built, tried = wanted, self._build(configuration, name)
                if wanted[0] != joint.gains:
                    self._check_change(name, joint, tried)
        except (ArithmeticError, ValueError) as error:
            raise UsageError(f'{NO_NUMBERS} ({error})') from error

    def try_gains(self, configuration: Any) -> None:
        """Raise UsageError for gains that do not work, also of joints that have not appeared."""
        for name in ('', *configuration.overrides):
            self._build(configuration, name)

    def _build(self, configuration: Any, joint: str) -> Any:
        """Return what the gains of this joint imply ('': of one without override)."""
        gains, settings = configuration.for_joint(joint)
        circle = Circle(settings.wrap_period, settings.unwrap)
        return Tried(self.observer.bound(gains), gains, circle)

    def _check_change(self, name: str, joint: Joint, tried: Any) -> None:
        why = tried.limits(joint.mean_dt) if joint.mean_dt > 0.0 else None
        if why:
            raise UsageError(f'{self._called(name)}: {why}')
        joint.try_step(tried)

    def _called(self, name: str) -> str:
        """Return the text for a joint; '' is common to all joints."""
        return f"{self.KEPT} '{name}'" if name else self.observer.name

    @property
    def skip(self) -> bool:
        """True if a message without an estimate of every joint is not answered."""
        return bool(self.settings.no_estimate == SKIP)

    def set_live(self, values: Values) -> None:
        """Use other live `SETTINGS` from the next message on: they are read where they act."""
        live = {name for name, each in declared(self.SETTINGS).items() if not each.structural}
        changed = {name: value for name, value in values.items() if name in live}
        self.settings = replace(self.settings, **changed)

    def apply(self, configuration: Any) -> None:
        """Use these gains and settings from the next sample on; every joint keeps its state."""
        self.bank.configuration = configuration
        for name, joint in self.bank.joints.items():
            gains, settings = configuration.for_joint(name)
            if settings != joint.settings:
                joint.set_settings(settings)
            if gains != joint.gains:
                joint.set_gains(gains)
                self._gains_changed(name)

    def _gains_changed(self, name: str) -> None:
        """React to other gains of a joint, which apply from the next sample on."""

    # Live only

    def go_live(self) -> None:
        """Limit the number of joints, and prepare everything that the first sample needs."""
        most = getattr(self.settings, 'joints_max', None)
        if most is not None:
            self.bank.most = most
        with suppress(Exception):  # of a user's model: reported at the first message
            self.bank.warm_up()

    def expire(self, names: Sequence[str]) -> bool:
        """Remove these joints, which had no sample for `expiry`; return False if that failed."""
        for name in names:
            self.bank.forget(name)
        return True

    # Actions

    def reset(self) -> str:
        """Reset every joint; return a text for the reply."""
        for joint in self.bank.joints.values():
            joint.reset()
        return f'{len(self.bank.joints)} {self.KEPT}s are reset'

    def actions(self) -> Sequence[Action]:
        """Return the services other than ~/reset."""
        return ()

    # Texts and counters

    def notices(self) -> list[str]:
        """Return new notices for the user since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def describe(self) -> str:
        """Return what is estimated, as text."""
        return ', '.join(sorted(self.bank.only)) or f'every {self.KEPT}'

    @property
    def overrides(self) -> Mapping[str, Values]:
        """Parameters of single joints by joint."""
        found: Mapping[str, Values] = self.bank.configuration.overrides if self.OVERRIDES else {}
        return found

    def needed(self) -> set[str]:
        """Return the joints that the measurement must contain because the parameters name them."""
        return {*self.bank.only, *self.overrides}

    def about(self, name: str) -> Mapping[str, Any]:
        """Return further values for the status of a joint."""
        return {}

    def always_awake(self, name: str) -> bool:
        """Return True while a joint is silent for a reason that its own status reports."""
        return False

    def why_silent(self, name: str) -> str:
        """Return why a joint may have no usable sample, if it is known; else ''."""
        why: str = self.bank.why_silent(name)
        return why

    def unused(self) -> dict[str, int]:
        """Return the numbers of unused messages of the measurement, except malformed ones."""
        return {'empty': self.bank.empty, 'mismatched': self.bank.mismatched}

    def messages(self) -> dict[str, Any]:
        """Return the numbers of messages: 'received', 'used', 'dropped' by kind, and answered."""
        answered = [number for number, port in enumerate(self.inputs) if port.answered]
        received = sum(self.received[number] for number in answered)
        malformed = sum(self.malformed[number] for number in answered)
        unused = {**self.unused(), 'malformed': malformed}
        counts = {
            'received': received,
            'used': received - sum(unused.values()),
            'dropped': {kind: count for kind, count in unused.items() if count},
            'estimates': self.answered,
        }
        if len(answered) < len(self.inputs):
            counts['inputs_malformed'] = sum(self.malformed) - malformed
        return counts

    def names_of(self, name: str) -> tuple[str, ...]:
        """Return the names of a joint's (or mechanism's) joints in the estimates."""
        return (name,)

    @property
    def source_of_stamps(self) -> str:
        """The parameter `stamp_source`; '' for families without it."""
        return getattr(self.settings, 'stamp_source', '')

    def why(self) -> str:
        """Return a note for the user if there are no estimates."""
        joints: dict[str, list[str]] = {}
        remedy = stamp_remedy(self.source_of_stamps)
        for name, joint in self.bank.joints.items():
            dropped = joint.dropped()
            said = '' if joint.used else self.why_silent(name)  # a missing input, not the position
            said = said or why_dropped(joint.received, dropped, remedy) or joint.why()
            if 'misconfigured' in dropped:  # the joint knows the parameter
                said = joint.why() or said
            joints.setdefault(said, []).extend(self.names_of(name))
        return '; '.join(
            f'{names[0]}: {said}' if len(names) == 1 else f'{said} ({", ".join(names)})'
            for said, names in joints.items()
            if said
        )

    def summary(self) -> dict[str, Any]:
        """Return what happened to all messages and samples."""
        return {
            'messages': self.messages(),
            'joints': {
                name: self._summary_of(name, joint) for name, joint in self.bank.joints.items()
            },
        }

    def _summary_of(self, name: str, joint: Joint) -> dict[str, Any]:
        history = (self.history or {}).get(name)
        return {
            **joint.samples(),
            'events': joint.events(),
            'status_s': dict(history.seconds()) if history else {},
            'rate_hz': 1.0 / joint.mean_dt if joint.mean_dt > 0.0 else None,
            'why': joint.why(),
        }

    def end(self, path: str) -> list[str]:
        """Return warnings at the end of a bag.

        Raises
        ------
        UserError : all messages of one topic are malformed, a requested joint or topic never
            appeared in the bag `path`.
        """
        for topic, count, malformed in zip(self.topics, self.received, self.malformed):
            if count and count == malformed:
                raise UserError(
                    f"no message of '{topic}' of {path} can be read: all {count} are "
                    f'malformed: {self.complaint[1]}'
                )
        return self.finish(path)

    def finish(self, path: str) -> list[str]:
        """As `end`, for what the family needs."""
        return []

    def require(self, path: str, names: Iterable[str], seen: Collection[str]) -> None:
        """Raise UserError if one of these joints was in no message of the bag `path`."""
        for name in names:
            if name not in seen:
                there = ', '.join(sorted(seen)) or 'none'
                raise UserError(
                    f"topic '{self.topics[0]}' of {path} has no joint '{name}'; it has {there}"
                )

    # Bags

    @classmethod
    def requested(
        cls, values: dict[str, Any], request: Request, has: Callable[[str], bool]
    ) -> dict[str, Any]:
        """Return the parameters with those that follow from a user's request.

        Parameters
        ----------
        has : returns True for a topic of the bag with messages.

        Raises
        ------
        UsageError : the request does not fit this family.
        """
        if request.angle or request.joints:
            raise UsageError(
                f'--angle and --joint are for observers of single angles: {cls.NAME_THEM}'
            )
        return values

    @classmethod
    def recognises(cls, has: Callable[[str], bool], joints: bool) -> bool:
        """Return True if a bag is only for this family; `joints`: it has measured joint states."""
        return False


def _taken(values: dict[str, Any], prefix: str, declaring: type[T]) -> T:
    """Return an instance of a declaration with the values below a prefix, which are removed."""
    own = {name: f'{prefix}.{name}' for name in declared(declaring)}
    try:
        return build(declaring, {k: values.pop(v) for k, v in own.items() if v in values})
    except UsageError as error:
        raise UsageError(str(error).replace("'", f"'{prefix}.", 1)) from None


def stamp_remedy(source: str) -> str:
    """Return what to do about samples without a stamp, by the present value of `stamp_source`."""
    driver = 'stamp each sample in the driver'
    return f"{driver}, or set 'stamp_source: publisher'" if source == HEADER else driver
