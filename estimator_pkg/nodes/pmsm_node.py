"""The class of the node `pmsm_observer`."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any

from estimator_pkg.nodes import runtime  # noqa: F401  settles what rclpy and numpy read  # isort: skip

from geometry_msgs.msg import Vector3Stamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.drive_stream import Answer
from estimator_pkg.driver.joint import JointSettings
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.nodes.endpoints import Endpoints
from estimator_pkg.nodes.pmsm_health import PmsmHealth
from estimator_pkg.nodes.pmsm_settings import DRIVE_SAMPLES, PmsmSettings
from estimator_pkg.nodes.ros_parameters import RosParameters, Values
from estimator_pkg.observers.circle import Circle

LOOK_AROUND = 0.1  # [s]


class PmsmObserver(Node):
    """Estimates speed, angle and flux of a motor from its currents and voltages.

    Parameters
    ----------
    node_name, options : as of `rclpy.node.Node`; ``parameter_overrides`` sets parameters (see
        `estimator_pkg.nodes.ros_parameters.ros_values`).

    Raises
    ------
    UsageError : a parameter is wrong, or motor data is missing.

    Attributes
    ----------
    stream : the motor behind its topics.
    """

    def __init__(self, node_name: str = 'pmsm_observer', **options: Any) -> None:
        super().__init__(node_name, **options)
        try:
            self._configure()
            self._connect()
        except UsageError:
            self.destroy_node()
            raise

    def _configure(self) -> None:
        self._ros = RosParameters(self)
        self.settings = self._ros.declare(PmsmSettings)
        self.settings.check()
        self._observer = self.settings.find()
        self._ros.declare(self._observer.gains)
        self._ros.declare(JointSettings)
        configuration = self._configuration(self._ros.values)
        self.stream = self.settings.stream(configuration)
        self.joint = self.stream.joint
        self.joint.warm_up()
        self.bank = Bank(configuration, (self.settings.joint,))
        self.bank.joints[self.settings.joint] = self.joint

    def _configuration(self, values: Values) -> Configuration:
        return Configuration(self._observer, {
            name: values[name] for name in Configuration(self._observer).parameters()})

    def _connect(self) -> None:
        self._endpoints = Endpoints(self)
        self._estimate = self._endpoints.publisher(JointState, '~/estimate')
        self._stddev = self._endpoints.publisher(JointState, '~/estimate_stddev')
        self._flux = self._endpoints.publisher(Vector3Stamped, '~/flux_linkage')
        if self.settings.input == DRIVE_SAMPLES:
            self._samples = self._endpoints.publisher(Float64MultiArray, '~/estimate_samples')
            inputs = [self._endpoints.subscribe(Float64MultiArray, 'drive_samples',
                                                self._batch_came)]
        else:
            inputs = [
                self._endpoints.subscribe(Vector3Stamped, 'current', self._current_came),
                self._endpoints.subscribe(Vector3Stamped, 'voltage', self._voltage_came)]
        self.create_service(Trigger, '~/reset', self._reset)
        self.health = PmsmHealth(self, self.bank, self._endpoints, self._ros, inputs[0],
                                 self.stream)
        self.create_timer(LOOK_AROUND, self._look_around,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._ros.watch(self._check, self._apply)
        topics = ' and '.join(each.topic_name for each in inputs)
        self.get_logger().info(
            f"{self._observer.name} estimates '{self.settings.joint}' from {topics} on "
            f'{self._estimate.topic_name}' + (', compiled' if self.joint.fast else ''))

    # Parameters

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        """Refuse gains that do not work, at the rate measured so far."""
        gains, settings = self._configuration(values).for_joint(self.settings.joint)
        functions = self._observer.build(gains, Circle(settings.wrap_period, settings.unwrap))
        functions.design()
        why = functions.limits(self.joint.mean_dt) if self.joint.mean_dt > 0.0 else None
        if why:
            raise UsageError(why)

    def _apply(self) -> None:
        """Use what was set from the next sample on; the state is kept."""
        self.bank.configuration = self._configuration(self._ros.values)
        gains, settings = self.bank.configuration.for_joint(self.settings.joint)
        if settings != self.joint.settings:
            self.joint.set_settings(settings)
        if gains != self.joint.gains:
            self.joint.set_gains(gains)
            self.joint.warm_up()

    # Messages

    def _batch_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        begun = perf_counter()
        try:
            answer = self.stream.batch(raw)
        except MalformedMessageError:
            self.health.malformed += 1
            return
        if answer.samples is not None:
            self._samples.publish(answer.samples)
        self._publish(answer)
        self.health.took(perf_counter() - begun)

    def _current_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        self._vector_came(raw, self.stream.current)

    def _voltage_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        self._vector_came(raw, self.stream.voltage)

    def _vector_came(self, raw: bytes, take: Any) -> None:
        begun = perf_counter()
        try:
            answers = take(raw)
        except MalformedMessageError:
            self.health.malformed += 1
            return
        for answer in answers:
            self._publish(answer)
        self.health.took(perf_counter() - begun)

    def _publish(self, answer: Answer) -> None:
        self._estimate.publish(answer.estimate)
        if answer.stddev is not None:
            self._stddev.publish(answer.stddev)
        if answer.flux is not None:
            self._flux.publish(answer.flux)

    def _look_around(self) -> None:
        """Ten times a second, by the steady clock: who listens, and how the motor is."""
        self._endpoints.drain()
        self.stream.stddev_wanted = self._stddev.get_subscription_count() > 0
        self.stream.flux_wanted = self._flux.get_subscription_count() > 0
        self.health.look()

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.joint.reset()
        response.success = True
        response.message = f'{self.settings.joint} starts again'
        return response
