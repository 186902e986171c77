"""The class of the node `switched_observer`."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any

from estimator_pkg.nodes import runtime  # noqa: F401  settles what rclpy and numpy read  # isort: skip

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import JointSettings
from estimator_pkg.driver.switched_joint import REFUSED, SwitchedBank, SwitchedJoint
from estimator_pkg.errors import UserError
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder
from estimator_pkg.models.switched import load
from estimator_pkg.nodes.endpoints import Endpoints
from estimator_pkg.nodes.health import Health
from estimator_pkg.nodes.ros_parameters import RosParameters, Values
from estimator_pkg.nodes.switched_settings import SwitchedNodeSettings
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.switched import OBSERVER

LOOK_AROUND = 0.1  # [s]


class SwitchedObserver(Node):
    """Estimates the velocities of a system that known events switch, and its discrete state.

    Parameters
    ----------
    node_name, options : as of `rclpy.node.Node`.

    Raises
    ------
    UserError : a parameter is wrong, or the model cannot be used.

    Attributes
    ----------
    bank : the system.
    """

    def __init__(self, node_name: str = 'switched_observer', **options: Any) -> None:
        super().__init__(node_name, **options)
        try:
            self._configure()
            self._connect()
        except UserError:
            self.destroy_node()
            raise

    def _configure(self) -> None:
        self._ros = RosParameters(self)
        self.settings = self._ros.declare(SwitchedNodeSettings)
        self._ros.declare(OBSERVER.gains)
        self._ros.declare(JointSettings)
        gains, settings = self._configuration(self._ros.values).for_joint('')
        self._model = load(gains.model)
        self.bank = SwitchedBank(SwitchedJoint(OBSERVER, gains, settings),
                                 self.settings.names(self._model), self.settings.input_scale)

    @staticmethod
    def _configuration(values: Values) -> Configuration:
        names = Configuration(OBSERVER).parameters()
        return Configuration(OBSERVER, {name: values[name] for name in names})

    def _connect(self) -> None:
        self._endpoints = Endpoints(self)
        self._estimate = self._endpoints.publisher(JointState, '~/estimate')
        self._stddev = self._endpoints.publisher(JointState, '~/estimate_stddev')
        self._discrete = self._endpoints.publisher(JointState, '~/discrete_state')
        self._encode, self._encode_discrete = Encoder().encode, Encoder().encode
        self._encode_stddev = Encoder().encode
        self._layout, self._decode_event = Decoder().layout, Decoder().decode
        self._by_publisher = self.settings.stamp_source == 'publisher'
        self.input = self._endpoints.subscribe(JointState, 'joint_states', self._states_came)
        # best effort too, so that every publisher of events matches
        self._endpoints.subscribe(JointState, 'switch_event', self._event_came, QoSProfile(
            depth=50, reliability=ReliabilityPolicy.BEST_EFFORT))
        self.create_service(Trigger, '~/reset', self._reset)
        self.health = Health(self, self.bank, self._endpoints, self._ros,  # type: ignore[arg-type]
                             self.input)
        self._stddev_wanted = False
        self.create_timer(LOOK_AROUND, self._look_around,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._ros.watch(self._check, self._apply)
        self.get_logger().info(
            f'switched estimates {", ".join(self.bank.names)} of {self.input.topic_name} on '
            f'{self._estimate.topic_name}')

    # Parameters

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        gains, settings = self._configuration(values).for_joint('')
        OBSERVER.build(gains, Circle(settings.wrap_period, settings.unwrap))

    def _apply(self) -> None:
        """Use what was set from the next sample on; the state is kept."""
        gains, settings = self._configuration(self._ros.values).for_joint('')
        if settings != self.bank.system.settings:
            self.bank.system.set_settings(settings)
        if gains != self.bank.system.gains:
            self.bank.system.set_gains(gains)

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
        pairs = self.bank.take(stamp_ns, layout.names, positions, efforts)
        names = self.bank.names if pairs else ()
        self._estimate.publish(self._encode(
            stamp_ns, layout.frame_id, names, [pair[0] for pair in pairs],
            [pair[1] for pair in pairs]))
        if pairs:
            z, _, _ = self.bank.system.discrete()
            self._discrete.publish(self._encode_discrete(
                stamp_ns, layout.frame_id, self._model.names, z))
            if self._stddev_wanted:
                position, velocity = self.bank.system.stddev()
                self._stddev.publish(self._encode_stddev(
                    stamp_ns, layout.frame_id, names[:1], (position,), (velocity,)))
        self.health.took(perf_counter() - begun)

    def _event_came(self, raw: bytes, info: Mapping[str, Any]) -> None:
        try:
            event = self._decode_event(raw)
        except MalformedMessageError:
            self.health.malformed += 1
            return
        mode = event.names[0] if event.names else ''
        said = self.bank.system.event(event.stamp_ns, mode, event.positions)
        if said in REFUSED:
            words = said.replace('_', ' ')
            self.get_logger().warning(f"the event '{mode}' is not used: {words}")

    def _look_around(self) -> None:
        """Ten times a second, by the steady clock."""
        self._stddev_wanted = self._stddev.get_subscription_count() > 0
        self.health.look()

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.bank.system.reset()
        response.success = True
        response.message = 'the system starts again'
        return response
