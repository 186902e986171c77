"""The class of the node `mechanical_observer`."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any

from estimator_pkg.nodes import runtime  # noqa: F401  settles what rclpy and numpy read  # isort: skip

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from estimator_pkg.driver.mechanism import (
    COMMAND,
    Mechanism,
    MechanismBank,
    MechanismConfiguration,
    MechanismSettings,
)
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.nodes.diagnostics import OK, entry
from estimator_pkg.nodes.endpoints import Endpoints, latched
from estimator_pkg.nodes.health import Health
from estimator_pkg.nodes.mechanical_settings import MechanicalNodeSettings
from estimator_pkg.nodes.ros_parameters import RosParameters, Values
from estimator_pkg.observers.mechanical_gains import in_words

LOOK_AROUND = 0.1  # [s]


class MechanicalObserver(Node):
    """Estimates the velocities of mechanisms from positions, inputs and a model.

    Parameters
    ----------
    node_name, options : as of `rclpy.node.Node`.

    Raises
    ------
    UserError : a parameter is wrong, or a model cannot be used.

    Attributes
    ----------
    bank : the mechanisms.
    """

    def __init__(self, node_name: str = 'mechanical_observer', **options: Any) -> None:
        super().__init__(node_name, **{'allow_undeclared_parameters': True, **options})
        try:
            self._configure()
            self._connect()
        except UserError:
            self.destroy_node()
            raise

    def _configure(self) -> None:
        self._ros = RosParameters(self)
        self.settings = self._ros.declare(MechanicalNodeSettings)
        self._observer = self.settings.find_observer()
        self._ros.declare(self._observer.gains)
        self._ros.declare(MechanismSettings)
        self._ros.allow_overrides(MechanismConfiguration(self._observer).parameters())
        self.bank = MechanismBank(self._configuration(self._ros.values, self._ros.overrides),
                                  self.settings.mechanisms, self.settings.input)

    def _configuration(self, values: Values, overrides: Mapping[str, Values]
                       ) -> MechanismConfiguration:
        names = MechanismConfiguration(self._observer).parameters()
        return MechanismConfiguration(self._observer, {name: values[name] for name in names},
                                      overrides)

    def _connect(self) -> None:
        self._endpoints = Endpoints(self)
        self._estimate = self._endpoints.publisher(JointState, '~/estimate')
        self._stddev = self._endpoints.publisher(JointState, '~/estimate_stddev')
        self._gains = self._endpoints.publisher(DiagnosticArray, '~/gains', latched())
        self._encode, self._encode_stddev = Encoder().encode, Encoder().encode
        self._layout, self._layout_of_command = Decoder().layout, Decoder().layout
        self._by_publisher = self.settings.stamp_source == 'publisher'
        self.input = self._endpoints.subscribe(JointState, 'joint_states', self._states_came)
        if self.settings.input == COMMAND:
            self._endpoints.subscribe(JointState, 'effort_command', self._command_came)
        self.create_service(Trigger, '~/reset', self._reset)
        self.health = Health(self, self.bank, self._endpoints, self._ros,  # type: ignore[arg-type]
                             self.input)
        self._stddev_wanted = False
        self._told: dict[str, float] = {}
        self.create_timer(LOOK_AROUND, self._look_around,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._ros.watch(self._check, self._apply)
        joints = ', '.join(joint for mechanism in self.bank.joints.values()
                           for joint in mechanism.names)
        self.get_logger().info(f'{self._observer.name} estimates {joints} of '
                               f'{self.input.topic_name} on {self._estimate.topic_name}')

    # Parameters

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        """Refuse gains that do not work, at the rates measured so far."""
        configuration = self._configuration(values, overrides)
        for name, mechanism in self.bank.joints.items():
            gains, settings = configuration.of(name)
            try:
                fresh = Mechanism(name, self._observer, gains, settings, self.settings.input)
            except UserError as error:
                raise UsageError(str(error)) from error
            why = (fresh.functions.limits(mechanism.mean_dt) if mechanism.mean_dt > 0.0
                   else None)
            if why:
                raise UsageError(f"mechanism '{name}': {why}")

    def _apply(self) -> None:
        """Use what was set from the next sample on; every mechanism keeps its state."""
        configuration = self._configuration(self._ros.values, self._ros.overrides)
        self.bank.configuration = configuration
        for name, mechanism in self.bank.joints.items():
            gains, settings = configuration.of(name)
            if settings != mechanism.settings:
                mechanism.set_settings(settings)
            if gains != mechanism.gains:
                mechanism.set_gains(gains)
                self._told.pop(name, None)

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
        valid = self.bank.update(stamp_ns, layout.names, positions, efforts)
        names = [each.name for each in valid]
        self._estimate.publish(self._encode(
            stamp_ns, layout.frame_id, names, [each.position for each in valid],
            [each.velocity for each in valid]))
        if self._stddev_wanted:
            pairs = self.bank.stddevs(names)
            self._stddev.publish(self._encode_stddev(
                stamp_ns, layout.frame_id, names, [pair[0] for pair in pairs],
                [pair[1] for pair in pairs]))
        self.health.took(perf_counter() - begun)

    def _command_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        try:
            layout = self._layout_of_command(raw)
            efforts = layout.numbers(raw, 2)
        except MalformedMessageError:
            self.health.malformed += 1
            return
        stamp_ns = info['source_timestamp'] if self._by_publisher else layout.stamp_ns(raw)
        self.bank.command(stamp_ns, layout.names, efforts)

    def _look_around(self) -> None:
        """Ten times a second, by the steady clock: who listens, and how the mechanisms are."""
        self._stddev_wanted = self._stddev.get_subscription_count() > 0
        self.health.look()
        if any(mechanism.mean_dt > 0.0 and name not in self._told
               for name, mechanism in self.bank.joints.items()):
            self._tell_gains()

    def _tell_gains(self) -> None:
        """Poles, limits and noise of the gains at the measured rate, on ~/gains."""
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        for name, mechanism in self.bank.joints.items():
            if mechanism.mean_dt > 0.0:
                self._told[name] = mechanism.mean_dt
                found = mechanism.functions.describe(  # type: ignore[attr-defined]
                    mechanism.mean_dt)
                status: DiagnosticStatus = entry(OK, name, self._observer.name, in_words(found))
                message.status.append(status)
        self._gains.publish(message)

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for mechanism in self.bank.joints.values():
            mechanism.reset()
        response.success = True
        response.message = f'{len(self.bank.joints)} mechanisms start again'
        return response
