# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node adaptive_observer over real DDS: parameters, freezing, saving, starting frozen."""

import itertools

import dds
import numpy as np
import pytest
from answers import estimated, valid
from own_node import BEGIN
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

from estimator_pkg.driver.adaptive import AdaptiveBank, AdaptiveConfiguration
from estimator_pkg.driver.identified import load
from estimator_pkg.estimate import LOST
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.observers.adaptive.observer import Adaptive
from estimator_pkg.parameters import build
from estimator_pkg.streams.adaptive import AdaptiveStream
from sim_pkg.joints.dc_motor import SIMULATOR, MotorParameters

MODULE = 'estimator_pkg.nodes.executables adaptive_observer'


def messages(duration, seed=1):
    """(CDR bytes of the measurement, true velocity)."""
    decode, measured, true = Decoder().decode, [], []
    for chunk in SIMULATOR.generate(build(MotorParameters, {'rate': 500.0}), duration, seed):
        for message in chunk:
            raw = bytes(message.encode(10**18))
            if message.topic == 'joint_states':
                measured.append(raw)
            else:
                true.append(decode(raw).velocities[0])
    return measured, true


@pytest.fixture(scope='module')
def motor():
    return messages(4.0)


def bank_of(raws, **values):
    decode = Decoder().decode
    bank = AdaptiveBank(AdaptiveConfiguration(Adaptive, values))
    estimates = []
    for raw in raws:
        message = decode(raw)
        taken = bank.take(message.stamp_ns, message.names, message.positions, message.efforts)
        estimates.append([estimate[:2] for _, estimate in valid(taken)])
    return bank, estimates


def values_of(entry):
    return {item.key: item.value for item in entry.values}


def test_learns_reports_freezes_saves_and_starts_frozen(motor, probe, own, tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray
    from std_srvs.srv import SetBool, Trigger

    raws, true = motor
    path = tmp_path / 'motor.yaml'
    reported = []
    probe.node.create_subscription(
        DiagnosticArray, '/adaptive_observer/identified_parameters', reported.append, 10
    )
    values = (f'parameters_file:={path}', 'torque_constant:=0.6', 'input_unit:=V')
    with (
        dds.NodeProcess(MODULE, *dds.ros_args(*values, remap=['joint_states:=/motor'])),
        dds.Observer(probe, '/adaptive_observer', '/motor') as node,
    ):
        answer = node.connect() and probe.call(
            Trigger, '/adaptive_observer/save', Trigger.Request()
        )
        assert not answer.success and 'nothing is identified' in answer.message
        answers = node.feed(raws)
        # live is the same numbers as the driver's
        _, expected = bank_of(raws)
        assert [
            list(zip(a.positions, a.velocities)) if estimated(a) else [] for a in answers
        ] == expected
        assert [a.efforts for a in answers] == [node._decode(raw).efforts for raw in raws]
        assert abs(answers[-1].velocities[0] - true[-1]) < 0.05
        probe.until(lambda: reported and values_of(reported[-1].status[0])['state'] == 'ADAPTING')
        values = values_of(reported[-1].status[0])
        assert values['trusted'] == 'True'
        assert float(values['b/J']) == pytest.approx(2.0, rel=0.02)
        assert float(values['J']) == pytest.approx(0.02, rel=0.02)
        assert values['b2.unit'] == 'rad/s^2 per V'
        assert values['b/J.trusted'] == 'True' and float(values['explained']) > 0.99
        assert values['J.unit'] == 'kg m^2' and 0.0 < float(values['J.stddev']) < 1e-3
        assert probe.call(SetBool, '/adaptive_observer/freeze', SetBool.Request(data=True)).success
        assert node.get('adapt') is False
        assert probe.call(Trigger, '/adaptive_observer/save', Trigger.Request()).success
    saved = load(str(path))['joint']
    assert -saved['a'][0] == pytest.approx(2.0, rel=0.02) and saved['order'] == 2
    later, true = messages(2.0, seed=7)
    stream = own('angle_and_input', parameters_file=str(path), adapt=False, bandwidth_hz=8.0)
    stream, decode = stream.node.stream, Decoder().decode
    answers = [decode(made[0]) for raw in later for made in stream.feed(0, raw, 0) if 0 in made]
    errors = [a.velocities[0] - t for a, t in zip(answers, true) if estimated(a)]
    assert len(errors) > 300 and np.abs(errors).max() < 0.2
    report = stream.bank.reports()['joint']
    assert report.phase == 'FROZEN'


def test_efforts_as_an_array_of_numbers(own):
    """effort_command as Float64MultiArray: in the order of the joints, when it was sent."""
    node = own(
        'angle_and_input',
        **{
            'joints': ('left', 'right'),
            'input': 'effort_command',
            'effort_command_type': 'Float64MultiArray',
            'stamp_source': 'publisher',
            'input_unit': 'N m',
            'per_joint.right.input_scale': [-1.0],
        },
    )
    stream, raw = node.node.stream, node.encode(0, '', ('right', 'left'), (0.1, 0.2))

    sent = itertools.count(BEGIN, 10**6)

    def feed(port, raw):
        return [answer for answer in stream.feed(port, raw, next(sent)) if 0 in answer]

    assert [feed(0, raw) for _ in range(3)] == [[]] * 3
    node.pass_time(1.0)
    status, why = node.status_of('left')
    assert status == LOST and 'no effort_command is valid for it' in why
    for numbers in ([1.0, 2.0, 3.0], [1.0, 2.0]):
        feed(1, serialize_message(Float64MultiArray(data=numbers)))
    assert stream.malformed == [0, 1]
    assert stream.complaint == ('/effort_command', '3 numbers, but there are 2 joints')
    for _ in range(20):
        feed(0, raw)
    left = stream.bank.joints['left']
    assert left.dropped() == {'non_finite': 3} and left.used == 20
    assert stream.about('left')['input_unit'] == 'N m'
    assert "'right': 'input_scale' has 2 numbers" in node.set(
        per_joint__right__input_scale=[1.0, 2.0]
    )
    assert not node.set(per_joint__right__input_scale=[2.0])


def test_a_joint_that_cannot_be_saved_does_not_expire(motor, tmp_path):
    folder = tmp_path / 'robot'
    folder.mkdir()
    stream = AdaptiveStream.of({'parameters_file': str(folder / 'motor.yaml')})
    stream.bank, _ = bank_of(motor[0])
    folder.rmdir()
    assert not stream.expire(['joint'])
    assert 'joint' in stream.bank.joints
    (notice,) = stream.notices()
    assert notice.startswith('joints do not expire: ') and 'motor.yaml' in notice
    assert stream.notices() == []
    folder.mkdir()
    assert stream.expire(['joint'])
    assert 'joint' not in stream.bank.joints and stream.notices() == []
    assert set(load(str(folder / 'motor.yaml'))) == {'joint'}
