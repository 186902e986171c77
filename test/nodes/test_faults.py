# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Each row of the table of faults is reported in three ways where it is present, and not elsewhere.

``python test/nodes/test_faults.py`` prints the table of docs/troubleshooting.md.
"""

from __future__ import annotations

import dataclasses
import math
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

if __name__ == '__main__':
    TEST = Path(__file__).parents[1]
    sys.path[:0] = [str(TEST / 'support')]

import dds
import motors
import numpy as np
import rclpy
from own_node import BEGIN, OwnNode, logged
from rclpy.context import Context
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Float64MultiArray

from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import LOST, MISCONFIGURED, TRACKING
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.models import gripper
from estimator_pkg.nodes import faults, senders
from estimator_pkg.nodes.ros_parameters import ros_values
from estimator_pkg.observers.contract import Observer
from estimator_pkg.streams.angle import AngleSettings, AngleStream

DOCS = Path(__file__).parents[2] / 'docs/troubleshooting.md'
LONGEST = 5.0  # [s] from a cause to its report
PER_LOOK = 5  # messages in 0.1 s
HEALTHY = 4.0  # [s] before a cause that comes later
ARM = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint')
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
MS = 1_000_000


def raising(mode):
    """What is wrong in a user's model."""
    return {'': None, 'close': None}[mode]


RAISING = dataclasses.replace(gripper.MODEL, transition=raising)


class Run:
    """A node that is fed with a stream; a case changes it from the cause on."""

    def __init__(self, patch, name, case):
        self.case, self.k, self.caused = case, 0, not case.later
        cli = dds.ros_args(remap=[f'/clock:=/{name}/clock'])
        values = {key.replace('SPACE', f'/{name}'): value for key, value in case.parameters.items()}
        self.own = OwnNode(patch, case.kind, name, tuple(cli), **values)
        for each in case.publishers:
            self.own.publisher(each)

    def send(self, by='driver', names=ARM, **options):
        """Joints that move, with efforts."""
        k = options.pop('k', self.k)
        position = options.pop('position', 0.5 * math.sin(0.08 * k))
        options.setdefault('efforts', [0.1] * len(names))
        self.own.send(names, [position] * len(names), by=by, **options)

    def tick(self):
        for _ in range(PER_LOOK):
            self.case.tick(self)
            self.k += 1
            time.sleep(2e-4)  # the stamps differ

    def run(self):
        case, own = self.case, self.own
        case.begin(self)
        if case.later:
            own.connect()
            own.pass_time(HEALTHY, self.tick)
            self.caused = True
        cause = own.now
        case.inject(self)
        own.pass_time(LONGEST + case.more + 1.0, self.tick)
        return cause


def nothing(run):
    """No message."""


@dataclasses.dataclass(frozen=True)
class Case:
    """How a fault is caused.

    row : of the table. report : pattern of the report. later : the cause comes later.
    estimates : there are estimates all the same. more : it takes so much longer [s].
    """

    row: str
    report: str
    tick: Callable[[Run], Any] = Run.send
    begin: Callable[[Run], Any] = nothing
    inject: Callable[[Run], Any] = nothing
    kind: Any = 'angle'
    parameters: dict = dataclasses.field(default_factory=dict)
    publishers: tuple = ('driver',)
    later: bool = False
    estimates: bool = False
    more: float = 0.0


def of_another_type(run):
    """One process has one type on a topic in each context."""
    context = Context()
    rclpy.init(context=context, domain_id=dds.DOMAIN)
    run.own.publisher('arduino', Float64, context=context)
    assert dds.until(lambda: run.own.node.count_publishers('joint_states'))


def drive(run, replaced=(b'', b''), **values):
    if not run.k % PER_LOOK:
        ((stamps, samples),) = motors.steady(1, run.k // PER_LOOK)
        raw = drive_samples.encode(stamps, samples)
        run.own.publishers['inverter'].publish(raw.replace(*replaced))


def inverter(run):
    run.own.publisher('inverter', Float64MultiArray, 'drive_samples')


def empty(run):
    none = drive_samples.encode(np.zeros(0, np.int64), np.zeros((0, 4)))
    run.own.publishers['inverter'].publish(none)


def by_both(run, **of_the_other):
    for number, by in enumerate(run.own.publishers):
        run.send(by, **(of_the_other if number else {}))


def arm_and_finger(run):
    for by, names in zip(run.own.publishers, (ARM, ('finger',))):
        run.send(by, names)


def present(run, **options):
    if run.own.publishers:
        run.send(**options)


def twice_stamped(run):
    stamp = time.time_ns()
    for _ in range(1 + run.caused):
        run.send(stamp_ns=stamp)


def repeating(run):
    stamp = run.__dict__.setdefault('start_ns', time.time_ns()) + run.k * 5 * MS
    run.send(stamp_ns=stamp, k=run.k // 5 * 5 if run.caused else run.k)


def going_back(run):
    run.send(stamp_ns=time.time_ns() - (3 * MS if run.caused and run.k % 2 else 0))


def too_many(run):
    for step in range(50 if run.caused else 1):
        run.send(stamp_ns=time.time_ns() + step)


def back_again(run):
    run.own.gone('driver')
    run.own.pass_time(2.0)
    run.own.publisher('driver')


def wrong_event(run):
    event = run.own.encode(time.time_ns() + MS, '', ('opne',))
    run.own.publishers['events'].publish(event)


def stuck_bit(run):
    start = run.__dict__.setdefault('start_ns', time.time_ns())
    for number in range(4 * run.k, 4 * run.k + 4):  # 200 Hz
        count = int(13.3 * number) & ~(8 * run.caused)
        stamp, angle = start + number * 5 * MS, count % 4096 * math.pi / 2048
        run.send(names=('a',), stamp_ns=stamp, position=angle)


CASES = {
    'nobody': Case(
        'nobody',
        r'nobody publishes SPACE/joint_states \(sensor_msgs/msg/JointState\): .*-r joint_states:=',
        tick=nothing,
        publishers=(),
    ),
    'another topic': Case(
        'nobody',
        "nobody publishes SPACE/joint_states .*; did you mean 'SPACE/arm/joint_states'",
        tick=nothing,
        begin=lambda run: run.own.publisher('arm', topic='arm/joint_states'),
        publishers=(),
    ),
    'type': Case(
        'type',
        'SPACE/arduino publishes std_msgs/msg/Float64 on SPACE/joint_states, where this node '
        'needs sensor_msgs/msg/JointState: .*remap',
        tick=nothing,
        begin=of_another_type,
        publishers=(),
    ),
    'qos': Case(
        'qos',
        'a publisher on SPACE/joint_states has an incompatible QoS .*: SPACE/driver .*eliab.*'
        "'qos_overrides.SPACE/joint_states.subscription'",
        tick=nothing,
        begin=lambda run: run.own.publisher('driver', reliable=False),
        parameters={'qos_overrides.SPACE/joint_states.subscription.reliability': 'reliable'},
        publishers=(),
    ),
    'mute': Case(
        'mute', 'SPACE/driver publishes SPACE/joint_states, but no message has arrived', nothing
    ),
    'shared': Case(
        'shared',
        'SPACE/joint_observer publishes SPACE/joint_observer/estimate as this node does.*'
        "'-r __node:=NAME'",
        inject=lambda run: run.own.publisher('joint_observer', topic='joint_observer/estimate'),
        later=True,
        estimates=True,
    ),
    'missing': Case(
        'missing',
        r"SPACE/joint_states does not carry joint 'shoulder': did you mean 'shoulder_pan_joint'\? "
        r"correct 'joints' .* \(it carries elbow_joint, shoulder_lift_joint, shoulder_pan_joint\)",
        parameters={'joints': ['shoulder']},
    ),
    'missing of an override': Case(
        'missing',
        r"does not carry joint 'zz': correct 'joints' or 'per_joint' \(it carries elbow",
        parameters={'per_joint.zz.gap_max': 0.3},
        estimates=True,
    ),
    'twice': Case(
        'twice',
        r'SPACE/driver and SPACE/relay send 3 joints \(.*\) on SPACE/joint_states, .*: stop one',
        by_both,
        inject=lambda run: run.own.publisher('relay'),
        later=True,
        estimates=True,
    ),
    'twice, of one joint': Case(
        'twice',
        "SPACE/driver and SPACE/relay send joint 'elbow_joint' on",
        lambda run: by_both(run, names=('elbow_joint', 'finger'), position=-1.0),
        inject=lambda run: run.own.publisher('relay'),
        later=True,
        estimates=True,
    ),
    'equal_names': Case(
        'equal_names',
        r"\d+ of \d+ messages on SPACE/joint_states have several positions of joint 'a', .* name",
        lambda run: run.send(names=('a', 'b', 'a')),
        estimates=True,
    ),
    'ended': Case(
        'silent',
        'no message on SPACE/joint_states for .* s: SPACE/driver ended; start it again',
        present,
        inject=lambda run: run.own.gone('driver'),
        later=True,
    ),
    'silent': Case(
        'silent',
        'no message on SPACE/joint_states for .* s: check that SPACE/driver runs',
        lambda run: run.caused or run.send(),
        later=True,
    ),
    'ended, one of two': Case(
        'silent',
        "no sample of joint 'finger' on SPACE/joint_states for .* s: SPACE/gripper ended; start",
        arm_and_finger,
        publishers=('driver', 'gripper'),
        inject=lambda run: run.own.gone('gripper'),
        later=True,
        estimates=True,
    ),
    'silent, a joint': Case(
        'silent',
        "no sample of joint 'elbow_joint' on SPACE/joint_states .*: check SPACE/driver .*elbow, ",
        lambda run: run.send(names=(*ARM[:2], 'elbow') if run.caused else ARM),
        later=True,
        estimates=True,
    ),
    'back': Case(
        'back',
        r'the messages are back on SPACE/joint_states: the outage lasted \d\.\d s',
        inject=back_again,
        later=True,
        estimates=True,
    ),
    'sensor': Case(
        'sensor',
        "the sensor of 'a' on SPACE/joint_states may be faulty: .*of the counter is stuck",
        stuck_bit,
        later=True,
        estimates=True,
    ),
    'malformed': Case(
        'malformed',
        r"\d+ of \d+ messages are malformed .*SPACE/drive_samples: .*'columns', not 'channel'",
        lambda run: drive(run, (b'channel', b'columns')),
        begin=inverter,
        kind='drive',
        parameters=MOTOR,
        publishers=(),
    ),
    'without positions': Case(
        'unused',
        r'\d+ of \d+ messages on SPACE/joint_states carry no position .*remap the input',
        lambda run: run.own.send(ARM, [], velocities=[0.1] * 3),
    ),
    'without efforts': Case(
        'unused',
        r"\d+ of \d+ messages on SPACE/joint_states have no effort .*'input: effort_command'",
        lambda run: run.send(efforts=[]),
        kind='angle_and_input',
    ),
    'without rows': Case(
        'unused',
        r'\d+ of \d+ messages on SPACE/drive_samples have no row and are dropped: publish at least',
        empty,
        begin=inverter,
        kind='drive',
        parameters=MOTOR,
        publishers=(),
    ),
    'mismatched': Case(
        'mismatched',
        r'\d+ of \d+ messages on SPACE/joint_states are dropped: their names and positions differ',
        lambda run: run.own.send(ARM, [0.1]),
    ),
    'refused': Case(
        'refused',
        r"\d+ of \d+ samples on SPACE/joint_states are beyond joints_max .*'elbow_joint'; 2 joints",
        parameters={'joints_max': 2},
        estimates=True,
    ),
    'lost': Case(
        'lost',
        r'\d+ of \d+ messages on SPACE/joint_states were lost in \d s: .*lower it',
        too_many,
        parameters={'qos_overrides.SPACE/joint_states.subscription.depth': 8},
        later=True,
        estimates=True,
    ),
    'zero_stamp': Case(
        'zero_stamp',
        r"\d+ of \d+ samples on SPACE/joint_states have no time stamp .*'stamp_source: publisher'",
        lambda run: run.send(stamp_ns=0),
    ),
    'no_clock': Case(
        'no_clock',
        "use_sim_time is true, but nobody publishes /clock: .*'--clock'",
        parameters={'use_sim_time': True},
        estimates=True,
    ),
    'clock': Case(
        'clock',
        r"stamps on SPACE/joint_states are -36\d\d\.\d s from this node's clock .*: check",
        lambda run: run.send(stamp_ns=time.time_ns() - 3600 * 1000 * MS),
        estimates=True,
    ),
    'duplicate': Case(
        'duplicate',
        r'\d+ of \d+ samples on SPACE/joint_states repeat the previous stamp .* reading of its own',
        twice_stamped,
        later=True,
        estimates=True,
    ),
    'late': Case(
        'late',
        r'\d+ of \d+ samples on SPACE/joint_states are older than the previous one',
        going_back,
        later=True,
        estimates=True,
    ),
    'repeated': Case(
        'repeated',
        r'\d+ of \d+ samples on SPACE/joint_states repeat the previous reading .*publish each',
        repeating,
        later=True,
        estimates=True,
    ),
    'jump': Case(
        'jump',
        'the clock of the measurements jumped, and all joints are reset: a looping bag',
        lambda run: run.send(stamp_ns=time.time_ns() - 10**12 * run.caused),
        later=True,
        estimates=True,
    ),
    'failed': Case(
        'failed',
        r'the observer failed on a message of SPACE/\w+, and all joints are reset: '
        r"KeyError: 'opne' \(line ",
        lambda run: run.send(names=('joint',), position=1e-3 * run.k),
        begin=lambda run: run.own.publisher('events', topic='switch_event'),
        inject=wrong_event,
        kind='switched',
        parameters={'model': f'{__name__}:RAISING'},
        later=True,
        estimates=True,
    ),
    'unusable': Case(
        'unusable',
        r'3 joints \(.*\): no usable sample for 0\.5 s; all \d+ received samples are dropped: '
        'their numbers are not finite',
        lambda run: run.send(position=math.nan if run.caused else 0.1),
        later=True,
        estimates=True,  # at first
    ),
    'expired': Case(
        'expired',
        r'3 joints \(.*\) removed: no sample for 1 s \(expiry\)',
        lambda run: run.send(names=('other',) if run.caused else ARM),
        parameters={'expiry': 1.0},
        later=True,
        estimates=True,
    ),
    'nothing': Case(
        'nothing',
        r'no estimate for \d s, though messages come on SPACE/drive_samples: .*\(wrong flux, ',
        drive,
        begin=inverter,
        kind='drive',
        parameters={**MOTOR, 'flux': 5.7e-3},
        publishers=(),
        more=4.0,
    ),
}


@pytest.fixture
def own(probe, monkeypatch):
    """(kind, parameters) -> a node in this process."""
    made = []

    def start(kind, **values):
        made.append(OwnNode(monkeypatch, kind, **values))
        return made[-1]

    yield start
    for each in made:
        each.close()


@pytest.mark.parametrize('name', CASES)
def test_a_fault_is_reported_in_three_ways_in_time_and_once(name, probe, monkeypatch, capfd):
    case, space = CASES[name], re.sub(r'\W+', '_', f'fault_{name}')
    (row,) = [fault for fault in faults.FAULTS if fault.name == case.row]
    run = Run(monkeypatch, space, case)
    try:
        cause = run.run()
    finally:
        run.own.close()
    report, latest = case.report.replace('SPACE', f'/{space}'), cause + LONGEST + case.more
    text = capfd.readouterr().err
    lines = [(level, line) for level, line in logged(text) if re.search(report, line)]
    assert len(lines) == 1, text
    for reports in (run.own.status, run.own.diagnostics):
        when = [now for now, entry in reports if re.search(report, entry.message)]
        assert when and cause <= when[0] <= latest, (name, [each.message for _, each in reports])
        levels = {entry.level for now, entry in reports if now >= when[0]}
        assert case.estimates or b'\x00' not in levels
    if any(run.own.node.stream.received) and not (case.later or case.estimates or row.harmless):
        assert [level for level, _ in logged(text)].count('ERROR') == 1


def test_every_row_has_a_case():
    assert {case.row for case in CASES.values()} == {fault.name for fault in faults.FAULTS}


@pytest.mark.parametrize('simulated', [False, True])
def test_without_a_fault_there_is_no_report(simulated, probe, monkeypatch, capfd):
    """Disjoint joints of two publishers; simulated time that begins at 0."""

    def tick(run):
        if not simulated:
            return arm_and_finger(run)
        stamp, message = run.k * 20 * MS, Clock()
        message.clock.sec, message.clock.nanosec = divmod(stamp, 10**9)
        run.own.publishers['clock'].publish(message)
        return run.send(stamp_ns=stamp)

    space = f'fine_{simulated}'.lower()
    publishers = ('driver',) if simulated else ('driver', 'gripper')
    run = Run(
        monkeypatch,
        space,
        Case('', '', tick, publishers=publishers, parameters={'use_sim_time': simulated}),
    )
    try:
        if simulated:
            run.own.publisher('clock', Clock, 'clock')
        run.run()
    finally:
        run.own.close()
    text = capfd.readouterr().err
    some = r'3 joints of' if simulated else r'4 joints of'
    assert len(re.findall(rf'tracking {some} /{space}/joint_states at \d+(\.\d)? Hz \(', text)) == 1
    assert {level for level, _ in logged(text)} == {'INFO'}, text
    assert run.own.status[-1][1].level == run.own.diagnostics[-1][1].level == b'\x00'


SHOWN = {'count': 'N', 'received': 'M', 'kept': 'joint', 'hint': '', 'meant': '', 'other': ''}


def words(text):
    """A text of the table with its places as words."""
    return re.sub(r'\{(\w+)[^}]*\}', lambda found: SHOWN.get(found[1], found[1].upper()), text)


def table():
    """The rows in the docs."""
    for fault in faults.FAULTS:
        yield f'| {fault.cause} | {words(fault.text)} | {words(fault.remedy)} |'


def test_the_docs_have_the_table():
    lines = DOCS.read_text().splitlines()
    assert not [line for line in table() if line not in lines]


# ---------------------------------------------------------------- when a fault is reported


def test_a_lasting_fault_is_logged_once_and_again_after_it_was_gone():
    written = []
    found = faults.Faults(lambda fault, text: written.append(text))
    late = {'late': (faults.FAULTS[0], 'text')}
    for second in range(10):
        found.update(late, float(second))
    assert written == ['text'] and found.present == {'late': 'text'}
    found.update({}, 10.0)
    assert found.present == {}
    found.update(late, 9.0 + faults.AGAIN)  # it flickers
    assert written == ['text']
    for second in (20.0, 30.0):
        found.update({}, second - 1.0)
        found.update(late, second)
    assert written == ['text'] * 3 and len(found._shown) == 1


def saw(runs, monkeypatch):
    """Return the joints that come twice, after messages of 5 ms: (number, is lost) of each."""
    now = [0.0]
    monkeypatch.setattr(senders, 'monotonic', lambda: now[0])
    heard, raw = senders.Senders(True), Encoder().encode(10**18, '', ['elbow'], [0.0])
    heard.several, found = True, []
    for number, lost in runs:
        now[0] += 0.005
        if not lost:
            heard.saw(raw, number)
        found += heard.twice(now[0])
    return found


@pytest.mark.parametrize('seed', range(5))
def test_two_publishers_of_a_joint_are_told_from_one_that_is_started_again(seed, monkeypatch):
    random = np.random.default_rng(seed)
    starts = zip(random.integers(1, 60, 8), random.integers(100, 400, 8))
    numbers = [first + k for first, count in starts for k in range(count)]
    assert not saw(zip(numbers, random.random(len(numbers)) < 0.1), monkeypatch)
    numbers, due = random.integers(1, 300, 2), [0.0, 0.0]
    numbers[1] = numbers[seed % 2]  # half of them in step
    periods, sent = random.uniform(0.5, 5.0, 2), []
    while len(sent) < 1000:
        one = int(due[1] < due[0])
        sent.append(int(numbers[one]))
        numbers[one] += 1
        due[one] += periods[one]
    assert saw(zip(sent, random.random(1000) < 0.1), monkeypatch)[-1:] == ['elbow']


# ---------------------------------------------------------------- statuses


def test_what_is_not_estimated_is_reported_but_not_each_standstill(own, capfd):
    """Seconds of a motor: at rest at the start, then it turns, stops, and loses its voltage."""
    live, row = own('drive', **MOTOR), 0
    motor = live.node.stream.joint

    def seconds(count, turns, voltage=1.0):
        """Return the errors about missing estimates in so many seconds."""
        nonlocal row
        for _ in range(count):
            for stamps, values in motors.steady(50, row, turns):
                raw = drive_samples.encode(stamps, values * (1.0, 1.0, voltage, voltage))
                live.node.stream.feed(0, raw, 0)
            row += 50
            live.now += 1.0
            live.node.health.look()
        said = logged(capfd.readouterr().err)
        return [line for level, line in said if level == 'ERROR' and 'no estimate' in line]

    (said,) = seconds(8, 0.0)
    assert 'no estimate for 4 s, though messages come on /drive_samples: back-EMF' in said
    assert not seconds(3, 100.0) and motor.estimate()[3] == TRACKING
    assert not seconds(8, 0.0) and motor.needs_motion
    (said,) = seconds(8, 100.0, voltage=0.0)
    assert 'all voltages are zero: is the voltage connected?' in said


def test_a_slow_stream_is_not_lost_between_two_samples_and_a_misconfigured_joint_when_none_comes(
    own,
):
    live = own('angle', timeout=0.5)
    feed, statuses = live.node.stream.feed, live.node.health.watch.statuses
    for k in range(8):  # 0.5 Hz: lost after four sample times
        feed(0, live.encode(BEGIN + 2000 * k * MS, '', ('slow',), (0.1 * k,)), 0)
        live.pass_time(2.0)
        assert statuses['slow'][0] != LOST and (k < 5 or statuses['slow'][0] == TRACKING)
    for k in range(200):  # and a fast one
        feed(0, live.encode(BEGIN + (20_000 + k) * MS, '', ('fast',), (0.1,)), 0)
    live.pass_time(0.8)
    assert (statuses['fast'][0], statuses['slow'][0]) == (LOST, TRACKING)
    live = own('angle', observer='hybrid_angle', form='paper', epsilon=0.1)
    statuses = live.node.health.watch.statuses
    for k in range(40):  # 25 Hz: too slow for these gains
        live.node.stream.feed(0, live.encode(BEGIN + 40 * k * MS, '', ('j',), (0.01 * k,)), 0)
        live.pass_time(0.1)
    assert statuses['j'][0] == MISCONFIGURED and 'epsilon' in statuses['j'][1]
    live.pass_time(live.node.stream.bank.joints['j'].silence + 0.2)
    assert statuses['j'][0] == LOST


WRONG = {  # (reading, sample) -> a wrong reading [counts], and for how long it is wrong [s]
    'direction reversed': (lambda count, k: -count, 0.0),  # the reading after it is as good as any
    'of the counter is stuck': (lambda count, k: count & ~8, 3.0),
}


@pytest.mark.parametrize('said', WRONG)
def test_an_encoder_that_counts_wrong_is_a_warning_until_it_was_right_for_a_minute(said, own):
    """It turns for 8 s and is wrong from 5 s on."""
    arm, (wrong, lasts) = own('angle', stamp_source='publisher'), WRONG[said]
    until = 5.0 + lasts + 60.0
    for k in range(70 * 200):
        second, count = k / 200, int(13.3 * min(k, 1600))
        if second >= 5.0 and (second < 5.0 + lasts or not lasts):
            count = wrong(count, k)
        raw = arm.encode(1, '', ('a',), (count % 4096 * math.pi / 2048,))
        arm.node.stream.feed(0, raw, BEGIN + 5 * k * MS)
        if k % 20 == 0:
            arm.now = arm.begun + second
            arm.node.health.look()
    for when, entry in arm.diagnostics:
        if when - arm.begun < 5 or when - arm.begun > until + 2:
            assert entry.level == b'\x00', when
        elif 7 < when - arm.begun < until - 3:
            assert entry.level == b'\x01' and said in entry.message


class FragileObserver(Observer):
    """It gives no numbers at a bandwidth of 123 Hz."""

    def module_of(self, gains):
        def prepare(coefficients, design, dt):
            raise OverflowError('math range error')

        if gains.bandwidth_hz != 123.0:
            return self.module
        made = ModuleType('fragile')
        vars(made).update({**vars(self.module), 'prepare': prepare, '__name__': 'fragile'})
        return made


@dataclasses.dataclass(frozen=True)
class FragileSettings(AngleSettings):
    def find_observer(self):
        return FragileObserver(**vars(super().find_observer()))


class Fragile(AngleStream):
    SETTINGS = FragileSettings


def test_gains_that_give_no_numbers_are_refused(own):
    reported = r'numbers become too large or too small for these gains \(math range error\)'
    live = own(Fragile, observer='hybrid_angle')
    live.node.stream.feed(0, live.encode(BEGIN, '', ['a'], [0.0]), 0)
    result = live.node.set_parameters_atomically(ros_values({'bandwidth_hz': 123.0}))
    assert not result.successful and re.fullmatch(reported, result.reason)
    assert live.node.get_parameter('bandwidth_hz').value != 123.0
    with pytest.raises(UsageError, match=f'hybrid_angle: {reported}'):
        own(Fragile, observer='hybrid_angle', bandwidth_hz=123.0)


if __name__ == '__main__':
    print('| Fault | Report | Remedy |\n|---|---|---|', *table(), sep='\n')
