"""Observers of drives, as in `pmsm_observer`: batches, or currents and voltages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estimator_pkg import observers
from estimator_pkg.bags.kinds.contract import OUTPUTS, Kind, Recording, Request, Setup, System
from estimator_pkg.bags.kinds.one_by_one import OneByOne, recorded
from estimator_pkg.bags.kinds.values import apart
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import MADE, TRUTH
from estimator_pkg.bags.series import Series
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.drive_stream import DriveStream
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages import drive_samples, vector3
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes.pmsm_settings import CURRENT_VOLTAGE, DRIVE_SAMPLES, PmsmSettings
from estimator_pkg.parameters import Parameter

NAME = 'drive'
INPUTS = {DRIVE_SAMPLES: (('/drive_samples', drive_samples.TYPE),),
          CURRENT_VOLTAGE: (('/current', vector3.TYPE), ('/voltage', vector3.TYPE))}


class DriveKind(Kind):
    """See the module."""

    node = 'pmsm_observer'
    settings = PmsmSettings
    usual = ('/drive_samples', '/current', '/voltage')
    wraps = False

    def parameters(self, observer: str) -> dict[str, Parameter]:
        """See `Kind`."""
        return Configuration(observers.find(observer)).parameters()

    def recognises(self, bag: Bag) -> bool:
        """True if there is a drive's input, and no joint is measured."""
        names = {topic.name for topic in bag.topics.values() if topic.count}
        joints = any(topic.type == JOINT_STATE and TRUTH not in f'{topic.name}/'
                     and not topic.name.endswith(MADE) for topic in bag.topics.values())
        return not joints and any(all(name in names for name, _ in topics)
                                  for topics in INPUTS.values())

    def prepare(self, bag: Bag, values: Mapping[str, Any], request: Request) -> Setup:
        """See `Kind`."""
        if request.angle:
            raise UsageError('--angle is not for drives')
        values = dict(values)
        if request.joints:
            if len(request.joints) > 1:
                raise UsageError('a drive has one joint: give --joint once')
            values['joint'] = request.joints[0]
        if 'input' not in values and not request.measurement:
            batches = bag.topics.get(INPUTS[DRIVE_SAMPLES][0][0])
            if (batches is None or not batches.count) and all(
                    name in bag.topics for name, _ in INPUTS[CURRENT_VOLTAGE]):
                values['input'] = CURRENT_VOLTAGE
        settings, _ = settled(values)
        needed = INPUTS[settings.input]
        if request.measurement:
            if len(needed) > 1:
                raise UsageError('--measurement is for batches: currents and voltages are read '
                                 f'from {needed[0][0]} and {needed[1][0]}')
            needed = ((request.measurement, needed[0][1]),)
        return Setup(values, tuple(bag.require(name, [kind]) for name, kind in needed))

    def start(self, setup: Setup) -> DriveReplay:
        """See `Kind`."""
        return DriveReplay(setup)

    def recording(self, bag: Bag, setup: Setup, measured: Mapping[str, Series]) -> Recording:
        """See `Kind`."""
        return recorded(bag, NAME, setup)


def settled(values: Mapping[str, Any]) -> tuple[PmsmSettings, DriveStream]:
    """Settings and the motor behind its topics; raises UsageError."""
    observer = PmsmSettings(observer=values.get('observer', PmsmSettings.observer)).find()
    settings, common, overrides = apart(values, PmsmSettings,
                                        Configuration(observer).parameters())
    if overrides:
        raise UsageError("'joints.<joint>.<parameter>': a drive has one joint")
    settings.check()
    return settings, settings.stream(Configuration(observer, common))


class DriveReplay(OneByOne):
    """See `Replay`."""

    def __init__(self, setup: Setup) -> None:
        super().__init__()
        self._settings, self.stream = settled(setup.values)
        self._topics = [topic.name for topic in setup.topics]
        self._in_batches = self._settings.input == DRIVE_SAMPLES
        self.outputs = {**OUTPUTS, 'flux_linkage': vector3.TYPE}
        if self._in_batches:
            self.batches = {len(self.outputs): self.stream.names[1]}
            self.outputs['estimate_samples'] = drive_samples.TYPE
        self.stream.stddev_wanted = self.stream.flux_wanted = True
        self.stream.joint.warm_up()

    def take(self, topic: str, raw: bytes, publish_ns: int) -> list[dict[int, bytes]]:
        """See `OneByOne`."""
        stream = self.stream
        if self._in_batches:
            answers = [stream.batch(raw)]
        else:
            answers = (stream.current if topic == self._topics[0] else stream.voltage)(raw)
        found = []
        for answer in answers:
            parts = (answer.estimate, answer.stddev, answer.flux, answer.samples)
            found.append({output: part for output, part in enumerate(parts) if part is not None})
        return found

    def systems(self) -> dict[str, System]:
        """See `Replay`."""
        joint = self.stream.joint
        return {self._settings.joint: System(joint, self.stream.names, {
            status: count * joint.mean_dt for status, count in self.stream.statuses.items()})}

    def unread(self) -> int:
        """See `OneByOne`."""
        return self.stream.malformed

    def complaint(self) -> str:
        """See `Replay`."""
        return f': {self.stream.complaint}' if self.stream.complaint else ''

    def messages(self) -> dict[str, Any]:
        """See `Replay`."""
        stream = self.stream
        unused = {'empty': stream.empty, 'malformed': stream.malformed,
                  'unpaired': stream.pairs.unpaired,
                  'unbalanced': stream.phases.unbalanced if stream.phases is not None else 0}
        return {'received': stream.messages, 'used': stream.messages - sum(unused.values()),
                'dropped': {kind: count for kind, count in unused.items() if count}}

    def why(self) -> str:
        """See `Replay`."""
        return super().why() or self.stream.why_silent()

    def summary(self) -> dict[str, Any]:
        """See `Replay`."""
        found = super().summary()
        for joint in found['joints'].values():
            joint['why'] = (self.stream.why_unbalanced() or joint['why']
                            or ('' if joint['used'] else self.stream.why_silent()))
        return found

    def finish(self, path: str) -> list[str]:
        """See `Replay`."""
        if not self.stream.messages:
            raise UserError(f'{path} has no messages on {" and ".join(self._topics)}')
        return []


KIND = DriveKind()
