# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node joint_observer over real DDS: statuses, live parameters, other executors, its end."""

import itertools
import math
import signal
import subprocess
import sys
import time

import dds
import numpy as np
import pytest
from answers import estimated
from answers import valid as valid_of
from sensor_msgs.msg import JointState
from stream_roles import best_effort

from estimator_pkg import observers
from estimator_pkg.circle import Circle, wrap
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.estimate import MISCONFIGURED, TRACKING
from estimator_pkg.messages.joint_state import Encoder

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


def test_every_message_has_the_shape_of_the_drivers_from_the_first_on(live):
    """So ~/estimate remapped to /joint_states replaces the topic of a driver."""
    names, encode = [fresh(name) for name in ('slide', 'hinge', 'tool')], Encoder().encode
    sent = [
        (
            [0.1 + 1e-3 * k, math.nan if 200 <= k < 210 else 0.2 - 2e-3 * k, -0.3],
            [1.0 + k, -2.0, 0.5],
        )
        for k in range(300)
    ]
    raws = [encode(BEGIN + k * MS, 'base', names, at, (), by) for k, (at, by) in enumerate(sent)]
    found = live.feed([*raws, raws[-1]], unanswered={300})  # a duplicate is not answered
    assert [each.stamp_ns for each in found] == [BEGIN + k * MS for k in range(300)]
    for k, (each, (positions, efforts)) in enumerate(zip(found, sent)):
        assert list(each.names) == names and each.frame_id == 'base'
        assert len(each.positions) == len(each.velocities) == 3
        assert list(each.efforts) == efforts
        for place in range(3):
            if math.isnan(each.velocities[place]):
                assert each.positions[place] == pytest.approx(positions[place], nan_ok=True)
        if k == 0:
            assert all(map(math.isnan, each.velocities))
        elif 200 <= k < 210:  # the others go on where one drops out
            assert math.isnan(each.velocities[1]) and math.isnan(each.positions[1])
            assert each.velocities[0] == pytest.approx(1.0, rel=1e-3)
        elif k > 220:
            assert list(each.velocities) == pytest.approx([1.0, -2.0, 0.0], abs=1e-2)


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
    for name, usual in (('noise', 0.0), ('gap_max', 0.2)):  # deleted: back to the default
        assert live.set(**{name: 0.4}).successful and live.get(name) == 0.4
        assert live.set(**{name: None}).successful and live.get(name) == usual


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


def test_misspelt_names_and_gains_of_another_observer_are_reported_at_the_start(own, capfd):
    """One line each, with the right name; a live change is refused in the same words."""
    depth = 'qos_overrides./{}joint_states.subscription.depth'
    misspelt = {depth.format('x'): 9, 'bandwith_hz': 20.0, 'per_joint.arm.nose': 1.0}
    own('angle', observer='hybrid_angle', **misspelt).pass_time(4.0)
    said = capfd.readouterr().err
    assert said.count('unknown parameter') == 3
    for name, right in zip(misspelt, (depth.format(''), 'bandwidth_hz', 'noise')):
        assert f"unknown parameter '{name}': did you mean '{right}'?" in said
    node = own('angle', **{'bandwidth_hz': 20.0, 'per_joint.arm.noise': 0.1})
    node.pass_time(4.0)
    said = capfd.readouterr().err
    for name, there in (
        ('bandwidth_hz', 'hybrid_angle, finite_difference, kalman, pll'),
        ('per_joint.arm.noise', 'hybrid_angle, finite_difference, kalman, pll, super_twisting'),
    ):
        assert (
            f"unknown parameter '{name}': {there} have it, edge_adaptive (the default) does "
            "not: start the node with 'observer: hybrid_angle'" in said
        )
    assert "start the node with 'observer: hybrid_angle'" in node.set(bandwidth_hz=30.0)


def test_gains_unstable_at_the_measured_rate(own, capfd):
    """A live change is refused; where the rate falls the joint is misconfigured until they fit."""
    node = own('angle', observer='hybrid_angle', form='paper', bandwidth_hz=5.0)
    hybrid = observers.find('hybrid_angle')

    def limits(bandwidth_hz, dt):
        gains = hybrid.gains(form='paper', bandwidth_hz=bandwidth_hz)
        return hybrid.limits(hybrid.design(gains, Circle()), dt)

    def status_after(count, dt, begin):
        for k in range(count):
            raw = node.encode(begin + k * dt, '', ('p',), (0.1 * k * dt * 1e-9,))
            node.node.stream.feed(0, raw, 0)
        node.pass_time(0.1)
        return node.status_of('p')

    assert status_after(400, MS, BEGIN)[0] == TRACKING
    assert node.set(bandwidth_hz=2000.0) == f"joint 'p': {limits(2000.0, 1e-3)}"
    status, why = status_after(200, 150 * MS, BEGIN + 10**12)
    assert status == MISCONFIGURED and why[:20] == limits(5.0, 0.15)[:20]
    assert "joint 'p' is misconfigured" in capfd.readouterr().err
    assert not node.set(bandwidth_hz=0.2)
    assert status_after(60, 150 * MS, BEGIN + 2 * 10**12)[0] == TRACKING


# Processes


def test_interrupts_end_the_node_quietly():
    with dds.NodeProcess(MODULE) as one, dds.NodeProcess(MODULE) as other:
        for process, number in ((one, signal.SIGINT), (other, signal.SIGTERM)):
            process.prints(f'{observers.DEFAULT} estimates every joint from /joint_states')
            process.signal(number)
            assert process.ends() == 0
            assert 'Traceback' not in process.output and 'rror' not in process.output


def test_a_publisher_that_waits_for_its_subscription_loses_nothing(probe):
    """Also where it comes back: the subscription ends with the last publisher, and its count of
    losses does not.
    """
    topic = '/waiting'

    def publisher():
        return probe.node.create_publisher(JointState, topic, best_effort(50))

    waiting = publisher()
    with (
        dds.NodeProcess(MODULE, *dds.ros_args(remap=(f'joint_states:={topic}', '__node:=starts'))),
        dds.Observer(probe, '/starts', '/unused') as listener,
    ):
        for done in range(2):  # before the node is there, and after
            source, waiting = waiting or publisher(), None
            probe.until(source.get_subscription_count)
            for raw in turning(listener, ['a'], [1.0], 100, begin=time.time_ns()):
                source.publish(raw)
                probe.spin(1e-3)
            due = 100 * (done + 1)
            probe.until(
                lambda due=due: len(listener.answers) == due,
                lambda: f'{len(listener.answers)}: {listener.next_report()["/starts"]}',
            )
            probe.node.destroy_publisher(source)
            probe.until(lambda: not probe.node.count_subscribers(topic))
        values = listener.next_report()['/starts']
        assert (values['lost_by_dds'], values['messages_received']) == ('0', '200')


def test_a_process_whose_output_nobody_reads_ends_by_itself(probe):
    """The node is destroyed all the same: else DDS waits for one of its threads for ever."""
    words = [sys.executable, '-m', *MODULE.split(), *dds.ros_args(remap=['__node:=unread'])]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        probe.until(lambda: 'unread' in probe.node.get_node_names())
        process.stderr.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(dds.PATIENCE) == 0
    finally:
        process.kill()
        process.wait()
