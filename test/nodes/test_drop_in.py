# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A velocity for a driver without one, by one remap: strangers before and after the node."""

import json
import math
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import dds
import pytest
import strangers

from estimator_pkg.messages.joint_state import Decoder, Encoder

MODULE = 'estimator_pkg.nodes.executables joint_observer'
STRANGERS = str(Path(strangers.__file__))
# name: reliability, durability, rate [Hz], velocity of the driver; errors [rad, rad/s]
DRIVERS = {
    'slow': ('reliable,transient_local,5,nan', (1e-3, 0.05)),
    'fastest': ('best_effort,volatile,1000,empty', (1e-3, 0.02)),
}
# its readings have no noise, and edge_adaptive is less accurate below 30 Hz then
OWN = {'slow': ('observer:=hybrid_angle',)}
CONSUMERS = {  # reliability, durability, depth
    'plugin of ros2_control, robot_state_publisher': 'best_effort,volatile,5',
    'MoveIt': 'reliable,volatile,25',
    'latching': 'reliable,transient_local,1',
}
LATCHED = 'qos_overrides./{0}/joint_states.publisher.durability:=transient_local'


class Consumers:
    """A process that listens to all topics with all QoS; `heard` has its messages by case."""

    def __init__(self, cases):
        self.heard = {case: [] for case in cases}
        self.ready = False
        self.child = start('consumers', *cases)
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.child.stdout:
            case, *message = json.loads(line)
            if message:
                self.heard[case].append(message)
            self.ready = True


def start(*words):
    return subprocess.Popen([sys.executable, STRANGERS, *words], stdout=subprocess.PIPE, text=True)


def end(child):
    child.send_signal(signal.SIGINT)
    try:
        child.wait(10.0)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def case_of(name, who):
    return f'/{name}/joint_states,{CONSUMERS[who]}'


def calm(messages, rate):
    """The messages that no pause of the driver, as a busy machine makes it, came shortly before."""
    before = paused = messages[0][0]
    found = []
    for message in messages:
        if message[0] - before > 1e9 * max(2.5 / rate, 0.15):
            paused = message[0]
        before = message[0]
        if before - paused > 1e9 * max(8.0 / rate, 0.3):
            found.append(message)
    return found


def all_calm(cases, rate):
    return all(messages and len(calm(messages[:], rate)) > 10 for messages in cases)


@pytest.fixture(scope='module')
def heard():
    """The messages that each consumer got, by case."""
    with ExitStack() as running:
        nodes = [
            running.enter_context(
                dds.NodeProcess(
                    MODULE,
                    # what a launch file of the robot says, in the robot's namespace
                    *dds.ros_args(
                        LATCHED.format(name),
                        *OWN.get(name, ()),
                        remap=(
                            'joint_states:=joint_states_raw',
                            '~/estimate:=joint_states',
                            f'__ns:=/{name}',
                        ),
                    ),
                )
            )
            for name in DRIVERS
        ]
        consumers = Consumers([case_of(name, who) for name in DRIVERS for who in CONSUMERS])
        running.callback(end, consumers.child)
        for name, node in zip(DRIVERS, nodes):
            node.prints(f'from /{name}/joint_states_raw on /{name}/joint_states')
        assert dds.until(lambda: consumers.ready)
        for name, (driver, _) in DRIVERS.items():
            rate = float(driver.split(',')[2])
            cases = [consumers.heard[case_of(name, who)] for who in CONSUMERS]
            enough = partial(all_calm, cases, rate)
            driving = start('driver', f'/{name}/joint_states_raw,{driver}')
            try:
                assert dds.until(enough, lambda: time.sleep(0.2))
            finally:
                end(driving)
        assert not any('Traceback' in node.output for node in nodes)
    return consumers.heard


@pytest.mark.parametrize(
    ('name', 'parameters', 'durability', 'old'),
    [
        ('kept', ('wait_for_subscriber:=60.0',), 'volatile', 100),
        ('dropped', ('wait_for_subscriber:=0.0',), 'volatile', 0),
        ('latched', (LATCHED.format('latched'),), 'transient_local', 1),
    ],
)
def test_what_a_late_subscriber_gets_of_the_messages_before(
    name, parameters, durability, old, probe
):
    """The first one all that waited for it; of a latched topic each gets the last one."""
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState

    encode, decode, node = Encoder().encode, Decoder().decode, probe.node
    driver = node.create_publisher(JointState, f'/{name}/joint_states_raw', 200)
    reliable = f'qos_overrides./{name}/joint_states_raw.subscription.reliability:=reliable'
    used = {}

    def diagnosed(message):
        (entry, *_) = message.status
        used[entry.name] = int(dds.value(entry, 'messages_used'))

    reports = node.create_subscription(DiagnosticArray, '/diagnostics', diagnosed, 50)
    remap = ('joint_states:=joint_states_raw', '~/estimate:=joint_states', f'__ns:=/{name}')
    qos = QoSProfile(depth=1000, durability=DurabilityPolicy[durability.upper()])

    def drive(first, count):
        for k in range(first, first + count):
            driver.publish(encode((k + 1) * 10_000_000, '', ['a'], [0.01 * k]))
            probe.spin(0.005)
        probe.until(lambda: used.get(f'/{name}/joint_observer') == first + count)

    def subscribe():
        got = []
        listener = node.create_subscription(
            JointState,
            f'/{name}/joint_states',
            lambda raw: got.append(decode(raw).stamp_ns // 10_000_000 - 1),
            qos,
            raw=True,
        )
        probe.until(listener.get_publisher_count)
        probe.spin(0.5)
        return got

    with dds.NodeProcess(MODULE, *dds.ros_args(reliable, *parameters, remap=remap)) as process:
        probe.until(driver.get_subscription_count)
        drive(0, 100)
        first = subscribe()
        assert first == list(range(100))[100 - old :], process.output
        drive(100, 20)
        probe.until(lambda: first[-1] == 119)
        assert first[old:] == list(range(100, 120))
        assert subscribe() == ([119] if durability == 'transient_local' else [])
    node.destroy_subscription(reports)


@pytest.mark.parametrize('who', CONSUMERS)
@pytest.mark.parametrize('name', DRIVERS)
def test_a_consumer_sees_a_complete_driver(name, who, heard):
    messages, (driver, bounds) = heard[case_of(name, who)], DRIVERS[name]
    stamps = [message[0] for message in messages]
    assert stamps == sorted(set(stamps))
    for stamp, frame_id, names, positions, velocities, efforts in messages:
        # by position: the order is that of the driver, and every array is complete
        assert names == strangers.NAMES and frame_id == 'base_link'
        assert len(positions) == len(velocities) == len(efforts) == len(names)
        assert efforts == strangers.efforts(efforts[0])  # the driver's own, of one message
        for one, velocity, truth in zip(positions, velocities, strangers.motion(stamp)[0]):
            assert math.isfinite(velocity) or one == truth  # as measured
    tracked = calm(messages, float(driver.split(',')[2]))
    assert len(tracked) > 10
    for stamp, _, names, positions, velocities, _ in tracked:
        state = {name: pair for name, *pair in zip(names, positions, velocities)}  # by name
        for joint, *true in zip(strangers.NAMES, *strangers.motion(stamp)):
            assert state[joint][0] == pytest.approx(true[0], abs=bounds[0])
            assert state[joint][1] == pytest.approx(true[1], abs=bounds[1])
