# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Any simulator as a live ROS 2 node: it publishes each message of the stream when it is due."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import math
import sys
import threading
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from estimator_pkg.errors import UserError
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.nodes.ros_parameters import RosParameters
from estimator_pkg.printable import PrintableLogger
from estimator_pkg.ros import runtime
from sim_pkg.contract import FOREVER, Message, RunSettings, Simulator, Topic
from sim_pkg.nodes.deadline import Deadlines

SENSOR_DATA = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=50, reliability=ReliabilityPolicy.BEST_EFFORT
)
LINGER = 0.2  # time for the last messages to leave before the process ends [s]
LOOK = 0.01  # time between two checks for subscribers [s]
PATIENCE = 5.0  # wait after which the log names the missing subscribers [s]
BEHIND = 0.5  # lateness that means that the machine is too slow [s]


def message_type(name: str) -> Any:
    """Return the message class of a type name such as 'sensor_msgs/msg/JointState'."""
    package, _, message = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), message)


class SimulatorNode(Node):
    """Publishes a simulator's stream from its construction on, in its own thread.

    Every parameter is fixed at start, because the values must follow from seed and parameters
    alone. Stamps are the system time at the start plus the simulated time; `use_sim_time` has no
    effect.

    Parameters
    ----------
    simulator : the simulator to run.
    name : name of the node.
    on_end : called from the thread when the stream ends, after `duration` or with an error.

    Attributes
    ----------
    error : the exception that ended the simulation early; None: no error.
    """

    def __init__(
        self,
        simulator: Simulator,
        name: str,
        *,
        on_end: Callable[[], None] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(name, **options)
        self.deadlines = Deadlines()
        self.error: Exception | None = None
        self._behind = False
        self._on_end = on_end
        self._thread = threading.Thread(target=self._play, name='deadlines', daemon=True)
        try:
            self._set_up(simulator)
        except BaseException as error:
            runtime.discard(super().destroy_node, error)
            raise
        self._thread.start()

    def get_logger(self) -> Any:
        """Return a logger that escapes unprintable characters in its messages."""
        return PrintableLogger(super().get_logger())

    def _set_up(self, simulator: Simulator) -> None:
        ros_parameters = RosParameters(self)
        settings = ros_parameters.declare(RunSettings)
        parameters: Any = ros_parameters.declare(simulator.parameters)
        topics = simulator.topics(parameters)
        self._senders = {topic.name: self._publisher(topic) for topic in topics}
        self._awaited = [
            (
                self._senders[topic.name],
                settings.wait_for_truth_subscribers
                if topic.truth
                else settings.wait_for_subscribers,
            )
            for topic in topics
        ]
        duration = math.inf if settings.duration == FOREVER else settings.duration
        self._topics = topics
        self._rate = getattr(parameters, 'rate', getattr(parameters, 'sample_rate', 0.0))
        self._chunks = simulator.generate(parameters, duration, settings.seed)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for wrong, hint in ros_parameters.unknown().items():
            self.get_logger().warning(f"unknown parameter '{wrong}': {hint}")
        if self.get_parameter('use_sim_time').value:
            self.get_logger().warning(
                'use_sim_time has no effect: this node stamps with the system time and '
                'simulates at its pace; unset it'
            )

    def _publisher(self, topic: Topic) -> Publisher:
        return self.create_publisher(
            message_type(topic.type),
            topic.name,
            SENSOR_DATA,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def _play(self) -> None:
        ended = True
        try:
            ended = self._played()
        except rclpy_implementation.RCLError:
            ended = False
            if self.context.ok():  # else an interrupt shut the context down during a call
                raise
        except Exception as error:
            self.error = error
            if not isinstance(error, UserError):
                raise
            self.get_logger().error(str(error))
        finally:
            if ended and self._on_end is not None:
                self._on_end()

    def _played(self) -> bool:
        """Publish the whole stream; return False if the node was stopped early."""
        if not self._wait_for_subscribers():
            return False
        first = next(self._chunks, [])  # before the clock starts: the first chunk takes longest
        self._report_topics(first)
        start_ns = self.deadlines.start()
        for chunk in itertools.chain([first], self._chunks):
            for message in chunk:
                raw = message.encode(start_ns)
                if not self.deadlines.wait(message.due_ns) or not self.context.ok():
                    return False
                self._senders[message.topic].publish(raw)
        for sender in self._senders.values():
            sender.wait_for_all_acked(Duration(seconds=1))
        return self.deadlines.pause(LINGER)

    def _report_topics(self, chunk: list[Message]) -> None:
        """Log what this node publishes."""
        said = []
        for topic in self._topics:
            raw = next((each.encode(0) for each in chunk if each.topic == topic.name), None)
            names = Decoder().decode(raw).names if raw and topic.type == JOINT_STATE else ()
            joints = f': {", ".join(names)}' if names else ''
            truth = ' (ground truth)' if topic.truth else ''
            said.append(f'{self._senders[topic.name].topic_name}{truth}, {topic.type}{joints}')
        rate = f'{self._rate:g} samples per second on ' if self._rate else ''
        self.get_logger().info(f'publishes {rate}{"; ".join(said)}')

    def _wait_for_subscribers(self) -> bool:
        """Wait for the requested numbers of subscribers; return False if stopped meanwhile."""
        for look in itertools.count():
            missing = [
                f'{sender.topic_name} has {count} of {required}'
                for sender, required in self._awaited
                if (count := sender.get_subscription_count()) < required
            ]
            if not missing:
                break
            if look == round(PATIENCE / LOOK):
                self.get_logger().info(f'waiting for subscribers: {", ".join(missing)}')
            if not self.deadlines.pause(LOOK):
                return False
        return True

    def _report(self) -> None:
        """Publish the lateness on /diagnostics; warn once when the node falls behind."""
        deadlines = self.deadlines
        behind = deadlines.lateness > BEHIND
        if behind and not self._behind:
            self.get_logger().warning(
                f'messages leave {deadlines.lateness:.1f} s late: this machine cannot keep up; '
                'lower the rate of the simulator or stop other processes'
            )
        self._behind = behind
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if behind else DiagnosticStatus.OK,
            name=f'{self.get_fully_qualified_name()}: deadlines',
            message=deadlines.summary(),
            hardware_id=self.get_fully_qualified_name(),
            values=[
                KeyValue(key=key, value=value)
                for key, value in (
                    ('messages', str(deadlines.met)),
                    ('late', str(deadlines.late)),
                    ('lateness [s]', f'{deadlines.lateness:.6f}'),
                    ('mean lateness [s]', f'{deadlines.mean_lateness:.6f}'),
                    ('worst lateness [s]', f'{deadlines.worst_lateness:.6f}'),
                )
            ],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def destroy_node(self) -> None:
        """Stop the thread, log a summary of the lateness, destroy the node."""
        self.deadlines.stop()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()
        name, logged = self.get_name(), self.context.ok()
        if logged:
            self.get_logger().info(self.deadlines.summary())
        super().destroy_node()
        if (
            not logged
        ):  # after an interrupt a logger could not reach /rosout and would print an error
            with contextlib.suppress(OSError):  # nobody reads it
                print(f'{name}: {self.deadlines.summary()}', file=sys.stderr, flush=True)
