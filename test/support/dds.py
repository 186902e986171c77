# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Helpers for tests over real DDS: a probe in the test's process, nodes in processes of their own.

Everything runs on this machine alone, in a ROS domain of this test run.
"""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

import nursery

from estimator_pkg.ros import runtime
from estimator_pkg.ros.domain import free_domain

DOMAIN = free_domain()
os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
PATIENCE = 60.0  # [s] a condition may take; a start that compiles takes 20 on a busy machine


def ros_args(*parameters: str, remap: Sequence[str] = (), file: Any = None) -> list[str]:
    """The command line of a node: remappings and parameters as FROM:=TO, a file of parameters."""
    words = ['--ros-args', *(('--params-file', str(file)) if file is not None else ())]
    for flag, pairs in (('-r', remap), ('-p', parameters)):
        words += [word for pair in pairs for word in (flag, pair)]
    return words


def latched() -> Any:
    """The QoS of ~/status."""
    from rclpy.qos import DurabilityPolicy, QoSProfile

    return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class NodeProcess:
    """A node in a process of its own; use it as a context, so that it always ends.

    Parameters
    ----------
    module : run as ``python -m``; a first argument may follow it.
    arguments : its command line.
    """

    def __init__(self, module: str, *arguments: str) -> None:
        self._child = nursery.start(*module.split(), *arguments)
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            self._lines.append(line.rstrip('\n'))

    @property
    def output(self) -> str:
        """What it has printed so far, log included."""
        return '\n'.join(self._lines)

    def prints(self, text: str, times: int = 1) -> None:
        """Wait until its output contains `text`, at least `times` times."""
        until(lambda: self.output.count(text) >= times or self._child.poll() is not None)
        self._reader.join(1.0 if self._child.poll() is not None else 0.0)
        assert self.output.count(text) >= times, f'{text!r} is not in: {self.output}'

    @property
    def pid(self) -> int:
        return self._child.pid

    @property
    def alive(self) -> bool:
        return self._child.poll() is None

    def signal(self, number: int) -> None:
        self._child.send_signal(number)

    def ends(self) -> int:
        """Wait until it has ended; its exit code."""
        code = self._child.wait(PATIENCE)
        self._reader.join(5.0)
        return code

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(self, *error: Any) -> None:
        if self.alive:
            self.signal(signal.SIGINT)
            try:
                self._child.wait(5.0)
            except subprocess.TimeoutExpired:
                self._child.kill()
        self._child.wait()
        self._reader.join(5.0)


def until(condition: Callable[[], Any], spin: Callable[[], None] | None = None) -> bool:
    """Wait for `condition`; False if it did not come true."""
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            return False
        if spin is None:
            time.sleep(0.01)
        else:
            spin()
    return True


class Probe:
    """A node in this process that publishes, listens and calls; its executor runs while it waits.

    One exists per test module that wants it (the fixture `probe`).
    """

    def __init__(self) -> None:
        import rclpy

        rclpy.init(domain_id=DOMAIN)
        self.node = rclpy.create_node('probe')
        self.executor = runtime.make_executor()
        self.executor.add_node(self.node)
        self._clients: dict[str, tuple[Any, Any]] = {}  # and the node that knows each

    def close(self) -> None:
        import rclpy

        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def until(
        self, condition: Callable[[], Any], what: Callable[[], Any] = lambda: 'never came'
    ) -> None:
        """Run the executor until `condition` holds; fails with `what` if it never does."""
        assert until(condition, lambda: self.executor.spin_once(timeout_sec=0.01)), what()

    def spin(self, seconds: float) -> None:
        """Run the executor for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.01)

    def call(self, kind: type, name: str, request: Any) -> Any:
        """The answer of a service.

        A client is kept, and in the executor before it is used: an answer that comes while
        EventsExecutor takes a client in may go unnoticed.
        """
        status = f'{name.rpartition("/")[0]}/status'
        client, knows = self._clients.get(name, (None, None))
        if client is None or knows != self._publishers(status):
            client = client or self.node.create_client(kind, name)
            self.until(client.service_is_ready, lambda: f'{name} is not served')
            self._introduce(status)
            self._clients[name] = client, self._publishers(status)
        future = client.call_async(request)
        self.until(future.done, lambda: f'no answer of {name}')
        return future.result()

    def _introduce(self, status: str) -> None:
        """Wait until a node knows the clients that were made up to now.

        rmw_fastrtps drops the answer to a client that the service has not discovered, although the
        client has discovered the service ("client will not receive response"): 1 of 60 first calls
        on a busy machine. What one process makes is discovered in its order, so a node that sends
        its latched status to a new subscription knows the clients, too.
        """
        from diagnostic_msgs.msg import DiagnosticArray

        heard: list[Any] = []
        if self._publishers(status):
            new = self.node.create_subscription(DiagnosticArray, status, heard.append, latched())
            self.until(lambda: heard, lambda: f'no {status}')
            self.node.destroy_subscription(new)
        self.spin(0.1)

    def _publishers(self, topic: str) -> list[bytes]:
        found = self.node.get_publishers_info_by_topic(topic)
        return sorted(bytes(each.endpoint_gid) for each in found)


class Observer:
    """A running joint_observer as a test sees it: feed it, collect what it says.

    Parameters
    ----------
    name : fully qualified, as '/joint_observer'.
    topic : where its JointStates come from.
    reliable : what its publisher offers.
    sim_time : the node's clock is a simulated one.

    Attributes
    ----------
    process : the node's, where whoever started it has put it here.
    """

    process: NodeProcess

    def __init__(
        self,
        probe: Probe,
        name: str = '/joint_observer',
        topic: str = '/joint_states',
        *,
        reliable: bool = True,
        sim_time: bool = False,
    ) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState

        from estimator_pkg.messages.joint_state import Decoder, Encoder

        self.probe, self.name, self._sim_time = probe, name, sim_time
        self.answers: list[Any] = []  # decoded JointStates of ~/estimate
        self.raw_answers: list[bytes] = []  # and as they came
        self.statuses: dict[str, Any] = {}  # newest ~/status, by joint
        self.diagnostics: dict[str, Any] = {}  # newest /diagnostics of this node, by entry
        self.reports = 0
        self.stamp_of_diagnostics = 0  # [ns]
        self._encode, self._decode = Encoder().encode, Decoder().decode
        reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        node = probe.node
        self.publisher = node.create_publisher(
            JointState, topic, QoSProfile(depth=50, reliability=reliability)
        )
        self._subscriptions = [
            node.create_subscription(JointState, f'{name}/estimate', self._answer, 1000, raw=True),
            node.create_subscription(DiagnosticArray, f'{name}/status', self._status, latched()),
            node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 50),
        ]

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *error: Any) -> None:
        for subscription in self._subscriptions:
            self.probe.node.destroy_subscription(subscription)
        self.probe.node.destroy_publisher(self.publisher)

    def connect(self) -> Observer:
        """Wait until the node is there and connected."""
        self.probe.until(
            lambda: (
                self.publisher.get_subscription_count()
                and all(map(self._connected, self._subscriptions))
            )
        )
        self.probe.spin(0.3)  # the node's side of the connections
        return self

    @staticmethod
    def _connected(subscription: Any) -> bool:
        return subscription.get_publisher_count() > 0

    def _answer(self, raw: bytes) -> None:
        self.raw_answers.append(raw)
        self.answers.append(self._decode(raw))

    def _status(self, message: Any) -> None:
        self.statuses = {status.name: status for status in message.status}

    def _diagnosed(self, message: Any) -> None:
        own = {
            status.name: status
            for status in message.status
            if status.name == self.name or status.name.startswith(f'{self.name}: ')
        }
        if own:
            self.reports += 1
            self.stamp_of_diagnostics = (
                message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            )
            self.diagnostics.update(own)

    def encode(
        self,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float],
        frame_id: str = 'base',
    ) -> bytes:
        return self._encode(stamp_ns, frame_id, names, positions)

    def feed(self, messages: Iterable[bytes], unanswered: Collection[int] = ()) -> list[Any]:
        """Publish messages, never more than 20 ahead of the node; its answers to them.

        Parameters
        ----------
        unanswered : which of them are not answered, because no sample of them is used.
        """
        start = len(self.answers)
        due = start
        for number, raw in enumerate(messages):
            self.publisher.publish(raw)
            if number in unanswered:
                self.probe.spin(0.002)  # nothing tells that it was taken
                continue
            due += 1
            self.probe.executor.spin_once(timeout_sec=0.0)
            self._answered(due - 20)
        self._answered(due)
        return self.answers[start:]

    def _answered(self, count: int) -> None:
        self.probe.until(
            lambda: len(self.answers) >= count,
            lambda: f'{len(self.answers)} of {count} answers came; {self.next_report()[self.name]}',
        )

    def next_report(self) -> dict[str, dict[str, str]]:
        """The values of the next /diagnostics that counts all up to now, by entry."""
        reports, now = self.reports, time.time_ns()
        self.probe.until(
            lambda: self.reports > reports and (self._sim_time or self.stamp_of_diagnostics >= now)
        )
        return {
            name: {item.key: item.value for item in status.values}
            for name, status in self.diagnostics.items()
        }

    def status(self, joint: str) -> str:
        """The newest status of a joint, '' while there is none."""
        entry = self.statuses.get(joint)
        return '' if entry is None else value(entry, 'status')

    def set(self, **values: Any) -> Any:
        """Set parameters together ('__' stands for '.'); the node's result."""
        from rcl_interfaces.srv import SetParametersAtomically
        from rclpy.parameter import Parameter

        request = SetParametersAtomically.Request()
        request.parameters = [
            Parameter(key.replace('__', '.'), value=given).to_parameter_msg()
            for key, given in values.items()
        ]
        return self.probe.call(
            SetParametersAtomically, f'{self.name}/set_parameters_atomically', request
        ).result

    def get(self, name: str) -> Any:
        """The value of a parameter."""
        from rcl_interfaces.srv import GetParameters
        from rclpy.parameter import parameter_value_to_python

        request = GetParameters.Request(names=[name])
        answer = self.probe.call(GetParameters, f'{self.name}/get_parameters', request)
        return parameter_value_to_python(answer.values[0])


def value(entry: Any, key: str) -> str:
    """The value of a key in a DiagnosticStatus."""
    return {item.key: item.value for item in entry.values}[key]
