# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node: a stream connected to ROS. Every observer node is this class with another stream."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from time import perf_counter
from traceback import format_exception
from typing import Any

from estimator_pkg.ros import runtime  # sets what rclpy and numpy read  # isort: skip

from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from std_srvs.srv import SetBool, Trigger

from estimator_pkg import streams
from estimator_pkg.errors import UsageError, UserError, plainly, where
from estimator_pkg.messages.field import Field
from estimator_pkg.nodes import message_types
from estimator_pkg.nodes.endpoints import Endpoints, get_message, latched
from estimator_pkg.nodes.health import Health
from estimator_pkg.nodes.ros_parameters import RosParameters, Values, in_words
from estimator_pkg.observers import instead
from estimator_pkg.parameters import declared
from estimator_pkg.printable import PrintableLogger, printable
from estimator_pkg.streams.contract import NO_NUMBERS, Action, Stream

LOOK_AROUND = 0.1  # [s]
START_WITH = "start the node with 'observer: {}'"  # to have another observer's gain


class ObserverNode(Node):
    """A stream whose ports are connected to subscriptions and publishers.

    It declares the parameters, publishes the stream's answers, and serves ``~/reset`` and the
    stream's other actions. Ten times a second it checks for subscribers and the joints' health.

    Parameters
    ----------
    stream : a class of streams, or the kind of its observers ('angle', 'drive', ...).
    node_name, options : as in `rclpy.node.Node`; ``parameter_overrides`` sets parameters (see
        `estimator_pkg.nodes.ros_parameters.ros_values`). The default name is the stream's.

    Raises
    ------
    UserError : a parameter is wrong, or a model or file that it names cannot be used.

    Attributes
    ----------
    stream : the stream.
    health : status, diagnostics and warnings.
    """

    def __init__(self, stream: type[Stream] | str, node_name: str = '', **options: Any) -> None:
        family = streams.named(stream) if isinstance(stream, str) else stream
        self._usual: dict[str, Any] = {}
        try:
            # Overrides may name joints that have not appeared, so they cannot all be declared; and
            # rclpy's refusal of an undeclared parameter does not name it.
            super().__init__(
                node_name or family.NODE, **{'allow_undeclared_parameters': True, **options}
            )
        except ParameterException as error:  # a parameter of rclpy, such as use_sim_time
            raise UsageError(in_words(error)) from error
        observer = None
        try:
            self._ros = RosParameters(self, self._usual)
            settings: Any = self._ros.declare(family.SETTINGS)
            groups: dict[str, Any] = {
                name: self._ros.declare(declaring, f'{name}.')
                for name, declaring in family.groups(settings).items()
            }
            settings = replace(settings, groups=groups)
            observer = settings.find_observer()
            self._per_joint = (*declared(observer.gains), *declared(family.PER_JOINT))
            self._ros.declare(observer.gains)
            self._ros.declare(family.PER_JOINT)
            if family.OVERRIDES:
                self._ros.allow_overrides(self._per_joint)
            self._ros.instead = partial(
                instead,
                known=(*self._per_joint, *declared(family.SETTINGS)),
                observer=observer,
                remedy=START_WITH,
            )
            self.stream = family.start(
                settings,
                family.configure(
                    observer, settings, self._common(self._ros.values), self._ros.overrides
                ),
            )
            for number, port in enumerate(self.stream.inputs):
                if port.field:
                    message_types.find(port.type)
                    found = Field(message_types.fields_of, port.type, port.field)
                    self.stream.read_field(found, number)
            self._open()
        except BaseException as error:
            if isinstance(error, ArithmeticError) and observer is not None:
                reason = UsageError(f'{observer.name}: {NO_NUMBERS} ({error})')
                runtime.discard(self.destroy_node, reason)
                raise reason from error
            runtime.discard(self.destroy_node, error)
            raise

    def declare_parameter(self, name: str, value: Any = None, *rest: Any, **options: Any) -> Any:
        """Note the default of a parameter that rclpy declares for itself."""
        if not options.get('ignore_override'):  # `RosParameters` declares values, not defaults
            self._usual.setdefault(name, value)
        return super().declare_parameter(name, value, *rest, **options)

    def get_logger(self) -> Any:
        """Return a logger that escapes unprintable characters in its messages."""
        return PrintableLogger(super().get_logger())

    def _open(self) -> None:
        """Connect the ports."""
        stream = self.stream
        self._endpoints = Endpoints(self, stream.settings.wait_for_subscriber)
        for output in stream.outputs:
            self._endpoints.output(
                get_message(output.type),
                f'~/{output.name}',
                latched() if output.latched else None,
                output.on_demand,
            )
        self.create_service(Trigger, '~/reset', self._reset)
        for action in stream.actions():
            self._serve(action)
        self.health = Health(self, stream, self._endpoints, self._ros)
        self._ros.watch(self._check, self._apply)
        stream.go_live()
        stream.wanted[:] = [each.wanted for each in self._endpoints.outputs]
        for port in range(len(stream.inputs)):
            self._listen(port)
        self._endpoints.refuse_circles()
        stream.topics = [each.topic_name for each in self._endpoints.inputs]
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(LOOK_AROUND, self._look_around, clock=steady)  # it subscribes, too
        self.get_logger().info(
            f'{stream.observer.name} estimates {stream.describe()} from '
            f'{" and ".join(dict.fromkeys(stream.topics))} '
            f'on {self._endpoints.outputs[0].topic_name} '
            f'({self._ros.changed()})'
        )

    # Messages

    def _listen(self, number: int) -> None:
        port, feed, outputs = self.stream.inputs[number], self.stream.feed, self._endpoints.outputs

        def came(raw: bytes, info: Mapping[str, Any]) -> None:
            begun = perf_counter()
            try:
                for answer in feed(number, raw, info['source_timestamp']):
                    for output, message in answer.items():
                        outputs[output].publish(message)
            except Exception as error:  # of a user's model, or of unexpected numbers
                if not self.context.ok():
                    raise
                self._failed(self.stream.topics[number], error)
                return
            if port.answered:
                self.health.took(perf_counter() - begun)

        kind = message_types.find(port.type) if port.field else get_message(port.type)
        self._endpoints.subscribe(kind, port.topic, came, optional=port.optional)

    def _failed(self, topic: str, error: Exception) -> None:
        """Reset after a failure of the observer, so that other joints keep their estimates."""
        self.stream.reset()
        self.health.failed(topic, where(error))
        self.get_logger().debug(''.join(format_exception(error)))

    def _look_around(self) -> None:
        """Check subscribers and joints, ten times a second by the steady clock."""
        self._endpoints.look()
        self.stream.wanted[:] = [each.wanted for each in self._endpoints.outputs]
        for notice in self.stream.notices():
            self.get_logger().warning(notice)
        self.health.look()

    # Parameters

    def _common(self, values: Values) -> Values:
        return {name: values[name] for name in self._per_joint}

    def _configuration(self, values: Values, overrides: Mapping[str, Values]) -> Any:
        stream = self.stream
        return stream.configure(stream.observer, stream.settings, self._common(values), overrides)

    def _check(self, values: Values, overrides: Mapping[str, Values]) -> None:
        with plainly(f"observer '{self.stream.observer.name}'"):
            self.stream.check(self._configuration(values, overrides))

    def _apply(self) -> None:
        self.stream.set_live(self._ros.values)
        try:
            with plainly(f"observer '{self.stream.observer.name}'"):
                self.stream.apply(self._configuration(self._ros.values, self._ros.overrides))
        except UserError as error:
            self.get_logger().error(f'parameters are set, but not every joint uses them: {error}')

    # Services

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, self.stream.reset()
        return response

    def _serve(self, action: Action) -> None:
        def serve(request: Any, response: Any) -> Any:
            reply = action.call(action.flag and request.data)
            response.success, response.message = reply.success, printable(reply.message)
            if reply.parameters:
                result = self.set_parameters_atomically(
                    [RosParameter(name, value=value) for name, value in reply.parameters.items()]
                )
                if not result.successful:
                    response.success, response.message = False, result.reason
            return response

        self.create_service(SetBool if action.flag else Trigger, f'~/{action.name}', serve)
