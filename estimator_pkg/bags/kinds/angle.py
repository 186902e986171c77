"""Observers of single angles, as in `joint_observer`: replay in arrays, compiled where it pays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator_pkg import observers
from estimator_pkg.bags.block import Block
from estimator_pkg.bags.estimates import messages
from estimator_pkg.bags.estimation import Estimation, History
from estimator_pkg.bags.kinds.contract import (
    PUBLISHER,
    Answers,
    Estimate,
    Kind,
    Recording,
    Replay,
    Request,
    Setup,
    System,
)
from estimator_pkg.bags.kinds.values import apart
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.samples import AngleField, JointStates, Source
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series, of_positions
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.guard import DUPLICATE
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UsageError, UserError, plainly
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.nodes.settings import ANGLE, NodeSettings
from estimator_pkg.observers.contract import COASTING, TRACKING
from estimator_pkg.parameters import Parameter

NAME = 'angle'
DATA = 'data'       # the number in the messages of std_msgs


class AngleKind(Kind):
    """See the module."""

    node = 'joint_observer'
    settings = NodeSettings

    def parameters(self, observer: str) -> dict[str, Parameter]:
        """See `Kind`."""
        return Configuration(observers.find(observer)).parameters()

    def prepare(self, bag: Bag, values: Mapping[str, Any], request: Request) -> Setup:
        """See `Kind`."""
        values = dict(values)
        topic, _, path = (request.angle or '').partition(':')
        if request.angle:
            if not topic or not path:
                raise UsageError(f"--angle '{request.angle}' is not TOPIC:FIELD")
            if request.measurement:
                raise UsageError('give either --angle or --measurement')
            values['input'] = ANGLE
            values['angle_type'] = 'Float64'  # whatever it is, the bag says
        by_angle = values.get('input') == ANGLE
        if request.joints:
            values['joints'] = list(request.joints)
            if by_angle:
                if len(request.joints) > 1:
                    raise UsageError('an angle belongs to one joint: give --joint once')
                values['angle_joint'] = request.joints[0]
        _settled(values)
        if by_angle:
            return Setup(values, (bag.require(topic or request.measurement or '/angle'),),
                         path or DATA)
        return Setup(values, (bag.topics[measurement_topic(bag, request.measurement)],))

    def start(self, setup: Setup) -> AngleReplay:
        """See `Kind`."""
        return AngleReplay(setup)

    def recording(self, bag: Bag, setup: Setup, measured: Mapping[str, Series]) -> Recording:
        """See `Kind`."""
        measured = measured or self.measured(bag, setup)
        if not measured:
            raise UserError(f'{bag.path}: {setup.topics[0].name} carries no position')
        return AngleRecording(dict(measured), dict(setup.values))

    def measured(self, bag: Bag, setup: Setup) -> dict[str, Series]:
        """See `Kind`; of a topic of numbers its one joint."""
        if setup.values.get('input') != ANGLE:
            return super().measured(bag, setup)
        replay = AngleReplay(setup)
        name = setup.topics[0].name
        groups, count, malformed = [], 0, 0
        for _, block in bag.blocks([name]):
            found, unread = replay.source.samples(block)
            groups += [group for group in found if group.positions.shape[1]]
            count, malformed = count + len(block), malformed + len(unread)
        bag.count_malformed(name, count, malformed)
        if not groups:
            return {}
        return {replay.settings.angle_joint: of_positions(
            np.concatenate([group.stamps_ns for group in groups]),
            np.concatenate([group.positions[:, 0] for group in groups]))}


def _settled(values: Mapping[str, Any]) -> tuple[NodeSettings, Configuration]:
    """Settings and gains; raises UsageError."""
    name = values.get('observer', NodeSettings.observer)
    observer = observers.find(name)
    if observer.kind != NAME:
        raise UsageError(f"observer '{observer.name}' does not work from an angle alone")
    settings, common, overrides = apart(values, NodeSettings, Configuration(observer).parameters())
    settings.check()
    configuration = Configuration(observer, settings.implied(common), overrides)
    for joint in ('', *configuration.overrides):
        configuration.for_joint(joint)
    return settings, configuration


class AngleReplay(Replay):
    """See `Replay`."""

    def __init__(self, setup: Setup) -> None:
        self.settings, self.configuration = _settled(setup.values)
        self._topic, = setup.topics
        self.source = self._make_source(setup.path)
        self.estimation = Estimation(self.configuration, self.settings.only,
                                     messages=self._topic.count)
        self._encoders = Encoder(), Encoder()
        self._answered = 0

    def _make_source(self, path: str) -> Source:
        settings = self.settings
        if settings.input != ANGLE:
            return JointStates(settings.stamp_source == PUBLISHER)
        source = AngleField(self._topic, path, settings.angle_joint, settings.raw_angle)
        if source.is_integer and settings.counts_per_revolution <= 0.0:
            raise UsageError(f"'{path}' of {self._topic.name} is a whole number, so it carries "
                             "counts: set 'counts_per_revolution'")
        return source

    def feed(self, names: Sequence[str], block: Block) -> Iterator[Answers]:
        """See `Replay`."""
        groups, malformed = self.source.samples(block)
        for group in self.estimation.update(groups, len(malformed)):
            self._answered += int(np.count_nonzero(group.valid.any(axis=1)))
            for output in (0, 1):
                for rows, raw in messages(group, self._encoders[output], stddev=output == 1):
                    yield Answers(output, rows, output + 1, raw)

    def systems(self) -> dict[str, System]:
        """See `Replay`."""
        return {name: System(joint, (name,), self.estimation.history[name].seconds)
                for name, joint in self.estimation.bank.joints.items()}

    def messages(self) -> dict[str, Any]:
        """See `Replay`."""
        bank, received = self.estimation.bank, self.estimation.messages
        unused = {'empty': bank.empty, 'mismatched': bank.mismatched,
                  'malformed': self.estimation.malformed}
        return {'received': received, 'used': received - sum(unused.values()),
                'dropped': {kind: count for kind, count in unused.items() if count},
                'estimates': self._answered}

    def read(self) -> dict[str, tuple[int, int]]:
        """See `Replay`."""
        estimation = self.estimation
        return ({self._topic.name: (estimation.messages, estimation.malformed)}
                if estimation.messages else {})

    def why(self) -> str:
        """See `Replay`."""
        bank, received, topic = self.estimation.bank, self.estimation.messages, self._topic.name
        if bank.empty == received:
            return f'no message of {topic} has a position there'
        if bank.mismatched == received:
            return f'no message of {topic} has as many positions as names'
        return super().why() or 'too few samples: all were needed to begin'

    def finish(self, path: str) -> list[str]:
        """The joints that the user named must be there."""
        seen, topic = self.estimation.seen, self._topic.name
        if not seen:
            raise UserError(f"topic '{topic}' of {path} names no joint"
                            if self.estimation.messages else
                            f"no message of '{topic}' of {path} can be read from the file")
        there = ', '.join(sorted(seen))
        missing = [name for name in self.settings.only if name not in seen]
        if missing and self.settings.input != ANGLE:
            raise UserError(f"topic '{topic}' of {path} has no joint '{missing[0]}'; it has "
                            f'{there}')
        said = [] if self._answered else [f'no estimate was given: {self.why()}']
        return said + [
            f"parameters are given for a joint '{name}' that never came; {topic} has {there}"
            for name in self.configuration.overrides if name not in seen]


@dataclass(frozen=True)
class AngleRecording(Recording):
    """The positions of joints, and the parameters that hold whatever the gains."""

    series: dict[str, Series]
    values: dict[str, Any]

    def run(self, observer: str, values: Mapping[str, Any], fast: bool | None = None
            ) -> dict[str, Estimate]:
        """See `Recording`."""
        settings, configuration = _settled({**self.values, **values, 'observer': observer})
        found = {}
        for name, series in self.series.items():
            if settings.only and name not in settings.only:
                continue
            joint = Joint(configuration.observer, *configuration.for_joint(name))
            with plainly(f"observer '{observer}'"):
                out = joint.run(series.stamps_ns, series.position, fast=fast)
            used = out.verdict < DUPLICATE
            valid = used & ((out.status == TRACKING) | (out.status == COASTING))
            history = History()
            history.add(series.stamps_ns, out)
            found[name] = Estimate(
                series.stamps_ns[valid], out.position[valid], out.velocity[valid],
                out.velocity_stddev[valid],
                {'received': joint.received, 'used': joint.used, 'dropped': joint.dropped()},
                history.seconds, series.stamps_ns[used], out.status[used],
                series.stamps_ns[np.isfinite(series.position)])
        return found

    def split(self, held_out: float) -> tuple[Recording, Recording]:
        """See `Recording`."""
        parts: tuple[dict[str, Series], ...] = ({}, {})
        for name, series in self.series.items():
            count = len(series.stamps_ns)
            cut = count - round(held_out * count)
            for part, rows in zip(parts, (slice(cut), slice(cut, None))):
                part[name] = Series(series.stamps_ns[rows], series.position[rows],
                                    series.velocity[rows], series.effort[rows])
        return AngleRecording(parts[0], self.values), AngleRecording(parts[1], self.values)

    def apart(self) -> dict[str, Recording]:
        """See `Recording`."""
        return {name: AngleRecording({name: series}, self.values)
                for name, series in self.series.items()}

    def size(self) -> int:
        """See `Recording`."""
        return sum(len(series.stamps_ns) for series in self.series.values())


KIND = AngleKind()
