# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""joint_observer with other inputs, QoS and clocks; its start and its end."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import dds
import pytest
from answers import estimated
from test_joint import BEGIN, MODULE, MS, turning

from estimator_pkg import observers
from estimator_pkg.circle import Circle

CONFIG = Path(__file__).parents[2] / 'config/joint_observer.yaml'


def launch(name, *parameters):
    """A node called `name` whose input is /<name>/joint_states or /<name>/angle."""
    return dds.NodeProcess(
        MODULE, *dds.ros_args(*parameters, remap=(f'__node:={name}', f'__ns:=/{name}'), file=CONFIG)
    )


@pytest.fixture(scope='module')
def processes():
    """All variants, started together."""
    parameter_sets = {
        'misspelt': [
            'qos_overrides./misspelt/joint_states.subscription.reliability:=reliable',
            'qos_overrides./mispelt/joint_states.subscription.depth:=9',
            'observer:=hybrid_angle',
            'bandwith_hz:=20.0',
            'per_joint.sholder.noise:=0.001',
            'per_joint.arm.nose:=1.0',
        ],
        'others': ['bandwidth_hz:=20.0', 'per_joint.arm.noise:=0.1'],
        'paper': ['observer:=hybrid_angle', 'form:=paper', 'bandwidth_hz:=5.0'],
        'wall': ['stamp_source:=publisher', 'joints:=[a]'],
        'sim': ['use_sim_time:=true', 'observer:=finite_difference'],
    }
    running = {name: launch(name, *values) for name, values in parameter_sets.items()}
    yield running
    for process in running.values():
        process.__exit__()


@pytest.fixture
def observe(probe):
    """(name) -> the variant of this name, connected."""
    made = []

    def observe(name, **options):
        observer = dds.Observer(probe, f'/{name}/{name}', f'/{name}/joint_states', **options)
        made.append(observer)
        return observer

    yield observe
    for observer in made:
        observer.__exit__()


def test_incompatible_qos_and_misspelt_names_are_reported(processes, observe, probe):
    live = observe('misspelt', reliable=False)
    process = processes['misspelt']
    probe.until(lambda: live.reports)
    process.prints('a publisher on /misspelt/joint_states has an incompatible QoS')
    process.prints("'qos_overrides./misspelt/joint_states.subscription.reliability'")
    assert live.next_report()['/misspelt/misspelt']['qos_mismatches'] == '1'
    with dds.Observer(probe, '/misspelt/misspelt', '/misspelt/joint_states') as reliable:
        reliable.connect().feed(turning(reliable, ['shoulder'], [1.0], 3))
    process.prints(
        "unknown parameter 'qos_overrides./mispelt/joint_states.subscription.depth': "
        "did you mean 'qos_overrides./misspelt/joint_states.subscription.depth'?"
    )
    process.prints("unknown parameter 'bandwith_hz': did you mean 'bandwidth_hz'?")
    process.prints("unknown parameter 'per_joint.arm.nose': did you mean 'noise'?")
    process.prints(
        "joint 'sholder' is not in /misspelt/joint_states: did you mean 'shoulder'? "
        "correct 'per_joint.sholder.noise' (it carries shoulder)"
    )
    assert process.output.count('unknown parameter') == 3  # what the YAML sets is known


def test_gains_of_another_observer_are_reported_at_the_start(processes, observe, probe):
    from rcl_interfaces.srv import GetParameters

    process = processes['others']
    for name, others in (
        ('bandwidth_hz', 'hybrid_angle, finite_difference, kalman, pll'),
        ('per_joint.arm.noise', 'hybrid_angle, finite_difference, kalman, pll, super_twisting'),
    ):
        line = (
            f"unknown parameter '{name}': {others} have it, edge_adaptive (the default) does "
            "not: start the node with 'observer: hybrid_angle'"
        )
        process.prints(line)
        assert process.output.count(line) == 1
    answer = probe.call(
        GetParameters,
        '/others/others/get_parameters',
        GetParameters.Request(names=['observer', 'prefer']),
    )
    assert [each.string_value for each in answer.values] == ['edge_adaptive', 'balanced']
    said = process.output.count("'bandwidth_hz': hybrid_angle")
    refused = observe('others').connect().set(bandwidth_hz=30.0)
    assert not refused.successful
    assert refused.reason.startswith("unknown parameter 'bandwidth_hz': hybrid_angle, ")
    assert "start the node with 'observer: hybrid_angle'" in refused.reason
    process.prints("'bandwidth_hz': hybrid_angle", said + 1)
    assert process.alive and 'Traceback' not in process.output


def test_gains_unstable_at_the_measured_rate(processes, observe, probe):
    live = observe('paper').connect()
    assert live.feed(turning(live, ['p'], [1.0], 400))[-1].names == ('p',)
    refused = live.set(bandwidth_hz=2000.0)
    hybrid = observers.find('hybrid_angle')
    module = hybrid.module
    fast = module.design(hybrid.gains(form='paper', bandwidth_hz=2000.0), Circle())
    assert not refused.successful
    assert refused.reason == f"joint 'p': {module.limits(fast, 1e-3)}"
    assert live.get('bandwidth_hz') == 5.0
    # the rate falls: the joint says so, and the node lives on
    falling = turning(live, ['p'], [0.1], 200, begin=BEGIN + 10**12, dt=150 * MS)
    for raw in falling:
        live.publisher.publish(raw)
        probe.spin(0.003)
        if live.status('p') == 'misconfigured':
            break
    assert live.status('p') == 'misconfigured'
    assert live.answers[-1].stamp_ns < BEGIN + 10**12 + 150 * 150 * MS  # no more are answered
    slow = module.design(hybrid.gains(form='paper', bandwidth_hz=5.0), Circle())
    assert dds.value(live.statuses['p'], 'why')[:20] == module.limits(slow, 0.15)[:20]
    assert processes['paper'].alive
    processes['paper'].prints("joint 'p' is misconfigured")
    assert int(live.next_report()['/paper/paper']['dropped.misconfigured']) > 0
    # gains that work at this rate bring it back
    assert live.set(bandwidth_hz=0.2).successful
    for raw in turning(live, ['p'], [0.1], 60, begin=BEGIN + 2 * 10**12, dt=150 * MS):
        live.publisher.publish(raw)
        probe.spin(0.003)
    probe.until(lambda: live.answers[-1].stamp_ns == BEGIN + 2 * 10**12 + 59 * 150 * MS)
    assert live.answers[-1].velocities == pytest.approx((0.1,), rel=0.05)


def test_drivers_without_stamps_use_the_publishers_time(processes, observe, probe):
    live = observe('wall').connect()
    before = time.time_ns()
    for i in range(80):
        live.feed([live.encode(0, ['a', 'b'], [0.001 * i, 0.0])])
        probe.spin(0.002)
    assert all(before <= answer.stamp_ns <= time.time_ns() for answer in live.answers)
    assert (
        estimated(live.answers[-1]) == live.answers[-1].names == ('a',)
    )  # 'joints' asks for this one alone
    assert live.next_report()['/wall/wall']['dropped.zero_stamp'] == '0'


def test_a_simulated_clock_that_rests_and_jumps_back(processes, observe, probe):
    from rosgraph_msgs.msg import Clock

    live = observe('sim', sim_time=True).connect()
    clock = probe.node.create_publisher(Clock, '/clock', 10)
    try:
        probe.until(clock.get_subscription_count)

        def run(seconds, count):
            for i in range(count):
                stamp = seconds * 1000 * MS + i * 10 * MS
                message = Clock()
                message.clock.sec, message.clock.nanosec = divmod(stamp, 1000 * MS)
                clock.publish(message)
                live.feed([live.encode(stamp, ['s'], [0.02 * i])])

        run(100, 60)
        assert live.answers[-1].velocities == pytest.approx((2.0,), rel=1e-3)
        probe.until(lambda: live.status('s') == 'lost')  # the clock rests, the timeout does not
        run(50, 60)
        assert live.answers[-1].velocities == pytest.approx((2.0,), rel=1e-3)
        live.next_report()
        report = live.next_report()
        assert report['/sim/sim: s']['events.clock_jump'] == '1'
        assert int(report['/sim/sim']['received']) == 120 == int(report['/sim/sim']['used'])
        header = live.stamp_of_diagnostics
        assert 50 * 1000 * MS <= header <= 51 * 1000 * MS  # in simulated time
    finally:
        probe.node.destroy_publisher(clock)


def test_the_class_in_an_executor_of_ones_own(probe):
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import JointState

    from estimator_pkg.nodes.observer import ObserverNode
    from estimator_pkg.nodes.ros_parameters import ros_values

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


def test_the_code_of_the_page_starts_and_ends_a_node(probe):
    page = Path(__file__).parents[2] / 'docs/ros_tools.md'
    start, end = re.findall(r'```python\n(.*?)```', page.read_text(), re.DOTALL)
    for _ in range(2):
        exec(start, names := {})
        spins = threading.Event()

        def spin(executor=names['executor'], ends=spins):
            while not ends.is_set():
                executor.spin_once(timeout_sec=0.1)

        thread = threading.Thread(target=spin)
        thread.start()
        with dds.Observer(probe, '/arm_observer') as live:
            live.connect()
            assert len(live.feed(turning(live, ['a'], [1.0], 50))) == 50
            spins.set()
            thread.join()
            exec(end, names)
            probe.until(lambda live=live: not live.publisher.get_subscription_count())
        names['executor'].shutdown()


def test_publishers_come_and_go_while_several_threads_spin(probe):
    """What a callback cancels or destroys another thread may have taken, which ends its spin."""
    from rclpy.executors import MultiThreadedExecutor
    from sensor_msgs.msg import JointState

    from estimator_pkg.nodes.observer import ObserverNode

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
        assert not any(timer.is_canceled() for node in nodes for timer in node.timers)
        subscriptions = [list(node.subscriptions) for node in nodes]
        probe.node.destroy_publisher(publisher)
        probe.spin(0.15)
        return subscriptions

    try:
        subscriptions = [come_and_go() for _ in range(4)]
        assert thread.is_alive()
        assert all(each == subscriptions[0] for each in subscriptions)
    finally:
        for listener in listeners:
            probe.node.destroy_subscription(listener)
        executor.shutdown()
        thread.join()
        for node in nodes:
            node.destroy_node()


def test_messages_whose_event_was_missed_are_taken_all_the_same(probe):
    from estimator_pkg.nodes.observer import ObserverNode

    # in no executor: nothing is dispatched
    node = ObserverNode('angle', 'missed', namespace='/missed')
    try:
        with dds.Observer(probe, '/missed/missed', '/missed/joint_states') as live:
            probe.until(
                lambda: node._endpoints.connect() or live.publisher.get_subscription_count()
            )
            live.connect()
            for raw in turning(live, ['a'], [1.0], 3):
                live.publisher.publish(raw)
            probe.spin(0.2)
            assert not live.answers
            # as its timer does: one look ends after 10 ms, which one message may take
            probe.until(lambda: node._look_around() or len(live.answers) == 3)
            assert [answer.stamp_ns for answer in live.answers] == [
                BEGIN + i * MS for i in range(3)
            ]
    finally:
        node.destroy_node()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupts_end_the_node_quietly(number):
    with dds.NodeProcess(MODULE) as process:
        process.prints(f'{observers.DEFAULT} estimates every joint from /joint_states')
        process.signal(number)
        assert process.ends() == 0
    assert 'Traceback' not in process.output and 'rror' not in process.output


def test_an_interrupt_waits_for_an_import_and_a_second_one_changes_nothing(tmp_path):
    """What is raised in an import may be dropped, or become an ImportError."""
    (tmp_path / 'interrupting.py').write_text(
        'import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nwhole = True\n'
    )
    (tmp_path / 'program.py').write_text(
        'import os, signal, time\n'
        'from estimator_pkg.ros.runtime import run\n'
        'def make():\n'
        '    import interrupting\n'
        '    print("imported", interrupting.whole, flush=True)\n'
        '    time.sleep(30.0)\n'
        '    print("made")\n'
        'try:\n'
        '    run(make)\n'
        'finally:\n'
        '    os.kill(os.getpid(), signal.SIGTERM)\n'
        '    print("ended")\n'
    )
    done = subprocess.run(
        [sys.executable, str(tmp_path / 'program.py')],
        text=True,
        capture_output=True,
        timeout=dds.PATIENCE,
        env={**os.environ, 'PYTHONSAFEPATH': ''},  # it imports what lies next to it
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, 'imported True\nended\n', '')


def test_an_interrupt_in_a_callback_from_c_ends_the_start():
    script = (
        'import ctypes, os, signal, time\nfrom estimator_pkg.ros.runtime import run\n'
        'def back():\n    os.kill(os.getpid(), signal.SIGINT)\n'
        'def make():\n    ctypes.CFUNCTYPE(None)(back)()\n    time.sleep(30.0)\nrun(make)'
    )
    done = subprocess.run(
        [sys.executable, '-c', script], text=True, capture_output=True, timeout=dds.PATIENCE
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


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
