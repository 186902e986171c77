"""The class of the node `adaptive_observer`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

from estimator_pkg.nodes import runtime  # noqa: F401  settles what rclpy and numpy read  # isort: skip

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from estimator_pkg.driver import adaptive_bank
from estimator_pkg.driver.adaptive_bank import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.joint import JointSettings
from estimator_pkg.errors import UserError
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.nodes.adaptive_settings import AdaptiveNodeSettings
from estimator_pkg.nodes.diagnostics import OK, WARN, entry
from estimator_pkg.nodes.endpoints import Endpoints
from estimator_pkg.nodes.health import Health
from estimator_pkg.nodes.ros_parameters import RosParameters, Values
from estimator_pkg.observers.adaptive import OBSERVER
from estimator_pkg.observers.circle import Circle

LOOK_AROUND = 0.1  # [s]


class AdaptiveObserver(Node):
    """Estimates the velocity of joints of unknown parameters, and the parameters.

    Parameters
    ----------
    node_name, options : as of `rclpy.node.Node`.

    Raises
    ------
    UsageError : a parameter, or the parameters file, is wrong.

    Attributes
    ----------
    bank : the joints.
    """

    def __init__(self, node_name: str = 'adaptive_observer', **options: Any) -> None:
        super().__init__(node_name, **{'allow_undeclared_parameters': True, **options})
        try:
            self._configure()
            self._connect()
        except UserError:
            self.destroy_node()
            raise

    def _configure(self) -> None:
        self._ros = RosParameters(self)
        self.settings = self._ros.declare(AdaptiveNodeSettings)
        self._ros.declare(OBSERVER.gains)
        self._ros.declare(JointSettings)
        self._ros.allow_overrides(AdaptiveConfiguration(OBSERVER).parameters())
        path = self.settings.parameters_file
        self._saved = adaptive_bank.load(path) if path and Path(path).exists() else {}
        configuration = self._configuration(self._ros.values, self._ros.overrides)
        for joint in ('', *configuration.overrides):
            self._build(configuration, joint)
        self.bank = AdaptiveBank(configuration, self.settings.only, self.settings.input_scale)

    def _configuration(self, values: Values, overrides: Mapping[str, Values]
                       ) -> AdaptiveConfiguration:
        names = AdaptiveConfiguration(OBSERVER).parameters()
        return AdaptiveConfiguration(OBSERVER, {name: values[name] for name in names}, overrides,
                                     self._saved)

    def _build(self, configuration: AdaptiveConfiguration, joint: str) -> Any:
        gains, settings = configuration.for_joint(joint)
        return OBSERVER.build(gains, Circle(settings.wrap_period, settings.unwrap))

    def _connect(self) -> None:
        self._endpoints = Endpoints(self)
        self._estimate = self._endpoints.publisher(JointState, '~/estimate')
        self._stddev = self._endpoints.publisher(JointState, '~/estimate_stddev')
        self._identified = self._endpoints.publisher(DiagnosticArray, '~/identified_parameters')
        self._encode, self._encode_stddev = Encoder().encode, Encoder().encode
        self._layout = Decoder().layout
        self._by_publisher = self.settings.stamp_source == 'publisher'
        self.input = self._endpoints.subscribe(JointState, 'joint_states', self._states_came)
        self.create_service(Trigger, '~/reset', self._reset)
        self.create_service(Trigger, '~/save', self._save)
        self.create_service(SetBool, '~/freeze', self._freeze)
        self.health = Health(self, self.bank, self._endpoints, self._ros, self.input)
        self._stddev_wanted = False
        self.create_timer(LOOK_AROUND, self._look_around,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._ros.watch(self._check, self._apply)
        wanted = ', '.join(self.settings.only) or 'every joint'
        self.get_logger().info(f'adaptive estimates {wanted} of {self.input.topic_name} on '
                               f'{self._estimate.topic_name}')

    # Parameters

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        configuration = self._configuration(values, overrides)
        for joint in ('', *self.bank.joints):
            self._build(configuration, joint)

    def _apply(self) -> None:
        """Use what was set from the next sample on; every joint keeps its state."""
        configuration = self._configuration(self._ros.values, self._ros.overrides)
        self.bank.configuration = configuration
        for name, joint in self.bank.joints.items():
            gains, settings = configuration.for_joint(name)
            if settings != joint.settings:
                joint.set_settings(settings)
            if gains != joint.gains:
                joint.set_gains(gains)

    # Messages

    def _states_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        begun = perf_counter()
        try:
            layout = self._layout(raw)
            positions, efforts = layout.numbers(raw, 0), layout.numbers(raw, 2)
        except MalformedMessageError:
            self.health.malformed += 1
            return
        stamp_ns = info['source_timestamp'] if self._by_publisher else layout.stamp_ns(raw)
        valid = self.bank.take(stamp_ns, layout.names, positions, efforts)
        names = [name for name, joint, estimate in valid]
        self._estimate.publish(self._encode(
            stamp_ns, layout.frame_id, names, [estimate[0] for name, joint, estimate in valid],
            [estimate[1] for name, joint, estimate in valid]))
        if self._stddev_wanted:
            pairs = [joint.stddev() for name, joint, estimate in valid]
            self._stddev.publish(self._encode_stddev(
                stamp_ns, layout.frame_id, names, [pair[0] for pair in pairs],
                [pair[1] for pair in pairs]))
        self.health.took(perf_counter() - begun)

    def _look_around(self) -> None:
        """Ten times a second, by the steady clock."""
        self._stddev_wanted = self._stddev.get_subscription_count() > 0
        self.health.look()
        if self._identified.get_subscription_count() > 0:
            self._tell_parameters()

    def _tell_parameters(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        for name, said in self.bank.reports().items():
            values: dict[str, Any] = {
                'state': said.phase, 'why': said.reason, 'trusted': said.trusted,
                'adapted_s': said.adapted, 'excitation': said.excitation}
            for item in said.parameters:
                values.update({item.name: item.value, f'{item.name}.stddev': item.stddev,
                               f'{item.name}.unit': item.unit})
            message.status.append(entry(OK if said.trusted else WARN, name,
                                        f'{said.phase}: {said.reason}', values))
        self._identified.publish(message)

    # Services

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for joint in self.bank.joints.values():
            joint.reset()
        response.success = True
        response.message = f'{len(self.bank.joints)} joints start again'
        return response

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
            response.message = f'{", ".join(adaptive_bank.save(path, self.bank))}: {path}'
            response.success = True
        except UserError as error:
            response.success, response.message = False, str(error)
        return response
