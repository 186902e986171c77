"""The class of the node `mechanical_observer`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from estimator_pkg.nodes.driven import DrivenHealth, DrivenNode  # first: settles what rclpy reads  # isort: skip

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.subscription import Subscription

from estimator_pkg.driver.mechanism import (
    MechanismBank,
    MechanismConfiguration,
    MechanismSettings,
    check_names,
)
from estimator_pkg.messages.joint_state import Layout
from estimator_pkg.nodes.diagnostics import OK, array, entry
from estimator_pkg.nodes.endpoints import latched
from estimator_pkg.nodes.mechanical_settings import MechanicalNodeSettings
from estimator_pkg.nodes.ros_parameters import Values
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.mechanical_gains import in_words


class MechanismHealth(DrivenHealth):
    """As of joints."""

    KEPT = 'mechanism'


class MechanicalObserver(DrivenNode):
    """Estimates the velocities of mechanisms from positions, inputs and a model.

    Parameters, errors and attributes as of `ObserverNode`; ``bank`` holds the mechanisms.
    """

    NAME = 'mechanical_observer'
    SETTINGS = MechanicalNodeSettings
    PER_JOINT = MechanismSettings
    HEALTH = MechanismHealth
    settings: MechanicalNodeSettings
    bank: MechanismBank

    def _find_observer(self) -> Observer:
        return self.settings.find_observer()

    def _configured(self, common: Mapping[str, Any], overrides: Mapping[str, Values]
                    ) -> MechanismConfiguration:
        return MechanismConfiguration(self._observer, common, overrides)

    def _make_bank(self, configuration: MechanismConfiguration) -> MechanismBank:
        self._meaning: dict[str, dict[str, str]] = {}  # of the gains, by mechanism
        return MechanismBank(configuration, self.settings.mechanisms, self.settings.input)

    def _connect(self) -> Subscription:
        self._gains = self._endpoints.publisher(DiagnosticArray, '~/gains', latched())
        return self._connect_states(self._states_came)

    def _orders(self) -> Sequence[Sequence[str]]:
        return self.bank.orders

    def _wanted(self) -> str:
        return ', '.join(joint for mechanism in self.bank.joints.values()
                         for joint in mechanism.names)

    def _try(self, configuration: MechanismConfiguration) -> None:
        """All mechanisms are known from the start, and what is common need not suit any of them."""
        check_names(configuration, self.settings.mechanisms)

    def _gains_changed(self, name: str) -> None:
        self._meaning.pop(name, None)

    # Messages

    def _states_came(self, stamp_ns: int, layout: Layout, raw: bytes) -> None:
        valid = self.bank.update(stamp_ns, layout.names, layout.numbers(raw, 0),
                                 layout.numbers(raw, 2))
        names = [each.name for each in valid]
        self._answer(stamp_ns, layout.frame_id, names,
                     [(each.position, each.velocity) for each in valid],
                     lambda: self.bank.stddevs(names))

    def _look(self) -> None:
        new = [name for name, mechanism in self.bank.joints.items()
               if name not in self._meaning and mechanism.mean_dt > 0.0]
        for name in new:
            mechanism = self.bank.joints[name]
            self._meaning[name] = in_words(mechanism.functions.describe(mechanism.mean_dt))
        if new:
            self._tell_gains()

    def about(self, name: str) -> Mapping[str, Any]:
        """Of a mechanism: stamps that lacked a joint, and what its gains mean, too."""
        return {**super().about(name), 'incomplete': self.bank.joints[name].incomplete,
                **self._meaning.get(name, {})}

    def _tell_gains(self) -> None:
        """Poles, limits and noise of the gains at the measured rate, on ~/gains."""
        self._gains.publish(array(self, (entry(OK, name, self._observer.name, words)
                                         for name, words in self._meaning.items())))
