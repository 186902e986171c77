"""Systems that known events switch, as in `switched_observer`: outputs, inputs and events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estimator_pkg.bags.kinds.contract import OUTPUTS, Kind, Recording, Request, Setup, System
from estimator_pkg.bags.kinds.driven import DrivenReplay, Sample
from estimator_pkg.bags.kinds.efforts import EFFORTS, effort_topics
from estimator_pkg.bags.kinds.one_by_one import recorded
from estimator_pkg.bags.kinds.values import apart
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.switched_joint import REFUSED, SwitchedBank, SwitchedJoint
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages.joint_state import TYPE, Decoder, Encoder
from estimator_pkg.models.switched import SwitchedModel, load
from estimator_pkg.nodes.switched_settings import SwitchedNodeSettings
from estimator_pkg.observers.switched import OBSERVER
from estimator_pkg.parameters import Parameter

NAME = 'switched'
EVENTS = '/switch_event'
DISCRETE = 'discrete_state'


class SwitchedKind(Kind):
    """See the module."""

    node = 'switched_observer'
    settings = SwitchedNodeSettings
    usual = ('/joint_states', EVENTS, EFFORTS)

    def parameters(self, observer: str) -> dict[str, Parameter]:
        """See `Kind`."""
        return Configuration(OBSERVER).parameters()

    def prepare(self, bag: Bag, values: Mapping[str, Any], request: Request) -> Setup:
        """See `Kind`."""
        if request.angle or request.joints:
            raise UsageError('--angle and --joint are for observers of single angles: name the '
                             "joints of a switched system with --set 'joints=[...]'")
        settings, _, _ = settled(values)
        topics = [bag.topics[measurement_topic(bag, request.measurement)]]
        if EVENTS in bag.topics:  # without one, nothing ever switches
            topics.append(bag.require(EVENTS, [TYPE]))
        return Setup(dict(values), (*topics, *effort_topics(bag, settings)))

    def start(self, setup: Setup) -> SwitchedReplay:
        """See `Kind`."""
        return SwitchedReplay(setup)

    def recording(self, bag: Bag, setup: Setup, measured: Mapping[str, Series]) -> Recording:
        """See `Kind`."""
        return recorded(bag, NAME, setup)


def settled(values: Mapping[str, Any]
            ) -> tuple[SwitchedNodeSettings, SwitchedBank, SwitchedModel]:
    """Settings, the system and its model; raises UserError or UsageError."""
    settings, common, overrides = apart(values, SwitchedNodeSettings,
                                        Configuration(OBSERVER).parameters())
    if overrides:
        raise UsageError("'joints.<joint>.<parameter>': a switched system has one set of gains")
    gains, of_joint = Configuration(OBSERVER, common).for_joint('')
    model = load(gains.model)
    return settings, SwitchedBank(SwitchedJoint(OBSERVER, gains, of_joint),
                                  settings.names(model), settings.input), model


class SwitchedReplay(DrivenReplay):
    """See `Replay`."""

    def __init__(self, setup: Setup) -> None:
        settings, self.bank, self._model = settled(setup.values)
        super().__init__(setup, settings, self.bank, self.bank.orders)
        self.outputs = {**OUTPUTS, DISCRETE: TYPE}
        self._system = System(self.bank.system, self.bank.names)
        self._decode_event = Decoder().decode
        self._encode_discrete = Encoder().encode
        self._has_events = any(topic.name == EVENTS for topic in setup.topics)

    def event(self, raw: bytes) -> None:
        """See `DrivenReplay`."""
        event = self._decode_event(raw)
        self.bank.system.event(event.stamp_ns, event.names[0] if event.names else '',
                               event.positions)

    def answer(self, sample: Sample) -> dict[int, bytes]:
        """See `DrivenReplay`."""
        pairs = self.bank.take(sample.stamp_ns, sample.names, sample.positions, sample.efforts)
        self._system.note()
        if not pairs:
            return self.encoded(sample, (), (), ())
        self.answered += 1
        answer = self.encoded(sample, self.bank.names, pairs, self.bank.deviations())
        answer[2] = self._encode_discrete(sample.stamp_ns, sample.frame_id, self._model.names,
                                          self.bank.system.discrete()[0])
        return answer

    def systems(self) -> dict[str, System]:
        """See `Replay`."""
        return {self.bank.names[0]: self._system}

    def unused(self) -> dict[str, int]:
        """See `OneByOne`."""
        return {'empty': self.bank.empty, 'mismatched': self.bank.mismatched}

    def summary(self) -> dict[str, Any]:
        """See `Replay`."""
        found = super().summary()
        found['switch_events'] = dict(self.bank.system.event_counts)
        return found

    def why(self) -> str:
        """See `Replay`."""
        if self.bank.mismatched and not self._system.joint.received:
            return (f'no message of {self._topic} has the joints {", ".join(self.bank.names)} with '
                    'the effort that the model needs')
        return super().why()

    def finish(self, path: str) -> list[str]:
        """See `Replay`."""
        if self._system.joint.received == 0:
            raise UserError(f'{path}: {self.why() or "no sample came"}')
        said = [] if self.answered else [f'no estimate was given: {self.why()}']
        for kind, count in self.bank.system.event_counts.items():
            if kind in REFUSED:
                said.append(f'{count} switching events were not used: {kind.replace("_", " ")}')
        if not self._has_events:
            said.append(f'{path} has no topic {EVENTS}: nothing ever switches')
        return said


KIND = SwitchedKind()
