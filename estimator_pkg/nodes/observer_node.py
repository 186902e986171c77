"""The class of the node `joint_observer`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from time import perf_counter
from typing import Any

from estimator_pkg.nodes import runtime  # noqa: F401  settles what rclpy and numpy read  # isort: skip

import std_msgs.msg
from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from estimator_pkg import observers
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint, JointSettings
from estimator_pkg.errors import UsageError
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.messages.number import decoder as number_decoder
from estimator_pkg.nodes.endpoints import Endpoints
from estimator_pkg.nodes.health import Health
from estimator_pkg.nodes.ros_parameters import RosParameters, Values
from estimator_pkg.nodes.settings import ANGLE, NodeSettings
from estimator_pkg.observers.circle import Circle

LOOK_AROUND = 0.1  # [s]

Valid = list[tuple[str, Joint, tuple[float, float, float, int]]]


class JointObserver(Node):
    """Estimates the velocity of every joint whose angle it receives.

    Parameters
    ----------
    node_name, options : as of `rclpy.node.Node`; ``parameter_overrides`` sets parameters (see
        `estimator_pkg.nodes.ros_parameters.ros_values`).

    Raises
    ------
    UsageError : a parameter is wrong.

    Attributes
    ----------
    bank : the joints.
    """

    def __init__(self, node_name: str = 'joint_observer', **options: Any) -> None:
        # Overrides may name joints that have not appeared, so they cannot all be declared.
        super().__init__(node_name, **{'allow_undeclared_parameters': True, **options})
        try:
            self._configure()
            self._connect()
        except UsageError:
            self.destroy_node()
            raise

    def _configure(self) -> None:
        self._ros = RosParameters(self)
        self.settings = self._ros.declare(NodeSettings)
        self.settings.check()
        self._observer = observers.find(self.settings.observer)
        if self._observer.kind != 'angle':
            raise UsageError(f"observer '{self._observer.name}' does not work from an angle alone")
        self._ros.declare(self._observer.gains)
        self._ros.declare(JointSettings)
        self._ros.allow_overrides(Configuration(self._observer).parameters())
        configuration = self._configuration(self._ros.values, self._ros.overrides)
        self._gives_acceleration = False
        for joint in ('', *configuration.overrides):
            self._build(configuration, joint)
            self._gives_acceleration |= self._observer.gives_acceleration(
                configuration.for_joint(joint)[0])
        self.bank = Bank(configuration, self.settings.only)

    def _configuration(self, values: Values, overrides: Mapping[str, Values]) -> Configuration:
        common = {name: values[name] for name in Configuration(self._observer).parameters()}
        return Configuration(self._observer, self.settings.implied(common), overrides)

    def _build(self, configuration: Configuration, joint: str) -> Any:
        gains, settings = configuration.for_joint(joint)
        return self._observer.build(gains, Circle(settings.wrap_period, settings.unwrap))

    def _connect(self) -> None:
        self._endpoints = Endpoints(self)
        self._estimate = self._endpoints.publisher(JointState, '~/estimate')
        self._stddev = self._endpoints.publisher(JointState, '~/estimate_stddev')
        self._acceleration: Publisher | None = None
        if self._gives_acceleration:
            self._acceleration = self._endpoints.publisher(JointTrajectory, '~/acceleration')
        self._encode, self._encode_stddev = Encoder().encode, Encoder().encode
        if self.settings.input == ANGLE:
            self._number = number_decoder(self.settings.angle_type)
            self._angle = self.settings.raw_angle.angle
            self._names = (self.settings.angle_joint,)
            self.input = self._endpoints.subscribe(
                getattr(std_msgs.msg, self.settings.angle_type), 'angle', self._angle_came)
        else:
            self._layout = Decoder().layout
            self._by_publisher = self.settings.stamp_source == 'publisher'
            self.input = self._endpoints.subscribe(JointState, 'joint_states',
                                                   self._joint_state_came)
        self.create_service(Trigger, '~/reset', self._reset)
        self.health = Health(self, self.bank, self._endpoints, self._ros, self.input)
        self._stddev_wanted = self._acceleration_wanted = False
        self.create_timer(LOOK_AROUND, self._look_around,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._ros.watch(self._check, self._apply)
        self.get_logger().info(
            f'{self._observer.name} estimates {self._wanted()} of {self.input.topic_name} on '
            f'{self._estimate.topic_name}')

    def _wanted(self) -> str:
        return ', '.join(self.settings.only) or 'every joint'

    # Parameters

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        """Refuse gains that do not work, at the rates measured so far."""
        configuration = self._configuration(values, overrides)
        self._build(configuration, '')
        for name, joint in self.bank.joints.items():
            if configuration.for_joint(name)[0] == joint.gains:
                continue
            limits = self._build(configuration, name).limits
            why = limits(joint.mean_dt) if joint.mean_dt > 0.0 else None
            if why:
                raise UsageError(f"joint '{name}': {why}")

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

    def _joint_state_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        begun = perf_counter()
        try:
            layout = self._layout(raw)
            positions = layout.numbers(raw, 0)
        except MalformedMessageError:
            self.health.malformed += 1
            return
        stamp_ns = info['source_timestamp'] if self._by_publisher else layout.stamp_ns(raw)
        self._publish(stamp_ns, layout.frame_id,
                      self.bank.update(stamp_ns, layout.names, positions))
        self.health.took(perf_counter() - begun)

    def _angle_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        begun = perf_counter()
        try:
            angle = self._angle(self._number(raw))
        except MalformedMessageError:
            self.health.malformed += 1
            return
        stamp_ns = info['source_timestamp']
        self._publish(stamp_ns, '', self.bank.update(stamp_ns, self._names, (angle,)))
        self.health.took(perf_counter() - begun)

    def _publish(self, stamp_ns: int, frame_id: str, valid: Valid) -> None:
        names = [name for name, joint, estimate in valid]
        self._estimate.publish(self._encode(
            stamp_ns, frame_id, names, [estimate[0] for name, joint, estimate in valid],
            [estimate[1] for name, joint, estimate in valid]))
        if self._stddev_wanted:
            pairs = [joint.stddev() for name, joint, estimate in valid]
            self._stddev.publish(self._encode_stddev(
                stamp_ns, frame_id, names, [pair[0] for pair in pairs],
                [pair[1] for pair in pairs]))
        if self._acceleration_wanted and self._acceleration is not None:
            self._acceleration.publish(_trajectory(stamp_ns, frame_id, valid))

    def _look_around(self) -> None:
        """Ten times a second, by the steady clock: who listens, and how the joints are."""
        self._endpoints.drain()
        self._stddev_wanted = self._stddev.get_subscription_count() > 0
        if self._acceleration is not None:
            self._acceleration_wanted = self._acceleration.get_subscription_count() > 0
        self.health.look()

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for joint in self.bank.joints.values():
            joint.reset()
        response.success = True
        response.message = f'{len(self.bank.joints)} joints start again'
        return response


def _trajectory(stamp_ns: int, frame_id: str, valid: Valid) -> JointTrajectory:
    """One point with the joints whose acceleration is known."""
    giving = [(name, estimate) for name, joint, estimate in valid if math.isfinite(estimate[2])]
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return JointTrajectory(
        header=Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id),
        joint_names=[name for name, estimate in giving],
        points=[JointTrajectoryPoint(
            positions=[estimate[0] for name, estimate in giving],
            velocities=[estimate[1] for name, estimate in giving],
            accelerations=[estimate[2] for name, estimate in giving])])
