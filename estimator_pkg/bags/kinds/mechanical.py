"""Observers of mechanisms, as in `mechanical_observer`: positions with inputs, and a model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estimator_pkg import observers
from estimator_pkg.bags.kinds.contract import ESTIMATE, Kind, Recording, Request, Setup, System
from estimator_pkg.bags.kinds.driven import DrivenReplay, Sample
from estimator_pkg.bags.kinds.efforts import EFFORTS, effort_topics
from estimator_pkg.bags.kinds.one_by_one import recorded
from estimator_pkg.bags.kinds.values import apart
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series
from estimator_pkg.driver.mechanism import MechanismBank, MechanismConfiguration
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.nodes.mechanical_settings import MechanicalNodeSettings
from estimator_pkg.parameters import Parameter

NAME = 'mechanical'


class MechanicalKind(Kind):
    """See the module."""

    node = 'mechanical_observer'
    settings = MechanicalNodeSettings
    usual = ('/joint_states', EFFORTS)
    wraps = False   # a model says which of its positions are angles

    def parameters(self, observer: str) -> dict[str, Parameter]:
        """See `Kind`."""
        return MechanismConfiguration(observers.find(observer)).parameters()

    def prepare(self, bag: Bag, values: Mapping[str, Any], request: Request) -> Setup:
        """See `Kind`."""
        if request.angle or request.joints:
            raise UsageError('--angle and --joint are for observers of single angles: name the '
                             "joints of a mechanism with --set 'joints=[...]'")
        settings, _ = settled(values)
        topics = [bag.topics[measurement_topic(bag, request.measurement)]]
        return Setup(dict(values), (*topics, *effort_topics(bag, settings)))

    def start(self, setup: Setup) -> MechanicalReplay:
        """See `Kind`."""
        return MechanicalReplay(setup)

    def recording(self, bag: Bag, setup: Setup, measured: Mapping[str, Series]) -> Recording:
        """See `Kind`."""
        return recorded(bag, NAME, setup)


def settled(values: Mapping[str, Any]) -> tuple[MechanicalNodeSettings, MechanismBank]:
    """Settings and mechanisms, from parameters as of the node's file.

    Raises
    ------
    UserError, UsageError : a parameter is wrong, or a model cannot be used.
    """
    observer = MechanicalNodeSettings(
        observer=values.get('observer', MechanicalNodeSettings.observer)).find_observer()
    settings, common, overrides = apart(values, MechanicalNodeSettings,
                                        MechanismConfiguration(observer).parameters())
    return settings, MechanismBank(MechanismConfiguration(observer, common, overrides),
                                   settings.mechanisms, settings.input)


class MechanicalReplay(DrivenReplay):
    """See `Replay`."""

    def __init__(self, setup: Setup) -> None:
        settings, self.bank = settled(setup.values)
        super().__init__(setup, settings, self.bank, self.bank.orders)
        self._systems = {name: System(mechanism, mechanism.names)
                         for name, mechanism in self.bank.joints.items()}

    def answer(self, sample: Sample) -> dict[int, bytes]:
        """See `DrivenReplay`."""
        valid = self.bank.update(sample.stamp_ns, sample.names, sample.positions, sample.efforts)
        for system in self._systems.values():
            system.note()
        self.answered += bool(valid)
        names = [each.name for each in valid]
        return self.encoded(sample, names, [(each.position, each.velocity) for each in valid],
                            self.bank.stddevs(names))

    def systems(self) -> dict[str, System]:
        """See `Replay`."""
        return self._systems

    def unused(self) -> dict[str, int]:
        """See `OneByOne`."""
        return {'empty': self.bank.empty, 'mismatched': self.bank.mismatched}

    def summary(self) -> dict[str, Any]:
        """See `Replay`."""
        found = super().summary()
        for name, mechanism in self.bank.joints.items():
            found['joints'][name]['incomplete'] = mechanism.incomplete
        return found

    def finish(self, path: str) -> list[str]:
        """A mechanism that never became complete is a mistake in the names, or in the inputs."""
        for mechanism in self.bank.joints.values():
            if mechanism.received == 0:
                raise UserError(f"topic '{self._topic}' of {path} never has all joints of "
                                f"mechanism '{mechanism.name}' ({', '.join(mechanism.names)}): "
                                "name them with the parameter 'joints'")
        if self.answered:
            return []
        why = self.why()
        return [f'no {ESTIMATE} was given: {why}' if why else f'no {ESTIMATE} was given']


KIND = MechanicalKind()
