# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Single angles: the node `joint_observer`. Joint states, or one number, to velocities."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers, params_file
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.batch import Estimates
from estimator_pkg.driver.configuration import Configuration, SourceSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.driver.raw_angle import RawAngle
from estimator_pkg.errors import UsageError, UserError, plainly, suggestion
from estimator_pkg.messages.block import Block
from estimator_pkg.messages.field import Field, Kind
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import structural
from estimator_pkg.streams.answer import ACCELERATION, Answering
from estimator_pkg.streams.arrays import Estimation
from estimator_pkg.streams.clocks import Clocks
from estimator_pkg.streams.contract import (
    ESTIMATE,
    PUBLISHER,
    STDDEV,
    Answer,
    Answers,
    JointsSettings,
    Port,
    Request,
    Stream,
    Values,
)
from estimator_pkg.streams.smoothing import SMOOTHED, SMOOTHED_STDDEV, Smoothing
from estimator_pkg.streams.sources import FieldSamples, JointStates, Source

JOINT_STATES = 'joint_states'
ANGLE = 'angle'
FIELD = 'field'
NONE, REGULAR = 'none', 'regular'  # of the parameter stamp_repair
DEGREES = 360.0  # per turn: up to this number it is a unit of the angle, and no count
ANGLE_TYPES = ('Float64', 'Float32', 'Int32', 'Int64', 'UInt16')  # of std_msgs
NODE_OF = {
    'angle_and_input': 'adaptive_observer',
    'drive': 'pmsm_observer',
    'mechanical': 'mechanical_observer',
    'switched': 'switched_observer',
    'wheels': 'wheel_odometry',
}  # by kind


@dataclass(frozen=True)
class AngleSettings(JointsSettings):
    """Parameters of the node `joint_observer`, without those of its observer."""

    observer: str = structural(
        observers.DEFAULT, description="observer to run ('velocity_estimator list' names them all)"
    )
    input: str = structural(
        JOINT_STATES,
        choices=(JOINT_STATES, ANGLE, FIELD),
        description='what to read: joint_states (sensor_msgs/JointState on the topic '
        'joint_states), angle (one number of std_msgs on the topic angle, see angle_type), or '
        'field (one number in messages of any type on the topic angle, see field_type and field)',
    )
    angle_type: str = structural(
        'Float64',
        choices=ANGLE_TYPES,
        description='message type of the topic angle, with input: angle',
    )
    field_type: str = structural(
        '',
        description='message type of the topic angle, with input: field, as in '
        'geometry_msgs/msg/PoseStamped; any type that is installed where the node runs',
    )
    field: str = structural(
        '',
        description='the number in these messages, as in pose.position.x or data[0]; yaw of an '
        'orientation [rad], as in pose.pose.orientation.yaw. Its time is the stamp of the header, '
        'without a header the time at which the publisher sent it',
    )
    angle_joint: str = structural('joint', description='name of the joint of the topic angle')
    counts_per_revolution: float = structural(
        0.0,
        unit='counts',
        range=(0.0, 1e12),
        description='counts per turn on the topic angle; 0: it is in rad. Also the default of '
        'quantum, unless it is 360 or less and the type is no integer: degrees are no counts',
    )
    angle_offset: float = structural(
        0.0,
        unit='rad',
        range=(-1e6, 1e6),
        description='added to the angle of the topic angle, after scale and sign',
    )
    angle_sign: int = structural(
        1, range=(-1, 1), description='-1 reverses the sign of the topic angle'
    )
    smoothing_lag: float = structural(
        0.05,
        unit='s',
        range=(0.005, 0.2),
        description='lag of ~/smoothed: a message is answered there once another one is this much '
        'newer',
    )
    stamp_source: str = structural(
        'header',
        choices=('header', 'publisher'),
        description='time of a message with a header: its stamp, or the time at which its '
        'publisher sent it (for drivers that leave the stamp zero)',
    )

    stamp_repair: str = structural(
        NONE,
        choices=(NONE, REGULAR),
        description='regular: the device samples regularly and its stamps jitter, so its clock is '
        'fitted to them and the observer uses the fitted times; stamps that the readings confirm '
        'are left alone. Estimates keep the stamps of their messages',
    )

    sources: tuple[str, ...] | None = structural(
        None,
        kind=tuple,
        description='names of other sensors of the joints; each has the parameters '
        'source.<name>.topic, field_type, field, kind, joint, ratio and delay',
    )

    def find_observer(self) -> type[Observer]:
        """Return the observer.

        Raises
        ------
        UsageError : it needs more than an angle; a sign of 0, an integer angle without counts, an
            empty name, a field without its type or path.
        """
        if self.angle_sign == 0:
            raise UsageError("parameter 'angle_sign' must be 1 or -1, not 0")
        if self.is_number:
            if (
                self.input == ANGLE
                and 'Int' in self.angle_type
                and self.counts_per_revolution <= 0.0
            ):
                raise UsageError(
                    f"angle_type '{self.angle_type}' is in counts: set 'counts_per_revolution'"
                )
            for name, value, example in (
                ('field_type', self.field_type, 'geometry_msgs/msg/PoseStamped'),
                ('field', self.field, 'pose.orientation.yaw'),
            ):
                if self.input == FIELD and not value:
                    raise UsageError(f"input 'field' needs '{name}': set it, as in {example}")
            if not self.angle_joint:
                raise UsageError("parameter 'angle_joint' must not be empty: set a name")
            if self.only and self.angle_joint not in self.only:
                raise UsageError(
                    f"angle_joint '{self.angle_joint}' is not in 'joints': add it or unset 'joints'"
                )
        found = observers.find(self.observer)
        if found.kind != AngleStream.KIND:
            hint = f': run the node {NODE_OF[found.kind]}' if found.kind in NODE_OF else ''
            raise UsageError(f"observer '{found.name}' needs more than an angle{hint}")
        return found

    @property
    def is_number(self) -> bool:
        """True if the input is one number per message, for one joint."""
        return self.input != JOINT_STATES

    @property
    def raw_angle(self) -> RawAngle:
        """The conversion from a number on the topic angle to rad."""
        return RawAngle(self.counts_per_revolution, self.angle_offset, self.angle_sign)

    def implied(self, common: Values) -> dict[str, Any]:
        """Return `common` observer parameters, with the quantum from the counts if it is unset."""
        values, counts = dict(common), self.counts_per_revolution
        whole = self.input == ANGLE and 'Int' in self.angle_type
        counted = counts > DEGREES or (whole and counts > 0.0)
        if self.is_number and counted and not values.get('quantum'):
            values['quantum'] = self.raw_angle.quantum
        return values


class AngleStream(Stream):
    """See `Stream`."""

    KIND = 'angle'
    NODE = 'joint_observer'
    SETTINGS = AngleSettings
    PER_SOURCE = SourceSettings
    SEPARATE = True
    IN_ARRAYS = True
    bank: Bank
    settings: AngleSettings

    def __init__(self, settings: AngleSettings, configuration: Configuration) -> None:
        observer = configuration.observer
        accelerates = any(
            observer.gives_acceleration(configuration.for_joint(joint)[0])
            for joint in ('', *configuration.overrides)
        )
        self.source: Source  # of a field: set by `read_field`
        if settings.input == FIELD:
            port = Port(ANGLE, settings.field_type, field=settings.field)
        elif settings.input == ANGLE:
            kind = Kind(settings.angle_type.lower())
            port = Port(ANGLE, f'std_msgs/msg/{settings.angle_type}', any_number=True)
            self.source = _number(Field(lambda _: {'data': kind}, port.type, 'data'), settings)
        else:
            self.source = JointStates(settings.stamp_source == PUBLISHER)
            port = Port(JOINT_STATES, self.source.type)
        super().__init__(
            settings,
            observer,
            self._bank(settings, configuration),
            [port, *self._others()],
            [ESTIMATE, STDDEV, *([ACCELERATION] if accelerates else []), SMOOTHED, SMOOTHED_STDDEV],
        )
        self.estimation = Estimation(self.bank)
        self._answering = Answering(self)
        self._smoothing = Smoothing(self, settings.smoothing_lag)
        self._clocks = Clocks(self._period_of) if settings.stamp_repair == REGULAR else None

    @classmethod
    def configure(
        cls,
        observer: type[Observer],
        settings: AngleSettings | None,
        common: Values,
        overrides: Mapping[str, Values],
    ) -> Configuration:
        """See `Stream`."""
        return Configuration(observer, settings.implied(common) if settings else common, overrides)

    @classmethod
    def groups(cls, settings: AngleSettings) -> dict[str, type]:
        """See `Stream`."""
        return {f'source.{name}': SourceSettings for name in settings.sources or () if name}

    @classmethod
    def start(cls, settings: AngleSettings, configuration: Configuration) -> Stream:
        """See `Stream`."""
        if settings.groups and cls is AngleStream:
            from estimator_pkg.streams.informed import InformedStream  # an `AngleStream`

            return InformedStream.start(settings, configuration)
        return super().start(settings, configuration)

    def _bank(self, settings: AngleSettings, configuration: Configuration) -> Bank:
        return Bank(configuration, settings.only)

    def _others(self) -> list[Port]:
        """Return the inputs beside the angle."""
        return []

    # Messages

    def take(self, port: int, raw: bytes, publish_ns: int) -> Sequence[Answer]:
        """See `Stream`."""
        sample = self.source.sample(raw, publish_ns)
        stamp_ns, frame_id, names, positions, efforts = sample
        at_ns = stamp_ns if self._clocks is None else self._clocks(stamp_ns, names, positions)
        taken = self.bank.update(at_ns, names, positions, efforts)
        answer = self._answering(stamp_ns, frame_id, taken)
        if self._smoothing.wanted:
            return (answer, *self._smoothing(at_ns, stamp_ns, frame_id, taken))
        self._smoothing.stop()
        return (answer,)

    def feed_block(self, ports: Sequence[int], block: Block) -> Iterable[Answers] | None:
        """See `Stream`; without `Smoothing`, which takes messages one by one."""
        if self._smoothing.wanted:
            return None
        groups, malformed = self.source.samples(block)
        self.received[0] += len(block) - len(malformed)
        for row in malformed:  # counted with the reason
            self.feed(0, bytes(block.data[block.start[row] : block.end[row]]), 0)
        times = None if self._clocks is None else self._clocks.block(groups)
        estimated = self.estimation.update(groups, self.history, times)
        return (answers for group in estimated for answers in self._answering.block(group))

    def read_field(self, field: Field, port: int = 0) -> None:
        """See `Stream`."""
        settings = self.settings
        if field.is_integer and settings.counts_per_revolution <= 0.0:
            raise UsageError(
                f"'{field.path}' of {field.type} is a whole number, so it carries counts: set "
                "'counts_per_revolution'"
            )
        self.source = _number(field, settings)

    def _period_of(self, name: str) -> float:
        """Return the wrap period of a joint [rad]."""
        period: float = self.bank.configuration.for_joint(name)[1].wrap_period
        return period

    def about(self, name: str) -> Mapping[str, Any]:
        """See `Stream`."""
        return {} if self._clocks is None else self._clocks.about(name)

    def _summary_of(self, name: str, joint: Joint) -> dict[str, Any]:
        summary = super()._summary_of(name, joint)
        about = {} if self._clocks is None else self._clocks.about(name)
        if about:
            summary['stamps'] = {
                key: None if isinstance(value, float) and math.isnan(value) else value
                for key, value in about.items()
            }
        return summary

    def reset(self) -> str:
        """See `Stream`."""
        if self._clocks is not None:
            self._clocks.reset()
        return super().reset()

    def _gains_changed(self, name: str) -> None:
        """See `Stream`."""
        self._smoothing.forget([name])

    def expire(self, names: Sequence[str]) -> bool:
        """See `Stream`."""
        self._smoothing.forget(names)
        return super().expire(names)

    # Texts

    def why(self) -> str:
        """See `Stream`."""
        received, topic = self.received[0], self.topics[0]
        if isinstance(self.source, FieldSamples) and self.bank.empty == received:
            return self.source.why_none(topic)
        for count, why in (
            (self.bank.empty, 'has a position there (observers need positions, not velocities)'),
            (self.bank.mismatched, 'has as many positions as names'),
        ):
            if count == received:
                return f'no message of {topic} {why}'
        return super().why() or 'too few samples: the start needed all of them'

    def finish(self, path: str) -> list[str]:
        """See `Stream`; joints that the user named must exist."""
        seen, topic = self.estimation.seen | set(self.bank.joints), self.topics[0]
        if not seen:
            raise UserError(
                f"topic '{topic}' of {path} names no joint"
                if self.received[0]
                else f"no message of '{topic}' of {path} can be read from the file"
            )
        if not self.settings.is_number:
            self.require(path, self.settings.only, seen)
        mixed = self.source.warnings(topic) if isinstance(self.source, FieldSamples) else []
        return [f'{path}: {warning}' for warning in mixed] + [
            f"'{params_file.OVERRIDES}.{name}' is for joint '{name}', which never appeared on "
            f'{topic}: {suggestion(name, seen)}'
            for name in self.overrides
            if name not in seen
        ]

    # Bags

    @classmethod
    def requested(
        cls, values: dict[str, Any], request: Request, has: Callable[[str], bool]
    ) -> dict[str, Any]:
        """See `Stream`."""
        if request.angle:
            values['input'] = ANGLE
            values['angle_type'] = 'Float64'  # any type: the bag's is used
        if request.joints:
            values['joints'] = list(request.joints)
            if values.get('input') in (ANGLE, FIELD):
                if len(request.joints) > 1:
                    raise UsageError('--angle is one joint: give --joint once')
                values['angle_joint'] = request.joints[0]
        return values

    def run(
        self, name: str, stamps_ns: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> tuple[Joint, Estimates] | None:
        """Process all samples of one joint at once; return None for a joint not to estimate.

        Parameters
        ----------
        stamps_ns, positions : shape (n,) [ns, rad or m].

        Raises
        ------
        UserError : the observer failed (a user's own can).
        """
        with plainly(f"observer '{self.observer.name}'"):
            joint = self.bank.joint(name)
            if joint is None:
                return None
            return joint, joint.run(stamps_ns, positions)


def _number(field: Field, settings: AngleSettings) -> FieldSamples:
    by_publisher = settings.stamp_source == PUBLISHER
    return FieldSamples(field, settings.angle_joint, settings.raw_angle, by_publisher)
