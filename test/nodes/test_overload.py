# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""More than a node can do: too many messages, too many names, messages before the connection."""

from __future__ import annotations

import os
import threading
import time
from itertools import pairwise
from pathlib import Path

import dds
import pytest
from own_node import OwnNode
from stream_roles import Role

from estimator_pkg.nodes import health
from estimator_pkg.streams.adaptive import AdaptiveStream
from estimator_pkg.streams.angle import AngleStream

BEGIN = 1_700_000_000_000_000_000  # [ns]
MS = 1_000_000


# ---------------------------------------------------------------- messages faster than callbacks

CONFIG = Path(__file__).resolve().parents[2] / 'config'
LOUD = 8000.0  # [Hz]
FLOODS = {  # node: what floods it, its rate [Hz] and joints, and the node's parameters
    'adaptive_observer': ('joints', LOUD, 60),
    'pmsm_observer': ('vectors', LOUD, 0, 'input:=current_voltage'),
    'cart_pendulum_sim': ('estimates', LOUD, 60),
}
ANSWERED = 0.5  # [s] of the node's CPU time, which does not depend on what else the machine does


class Watched:
    """The process of a node: its CPU time, its memory, and what its /diagnostics say."""

    def __init__(self, probe, name, process):
        from diagnostic_msgs.msg import DiagnosticArray

        self._pid, self._name = process.pid, f'/{name}'
        self.reported: list[float] = []  # CPU time at each report [s]
        self.values: dict[str, str] = {}
        probe.node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)

    def _diagnosed(self, message):
        for status in message.status:
            if status.name.partition(':')[0] == self._name:
                self.reported.append(self.cpu())
                self.values.update({item.key: item.value for item in status.values})

    def cpu(self):
        """CPU time since its start [s]."""
        text = Path(f'/proc/{self._pid}/stat').read_text()
        user, system = text.rpartition(')')[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf('SC_CLK_TCK')

    def memory(self):
        """Memory in use [MB]."""
        text = Path(f'/proc/{self._pid}/statm').read_text()
        return int(text.split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6

    def counted(self):
        """Messages received and lost, by the node's own account."""
        return int(self.values['messages_received']) + int(self.values['lost_by_dds'])


def requests(name):
    """(class, name, request) of services that must answer."""
    from rcl_interfaces.msg import Parameter, ParameterValue
    from rcl_interfaces.srv import GetParameters, SetParametersAtomically
    from std_srvs.srv import Trigger

    yield GetParameters, f'/{name}/get_parameters', GetParameters.Request(names=['use_sim_time'])
    if not name.endswith('_sim'):
        yield Trigger, f'/{name}/reset', Trigger.Request()
        value = ParameterValue(type=3, double_value=0.3)
        yield (
            SetParametersAtomically,
            f'/{name}/set_parameters_atomically',
            SetParametersAtomically.Request(parameters=[Parameter(name='gap_max', value=value)]),
        )


@pytest.mark.parametrize(
    'case',
    [
        each if each == 'adaptive_observer' else pytest.param(each, marks=pytest.mark.slow)
        for each in FLOODS
    ],
)
def test_a_flood_starves_neither_services_nor_reports_and_is_counted(probe, case):
    """The node gets more than it can handle: it still answers, and says what it lost."""
    name, (kind, rate, joints, *parameters) = case, FLOODS[case]
    package = 'sim_pkg' if name.endswith('_sim') else 'estimator_pkg'
    file = CONFIG / 'pmsm_observer.yaml' if name == 'pmsm_observer' else None
    with (
        dds.NodeProcess(
            f'{package}.nodes.executables {name}', *dds.ros_args(*parameters, file=file)
        ) as process,
        Role('flood', kind, str(rate), str(joints)) as source,
    ):
        node = Watched(probe, name, process)
        probe.until(lambda: len(node.reported) > 3)
        before, first = node.memory(), len(node.reported)
        longest = 0.0, ''
        for _ in range(5):
            for request in requests(name):
                begun = node.cpu()
                probe.call(*request)
                longest = max(longest, (node.cpu() - begun, request[1]))
        probe.until(lambda: len(node.reported) > first + 3)
        between = max(b - a for a, b in pairwise(node.reported[first:]))
        grown = node.memory() - before
        source.go_on()
        if 'lost_by_dds' in node.values:
            probe.until(lambda: source.said)
            published = source.said[0]['published']
            probe.until(lambda: node.counted() >= published)
            now = len(node.reported)
            probe.until(lambda: len(node.reported) > now)
            assert node.counted() == published, node.values
            if joints:  # a drive's node keeps up where the machine is too busy for the flood
                assert int(node.values['lost_by_dds']) > 0.1 * published
        assert longest[0] < ANSWERED, f'{longest} s'
        assert between < 1.0 + ANSWERED, f'{case}: reports are {between} s apart'
        assert grown < 5.0, f'{case}: its memory grew by {grown} MB'


def test_a_stream_that_is_too_fast_starves_no_service(probe):
    """A callback of 2 ms and a message every 0.3 ms: the queue of events must not grow."""
    import rclpy
    from rclpy.context import Context
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from std_msgs.msg import Float64
    from std_srvs.srv import Trigger

    from estimator_pkg.ros.executor import SteadyExecutor

    context = Context()
    rclpy.init(context=context, domain_id=dds.DOMAIN)
    busy = rclpy.create_node('busy', context=context)
    taken: list[bytes] = []

    def slow(raw):
        taken.append(raw)
        time.sleep(2e-3)

    def answer(request, response):
        response.message = str(len(taken))
        return response

    busy.create_subscription(
        Float64,
        'flood',
        slow,
        QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT),
        raw=True,
    )
    busy.create_service(Trigger, 'busy', answer)
    executor = SteadyExecutor(context=context)
    executor.add_node(busy)
    ended = threading.Event()

    def spin():
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.05)

    def flood():
        while flowing.is_set():
            publisher.publish(bytes(12))
            time.sleep(2e-4)

    publisher = probe.node.create_publisher(Float64, 'flood', 50)
    flowing = threading.Event()
    flowing.set()
    threads = [threading.Thread(target=spin), threading.Thread(target=flood)]
    try:
        threads[0].start()
        probe.until(publisher.get_subscription_count)
        threads[1].start()
        assert dds.until(lambda: executor.in_turns)
        for _ in range(5):
            before = len(taken)
            handled = int(probe.call(Trigger, 'busy', Trigger.Request()).message)
            assert handled - before < 250  # events queued in the meantime would be thousands
        flowing.clear()
        time.sleep(0.5)  # the queue runs empty
        count = len(taken)
        publisher.publish(bytes(12))
        assert dds.until(lambda: len(taken) == count + 1)
        assert probe.call(Trigger, 'busy', Trigger.Request()).message == str(count + 1)
    finally:
        flowing.clear()
        ended.set()
        for thread in threads:
            thread.join()
        executor.shutdown()
        busy.destroy_node()
        rclpy.shutdown(context=context)
        probe.node.destroy_publisher(publisher)


# ---------------------------------------------------------------- names without end


@pytest.fixture
def still(probe, monkeypatch):
    """(kind, parameters) -> a node in this process."""
    made = []

    def start(kind, **values):
        made.append(OwnNode(monkeypatch, kind, **values))
        return made[-1]

    yield start
    for each in made:
        each.close()


def feed(live, names, k):
    args = (BEGIN + k * MS, tuple(names), (0.01 * k,) * len(names))
    bank = live.node.stream.bank
    if isinstance(live.node.stream, AdaptiveStream):
        bank.take(*args, (0.1,) * len(names))
    else:
        bank.update(*args)


def test_a_look_judges_joints_that_are_alive_and_makes_the_entries_of_a_tenth(still, monkeypatch):
    live = still(AngleStream, timeout=0.02, gap_max=0.02)
    watch, names, judged, made = live.node.health.watch, [f'j{k}' for k in range(40)], [], []

    def noting(kept, function):
        return lambda name, *rest: kept.append(name) or function(name, *rest)

    monkeypatch.setattr(watch, 'judge', noting(judged, watch.judge))
    monkeypatch.setattr(health, 'entry', noting(made, health.entry))

    def look(seconds=0.01):
        live.now += seconds
        judged.clear()
        live.node.health.look()
        return set(judged)

    for k in range(2):
        feed(live, names, k)
    look()
    live.node.health._last_report += 1e6  # no report is due
    look(0.03)  # all are lost
    feed(live, ['j7', 'j9'], 2)
    assert look() == {'j7', 'j9'}
    assert look(0.03) == {'j7', 'j9'}  # they get lost
    assert look() == set()
    made.clear()
    look()
    assert len(made) == len(names) // 10


@pytest.mark.parametrize('kind', [AngleStream, AdaptiveStream])
def test_joints_expire_unless_they_are_named(still, kind, capfd):
    live = still(kind, joints_max=2, expiry=0.02, **{'per_joint.kept.wrap_period': 0.0})
    for k in range(3):
        feed(live, ['kept', 'old', f'new_{k}'], k)
    live.node.health.look()
    before = live.node.health._totals()
    assert before['received'] == 9 and before['dropped.refused'] == 2
    assert before['received'] == before['used'] + sum(
        count for key, count in before.items() if key.startswith('dropped.')
    )
    live.now += 1.1
    live.node.health.look()
    assert set(live.node.stream.bank.joints) == {'kept'}
    after = live.node.health._totals()
    assert after['joints_expired'] == 2 and after['received'] == 9
    assert after['used'] == before['used']
    said = capfd.readouterr().err
    assert 'removed: no sample for 0.02 s (expiry)' in said and "'joints_max'" in said
    feed(live, ['old'], 9)
    assert live.node.stream.bank.joints['old'].used == 1


def test_an_event_of_a_destroyed_subscription_is_dropped(probe):
    """DDS queues that a publisher left, and its subscription is destroyed before the event runs."""
    import rclpy
    from rclpy.event_handler import SubscriptionEventCallbacks
    from sensor_msgs.msg import JointState

    from estimator_pkg.ros.runtime import make_executor

    executor, node = make_executor(), rclpy.create_node('leaving')
    executor.add_node(node)

    def spin(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.01)

    try:
        for _ in range(3):
            matched = []
            subscription = node.create_subscription(
                JointState,
                'leaving',
                lambda message: None,
                10,
                event_callbacks=SubscriptionEventCallbacks(matched=matched.append),
            )
            publisher = probe.node.create_publisher(JointState, 'leaving', 10)
            assert dds.until(lambda matched=matched: matched, lambda: spin(0.01))
            probe.node.destroy_publisher(publisher)
            time.sleep(0.3)  # the event waits
            node.destroy_subscription(subscription)
            spin(0.2)
    finally:
        executor.shutdown()
        node.destroy_node()
