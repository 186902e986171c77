"""Observers of joints of unknown parameters, as in `adaptive_observer`: positions with inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from estimator_pkg.bags.kinds.contract import OUTPUTS, Kind, Recording, Request, Setup, System
from estimator_pkg.bags.kinds.driven import DrivenReplay, Sample
from estimator_pkg.bags.kinds.efforts import EFFORTS, effort_topics
from estimator_pkg.bags.kinds.one_by_one import MessageRecording, recorded
from estimator_pkg.bags.kinds.values import apart
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series, joint_series
from estimator_pkg.driver import adaptive_file
from estimator_pkg.driver.adaptive_bank import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.identified import values_of
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages import diagnostics
from estimator_pkg.nodes.adaptive_settings import AdaptiveNodeSettings
from estimator_pkg.observers.adaptive import OBSERVER
from estimator_pkg.parameters import Parameter

NAME = 'angle_and_input'
PARAMETERS = 'identified_parameters'
PERIOD = 100_000_000    # ns between two messages of it, by the stamps of the measurement


class AdaptiveKind(Kind):
    """See the module."""

    node = 'adaptive_observer'
    settings = AdaptiveNodeSettings
    usual = ('/joint_states', EFFORTS)

    def parameters(self, observer: str) -> dict[str, Parameter]:
        """See `Kind`."""
        return Configuration(OBSERVER).parameters()

    def prepare(self, bag: Bag, values: Mapping[str, Any], request: Request) -> Setup:
        """See `Kind`."""
        if request.angle:
            raise UsageError('--angle is for observers that need nothing else: adaptive reads the '
                             'effort too')
        values = dict(values)
        if request.joints:
            values['joints'] = list(request.joints)
        settings, _ = settled(values)
        return Setup(values, (bag.topics[measurement_topic(bag, request.measurement)],
                              *effort_topics(bag, settings)))

    def start(self, setup: Setup) -> AdaptiveReplay:
        """See `Kind`."""
        return AdaptiveReplay(setup)

    def recording(self, bag: Bag, setup: Setup, measured: Mapping[str, Series]) -> Recording:
        """See `Kind`."""
        messages = recorded(bag, NAME, setup)
        names = tuple(measured or joint_series(bag, setup.topics[0].name))
        return AdaptiveRecording(messages.path, messages.kind, setup, messages.blocks, names)


def settled(values: Mapping[str, Any]) -> tuple[AdaptiveNodeSettings, AdaptiveBank]:
    """Settings and joints; raises UserError or UsageError."""
    settings, common, overrides = apart(values, AdaptiveNodeSettings,
                                        Configuration(OBSERVER).parameters())
    settings.check()
    path = settings.parameters_file
    saved = adaptive_file.load(path) if path and Path(path).exists() else {}
    configuration = AdaptiveConfiguration(OBSERVER, common, overrides, saved)
    for joint in ('', *configuration.overrides):
        configuration.for_joint(joint)
    return settings, AdaptiveBank(configuration, settings.only, settings.input)


class AdaptiveReplay(DrivenReplay):
    """See `Replay`. The identified parameters are written at the stamps of the measurement."""

    def __init__(self, setup: Setup) -> None:
        self._settings, self.bank = settled(setup.values)
        super().__init__(setup, self._settings, self.bank, [self._settings.only])
        self.outputs = {**OUTPUTS, PARAMETERS: diagnostics.TYPE}
        self._systems: dict[str, System] = {}
        self._seen: set[str] = set()
        self._told_ns = 0

    def answer(self, sample: Sample) -> dict[int, bytes]:
        """See `DrivenReplay`."""
        self._seen.update(sample.names)
        valid = self.bank.take(sample.stamp_ns, sample.names, sample.positions, sample.efforts)
        for name, joint in self.bank.joints.items():
            self._systems.setdefault(name, System(joint, (name,))).note()
        self.answered += bool(valid)
        answer = self.encoded(sample, [name for name, _, _ in valid],
                              [estimate for _, _, estimate in valid],
                              [joint.stddev() for _, joint, _ in valid])
        if abs(sample.stamp_ns - self._told_ns) >= PERIOD and self._systems:
            self._told_ns = sample.stamp_ns
            answer[2] = diagnostics.encode(sample.stamp_ns, self._told())
        return answer

    def _told(self) -> list[diagnostics.Status]:
        return [diagnostics.Status(
            said.trusted, name, f'{said.phase}: {said.reason}',
            values_of(said, self.bank.unit(name)))
            for name, said in self.bank.reports().items()]

    def systems(self) -> dict[str, System]:
        """See `Replay`."""
        return self._systems

    def unused(self) -> dict[str, int]:
        """See `OneByOne`."""
        bank = self.bank
        return {'empty': bank.empty, 'mismatched': bank.mismatched - bank.without_input,
                'without_effort': bank.without_input}

    def summary(self) -> dict[str, Any]:
        """See `Replay`."""
        found = super().summary()
        for name, said in self.bank.reports().items():
            found['joints'][name]['identified'] = values_of(said, self.bank.unit(name))
        return found

    def why(self) -> str:
        """See `Replay`."""
        if self.bank.without_input and not self._systems:
            return (f"{self._topic} carries no effort, which the observer needs as the model's "
                    'input')
        return '; '.join(f'{name}: {said.phase}: {said.reason}'
                         for name, said in self.bank.reports().items()) or super().why()

    def finish(self, path: str) -> list[str]:
        """See `Replay`."""
        missing = [name for name in self._settings.only if name not in self._seen]
        if missing and self._seen:
            raise UserError(f"topic '{self._topic}' of {path} has no joint '{missing[0]}'; it has "
                            f'{", ".join(sorted(self._seen))}')
        if self.answered:
            return []
        return [f'no estimate was given: {self.why()}']


@dataclass(frozen=True)
class AdaptiveRecording(MessageRecording):
    """Joints that can have gains of their own."""

    names: tuple[str, ...] = ()

    def apart(self) -> dict[str, Recording]:
        """See `Recording`."""
        return {name: replace(self, names=(name,), setup=self.setup.having({'joints': [name]}))
                for name in self.names}


KIND = AdaptiveKind()
