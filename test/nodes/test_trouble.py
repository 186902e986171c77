# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What nodes say when something is wrong with what comes, or with what is done with it.

The nodes live in this process and in no executor: they take what waits when they look around.
"""

import dataclasses
import math
import re
import time

import dds
import motors
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import LOST, MISCONFIGURED, TRACKING
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.models import gripper
from estimator_pkg.nodes.detection import JOINT_PATIENCE
from estimator_pkg.nodes.observer import ObserverNode
from estimator_pkg.nodes.ros_parameters import ros_values
from estimator_pkg.streams.adaptive import AdaptiveStream
from estimator_pkg.streams.angle import AngleSettings, AngleStream
from estimator_pkg.streams.drive import DriveStream
from estimator_pkg.streams.mechanical import MechanicalStream
from estimator_pkg.streams.switched import SwitchedStream
from estimator_pkg.streams.wheels import WheelStream

BEGIN = 1_700_000_000_000_000_000  # [ns]
MS = 1_000_000
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}


def raising(mode):
    """What is wrong in a user's model."""
    return {'': None, 'close': None}[mode]


RAISING = dataclasses.replace(gripper.MODEL, transition=raising)


class Own:
    """A node in this process, and who publishes to it."""

    def __init__(self, probe, kind, **values):
        self.probe = probe
        self.node = ObserverNode(
            kind, kind.__name__.lower(), parameter_overrides=ros_values(values)
        )
        self.encode = Encoder().encode
        self._publishers = []

    def publisher(self, kind, topic):
        """One more, connected."""
        before = {each for each in self._publishers if each.topic_name == f'/{topic}'}
        made = self.probe.node.create_publisher(kind, topic, 50)
        self._publishers.append(made)

        def connected():
            self.node._endpoints.connect()
            return made.get_subscription_count() and self.node.count_publishers(topic) > len(before)

        self.probe.until(connected)
        time.sleep(0.1)
        return made

    def take(self, publisher, *raws):
        """Publish, and wait until the node has had them; its counters."""
        before = self.node.health._totals()['messages_received']
        for raw in raws:
            publisher.publish(raw)

        def taken():
            self.node._look_around()
            return self.node.health._totals()['messages_received'] - before == len(raws)

        assert dds.until(taken)
        return self.node.health._totals()

    def reported(self):
        """The diagnostics' entry, as after a second."""
        entries = []
        self.node.health._diagnostics = type('', (), {'publish': entries.append})
        self.node.health._report(time.monotonic())
        return deserialize_message(entries[-1], DiagnosticArray).status[0]

    def close(self):
        self.node.destroy_node()
        for each in self._publishers:
            self.probe.node.destroy_publisher(each)


@pytest.fixture
def own(probe):
    """(class of the node, parameters) -> it, in this process."""
    made = []

    def start(kind, **values):
        made.append(Own(probe, kind, **values))
        return made[-1]

    yield start
    for each in made:
        each.close()


def test_what_is_not_estimated_is_reported_but_not_each_standstill(own, capfd):
    """Seconds of a motor: at rest at the start, then it turns, stops, and loses its voltage."""
    drive = own(DriveStream, **MOTOR)
    health, motor = drive.node.health, drive.node.stream.joint
    begun, passed, row = time.monotonic(), 0, 0

    def seconds(count, turns, voltage=1.0):
        nonlocal passed, row
        for _ in range(count):
            for stamps, values in motors.steady(50, row, turns):
                drive.node.stream.feed(
                    0, drive_samples.encode(stamps, values * (1.0, 1.0, voltage, voltage)), 0
                )
            row, passed = row + 50, passed + 1
            health.watch.look(begun + passed, every=True)
            health._detector.look(begun + passed)
            health._report(begun + passed)

    def errors():
        return [line for line in capfd.readouterr().err.splitlines() if 'no estimate' in line]

    seconds(8, 0.0)
    (said,) = errors()
    said_first = 'no estimate for 4 s, though messages come on /drive_samples: back-EMF'
    assert '[ERROR]' in said and said_first in said and '(motor, motor_electrical)' in said
    seconds(3, 100.0)
    assert motor.estimate()[3] == TRACKING and 'nothing' not in health._faults.present
    seconds(8, 0.0)
    assert motor.needs_motion and not errors() and 'nothing' not in health._faults.present
    seconds(8, 100.0, voltage=0.0)
    (said,) = errors()
    assert '[ERROR]' in said and 'all voltages are zero: is the voltage connected?' in said


def test_joints_that_start_again_and_again_are_estimated(own, capfd):
    """At each report they have just started (a driver that is killed every other second)."""
    arm = own(AngleStream)
    health, stream, begun = arm.node.health, arm.node.stream, time.monotonic()
    for second in range(8):
        for count in (20, 1):
            for k in range(count):
                stamp = BEGIN + (1000 * second + 10 * k) * MS
                stream.feed(0, arm.encode(stamp, '', ('a',), (0.01 * k,)), 0)
            health.watch.look(begun + second, every=True)
            health._detector.look(begun + second)
            if count > 1:
                assert health.watch.estimated
                stream.reset()
        health._report(begun + second)
    assert 'no estimate' not in capfd.readouterr().err


def test_a_model_that_raises_costs_a_restart_and_not_the_node(own, capfd):
    from sensor_msgs.msg import JointState

    system = own(SwitchedStream, model=f'{__name__}:RAISING')
    states = system.publisher(JointState, 'joint_states')
    events = system.publisher(JointState, 'switch_event')

    def sample(k):
        return system.encode(BEGIN + k * MS, '', ('joint',), (1e-3 * k,), (), (0.0,))

    system.take(states, sample(0), sample(1))
    events.publish(system.encode(BEGIN + 2 * MS, '', ('opne',)))
    assert dds.until(lambda: system.node._look_around() or system.node.stream.bank.system._waiting)
    totals = system.take(states, sample(2), sample(3), sample(4))
    assert totals['messages_dropped.failed'] == 1 and totals['resets'] == 1
    assert totals['messages_received'] == totals['messages_used'] + 1 == 5
    assert totals['received'] == totals['used']
    said = capfd.readouterr().err
    assert (
        'the observer failed on a message of /joint_states, and all joints are reset: '
        "KeyError: 'opne' (line " in said
    ) and 'Traceback' not in said
    assert '1 messages on which the observer failed' in system.reported().message


def test_samples_that_are_all_dropped_are_reported_with_the_reason(own, capfd):
    from sensor_msgs.msg import JointState

    live = own(AngleStream, timeout=0.02, gap_max=0.02)
    states = live.publisher(JointState, 'joint_states')
    for k in range(2):
        live.take(states, live.encode(BEGIN + k * MS, '', 'abcdefg', [0.0] * 7))
    time.sleep(0.05)
    live.take(states, live.encode(BEGIN + 2 * MS, '', 'abcdefg', [math.nan] * 7))
    said = capfd.readouterr().err
    assert (
        '7 joints have no usable sample for 0.02 s; all 7 received samples are dropped: their '
        "numbers are not finite, or too large for any joint ('a', 'b', 'c', 'd', 'e' and 2 more)"
    ) in said
    assert live.node.health.watch.statuses['g'][1].endswith('too large for any joint')


def test_a_slow_stream_is_not_lost_between_two_samples(own):
    """0.5 Hz, and a timeout that wall time passes between any two: as long as four sample times."""
    from sensor_msgs.msg import JointState

    live = own(AngleStream, timeout=0.02)
    states = live.publisher(JointState, 'joint_states')
    for k in range(8):
        live.take(states, live.encode(BEGIN + 2000 * k * MS, '', ('slow',), (0.1 * k,)))
        time.sleep(0.05)
        live.node.health.look()
        assert live.node.health.watch.statuses['slow'][0] != LOST
        assert k < 5 or live.node.health.watch.statuses['slow'][0] == TRACKING
    joint = live.node.stream.bank.joints['slow']
    assert joint.silence == pytest.approx(8.0) and joint.events() == {}
    for k in range(200):  # and a fast one is
        live.take(states, live.encode(BEGIN + (20_000 + k) * MS, '', ('fast',), (0.1,)))
    time.sleep(0.3)
    live.node.health.look()
    assert live.node.health.watch.statuses['fast'][0] == LOST
    assert live.node.health.watch.statuses['slow'][0] == TRACKING


def test_a_misconfigured_joint_is_lost_only_when_no_sample_arrives(own):
    from sensor_msgs.msg import JointState

    live = own(AngleStream, observer='hybrid_angle', timeout=0.05, form='paper', epsilon=0.1)
    states = live.publisher(JointState, 'joint_states')
    for k in range(30):  # 25 Hz: too slow for these gains
        live.take(states, live.encode(BEGIN + 40 * k * MS, '', ('j',), (0.01 * k,)))
        time.sleep(0.04)
        live.node.health.look()
    status, why = live.node.health.watch.statuses['j']
    joint = live.node.stream.bank.joints['j']
    assert joint.received - joint.used > joint.silence / 0.04  # for longer than its silence
    assert status == MISCONFIGURED and 'epsilon' in why
    time.sleep(joint.silence + 0.1)
    live.node.health.look()
    assert live.node.health.watch.statuses['j'][0] == LOST


def test_two_clocks_on_one_topic_are_reported(own, capfd):
    from sensor_msgs.msg import JointState

    live = own(AngleStream)
    one, other = (live.publisher(JointState, 'joint_states') for _ in range(2))
    live.take(one, live.encode(BEGIN, '', ['a'], [0.0]))
    live.take(other, live.encode(BEGIN - 10**12, '', ['a'], [0.0]))
    live.reported()
    assert (
        'the clock of the measurements jumped (a looping bag, a restarted simulation, '
        '2 publishers whose clocks differ)'
    ) in capfd.readouterr().err


def test_outputs_of_our_nodes_are_no_hint(own):
    from sensor_msgs.msg import JointState

    live, other = own(AngleStream), own(SwitchedStream, model=f'{__name__}:RAISING')
    assert dds.until(lambda: live.node.count_publishers(f'/{other.node.get_name()}/estimate'))
    [each] = live.node._endpoints.inputs
    assert live.node._endpoints._instead(each) == ''
    driver = live.probe.node.create_publisher(JointState, '/arm/joint_states', 1)
    assert dds.until(lambda: live.node.count_publishers('/arm/joint_states'))
    assert live.node._endpoints._instead(each) == "; did you mean '/arm/joint_states'?"
    live.probe.node.destroy_publisher(driver)


def test_what_a_topic_carries_is_what_came_last(own):
    """Two publishers, so that names are noted all the time."""
    from sensor_msgs.msg import JointState

    live = own(AngleStream, joints=['a', 'b'], timeout=0.05, gap_max=0.05)
    one, _ = live.publisher(JointState, 'joint_states'), live.publisher(JointState, 'joint_states')
    for k in range(150):
        names = ('a', 'b') if k < 20 else ('a', 'a')
        live.take(one, live.encode(BEGIN + k * MS, '', names, (0.1, 0.2)))
        time.sleep(0.01)
        if k in (5, 19, 140):
            live.reported()
        live.node.health.look()
    said = live.reported().message
    assert "joint 'b' is not in /joint_states: check its publisher (it carries a)" in said


@pytest.mark.parametrize(
    ('joint', 'advice'),
    [
        ('elbow_jiont', "did you mean 'elbow'? correct 'per_joint.elbow_jiont.gap_max'"),
        ('zz', "correct 'per_joint.zz.gap_max'"),
    ],
)
def test_a_joint_of_an_override_that_never_comes(joint, advice, own):
    from sensor_msgs.msg import JointState

    live = own(AngleStream, **{f'per_joint.{joint}.gap_max': 0.3})
    states = live.publisher(JointState, 'joint_states')
    live.take(states, live.encode(BEGIN, '', ('elbow', 'wrist'), (0.1, 0.2)))
    live.node.health._detector.first_input -= JOINT_PATIENCE
    expected = f"joint '{joint}' is not in /joint_states: {advice} (it carries elbow, wrist)"
    assert expected in live.reported().message and "'joints'" not in live.reported().message


def test_a_drive_without_stamps_gets_no_advice_on_a_parameter_it_lacks(own, capfd):
    from std_msgs.msg import Float64MultiArray

    motor = own(DriveStream, **MOTOR)
    samples = motor.publisher(Float64MultiArray, 'drive_samples')
    good = drive_samples.encode(np.zeros(5, np.int64), np.zeros((5, 4)))
    motor.take(samples, good, good.replace(b'channel', b'columns'))
    entry = motor.reported()
    said = capfd.readouterr().err
    assert '5 of 5 samples on /drive_samples have no time stamp and are dropped: stamp' in said
    assert 'stamp_source' not in said
    assert '1 of 2 messages on /drive_samples are malformed and dropped: a dimension has' in said
    assert "1 malformed messages (a dimension has the label 'columns'" in entry.message


WRONG = {  # (reading, sample) -> a wrong reading [counts], and for how long it is wrong [s]
    'alternates by a count': (lambda count, k: count + k % 2, 15.0),
    'direction reversed': (lambda count, k: -count, 0.0),  # the reading after it is as good as any
    'of the counter is stuck': (lambda count, k: count & ~8, 3.0),
}


@pytest.mark.parametrize(
    'said, resets', [*((said, False) for said in WRONG), ('alternates by a count', True)]
)
def test_an_encoder_that_counts_wrong_is_a_warning_until_it_was_right_for_a_minute(
    said, resets, own, monkeypatch
):
    """It turns for 8 s and is wrong from 5 s on."""
    arm, (wrong, lasts), reports = own(AngleStream, stamp_source='publisher'), WRONG[said], []
    arm.node.health._diagnostics = type('', (), {'publish': reports.append})
    begun, until = time.monotonic(), 5.0 + lasts + (10.0 if resets else 60.0)
    for k in range(90 * 200):
        second, count = k / 200, int(13.3 * min(k, 1600))
        if second >= 5.0 and (second < 5.0 + lasts or not lasts):
            count = wrong(count, k)
        raw = arm.encode(1, '', ('a',), (count % 4096 * math.pi / 2048,))
        arm.node.stream.feed(0, raw, BEGIN + 5 * k * MS)
        if k % 20 == 0:
            monkeypatch.setattr(
                'estimator_pkg.nodes.health.monotonic', lambda now=begun + second: now
            )
            arm.node.health.look()
        if resets and second == until:
            arm.node.stream.reset()
    for second, raw in enumerate(reports, 1):
        of_node, of_joint = deserialize_message(raw, DiagnosticArray).status
        if second < 5 or second > until + 3:
            assert of_node.level == of_joint.level == b'\x00', second
        elif 7 < second < until - 3:
            assert of_node.level == of_joint.level == b'\x01', second
            assert said in of_node.message and said in of_joint.message


@pytest.mark.parametrize(
    'kind, values',
    [
        (AngleStream, {}),
        (AdaptiveStream, {}),
        (SwitchedStream, {'model': 'gripper'}),
        (MechanicalStream, {}),
        (WheelStream, {'radius': [0.1], 'track': 0.5}),
    ],
)
def test_equal_names_in_a_message_have_their_own_remedy(kind, values, own):
    """The second position repeats the stamp, which is no fault of the stamps."""
    live = own(kind, **values)
    stream = live.node.stream
    names = sorted(stream.needed()) or ['a', 'b']
    names = [*names, 'unknown', 'unknown', names[0]] if stream.needed() else [*names, names[0]]
    for k in range(20):
        numbers = [0.01 * k] * len(names)
        stream.feed(0, live.encode(BEGIN + 10 * k * MS, '', names, numbers, (), numbers), 0)
        said = live.reported().message if k % 10 == 9 else ''
    assert (
        f"joint '{names[0]}' has several positions in 10 of 10 messages on /joint_states, and one "
        'is used: give each joint of the publisher its own name'
    ) in said
    assert 'repeat the previous stamp' not in said


def test_batches_without_a_row_are_reported(own, capfd):
    from std_msgs.msg import Float64MultiArray

    motor = own(DriveStream, **MOTOR)
    samples = motor.publisher(Float64MultiArray, 'drive_samples')
    nothing = drive_samples.encode(np.zeros(0, np.int64), np.zeros((0, 4)))
    one = drive_samples.encode(np.array([BEGIN]), np.zeros((1, 4)))
    text = ' messages on /drive_samples have no row and are dropped: publish at least one sample'
    motor.take(samples, one, one)
    assert text not in motor.reported().message
    motor.take(samples, one, nothing, nothing)
    assert f'2 of 3{text}' in motor.reported().message
    assert f'2 of 3{text}' in capfd.readouterr().err


def fragile(observer):
    """This observer, which gives no numbers at a bandwidth of 123 Hz."""

    class Broken(observer):
        @staticmethod
        def prepare(coefficients, design, dt):
            raise OverflowError('math range error')

    class Fragile(observer):
        @classmethod
        def bound(cls, gains):
            return Broken if gains.bandwidth_hz == 123.0 else observer

    return Fragile


@dataclasses.dataclass(frozen=True)
class FragileSettings(AngleSettings):
    def find_observer(self):
        return fragile(super().find_observer())


class Fragile(AngleStream):
    SETTINGS = FragileSettings


def test_gains_that_give_no_numbers_are_refused(own):
    from sensor_msgs.msg import JointState

    reported = r'numbers become too large or too small for these gains \(math range error\)'
    live = own(Fragile, observer='hybrid_angle')
    states = live.publisher(JointState, 'joint_states')
    live.take(states, live.encode(BEGIN, '', ['a'], [0.0]))
    result = live.node.set_parameters_atomically(ros_values({'bandwidth_hz': 123.0}))
    assert not result.successful and re.fullmatch(reported, result.reason)
    assert live.node.get_parameter('bandwidth_hz').value != 123.0
    assert live.take(states, live.encode(BEGIN + MS, '', ['a'], [0.0]))['used'] == 2
    with pytest.raises(UsageError, match=f'hybrid_angle: {reported}'):
        own(Fragile, observer='hybrid_angle', bandwidth_hz=123.0)
