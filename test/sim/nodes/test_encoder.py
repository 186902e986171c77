# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node encoder_sim over real DDS: the same run as `simulate`, in real time, ending cleanly."""

import contextlib
import signal
import time
from pathlib import Path

import dds
import numpy as np
import nursery
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.nodes.ros_parameters import ros_values
from estimator_pkg.parameters import build
from sim_pkg.joints.encoder import SIMULATOR, EncoderParameters
from sim_pkg.nodes import simulator_node
from sim_pkg.nodes.deadline import Deadlines
from sim_pkg.nodes.simulator_node import SimulatorNode

CONFIG = Path(__file__).parents[3] / 'config/encoder_sim.yaml'
MEASURED, TRUTH = '/joint_states', '/ground_truth/joint_states'
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


@pytest.fixture
def hear(probe):
    """Subscribe: (type, topic, qos) -> the list of (message, when it came [ns]), which grows."""
    made = []

    def subscribe(kind, topic, qos=10, raw=False):
        kept = []
        made.append(
            probe.node.create_subscription(
                kind, topic, lambda message: kept.append((message, time.time_ns())), qos, raw=raw
            )
        )
        return kept

    yield subscribe
    for each in made:
        probe.node.destroy_subscription(each)


def encoder_sim(*pairs, remap=(), file=None):
    """The node as a process."""
    words = dds.ros_args(*pairs, remap=remap, file=file)
    return dds.NodeProcess('sim_pkg.nodes.executables encoder_sim', *words)


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


def test_live_run_equals_the_simulated_one(probe, hear):
    """All faults on: the same values and relative stamps, in the same order, none lost."""
    heard, true = (hear(JointState, topic, RELIABLE, raw=True) for topic in (MEASURED, TRUTH))
    diagnosed = hear(DiagnosticArray, '/diagnostics')
    pairs = [f'{name}:={value}' for name, value in FAULTS.items()]
    pairs += ['joints:=[left, right]', 'seed:=5', 'duration:=2.0']
    pairs += ['wait_for_subscribers:=1', 'wait_for_truth_subscribers:=1']
    for topic in (MEASURED, TRUTH):
        pairs += [
            f'qos_overrides.{topic}.publisher.{policy}'
            for policy in ('reliability:=reliable', 'depth:=5000')
        ]
    with encoder_sim(*pairs, file=CONFIG) as process:
        probe.until(lambda: not process.alive)
        probe.spin(0.5)
        assert process.ends() == 0, process.output
    values = {**FAULTS, 'joints': ['left', 'right']}
    expected = simulated(2.0, 5, **values)
    wanted = decoded(expected['joint_states'])
    raws, came_ns = zip(*heard)
    got = decoded(raws)
    start_ns = got[0].stamp_ns - wanted[0].stamp_ns
    assert [(m.stamp_ns - start_ns, *m[1:]) for m in got] == [tuple(m) for m in wanted]
    truth = decoded([raw for raw, _ in true])
    assert [(m.stamp_ns - start_ns, *m[1:]) for m in truth] == [
        tuple(m) for m in decoded(expected[TRUTH[1:]])
    ]
    # In real time: nothing leaves before it is due, and the mean rate is that of the stamps.
    stamps = np.array([m.stamp_ns for m in wanted])
    came = np.array(came_ns) - start_ns
    assert (came - stamps).min() > -200_000 - 1_000_000  # stamp jitter, and two clocks read apart
    assert np.polyfit(stamps, came, 1)[0] == pytest.approx(1.0, abs=0.1)
    reports = [status for message, _ in diagnosed for status in message.status]
    assert [status.name for status in reports][:1] == ['/encoder_sim: deadlines']
    reported = {pair.key: pair.value for pair in reports[-1].values}
    assert 0 < int(reported['messages']) <= len(wanted) + 2000
    assert f'{len(wanted) + 2000} messages, ' in process.output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupt_ends_it_cleanly(probe, hear, number):
    heard = hear(JointState, MEASURED, BEST_EFFORT)
    with encoder_sim() as process:
        probe.until(lambda: len(heard) > 50)
        offered = probe.node.get_publishers_info_by_topic(MEASURED)
        process.signal(number)
        assert process.ends() == 0
    said = process.output
    assert 'publishes 1000 samples per second on /joint_states, sensor_msgs/msg/JointState:' in said
    assert len(said.splitlines()) == 2  # and says how well it kept time
    assert 'more than 1 ms late' in said
    assert [end.qos_profile.reliability for end in offered] == [ReliabilityPolicy.BEST_EFFORT]


@pytest.mark.parametrize('pair', ['wait_for_subscribers:=1', 'rate:=0.01'])
def test_interrupt_while_it_waits(probe, hear, pair):
    diagnosed = hear(DiagnosticArray, '/diagnostics')
    with encoder_sim(pair, remap=['joint_states:=nobody_listens']) as process:
        probe.until(lambda: diagnosed)
        process.signal(signal.SIGINT)
        assert process.ends() == 0
    assert 'Traceback' not in process.output


@contextlib.contextmanager
def node_of(probe, name, **values):
    """The node in the executor of this process."""
    node = SimulatorNode(SIMULATOR, name, parameter_overrides=ros_values(values))
    probe.executor.add_node(node)
    try:
        yield node
    finally:
        probe.executor.remove_node(node)
        node.destroy_node()


def test_it_waits_for_who_listens_to_the_truth_too_and_says_so(probe, hear, capfd, monkeypatch):
    """A recorder whose subscription to the truth comes late has the truth of every measurement."""
    monkeypatch.setattr(simulator_node, 'PATIENCE', 0.1)
    heard, said = [hear(JointState, MEASURED, BEST_EFFORT, raw=True)], []
    waits = {'wait_for_subscribers': 1, 'wait_for_truth_subscribers': 1}
    with node_of(probe, 'patient', rate=100.0, **waits) as node:

        def waiting():
            said.append(capfd.readouterr().err)
            return f'waiting for subscribers: {TRUTH} has 0 of 1\n' in ''.join(said)

        probe.until(waiting)
        probe.spin(0.2)
        assert node.deadlines.met == 0 and not heard[0]
        heard.append(hear(JointState, TRUTH, BEST_EFFORT, raw=True))
        probe.until(lambda: all(len(rows) >= 20 for rows in heard))
    measured, truth = (
        [m.stamp_ns for m in decoded([raw for raw, _ in rows[:20]])] for rows in heard
    )
    assert measured == truth


def test_node_in_an_executor_of_the_users_own(probe, hear):
    heard = hear(JointState, MEASURED, BEST_EFFORT)
    with node_of(probe, 'mine', joints=('a', 'b'), rate=200.0) as node:
        probe.until(lambda: len(heard) > 20)
        assert heard[0][0].name == ['a', 'b']
        (result,) = node.set_parameters([Parameter('noise', value=0.1)])
        assert not result.successful  # values follow from seed and parameters alone
    assert node.deadlines.met > 20
    assert not node.deadlines.wait(0)  # its thread has ended


def test_a_machine_that_cannot_keep_up_is_warned_about_once(probe, hear, capfd, monkeypatch):
    monkeypatch.setattr(simulator_node, 'BEHIND', -1.0)  # as if every message left late
    diagnosed = hear(DiagnosticArray, '/diagnostics')
    with node_of(probe, 'slow'):
        probe.until(lambda: len(diagnosed) > 1)
    levels = {status.level for message, _ in diagnosed for status in message.status}
    assert levels == {DiagnosticStatus.WARN}
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


@pytest.mark.parametrize('error', ['UserError', 'RuntimeError'])
def test_what_fails_in_mid_run_ends_the_process(error):
    code, said = nursery.run_script(FAILING.replace('{error}', error))
    assert code == 1
    assert 'nothing goes on' in said and '128 messages' in said
    assert ('Traceback' in said) == (error == 'RuntimeError')
    assert error == 'RuntimeError' or len(said.splitlines()) == 3


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
