# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node encoder_sim over real DDS: the same run as `simulate`, in real time, ending cleanly."""

import contextlib
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg.ros.runtime import make_executor  # first: it settles what rclpy reads

# isort: split
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.nodes.ros_parameters import ros_values
from estimator_pkg.parameters import build
from estimator_pkg.ros.domain import free_domain
from sim_pkg.joints.encoder import SIMULATOR, EncoderParameters
from sim_pkg.nodes import simulator_node
from sim_pkg.nodes.deadline import Deadlines
from sim_pkg.nodes.simulator_node import SimulatorNode

pytestmark = pytest.mark.dds
CONFIG = Path(__file__).parents[3] / 'config/encoder_sim.yaml'
PATIENCE = 30.0  # for what takes far less [s]
RELIABLE = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=5000, reliability=ReliabilityPolicy.RELIABLE
)
BEST_EFFORT = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT
)
FAULTS = {
    'profile': 'random',
    'noise': 0.002,
    'dropped': 0.02,
    'repeated': 0.02,
    'duplicated': 0.02,
    'outliers': 0.01,
    'gap_every': 0.4,
    'gap_length': 0.02,
    'burst_every': 0.2,
    'burst_length': 0.08,
    'sampling_jitter': 0.0004,
    'stamp_jitter': 0.0002,
}


class Listener:
    """A node that keeps messages: topic -> [(raw message, when it came [ns])]."""

    def __init__(self):
        self.node = rclpy.create_node('listener')
        self.executor = make_executor()
        self.executor.add_node(self.node)
        self.heard = {}

    def subscribe(self, kind, topic, qos, raw=True):
        kept = self.heard[topic] = []
        self.node.create_subscription(
            kind, topic, lambda message: kept.append((message, time.time_ns())), qos, raw=raw
        )

    def spin(self, until):
        """Listen until the condition holds; False if it never did."""
        end = time.monotonic() + PATIENCE
        while not until():
            if time.monotonic() > end:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def drain(self):
        """Listen until nothing more comes."""
        before = -1
        while before != (before := sum(map(len, self.heard.values()))):
            for _ in range(200):
                self.executor.spin_once(timeout_sec=0.001)


@pytest.fixture(scope='module')
def graph():
    """ROS in this process, in a domain of its own."""
    with pytest.MonkeyPatch.context() as patch:
        domain = free_domain()
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        rclpy.init(domain_id=domain)
        yield
        rclpy.try_shutdown()


@pytest.fixture
def listener(graph):
    listener = Listener()
    yield listener
    listener.executor.shutdown()
    listener.node.destroy_node()


@contextlib.contextmanager
def encoder_sim(*arguments, **parameters):
    """The node as a process; it is ended in any case."""
    words = [
        word for name, value in parameters.items() for word in ('-p', f'{name}:={_yaml(value)}')
    ]
    process = subprocess.Popen(
        [
            sys.executable,
            *shlex.split('-m sim_pkg.nodes.executables encoder_sim --ros-args'),
            *arguments,
            *words,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def _yaml(value):
    if isinstance(value, bool):
        return str(value).lower()
    return '[' + ', '.join(value) + ']' if isinstance(value, list) else value


def reliable(*topics):
    return [
        word
        for topic in topics
        for policy in ('reliability:=reliable', 'depth:=5000')
        for word in ('-p', f'qos_overrides.{topic}.publisher.{policy}')
    ]


def ended(process):
    """(exit code, what it said) of a process that ends by itself."""
    output, error = process.communicate(timeout=PATIENCE)
    return process.returncode, output + error


def simulated(duration, seed, **values):
    """What `simulate` writes: topic -> raw messages of a run that starts at 0."""
    messages = {}
    for chunk in SIMULATOR.generate(build(EncoderParameters, values), duration, seed):
        for message in chunk:
            messages.setdefault(message.topic, []).append(message.encode(0))
    return messages


def decoded(raws):
    decoder = Decoder()
    return [decoder.decode(raw) for raw in raws]


def test_live_run_equals_the_simulated_one(listener):
    """All faults on: the same values and relative stamps, in the same order, none lost."""
    truth_topic = 'ground_truth/joint_states'
    listener.subscribe(JointState, 'joint_states', RELIABLE)
    listener.subscribe(JointState, truth_topic, RELIABLE)
    listener.subscribe(DiagnosticArray, '/diagnostics', 10, raw=False)
    values = {**FAULTS, 'joints': ['left', 'right']}
    with encoder_sim(
        *reliable('/joint_states', '/' + truth_topic),
        '--params-file',
        str(CONFIG),
        seed=5,
        duration=2.0,
        wait_for_subscribers=1,
        wait_for_truth_subscribers=1,
        **values,
    ) as process:
        assert listener.spin(lambda: process.poll() is not None)
        listener.drain()
        code, said = ended(process)
    assert code == 0, said
    expected = simulated(2.0, 5, **values)
    wanted = decoded(expected['joint_states'])
    raws, came_ns = zip(*listener.heard['joint_states'])
    got = decoded(raws)
    start_ns = got[0].stamp_ns - wanted[0].stamp_ns
    assert [(m.stamp_ns - start_ns, *m[1:]) for m in got] == [tuple(m) for m in wanted]
    truth = decoded([raw for raw, _ in listener.heard[truth_topic]])
    assert [(m.stamp_ns - start_ns, *m[1:]) for m in truth] == [
        tuple(m) for m in decoded(expected[truth_topic])
    ]
    # In real time: nothing leaves before it is due, and the mean rate is that of the stamps.
    stamps = np.array([m.stamp_ns for m in wanted])
    came = np.array(came_ns) - start_ns
    assert (came - stamps).min() > -200_000 - 1_000_000  # stamp jitter, and two clocks read apart
    assert np.polyfit(stamps, came, 1)[0] == pytest.approx(1.0, abs=0.1)
    reports = [status for message, _ in listener.heard['/diagnostics'] for status in message.status]
    assert [status.name for status in reports][:1] == ['/encoder_sim: deadlines']
    reported = {pair.key: pair.value for pair in reports[-1].values}
    assert 0 < int(reported['messages']) <= len(wanted) + 2000
    assert f'{len(wanted) + 2000} messages, ' in said


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupt_ends_it_cleanly(listener, number):
    listener.subscribe(JointState, 'joint_states', BEST_EFFORT)
    with encoder_sim() as process:
        assert listener.spin(lambda: len(listener.heard['joint_states']) > 50)
        offered = listener.node.get_publishers_info_by_topic('joint_states')
        process.send_signal(number)
        code, said = ended(process)
    assert code == 0
    assert 'Traceback' not in said
    assert (
        'publishes 1000 samples per second on /joint_states, sensor_msgs/msg/JointState: w' in said
    )
    assert len(said.splitlines()) == 2  # and says how well it kept time
    assert 'more than 1 ms late' in said
    assert [end.qos_profile.reliability for end in offered] == [ReliabilityPolicy.BEST_EFFORT]


@pytest.mark.parametrize('parameters', [{'wait_for_subscribers': 1}, {'rate': 0.01}])
def test_interrupt_while_it_waits(listener, parameters):
    listener.subscribe(DiagnosticArray, '/diagnostics', 10, raw=False)
    with encoder_sim('-r', 'joint_states:=nobody_listens', **parameters) as process:
        assert listener.spin(lambda: listener.heard['/diagnostics'])
        process.send_signal(signal.SIGINT)
        code, said = ended(process)
    assert code == 0
    assert 'Traceback' not in said


def test_it_waits_for_who_listens_to_the_truth_too_and_says_so(listener, capfd, monkeypatch):
    """A recorder whose subscription to the truth comes late has the truth of every measurement."""
    monkeypatch.setattr(simulator_node, 'PATIENCE', 0.1)
    listener.subscribe(JointState, 'joint_states', BEST_EFFORT)
    node = SimulatorNode(
        SIMULATOR,
        'patient',
        parameter_overrides=ros_values(
            {'rate': 100.0, 'wait_for_subscribers': 1, 'wait_for_truth_subscribers': 1}
        ),
    )
    listener.executor.add_node(node)
    try:
        said = []
        assert listener.spin(
            lambda: (
                said.append(capfd.readouterr().err)
                or (
                    'waiting for subscribers: /ground_truth/joint_states has 0 of 1\n'
                    in ''.join(said)
                )
            )
        )
        for _ in range(20):
            listener.executor.spin_once(timeout_sec=0.01)
        assert node.deadlines.met == 0 and not listener.heard['joint_states']
        listener.subscribe(JointState, 'ground_truth/joint_states', BEST_EFFORT)
        assert listener.spin(lambda: all(len(rows) >= 20 for rows in listener.heard.values()))
    finally:
        listener.executor.remove_node(node)
        node.destroy_node()
    measured, truth = (
        [m.stamp_ns for m in decoded([raw for raw, _ in rows[:20]])]
        for rows in listener.heard.values()
    )
    assert measured == truth


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'rate': 'fast'}, "encoder_sim: parameter 'rate' must be a number, not 'fast'"),
        (
            {'joints': ['a', 'b'], 'convention': 'raw_counts'},
            "encoder_sim: convention 'raw_counts'",
        ),
    ],
)
def test_wrong_value_is_one_line_and_exit_code_2(graph, parameters, said):
    with encoder_sim(**parameters) as process:
        code, output = ended(process)
    assert code == 2
    assert output.startswith(said)
    assert output.count('\n') == 1


def test_unknown_parameter_and_simulated_time_are_warned_about(graph):
    with encoder_sim(duration=0.1, amplitud=3.0, use_sim_time=True) as process:
        code, said = ended(process)
    assert code == 0
    assert "unknown parameter 'amplitud': did you mean 'amplitude'?" in said
    assert 'use_sim_time has no effect' in said
    assert '200 messages' in said  # it runs all the same


def test_node_in_an_executor_of_the_users_own(listener):
    listener.subscribe(JointState, 'joint_states', BEST_EFFORT)
    node = SimulatorNode(
        SIMULATOR, 'mine', parameter_overrides=ros_values({'joints': ('a', 'b'), 'rate': 200.0})
    )
    listener.executor.add_node(node)
    try:
        assert listener.spin(lambda: len(listener.heard['joint_states']) > 20)
        assert decoded([listener.heard['joint_states'][0][0]])[0].names == ('a', 'b')
        (result,) = node.set_parameters([Parameter('noise', value=0.1)])
        assert not result.successful  # values follow from seed and parameters alone
    finally:
        listener.executor.remove_node(node)
        node.destroy_node()
    assert node.deadlines.met > 20
    assert not node.deadlines.wait(0)  # its thread has ended


def test_a_machine_that_cannot_keep_up_is_warned_about_once(listener, capfd, monkeypatch):
    monkeypatch.setattr(simulator_node, 'BEHIND', -1.0)  # as if every message left late
    listener.subscribe(DiagnosticArray, '/diagnostics', 10, raw=False)
    node = SimulatorNode(SIMULATOR, 'slow')
    listener.executor.add_node(node)
    try:
        assert listener.spin(lambda: len(listener.heard['/diagnostics']) > 1)
    finally:
        listener.executor.remove_node(node)
        node.destroy_node()
    assert {
        status.level for message, _ in listener.heard['/diagnostics'] for status in message.status
    } == {DiagnosticStatus.WARN}
    assert capfd.readouterr().err.count('this machine cannot keep up') == 1


FAILING = """
import sys
from dataclasses import replace
from estimator_pkg.errors import UserError
from sim_pkg.nodes.executables import process

def make_node():
    import rclpy
    from sim_pkg.joints.encoder import SIMULATOR
    from sim_pkg.nodes.simulator_node import SimulatorNode

    def generate(*arguments):
        yield next(SIMULATOR.generate(*arguments))
        raise {error}('nothing goes on')

    return SimulatorNode(replace(SIMULATOR, generate=generate), 'failing',
                         on_end=rclpy.try_shutdown)

sys.exit(process(make_node)())
"""


@pytest.mark.parametrize(('error', 'lines'), [('UserError', 3), ('RuntimeError', None)])
def test_what_fails_in_mid_run_ends_the_process(graph, error, lines):
    done = subprocess.run(
        [sys.executable, '-c', FAILING.replace('{error}', error)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 1
    assert 'nothing goes on' in done.stderr and '128 messages' in done.stderr
    assert ('Traceback' in done.stderr) == (error == 'RuntimeError')
    assert lines is None or len(done.stderr.splitlines()) == lines


def test_deadlines_are_absolute_and_counted():
    deadlines = Deadlines()
    deadlines.start()
    time.sleep(0.02)  # late from the start: the first ones leave at once, none is skipped
    assert all(deadlines.wait(due) for due in (0, 1_000_000, 2_000_000))
    assert deadlines.met == deadlines.late == 3
    assert deadlines.worst_lateness >= 0.02
    before = time.monotonic_ns()
    start = deadlines._start_ns
    assert deadlines.wait(60_000_000)
    assert time.monotonic_ns() - start >= 60_000_000
    assert before - start < 60_000_000 or deadlines.late == 4
    assert deadlines.mean_lateness <= deadlines.worst_lateness
    deadlines.stop()
    assert not deadlines.wait(10_000_000_000)
    assert not deadlines.pause(10.0)
    assert deadlines.met == 4
