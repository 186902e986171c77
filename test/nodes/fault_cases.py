# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How each fault of a node is caused: the cases of test_faults.py."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import dds
import motors
import numpy as np
import rclpy
from own_node import OwnNode
from rclpy.context import Context
from std_msgs.msg import Float64, Float64MultiArray

from estimator_pkg.messages import drive_samples
from estimator_pkg.models import gripper

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


def wrong_event(run):
    event = run.own.encode(time.time_ns() + MS, '', ('opne',))
    run.own.publishers['events'].publish(event)


def stuck_bit(run):
    start = run.__dict__.setdefault('start_ns', time.time_ns())
    for number in range(4 * run.k, 4 * run.k + 4):  # 200 Hz
        count = int(13.3 * number) & ~(8 * run.caused)
        stamp, angle = start + number * 5 * MS, count % 4096 * math.pi / 2048
        run.send(names=('a',), stamp_ns=stamp, position=angle)


later = partial(Case, later=True, estimates=True)  # it comes while all is well, which goes on
drive_case = partial(Case, begin=inverter, kind='drive', parameters=MOTOR, publishers=())

CASES = {
    'nobody': Case(
        'nobody',
        r'nobody publishes SPACE/joint_states \(sensor_msgs/msg/JointState\): .*-r joint_states:='
        ".*; did you mean 'SPACE/arm/joint_states'",
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
    'shared': later(
        'shared',
        'SPACE/joint_observer publishes SPACE/joint_observer/estimate as this node does.*'
        "'-r __node:=NAME'",
        inject=lambda run: run.own.publisher('joint_observer', topic='joint_observer/estimate'),
    ),
    'missing': Case(
        'missing',
        r"SPACE/joint_states does not carry joint 'shoulder': did you mean 'shoulder_pan_joint'\? "
        r"correct 'joints' .* \(it carries elbow_joint, shoulder_lift_joint, shoulder_pan_joint\)",
        parameters={'joints': ['shoulder']},
    ),
    'twice': later(
        'twice',
        r'SPACE/driver and SPACE/relay send 3 joints \(.*\) on SPACE/joint_states, .*: stop one',
        by_both,
        inject=lambda run: run.own.publisher('relay'),
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
    'ended, one of two': later(
        'silent',
        "no sample of joint 'finger' on SPACE/joint_states for .* s: SPACE/gripper ended; start",
        arm_and_finger,
        publishers=('driver', 'gripper'),
        inject=lambda run: run.own.gone('gripper'),
    ),
    'silent, a joint': later(
        'silent',
        "no sample of joint 'elbow_joint' on SPACE/joint_states .*: check SPACE/driver .*elbow, ",
        lambda run: run.send(names=(*ARM[:2], 'elbow') if run.caused else ARM),
    ),
    'sensor': later(
        'sensor',
        "the sensor of 'a' on SPACE/joint_states may be faulty: .*of the counter is stuck",
        stuck_bit,
    ),
    'malformed': drive_case(
        'malformed',
        r"\d+ of \d+ messages are malformed .*SPACE/drive_samples: .*'columns', not 'channel'",
        lambda run: drive(run, (b'channel', b'columns')),
    ),
    'without efforts': Case(
        'unused',
        r"\d+ of \d+ messages on SPACE/joint_states have no effort .*'input: effort_command'",
        lambda run: run.send(efforts=[]),
        kind='angle_and_input',
    ),
    'without rows': drive_case(
        'unused',
        r'\d+ of \d+ messages on SPACE/drive_samples have no row and are dropped: publish at least',
        empty,
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
    'lost': later(
        'lost',
        r'\d+ of \d+ messages on SPACE/joint_states were lost in \d s: .*lower it',
        too_many,
        parameters={'qos_overrides.SPACE/joint_states.subscription.depth': 8},
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
    'duplicate': later(
        'duplicate',
        r'\d+ of \d+ samples on SPACE/joint_states repeat the previous stamp .* reading of its own',
        twice_stamped,
    ),
    'one name twice in a message': Case(
        'duplicate',
        r'\d+ of \d+ samples on SPACE/joint_states repeat the previous stamp .* each joint once',
        lambda run: run.send(names=('a', 'b', 'a')),
        estimates=True,
    ),
    'late': later(
        'late',
        r'\d+ of \d+ samples on SPACE/joint_states are older than the previous one',
        going_back,
    ),
    'repeated': later(
        'repeated',
        r'\d+ of \d+ samples on SPACE/joint_states repeat the previous reading .*publish each',
        repeating,
    ),
    'jump': later(
        'jump',
        'the clock of the measurements jumped, and all joints are reset: a looping bag',
        lambda run: run.send(stamp_ns=time.time_ns() - 10**12 * run.caused),
    ),
    'failed': later(
        'failed',
        r'the observer failed on a message of SPACE/\w+, and all joints are reset: '
        r"KeyError: 'opne' \(line ",
        lambda run: run.send(names=('joint',), position=1e-3 * run.k),
        begin=lambda run: run.own.publisher('events', topic='switch_event'),
        inject=wrong_event,
        kind='switched',
        parameters={'model': f'{__name__}:RAISING'},
    ),
    'unusable': later(
        'unusable',
        r'3 joints \(.*\): no usable sample for 0\.5 s; all \d+ received samples are dropped: '
        'their numbers are not finite',
        lambda run: run.send(position=math.nan if run.caused else 0.1),
    ),
    'expired': later(
        'expired',
        r'3 joints \(.*\) removed: no sample for 1 s \(expiry\)',
        lambda run: run.send(names=('other',) if run.caused else ARM),
        parameters={'expiry': 1.0},
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
