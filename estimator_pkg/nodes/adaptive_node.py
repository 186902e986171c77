"""The class of the node `adaptive_observer`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from estimator_pkg.nodes.driven import DrivenNode  # first: settles what rclpy reads  # isort: skip

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter as RosParameter
from rclpy.subscription import Subscription
from std_srvs.srv import SetBool, Trigger

from estimator_pkg.driver import adaptive_file
from estimator_pkg.driver.adaptive_bank import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.efforts import DrivenSettings
from estimator_pkg.driver.identified import values_of
from estimator_pkg.errors import UserError
from estimator_pkg.messages.joint_state import Layout
from estimator_pkg.nodes.adaptive_settings import AdaptiveNodeSettings
from estimator_pkg.nodes.diagnostics import OK, WARN, array, entry
from estimator_pkg.nodes.ros_parameters import Values
from estimator_pkg.observers.adaptive import OBSERVER
from estimator_pkg.observers.contract import Observer
from estimator_pkg.printable import printable


class AdaptiveObserver(DrivenNode):
    """Estimates the velocity of joints of unknown parameters, and the parameters.

    Parameters, errors and attributes as of `ObserverNode`.
    """

    NAME = 'adaptive_observer'
    SETTINGS = AdaptiveNodeSettings
    PER_JOINT = DrivenSettings
    settings: AdaptiveNodeSettings
    bank: AdaptiveBank

    def _find_observer(self) -> Observer:
        self.settings.check()
        path = self.settings.parameters_file
        self._saved = adaptive_file.load(path) if path and Path(path).exists() else {}
        return OBSERVER

    def _configured(self, common: Mapping[str, Any], overrides: Mapping[str, Values]
                    ) -> AdaptiveConfiguration:
        return AdaptiveConfiguration(OBSERVER, common, overrides, self._saved)

    def _make_bank(self, configuration: AdaptiveConfiguration) -> AdaptiveBank:
        return AdaptiveBank(configuration, self.settings.only, self.settings.input,
                            self.settings.joints_max)

    def _connect(self) -> Subscription:
        self._identified = self._endpoints.on_demand(DiagnosticArray, '~/identified_parameters')
        self.create_service(Trigger, '~/save', self._save)
        self.create_service(SetBool, '~/freeze', self._freeze)
        return self._connect_states(self._states_came)

    def _orders(self) -> Sequence[Sequence[str]]:
        return [self.settings.only]

    def _wanted(self) -> str:
        return ', '.join(self.settings.only) or super()._wanted()

    # Messages

    def _states_came(self, stamp_ns: int, layout: Layout, raw: bytes) -> None:
        valid = self.bank.take(stamp_ns, layout.names, layout.numbers(raw, 0),
                               layout.numbers(raw, 2))
        self._answer_joints(stamp_ns, layout.frame_id, valid)

    def _look(self) -> None:
        if self._identified.wanted:
            self._tell_parameters()

    def _tell_parameters(self) -> None:
        self._identified.publish(array(self, (
            entry(OK if said.trusted else WARN, name, f'{said.phase}: {said.reason}',
                  values_of(said, self.bank.unit(name)))
            for name, said in self.bank.reports().items())))

    def _saved_before_expiry(self, names: Sequence[str]) -> bool:
        path, reports = self.settings.parameters_file, self.bank.reports()
        if not path or not any(name in reports and reports[name].adapted for name in names):
            return True
        try:
            adaptive_file.save(path, self.bank)
            self._saved.update(adaptive_file.load(path))  # for a joint that comes again
        except UserError as error:
            self.get_logger().warning(f'joints do not expire: {error}')
            return False
        self.bank.configuration = self._configuration(self._ros.values, self._ros.overrides)
        return True

    # Services

    def _freeze(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        result = self.set_parameters([RosParameter('adapt', value=not request.data)])[0]
        response.success = result.successful
        response.message = result.reason or ('held' if request.data else 'adapting')
        return response

    def _save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        path = self.settings.parameters_file
        try:
            if not path:
                raise UserError("parameter 'parameters_file' is not set")
            saved = ', '.join(adaptive_file.save(path, self.bank))
            response.message = printable(f'{saved}: {path}')
            response.success = True
        except UserError as error:
            response.success, response.message = False, printable(error)
        return response
