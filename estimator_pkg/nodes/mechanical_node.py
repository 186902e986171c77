"""The class of the node `mechanical_observer`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estimator_pkg.nodes.base import ObserverNode  # first: settles what rclpy reads  # isort: skip

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.subscription import Subscription

from estimator_pkg.driver.mechanism import (
    COMMAND,
    Mechanism,
    MechanismBank,
    MechanismConfiguration,
    MechanismSettings,
)
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.joint_state import Layout
from estimator_pkg.nodes.diagnostics import OK, entry
from estimator_pkg.nodes.endpoints import latched
from estimator_pkg.nodes.mechanical_settings import MechanicalNodeSettings
from estimator_pkg.nodes.ros_parameters import Values
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.mechanical_gains import in_words


class MechanicalObserver(ObserverNode):
    """Estimates the velocities of mechanisms from positions, inputs and a model.

    Parameters, errors and attributes as of `ObserverNode`; ``bank`` holds the mechanisms.
    """

    NAME = 'mechanical_observer'
    SETTINGS = MechanicalNodeSettings
    PER_JOINT = MechanismSettings
    settings: MechanicalNodeSettings
    bank: MechanismBank

    def _find_observer(self) -> Observer:
        return self.settings.find_observer()

    def _configured(self, common: Mapping[str, Any], overrides: Mapping[str, Values]
                    ) -> MechanismConfiguration:
        return MechanismConfiguration(self._observer, common, overrides)

    def _make_bank(self, configuration: MechanismConfiguration) -> MechanismBank:
        return MechanismBank(configuration, self.settings.mechanisms, self.settings.input)

    def _connect(self) -> Subscription:
        self._gains = self._endpoints.publisher(DiagnosticArray, '~/gains', latched())
        self._told: set[str] = set()
        states = self._listen_to_states('joint_states', self._states_came)
        if self.settings.input == COMMAND:
            self._listen_to_states('effort_command', self._command_came, answered=False)
        return states

    def _wanted(self) -> str:
        return ', '.join(joint for mechanism in self.bank.joints.values()
                         for joint in mechanism.names)

    def _restarted(self) -> str:
        return f'{len(self.bank.joints)} mechanisms start'

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        """Refuse gains that do not work, at the rates measured so far."""
        configuration = self._configuration(values, overrides)
        for name, mechanism in self.bank.joints.items():
            gains, settings = configuration.for_joint(name)
            fresh = Mechanism(name, self._observer, gains, settings, self.settings.input)
            why = fresh.functions.limits(mechanism.mean_dt) if mechanism.mean_dt > 0.0 else None
            if why:
                raise UsageError(f"mechanism '{name}': {why}")

    def _gains_changed(self, name: str) -> None:
        self._told.discard(name)

    # Messages

    def _states_came(self, stamp_ns: int, layout: Layout, raw: bytes) -> None:
        valid = self.bank.update(stamp_ns, layout.names, layout.numbers(raw, 0),
                                 layout.numbers(raw, 2))
        names = [each.name for each in valid]
        self._answer(stamp_ns, layout.frame_id, names,
                     [(each.position, each.velocity) for each in valid],
                     lambda: self.bank.stddevs(names))

    def _command_came(self, stamp_ns: int, layout: Layout, raw: bytes) -> None:
        self.bank.command(stamp_ns, layout.names, layout.numbers(raw, 2))

    def _look(self) -> None:
        if any(mechanism.mean_dt > 0.0 and name not in self._told
               for name, mechanism in self.bank.joints.items()):
            self._tell_gains()

    def _tell_gains(self) -> None:
        """Poles, limits and noise of the gains at the measured rate, on ~/gains."""
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        for name, mechanism in self.bank.joints.items():
            if mechanism.mean_dt > 0.0:
                self._told.add(name)
                found = mechanism.functions.describe(  # type: ignore[attr-defined]
                    mechanism.mean_dt)
                status: DiagnosticStatus = entry(OK, name, self._observer.name, in_words(found))
                message.status.append(status)
        self._gains.publish(message)
