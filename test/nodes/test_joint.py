# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The node joint_observer, in a process of its own, over real DDS."""

import itertools
import math
import time

import dds
import numpy as np
import pytest
from answers import estimated
from answers import valid as valid_of

from estimator_pkg import observers
from estimator_pkg.circle import wrap
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.configuration import Configuration

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


def test_estimates_are_right_and_carry_the_stamp_of_the_measurement(live):
    answers = live.feed(turning(live, ['right_a', 'right_b'], [30.0, -20.0], 600))
    assert [answer.stamp_ns for answer in answers] == [BEGIN + i * MS for i in range(600)]
    assert {answer.frame_id for answer in answers} == {'base'}
    assert answers[0].names == ('right_a', 'right_b') and estimated(answers[0]) == ()  # not settled
    for i, answer in enumerate(answers[200:], 200):
        assert answer.names == ('right_a', 'right_b')
        assert answer.velocities == pytest.approx((30.0, -20.0), rel=1e-6)
        for speed, position in zip((30.0, -20.0), answer.positions):
            assert -math.pi <= position < math.pi
            assert wrap(position - speed * i * 1e-3, TURN) == pytest.approx(0.0, abs=1e-6)
        assert answer.efforts == ()


def joint_entry(report, name):
    return report[f'/joint_observer: {name}']


def test_bad_input_is_counted_by_kind_and_the_node_lives_on(live):
    bad = fresh('bad')
    before = live.next_report()['/joint_observer']
    live.feed(turning(live, [bad], [1.0], 300))
    at = BEGIN + 299 * MS
    far = at + 10**15

    def one(stamp, *positions, names=(bad,)):
        return live.encode(stamp, names, positions)

    live.feed(
        [
            one(at + MS, math.nan),
            one(at + MS, math.inf),
            one(at + MS, -math.inf),
            one(at, 0.3),
            one(at, 0.3),  # equal stamps
            one(at - 5 * MS, 0.29),  # late
            one(0, 0.3),  # no stamp
            one(at + 2 * MS, names=()),
            one(at + 2 * MS),  # empty
            one(at + 2 * MS, 0.3, 0.4),
            one(at + 2 * MS, 0.3, names=(bad, 'worse')),
            one(far, 0.301),
            one(at + 3 * MS, 0.302),
        ],
        unanswered=range(11),
    )  # one stamp from the far future
    live.publisher.publish(b'\x00\x01\x00\x00nonsense')
    live.publisher.publish(one(at + 4 * MS, 0.303)[:-5])
    for loop in range(2):  # a bag that loops
        live.feed(turning(live, [bad], [1.0], 300, begin=BEGIN - (loop + 1) * 10**12))
    after = live.next_report()
    joint = {
        key: int(count)
        for key, count in joint_entry(after, bad).items()
        if key.partition('.')[0] in ('received', 'used', 'dropped', 'events')
    }
    dropped = {
        key.partition('.')[2]: count for key, count in joint.items() if key.startswith('dropped.')
    }
    assert dropped == {
        'duplicate': 2,
        'late': 1,
        'non_finite': 3,
        'zero_stamp': 1,
        'misconfigured': 0,
        'repeated': 0,
    }
    assert joint['events.outage'] == 1 and joint['events.stray_stamp'] == 1
    assert joint['events.clock_jump'] == 2
    assert joint['received'] == joint['used'] + sum(dropped.values()) == 300 + 7 + 2 + 600
    new = {
        key: int(after['/joint_observer'][key]) - int(before[key])
        for key in before
        if key.startswith('messages_')
    }
    assert new['messages_dropped.malformed'] == 2
    assert new['messages_dropped.empty'] == 2
    assert new['messages_dropped.mismatched'] == 2
    assert new['messages_received'] == new['messages_used'] + 6 == 300 + 13 + 2 + 600
    assert live.answers[-1].velocities == pytest.approx((1.0,), rel=1e-6)
    assert live.process.alive and 'Traceback' not in live.process.output
    for reported in (
        'have no time stamp',
        'stamp_source: publisher',
        'clock of the measurements',
        'are malformed',
    ):
        live.process.prints(reported)


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


def test_a_driver_that_repeats_one_stamp_is_lost_too(live):
    stuck = fresh('stuck')
    live.feed(turning(live, [stuck], [1.0], 400))
    end = time.monotonic() + dds.PATIENCE
    while live.status(stuck) != 'lost' and time.monotonic() < end:
        live.feed(turning(live, [stuck], [1.0], 1, first=399), unanswered=[0])
        live.probe.spin(0.02)
    assert live.status(stuck) == 'lost'


def test_reset_starts_every_joint_again(live):
    from std_srvs.srv import Trigger

    again = fresh('again')
    assert estimated(live.feed(turning(live, [again], [1.0], 400))[-1]) == (again,)
    answer = live.probe.call(Trigger, '/joint_observer/reset', Trigger.Request())
    assert answer.success and 'are reset' in answer.message
    assert live.feed(turning(live, [again], [1.0], 1, first=400))[-1].names == (again,)
    assert not estimated(live.answers[-1])
    assert joint_entry(live.next_report(), again)['resets'] == '1'


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


# Outputs made only while somebody listens
