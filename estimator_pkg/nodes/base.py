"""What every node of an observer does; a node's own file holds what is its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from time import perf_counter
from traceback import format_exception
from typing import Any, ClassVar

from estimator_pkg.nodes import runtime  # noqa: F401  settles what rclpy and numpy read  # isort: skip

from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint, JointSettings
from estimator_pkg.errors import UsageError, where
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Decoder, Encoder, Layout
from estimator_pkg.nodes.acceleration import trajectory
from estimator_pkg.nodes.endpoints import Endpoints, OnDemand
from estimator_pkg.nodes.health import Health, WatchedBank
from estimator_pkg.nodes.ros_parameters import RosParameters, Values, in_words
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import declared
from estimator_pkg.printable import PrintableLogger

LOOK_AROUND = 0.1   # [s]
TYPICAL_DT = 1e-3   # [s]
NO_NUMBERS = 'numbers become too large or too small for these gains'

Receive = Callable[[bytes, Mapping[str, Any]], None]  # (CDR bytes, message info)
Take = Callable[[int, Layout, bytes], None]           # (stamp [ns], layout, CDR bytes)


class ObserverNode(Node):
    """A node that keeps a bank of joints, feeds it from topics and publishes what it estimates.

    It declares the parameters, publishes ``~/estimate`` and ``~/estimate_stddev``, serves
    ``~/reset``, and ten times a second looks who listens and how the joints are. A node says what
    it is by the class attributes and the methods below them; nothing else needs to be overridden.

    Parameters
    ----------
    node_name, options : as of `rclpy.node.Node`; ``parameter_overrides`` sets parameters (see
        `estimator_pkg.nodes.ros_parameters.ros_values`). The name is that of the executable by
        default.

    Raises
    ------
    UserError : a parameter is wrong, or a model or file that it names cannot be used.

    Attributes
    ----------
    settings : what is set of the node as a whole.
    bank : the joints.
    input : the subscription that feeds the bank.
    health : status, diagnostics and warnings.
    """

    NAME: ClassVar[str]
    SETTINGS: ClassVar[type]                           # of the node as a whole
    PER_JOINT: ClassVar[type[JointSettings]] = JointSettings
    OVERRIDES: ClassVar[bool] = True                   # joints.<joint>.<parameter> may be set
    HEALTH: ClassVar[type[Health]] = Health

    settings: Any
    bank: WatchedBank

    def __init__(self, node_name: str = '', **options: Any) -> None:
        try:
            # Overrides may name joints that have not appeared, so they cannot all be declared.
            super().__init__(node_name or self.NAME,
                             **{'allow_undeclared_parameters': self.OVERRIDES, **options})
        except ParameterException as error:  # of a parameter of rclpy's own, as use_sim_time
            raise UsageError(in_words(error)) from error
        try:
            self._declare()
            configuration = self._configuration(self._ros.values, self._ros.overrides)
            self._try(configuration)
            self.bank = self._make_bank(configuration)
            self._open()
        except BaseException as error:
            self.destroy_node()
            if isinstance(error, ArithmeticError):
                raise UsageError(f'{self._observer.name}: {NO_NUMBERS} ({error})') from error
            raise

    def get_logger(self) -> Any:
        """The node's logger, whose texts are printable whatever names are in them."""
        return PrintableLogger(super().get_logger())

    # What a node says of itself

    def _find_observer(self) -> Observer:
        """The observer; raises UsageError if the settings do not go together."""
        raise NotImplementedError

    def _make_bank(self, configuration: Any) -> WatchedBank:
        """The joints; raises UserError if something is wrong that no range can say."""
        raise NotImplementedError

    def _connect(self) -> Subscription:
        """Make the node's own publishers and its inputs; returns what feeds the bank."""
        raise NotImplementedError

    def _configured(self, common: Mapping[str, Any], overrides: Mapping[str, Values]) -> Any:
        """Gains and settings per joint, of the common values and the overrides."""
        return Configuration(self._observer, common, overrides)

    def _try(self, configuration: Any) -> None:
        """Raise UsageError for gains that do not work, of joints that have not appeared, too."""
        for name in ('', *configuration.overrides):
            self._build(configuration, name)

    def _wanted(self) -> str:
        """What is estimated, in words."""
        return 'every joint'

    def _restarted(self) -> str:
        """What ~/reset lets start again, in words."""
        return f'{len(self.bank.joints)} {self.HEALTH.KEPT}s start'

    def _make_health(self) -> Health:
        return self.HEALTH(self, self.bank, self._endpoints, self._ros)

    def _gains_changed(self, name: str) -> None:
        """A joint has other gains from the next sample on."""

    def _saved_before_expiry(self, names: Sequence[str]) -> bool:
        """Whether these joints may be forgotten: what they have learnt is kept elsewhere."""
        return True

    def expire(self, names: Sequence[str]) -> bool:
        """Forget these joints, which have had no sample for `expiry`; whether that was possible."""
        if not self._saved_before_expiry(names):
            return False
        bank: Any = self.bank
        for name in names:
            bank.forget(name)
        return True

    def _look(self) -> None:
        """What else is to be done ten times a second."""

    # Start

    def _declare(self) -> None:
        self._ros = RosParameters(self)
        self.settings = self._ros.declare(self.SETTINGS)
        self._observer = self._find_observer()
        self._per_joint = (*declared(self._observer.gains), *declared(self.PER_JOINT))
        self._ros.declare(self._observer.gains)
        self._ros.declare(self.PER_JOINT)
        if self.OVERRIDES:
            self._ros.allow_overrides(self._per_joint)

    def _open(self) -> None:
        self._endpoints = Endpoints(self)
        self._estimate = self._endpoints.publisher(JointState, '~/estimate')
        self._stddev = self._endpoints.on_demand(JointState, '~/estimate_stddev')
        self._encode, self._encode_stddev = Encoder().encode, Encoder().encode
        self._acceleration: OnDemand | None = None
        self.create_service(Trigger, '~/reset', self._reset)
        self.health = self._make_health()
        self._ros.watch(self._check, self._apply)
        with suppress(Exception):  # of a user's model: told when a message meets it
            self.bank.rehearse()
        self.create_timer(LOOK_AROUND, self._look_around,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        # Last: from here on messages come, and wait in a queue that is not long.
        self.input = self.health.input = self._connect()
        self.get_logger().info(
            f'{self._observer.name} estimates {self._wanted()} of '
            f'{" and ".join(self._endpoints.inputs)} on {self._estimate.topic_name}')

    # Parameters

    def _configuration(self, values: Values, overrides: Mapping[str, Values]) -> Any:
        return self._configured({name: values[name] for name in self._per_joint}, overrides)

    def _build(self, configuration: Any, joint: str) -> Any:
        """The observer's functions for this joint ('': for one of no override)."""
        gains, settings = configuration.for_joint(joint)
        functions = self._observer.build(gains, Circle(settings.wrap_period, settings.unwrap))
        functions.prepare(functions.design(), TYPICAL_DT)  # raises, where there are no numbers
        return functions

    def _called(self, name: str) -> str:
        """A joint in words; '' is none, but what is common to all."""
        return f"{self.HEALTH.KEPT} '{name}'" if name else self._observer.name

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        """Refuse gains that do not work, at the rates measured so far and from where joints are."""
        configuration = self._configuration(values, overrides)
        try:
            self._try(configuration)
            for name, joint in self.bank.joints.items():
                functions = self._build(configuration, name)
                if configuration.for_joint(name)[0] != joint.gains:
                    self._check_change(name, joint, functions)
        except (ArithmeticError, ValueError) as error:
            raise UsageError(f'{NO_NUMBERS} ({error})') from error

    def _check_change(self, name: str, joint: Joint, functions: Any) -> None:
        why = functions.limits(joint.mean_dt) if joint.mean_dt > 0.0 else None
        if not why and not joint.goes_on_with(functions):
            why = 'the state cannot be kept with this: set it before the node starts'
        if why:
            raise UsageError(f'{self._called(name)}: {why}')

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
                self._gains_changed(name)

    # Messages

    def _listen(self, kind: type, topic: str, take: Receive, *, answered: bool = True,
                qos: QoSProfile | None = None) -> Subscription:
        """A subscription; messages of which nothing can be made are counted and go no further.

        Parameters
        ----------
        take : gets the CDR bytes and the message info; may raise MalformedMessageError.
        answered : an estimate answers each message, so its time is that of a step.
        """
        def came(raw: bytes, info: Mapping[str, Any]) -> None:
            begun = perf_counter()
            try:
                take(raw, info)
            except MalformedMessageError as error:
                self.health.malformed(subscription.topic_name, str(error))
                return
            except Exception as error:  # of a user's model, or of numbers that nobody foresaw
                if not self.context.ok():
                    raise
                self._failed(subscription.topic_name, error)
                return
            if answered:
                self.health.took(perf_counter() - begun)

        subscription = self._endpoints.subscribe(kind, topic, came, qos)
        return subscription

    def _failed(self, topic: str, error: Exception) -> None:
        """An observer that fails must not take the others' estimates with it: start again."""
        for joint in self.bank.joints.values():
            joint.reset()
        self.health.failed(topic, where(error))
        self.get_logger().debug(''.join(format_exception(error)))

    def _listen_to_states(self, topic: str, take: Take, **options: Any) -> Subscription:
        """As `_listen`, to JointStates; the stamp is that of ``stamp_source``."""
        layout_of = Decoder().layout
        by_publisher = self.settings.stamp_source == 'publisher'

        def came(raw: bytes, info: Mapping[str, Any]) -> None:
            layout = layout_of(raw)
            stamp_ns = info['source_timestamp'] if by_publisher else layout.stamp_ns(raw)
            take(stamp_ns, layout, raw)

        return self._listen(JointState, topic, came, **options)

    def _tell_acceleration(self) -> None:
        """Publish ~/acceleration too, of estimates that have it."""
        self._acceleration = self._endpoints.on_demand(JointTrajectory, '~/acceleration')

    def _answer(self, stamp_ns: int, frame_id: str, names: Sequence[str],
                estimates: Sequence[Sequence[Any]],
                stddevs: Callable[[], Sequence[tuple[float, float]]]) -> None:
        """Publish the estimates, and what else is made of them while somebody listens.

        Parameters
        ----------
        estimates : position, velocity and maybe more of each name; after `_tell_acceleration` the
            third is the acceleration or nan.
        stddevs : makes position's and velocity's standard deviation of each name.
        """
        self._estimate.publish(self._encode(stamp_ns, frame_id, names,
                                            [each[0] for each in estimates],
                                            [each[1] for each in estimates]))
        if self._stddev.wanted:
            pairs = stddevs()
            self._stddev.publish(self._encode_stddev(stamp_ns, frame_id, names,
                                                     [pair[0] for pair in pairs],
                                                     [pair[1] for pair in pairs]))
        if self._acceleration is not None and self._acceleration.wanted:
            self._acceleration.publish(trajectory(stamp_ns, frame_id, names, estimates))

    def _answer_joints(self, stamp_ns: int, frame_id: str,
                       valid: Sequence[tuple[str, Joint, Sequence[Any]]]) -> None:
        """`_answer` with (name, joint, estimate) of each."""
        self._answer(stamp_ns, frame_id, [name for name, joint, estimate in valid],
                     [estimate for name, joint, estimate in valid],
                     lambda: [joint.stddev() for name, joint, estimate in valid])

    def _look_around(self) -> None:
        """Ten times a second, by the steady clock: who listens, and how the joints are."""
        self._endpoints.look()
        self._look()
        self.health.look()

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for joint in self.bank.joints.values():
            joint.reset()
        response.success = True
        response.message = f'{self._restarted()} again'
        return response
