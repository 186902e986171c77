# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node joint_observer over real DDS: statuses, live parameters, other executors, its end."""

import itertools
import math
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import dds
import numpy as np
import pytest
from answers import estimated
from answers import valid as valid_of
from own_node import OwnNode

from estimator_pkg import observers
from estimator_pkg.circle import Circle, wrap
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.estimate import MISCONFIGURED, TRACKING
from estimator_pkg.nodes.observer import ObserverNode
from estimator_pkg.nodes.ros_parameters import ros_values

MODULE = 'estimator_pkg.nodes.executables joint_observer'
BEGIN = 1_700_000_000_000_000_000  # [ns]
MS = 1_000_000
TURN = 2.0 * math.pi
TRIES = itertools.count()


@pytest.fixture(scope='module')
def live(probe):
    """A node of hybrid_angle at its defaults; every test brings joints of its own."""
    with (
        dds.NodeProcess(MODULE, *dds.ros_args('observer:=hybrid_angle')) as process,
        dds.Observer(probe) as observer,
    ):
        observer.process = process
        yield observer.connect()


def fresh(name):
    """A joint that nobody has fed, not even this test where it is tried again."""
    return f'{name}_{next(TRIES)}'


def turning(live, names, speeds, count, *, begin=BEGIN, dt=MS, first=0):
    """Messages of shafts that turn at constant speeds [rad/s], wrapped to [-pi, pi)."""
    return [
        live.encode(begin + i * dt, names, [wrap(speed * i * dt * 1e-9, TURN) for speed in speeds])
        for i in range(first, first + count)
    ]


def test_status_of_a_joint_from_its_first_sample_to_silence(live):
    patient = fresh('patient')
    live.feed(turning(live, [patient], [1.0], 1))
    live.probe.until(lambda: live.status(patient) == 'initialising')
    live.feed(turning(live, [patient], [1.0], 400, first=1))
    live.probe.until(lambda: live.status(patient) == 'tracking')
    assert dds.value(live.statuses[patient], 'group_delay_s') == '0'
    assert float(dds.value(live.statuses[patient], 'rate_hz')) == pytest.approx(1000.0)
    live.probe.until(lambda: live.status(patient) == 'lost')
    assert 'no usable sample for 0.5 s' in live.statuses[patient].message
    live.feed(turning(live, [patient], [1.0], 1, first=500))
    live.probe.until(lambda: live.status(patient) == 'tracking')


def test_reset_starts_every_joint_again(live):
    from std_srvs.srv import Trigger

    again = fresh('again')
    assert estimated(live.feed(turning(live, [again], [1.0], 400))[-1]) == (again,)
    answer = live.probe.call(Trigger, '/joint_observer/reset', Trigger.Request())
    assert answer.success and 'are reset' in answer.message
    assert live.feed(turning(live, [again], [1.0], 1, first=400))[-1].names == (again,)
    assert not estimated(live.answers[-1])
    assert live.next_report()[f'/joint_observer: {again}']['resets'] == '1'


# Parameters


def offline(values=None, overrides=None):
    return Bank(Configuration(observers.find('hybrid_angle'), values, overrides))


def valid(bank, stamp, names, positions):
    """(name, position, velocity) of each joint with an estimate."""
    taken = bank.update(stamp, names, positions)
    return [(name, *estimate[:2]) for name, estimate in valid_of(taken)]


def shown(answer):
    """The same of a message."""
    there = zip(answer.names, answer.positions, answer.velocities)
    return [each for each in there if math.isfinite(each[2])]


def uneven(count):
    generator = np.random.default_rng(1)
    return [wrap(2.0 * i * 1e-3 + 1e-3 * generator.standard_normal(), TURN) for i in range(count)]


def test_a_gain_changes_live_and_the_state_is_kept(live):
    bank, samples = offline(), uneven(800)
    try:
        for i, sample in enumerate(samples):
            if i == 400:
                result = live.set(bandwidth_hz=20)  # a whole number for a float
                assert result.successful, result.reason
                assert repr(live.get('bandwidth_hz')) == '20.0'
                joint = bank.joints['tuned']
                joint.set_gains(offline({'bandwidth_hz': 20.0}).configuration.for_joint('')[0])
            stamp = BEGIN + i * MS
            (answer,) = live.feed([live.encode(stamp, ['tuned'], [sample])])
            expected = valid(bank, stamp, ['tuned'], [sample])
            assert shown(answer) == expected
        assert answer.names == ('tuned',)
    finally:
        assert live.set(bandwidth_hz=45.0).successful


def test_an_override_of_one_joint_before_it_appears_and_back(live):
    assert live.set(per_joint__eager__bandwidth_hz=200).successful
    bank = offline({}, {'eager': {'bandwidth_hz': 200.0}})
    for i, sample in enumerate(uneven(300)):
        stamp = BEGIN + i * MS
        (answer,) = live.feed([live.encode(stamp, ['eager', 'calm'], [sample, sample])])
        expected = valid(bank, stamp, ['eager', 'calm'], [sample, sample])
        assert shown(answer) == expected
    assert answer.velocities[0] != answer.velocities[1]
    assert live.get('per_joint.eager.bandwidth_hz') == 200.0
    assert live.set(per_joint__eager__bandwidth_hz=None).successful  # follows the common value
    assert live.get('per_joint.eager.bandwidth_hz') is None


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ({'bandwidth_hz': -1.0}, "'bandwidth_hz' = -1 is outside [0.001, 1e+06]"),
        ({'bandwidth_hz': -1}, 'is outside'),
        ({'bandwidth_hz': math.nan}, 'must be finite'),
        ({'bandwidth_hz': 'fast'}, "must be a number, not 'fast'"),
        ({'bandwith_hz': 20.0}, "unknown parameter 'bandwith_hz': did you mean 'bandwidth_hz'?"),
        ({'per_joint__a__nose': 0.1}, "did you mean 'noise'?"),
        ({'prefer': 'fast'}, "start the node with 'observer: edge_adaptive'"),
        ({'per_joint__a__prefer': 'fast'}, "start the node with 'observer: edge_adaptive'"),
        ({'per_joint__a__noise': 'loud'}, "'per_joint.a.noise' must be a number"),
        ({'per_joint__a__order': 2}, 'structural'),
        ({'order': 2}, 'read-only'),
        ({'observer': 'kalman'}, 'read-only'),
        ({'gap_max': 0.5, 'low_speed_bound': 3}, "'low_speed_bound' must be true or false"),
        ({'k1': 100.0, 'k2': 1e-6, 'k3': 1e6}, 'stable'),
    ],
)
def test_a_wrong_value_is_refused_with_the_reason_and_nothing_changes(live, given, reason):
    names = ('bandwidth_hz', 'gap_max', 'order')
    before = [live.get(name) for name in names]
    logged = live.process.output.count('parameters are not changed: ')
    result = live.set(**given)
    assert not result.successful and reason in result.reason
    assert [live.get(name) for name in names] == before
    # rqt_reconfigure shows the new value and drops the node's answer
    live.process.prints('parameters are not changed: ', logged + 1)


def test_automatic_parameters_can_be_set_and_left_to_the_node_again(live):
    assert live.get('noise') == 0.0
    assert live.set(noise=0.001).successful
    assert live.get('noise') == 0.001
    assert live.set(noise=None).successful  # deleted: back to the default
    assert live.get('noise') == 0.0
    assert live.set(gap_max=0.4).successful and live.set(gap_max=None).successful
    assert live.get('gap_max') == 0.2  # the default, not gone


def test_misspelt_names_and_gains_of_another_observer_are_reported_at_the_start(probe):
    """One line each, with the right name; a live change is refused in the same words."""
    starts = {
        'misspelt': [
            'qos_overrides./mispelt/joint_states.subscription.depth:=9',
            'observer:=hybrid_angle',
            'bandwith_hz:=20.0',
            'per_joint.arm.nose:=1.0',
        ],
        'others': ['bandwidth_hz:=20.0', 'per_joint.arm.noise:=0.1'],
    }
    config = Path(__file__).parents[2] / 'config/joint_observer.yaml'  # what it sets is known
    misspelt, others = (
        dds.NodeProcess(
            MODULE, *dds.ros_args(*words, remap=(f'__node:={name}', f'__ns:=/{name}'), file=config)
        )
        for name, words in starts.items()
    )
    with misspelt, others, dds.Observer(probe, '/others/others', '/others/joint_states') as live:
        for line in (
            "'qos_overrides./mispelt/joint_states.subscription.depth': did you mean "
            "'qos_overrides./misspelt/joint_states.subscription.depth'?",
            "'bandwith_hz': did you mean 'bandwidth_hz'?",
            "'per_joint.arm.nose': did you mean 'noise'?",
        ):
            misspelt.prints(f'unknown parameter {line}')
        assert misspelt.output.count('unknown parameter') == 3
        for name, there in (
            ('bandwidth_hz', 'hybrid_angle, finite_difference, kalman, pll'),
            ('per_joint.arm.noise', 'hybrid_angle, finite_difference, kalman, pll, super_twisting'),
        ):
            others.prints(
                f"unknown parameter '{name}': {there} have it, edge_adaptive (the default) does "
                "not: start the node with 'observer: hybrid_angle'"
            )
        refused = live.connect().set(bandwidth_hz=30.0)
        assert not refused.successful
        assert "start the node with 'observer: hybrid_angle'" in refused.reason


def test_gains_unstable_at_the_measured_rate(probe, monkeypatch, capfd):
    """A live change is refused; where the rate falls the joint is misconfigured until they fit."""
    own = OwnNode(monkeypatch, 'angle', observer='hybrid_angle', form='paper', bandwidth_hz=5.0)
    hybrid, statuses = observers.find('hybrid_angle'), own.node.health.watch.statuses

    def limits(bandwidth_hz, dt):
        gains = hybrid.gains(form='paper', bandwidth_hz=bandwidth_hz)
        return hybrid.limits(hybrid.design(gains, Circle()), dt)

    def turning(count, dt, begin):
        for k in range(count):
            raw = own.encode(begin + k * dt, '', ('p',), (0.1 * k * dt * 1e-9,))
            own.node.stream.feed(0, raw, 0)
        own.pass_time(0.1)

    try:
        turning(400, MS, BEGIN)
        assert statuses['p'][0] == TRACKING
        (refused,) = own.node.set_parameters(ros_values({'bandwidth_hz': 2000.0}))
        assert not refused.successful and refused.reason == f"joint 'p': {limits(2000.0, 1e-3)}"
        turning(200, 150 * MS, BEGIN + 10**12)
        assert statuses['p'][0] == MISCONFIGURED and statuses['p'][1][:20] == limits(5.0, 0.15)[:20]
        assert "joint 'p' is misconfigured" in capfd.readouterr().err
        (result,) = own.node.set_parameters(ros_values({'bandwidth_hz': 0.2}))
        assert result.successful
        turning(60, 150 * MS, BEGIN + 2 * 10**12)
        assert statuses['p'][0] == TRACKING
    finally:
        own.close()


def test_the_class_in_an_executor_of_ones_own(probe):
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import JointState

    node = ObserverNode(
        'angle',
        'mine',
        namespace='/own',
        parameter_overrides=ros_values(
            {'observer': 'finite_difference', 'joints': ('a',), 'bandwidth_hz': 100}
        ),
    )
    made = []
    answering = node.stream._answering
    encode = answering._stddev.encode
    answering._stddev.encode = lambda *given: made.append(given) or encode(*given)
    executor = SingleThreadedExecutor()  # hands callbacks other arguments than EventsExecutor
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        with dds.Observer(probe, '/own/mine', '/own/joint_states') as live:
            live.connect()
            answer = live.feed(turning(live, ['a', 'b'], [1.0, 1.0], 200))[-1]
            assert answer.names == ('a',)
            assert answer.velocities == pytest.approx((1.0,), rel=1e-6)
            assert not made  # nobody listens, so no standard deviation is made
            listener = probe.node.create_subscription(
                JointState, '/own/mine/estimate_stddev', lambda message: None, 10
            )
            probe.until(listener.get_publisher_count)
            probe.spin(0.5)
            live.feed(turning(live, ['a'], [1.0], 5, first=200))
            assert len(made) == 5
            probe.node.destroy_subscription(listener)
            assert '/own/mine/acceleration' not in dict(node.get_topic_names_and_types())
    finally:
        executor.shutdown()
        thread.join()
        node.destroy_node()


def test_publishers_come_and_go_while_several_threads_spin(probe):
    """What a callback destroys another thread may have taken, which ends its spin."""
    from rclpy.executors import MultiThreadedExecutor
    from sensor_msgs.msg import JointState

    nodes = [ObserverNode('angle', name, namespace='/threads') for name in ('one', 'two')]
    executor = MultiThreadedExecutor(2)
    for node in nodes:
        executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    listeners = [
        probe.node.create_subscription(JointState, f'/threads/{name}/estimate', repr, 10)
        for name in ('one', 'two')
    ]

    def come_and_go():
        """A publisher that both nodes hear; return their subscriptions meanwhile."""
        publisher = probe.node.create_publisher(JointState, '/threads/joint_states', 10)
        before = [node.stream.received[0] for node in nodes]

        def heard():
            seconds, nanosec = divmod(time.time_ns(), 10**9)
            message = JointState(name=['a'], position=[0.1])
            message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanosec
            publisher.publish(message)
            return all(node.stream.received[0] > old for node, old in zip(nodes, before))

        probe.until(heard)
        probe.spin(0.3)
        subscriptions = [list(node.subscriptions) for node in nodes]
        probe.node.destroy_publisher(publisher)
        probe.spin(0.15)
        return subscriptions

    try:
        subscriptions = [come_and_go() for _ in range(2)]
        assert thread.is_alive()
        assert all(each == subscriptions[0] for each in subscriptions)
    finally:
        for listener in listeners:
            probe.node.destroy_subscription(listener)
        executor.shutdown()
        thread.join()
        for node in nodes:
            node.destroy_node()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupts_end_the_node_quietly(number):
    with dds.NodeProcess(MODULE) as process:
        process.prints(f'{observers.DEFAULT} estimates every joint from /joint_states')
        process.signal(number)
        assert process.ends() == 0
    assert 'Traceback' not in process.output and 'rror' not in process.output


def test_a_process_whose_output_nobody_reads_ends_by_itself(probe):
    """The node is destroyed all the same: else DDS waits for one of its threads for ever."""
    process = subprocess.Popen(
        [
            *(sys.executable, '-m', 'sim_pkg.nodes.executables', 'encoder_sim'),
            *dds.ros_args(remap=['__node:=unread']),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    try:
        probe.until(lambda: 'unread' in probe.node.get_node_names())
        assert process.stderr is not None
        process.stderr.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(dds.PATIENCE) == 0
    finally:
        process.kill()
        process.wait()


def test_an_end_that_hangs_is_ended_by_an_alarm():
    script = (
        'import signal, time\nfrom estimator_pkg import interrupts\n'
        'interrupts.LONGEST_END = 0.2\nsignal.signal(signal.SIGALRM, signal.SIG_IGN)\n'
        'interrupts.limit_end()\ntime.sleep(60.0)'
    )
    done = subprocess.run([sys.executable, '-c', script], timeout=dds.PATIENCE, check=False)
    assert done.returncode == -signal.SIGALRM
