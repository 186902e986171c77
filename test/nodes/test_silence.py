# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Each fault that keeps a node silent is injected over DDS, and reported in three ways within 5 s.

``python test/nodes/test_silence.py`` injects all and prints the table of docs/troubleshooting.md.
The tests inject them in a process of its own: DDS may crash, or wait for ever, when endpoints end.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from contextlib import suppress
from pathlib import Path

import pytest

if __name__ == '__main__':
    TEST = Path(__file__).parents[1]
    sys.path[:0] = [str(TEST), str(TEST / 'support')]
    import conftest  # noqa: F401  the profile of discovery

import dds
import motors
import numpy as np

from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.joint_state import Encoder

DOCS = Path(__file__).parents[2] / 'docs/troubleshooting.md'
NODES = 'estimator_pkg.nodes.executables'
WAYS = {'terminal', '~/status', '/diagnostics'}
LONGEST = 5.0  # [s] from a cause to its report
AFTER = 2.5  # [s] for which the test looks for a second report
WORLD = 100.0  # [s] for all of them
TOGETHER = 10  # nodes at once
HEALTHY = 2.0  # [s] after the good news until a cause that comes later: the rate is known by then
RATE = 50.0  # [Hz]
ARM = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint')
MOTOR = ['resistance:=0.06', 'inductance:=33.75e-6', 'flux:=1.9e-3', 'pole_pairs:=7']
CASES = {}


class Process(dds.NodeProcess):
    """A node, with the time of each line that it printed."""

    def __init__(self, *arguments):
        self.lines = []
        super().__init__(*arguments)

    def _read(self):
        for line in self._child.stdout:
            self._lines.append(line.rstrip('\n'))
            self.lines.append((time.monotonic(), line.rstrip('\n')))


class Case:
    """A node, what is published to it, and what it reports.

    A subclass is a fault: its docstring is the first column of the table in the docs.

    Attributes
    ----------
    node, parameters : of the process. report : pattern of the report.
    later : the cause comes `HEALTHY` seconds after the good news, else with the start.
    estimates : there are estimates despite of the fault. error : it is logged as an error, the
        only one. longest : time from the cause to the report [s].
    cause : when it came, by the steady clock [s].
    seen : when the report came, by way. messages : of the reports.
    """

    node = 'joint_observer'
    parameters: tuple = ()
    remap: tuple = ()
    report = ''
    later = estimates = error = False
    longest = LONGEST
    rate = RATE
    names: tuple = ARM

    def __init_subclass__(cls):
        CASES[cls.__name__] = cls

    def __init__(self, probe):
        self.probe, self.space = probe, f'/{type(self).__name__}'
        self.started = self.good_since = self.cause = None
        self.seen, self.reports, self.oks, self.read = {}, {}, [], 0
        self.strangers, self.publishers, self.k = [], [], 0
        self.encode = Encoder().encode
        words = dds.ros_args(*self.parameters, remap=('__ns:=SPACE', *self.remap))
        self.process = Process(
            f'{NODES} {self.node}', *(each.replace('SPACE', self.space) for each in words)
        )

    # For subclasses

    def publisher(self, name, kind=None, topic='joint_states', best_effort=False, context=None):
        """A publisher on the case's topic, of a node of its own."""
        import rclpy
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState

        node = rclpy.create_node(name, namespace=self.space, context=context)
        policy = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        self.strangers.append(node)
        self.publishers.append(
            node.create_publisher(
                kind or JointState,
                f'{self.space}/{topic}',
                QoSProfile(depth=100, reliability=policy),
            )
        )
        return self.publishers[-1]

    def gone(self, number):
        """A publisher's node ends."""
        self.strangers.pop(number).destroy_node()
        self.publishers.pop(number)

    def begin(self):
        """Called when the process starts."""
        self.publisher('driver')

    def inject(self):
        """Called when the cause is due."""

    def tick(self):
        """Called at `rate` after `begin`."""
        self.send()

    def send(self, publisher=0, names=None, stamp_ns=None, k=None, position=None):
        """Publish a sample of joints that move."""
        names, k = names or self.names, self.k if k is None else k
        stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
        angle = 0.5 * np.sin(4.0 * k / self.rate) if position is None else position
        raw = self.encode(stamp_ns, '', names, [angle] * len(names), (), [0.1] * len(names))
        self.publishers[publisher].publish(raw)

    def regular_ns(self):
        """The stamp that is due now, however late this process is."""
        start = self.__dict__.setdefault('start_ns', time.time_ns())
        return start + round(self.k * 1e9 / self.rate)

    # For the world

    def look(self, now):
        """Publish what is due, and note what was printed."""
        if self.started is None:
            if ' estimates ' not in self.process.output:
                return
            self.started = self.due = now
            self.begin()
        if self.good_since is None and ' tracking ' in self.process.output:
            self.good_since = now
        since = self.good_since if self.later else now - HEALTHY
        if self.cause is None and since is not None and now - since >= HEALTHY:
            self.cause = now
            self.inject()
        for _ in range(20):  # what is late is published, too
            if self.due > now:
                break
            self.tick()
            self.k += 1
            self.due += 1.0 / self.rate
        for when, line in self.process.lines[self.read :]:
            self.read += 1
            self.note('terminal', line, when, 'WARN' in line or 'ERROR' in line)

    def note(self, way, text, when, faulty):
        """Note a report of one of the three ways."""
        if self.cause is None or when < self.cause or way in self.seen:
            return
        if faulty and re.search(self.report.replace('SPACE', self.space), text):
            self.seen[way], self.reports[way] = when, text

    def hear(self, way, message):
        """Take ~/status or /diagnostics."""
        now = time.monotonic()
        for entry in message.status:
            if entry.name.startswith(self.space):
                self.note(way, entry.message, now, entry.level != b'\x00')
            if entry.name == f'{self.space}/{self.node}' and self.cause is not None:
                self.oks += [(way, now)] * (entry.level == b'\x00')

    @property
    def done(self):
        if self.cause is None:
            return False
        early = len(self.seen) == len(WAYS) and not self.error  # another error may follow
        since = max(self.seen.values()) if early else self.cause + self.longest
        return time.monotonic() > since + AFTER

    @property
    def text(self):
        """What the terminal shows, without the time."""
        return re.sub(r'^\[\w+\] \[[\d.]+\] \[[^]]*\]: ', '', self.reports.get('terminal', ''))

    def result(self):
        """What the tests need, as JSON; times are those since the cause [s]."""
        report = self.report.replace('SPACE', self.space)
        return {
            'took': {way: when - self.cause for way, when in self.seen.items()},
            'oks': [(way, when - self.cause) for way, when in self.oks],
            'logged': sum(
                bool(re.search(report, line)) and when >= self.cause
                for when, line in self.process.lines
            ),
            'text': self.text,
            'output': self.process.output,
        }

    def close(self):
        self.process.__exit__()
        for node in self.strangers:
            node.destroy_node()


class NobodyPublishes(Case):
    """nobody publishes the topic"""

    report = (
        r'nobody publishes SPACE/joint_states \(sensor_msgs/msg/JointState\): .*-r joint_states:='
    )

    def begin(self):
        pass

    def tick(self):
        pass


class AnotherType(NobodyPublishes):
    """it has another type"""

    report = (
        'SPACE/arduino publishes std_msgs/msg/Float64 on SPACE/joint_states, where this node '
        'needs sensor_msgs/msg/JointState: .*remap'
    )

    def begin(self):
        import rclpy
        from rclpy.context import Context
        from std_msgs.msg import Float64

        self.context = Context()  # of its own: one process has one type on a topic
        rclpy.init(context=self.context, domain_id=dds.DOMAIN)
        self.publisher('arduino', Float64, context=self.context)

    def close(self):
        import rclpy

        super().close()
        rclpy.shutdown(context=self.context)


class IncompatibleQos(Case):
    """it has an incompatible QoS"""

    parameters = ('qos_overrides.SPACE/joint_states.subscription.reliability:=reliable',)
    report = (
        'a publisher on SPACE/joint_states has an incompatible QoS .*SPACE/driver has reliability '
        "best_effort.*'qos_overrides.SPACE/joint_states.subscription.reliability' to best_effort"
    )

    def begin(self):
        self.publisher('driver', best_effort=True)


class SendsNothing(Case):
    """it has a publisher that sends nothing"""

    report = 'SPACE/driver publishes SPACE/joint_states, but no message has arrived: check'

    def tick(self):
        pass


class OtherNames(Case):
    """a joint that the messages do not carry"""

    parameters = ('joints:=[shoulder]',)
    error = True
    report = (
        r"joint 'shoulder' is not in SPACE/joint_states: did you mean 'shoulder_pan_joint'\? "
        r'\(it carries elbow_joint, shoulder_lift_joint, shoulder_pan_joint\)'
    )


class AnotherLayout(NobodyPublishes):
    """another dimension than `channel` (pmsm_observer)"""

    node, parameters = 'pmsm_observer', tuple(MOTOR)
    report = (
        r'\d+ of \d+ messages on SPACE/drive_samples are malformed and dropped: '
        ".*'columns', not 'channel'"
    )
    error = True

    def begin(self):
        from std_msgs.msg import Float64MultiArray

        self.publisher('inverter', Float64MultiArray, 'drive_samples')

    def tick(self):
        stamps = time.time_ns() + 50_000 * np.arange(5)
        raw = drive_samples.encode(stamps, np.zeros((5, 4)))
        self.publishers[0].publish(raw.replace(b'channel', b'columns'))


class WithoutEffort(Case):
    """messages without efforts (adaptive_observer)"""

    node = 'adaptive_observer'
    report = (
        r'\d+ of \d+ messages on SPACE/joint_states have no effort .* or set '
        "'input: effort_command'"
    )
    error = True

    def send(self):
        angle = 0.5 * np.sin(4.0 * self.k / self.rate)
        raw = self.encode(time.time_ns(), '', self.names, [angle] * len(self.names))
        self.publishers[0].publish(raw)


class WrongFlux(AnotherLayout):
    """motor data that the signals contradict (pmsm_observer, three times the flux)"""

    parameters = tuple(each.replace('1.9e-3', '5.7e-3') for each in MOTOR)
    report = r'no estimate for \d s, though messages come on SPACE/drive_samples: .*\(wrong flux, '
    longest = 7.0

    def tick(self):
        ((stamps, values),) = motors.steady(1, self.k)
        self.publishers[0].publish(drive_samples.encode(stamps, values))


class TwoThatAgree(Case):
    """two publishers of the same joint that agree"""

    report = (
        '3 joints come on SPACE/joint_states from two publishers, SPACE/driver and SPACE/relay: '
        r"stop one .* \('elbow_joint', 'shoulder_lift_joint', 'shoulder_pan_joint'\)"
    )
    later = estimates = True

    def inject(self):
        self.publisher('relay')

    def tick(self):
        stamp = time.time_ns()
        for number in range(len(self.publishers)):
            self.send(number, stamp_ns=stamp)


class TwoThatDiffer(TwoThatAgree):
    """two publishers of the same joint"""

    report = (
        r"joint 'elbow_joint' comes on SPACE/joint_states from two publishers, .*driver and .*relay"
    )

    def tick(self):
        self.send()
        if len(self.publishers) > 1:
            self.send(1, names=('elbow_joint', 'finger'), position=-1.0)


class OneNameTwice(Case):
    """one name twice in a message"""

    report = (
        r"joint 'elbow_joint' has several positions in \d+ of \d+ messages on SPACE/joint_states, "
        'and one is used: give each joint .* its own name'
    )
    estimates = True
    names = ('elbow_joint', 'shoulder_pan_joint', 'elbow_joint')


class SameName(Case):
    """another node publishes on its output (the same node, started twice)"""

    report = (
        'SPACE/joint_observer publishes SPACE/joint_observer/estimate as this node does, .*: stop '
        "one of them, .*'-r __node:=NAME'"
    )
    later = estimates = True
    longest = 8.0  # the other one starts, too

    def inject(self):
        words = dds.ros_args(remap=(f'__ns:={self.space}',))
        self.other = dds.NodeProcess(f'{NODES} {self.node}', *words)

    def close(self):
        if self.cause is not None:
            self.other.__exit__()
        super().close()


class ZeroStamps(Case):
    """stamps that are zero"""

    report = (
        r'\d+ of \d+ samples on SPACE/joint_states have no time stamp '
        ".*'stamp_source: publisher'"
    )
    error = True

    def tick(self):
        self.send(stamp_ns=0)


class NoPositions(Case):
    """messages without positions"""

    report = r'\d+ of \d+ messages on SPACE/joint_states carry no position .*remap the input'
    error = True

    def tick(self):
        raw = self.encode(time.time_ns(), '', self.names, [], [0.1] * len(self.names), [])
        self.publishers[0].publish(raw)


class AnotherClock(Case):
    """stamps of another clock"""

    report = (
        r"stamps on SPACE/joint_states are 3600.* s behind this node's clock .*: check the clock"
    )
    estimates = True

    def tick(self):
        self.send(stamp_ns=time.time_ns() - 3600 * 10**9)


class NoSimulatedTime(Case):
    """`use_sim_time` without a clock"""

    parameters = ('use_sim_time:=true',)
    report = "use_sim_time is true, but nobody publishes /clock: .*'--clock'"
    estimates = True


class RepeatedStamps(Case):
    """stamps that repeat"""

    report = (
        r'\d+ of \d+ samples on SPACE/joint_states repeat the previous stamp .*: stamp each .* a '
        'reading of its own'
    )
    later = estimates = True

    def tick(self):
        stamp = time.time_ns()
        for _ in range(1 if self.cause is None else 2):
            self.send(stamp_ns=stamp)


class RepeatedReadings(Case):
    """readings that repeat"""

    report = r'\d+ of \d+ samples on SPACE/joint_states repeat the previous reading .*publish each'
    later = estimates = True
    rate = 200.0

    def tick(self):
        stamp = self.regular_ns()
        self.send(k=self.k if self.cause is None else self.k // 5 * 5, stamp_ns=stamp)


class Lost(Case):
    """messages that are lost for several seconds"""

    parameters = ('qos_overrides.SPACE/joint_states.subscription.depth:=8',)
    report = r'\d+ of \d+ messages on SPACE/joint_states were lost in \d s: .*lower it'
    later = estimates = True

    def tick(self):
        for step in range(1 if self.cause is None else 30):
            self.send(stamp_ns=time.time_ns() + step, names=[f'joint_{k}' for k in range(20)])


class Ended(Case):
    """its publisher ends"""

    report = 'no message on SPACE/joint_states for .* s: SPACE/driver ended; start it again'
    later = True

    def inject(self):
        self.gone(0)

    def tick(self):
        if self.publishers:
            self.send()


class OneOfTwoEnded(Case):
    """one of two publishers ends"""

    report = "no sample of 'finger' on SPACE/joint_states for .* s: SPACE/gripper ended; start it"
    later = estimates = True

    def begin(self):
        self.publisher('driver')
        self.publisher('gripper')

    def inject(self):
        self.gone(1)

    def tick(self):
        for number, names in zip(range(len(self.publishers)), (ARM, ('finger',))):
            self.send(number, names)


class Killed(Case):
    """its publisher crashes"""

    report = 'no message on SPACE/joint_states for .* s: nothing comes from .*/encoder_sim; check'
    later = True

    def begin(self):
        self.simulator = dds.NodeProcess(
            'sim_pkg.nodes.executables encoder_sim',
            *dds.ros_args('rate:=50.0', remap=(f'__ns:={self.space}',)),
        )

    def inject(self):
        self.simulator.signal(signal.SIGKILL)

    def tick(self):
        pass

    def close(self):
        self.simulator.__exit__()
        super().close()


class CameBack(Ended):
    """its publisher is back (2 s after it ended)"""

    report = r'the messages are back on SPACE/joint_states after an outage of \d+\.\d s'
    estimates = True
    ended = None

    def look(self, now):
        if self.good_since is not None and self.ended is None:
            self.ended = now
            self.gone(0)
        super().look(now)

    def inject(self):
        self.publisher('driver')


class JointGone(Case):
    """a joint that the messages do not carry any more"""

    report = r"joint 'elbow_joint' is not in SPACE/joint_states: did you mean 'elbow'\? \(it "
    later = estimates = True

    def tick(self):
        self.send(names=ARM if self.cause is None else (*ARM[:2], 'elbow'))


class Fine(Case):
    """no fault: the good news, and not a word of warning (disjoint joints of two publishers)"""

    report = r'^$'
    good = (
        r'tracking 4 joints of SPACE/joint_states at \d+(\.\d)? Hz '
        r'\(shoulder_pan_joint, shoulder_lift_joint, elbow_joint, finger\)'
    )

    def begin(self):
        self.publisher('driver')
        self.publisher('gripper')

    def tick(self):
        for number, names in zip(range(len(self.publishers)), (ARM, ('finger',))):
            self.send(number, names)


class SimulatedTime(Fine):
    """no fault: simulated time that starts at 0"""

    parameters = ('use_sim_time:=true',)
    good = r'tracking 3 joints of SPACE/joint_states at \d+(\.\d)? Hz '

    remap = ('/clock:=SPACE/clock',)

    def begin(self):
        from rosgraph_msgs.msg import Clock

        self.clock = Clock
        self.publisher('simulation')
        self.publisher('simulation_clock', Clock, 'clock')

    def tick(self):
        stamp = self.k * 20_000_000
        message = self.clock()
        message.clock.sec, message.clock.nanosec = divmod(stamp, 10**9)
        self.publishers[1].publish(message)
        self.send(stamp_ns=stamp)


FAULTS = [name for name, case in CASES.items() if not issubclass(case, Fine)]
# The same fault in another node, or part of another one: each node takes two seconds of processor.
ALIKE = ('TwoThatAgree', 'Killed', 'OneOfTwoEnded')


def world(names, file):
    """Run these cases side by side, and write their results by name."""
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.qos import DurabilityPolicy, QoSProfile

    probe = dds.Probe()
    cases = {}
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    def diagnosed(message):
        for entry in message.status[:1]:
            case = cases.get(entry.name.split('/')[1])
            if case is not None:
                case.hear('/diagnostics', message)

    listening = [probe.node.create_subscription(DiagnosticArray, '/diagnostics', diagnosed, 100)]
    try:
        waiting = list(names)
        end = time.monotonic() + WORLD
        while not (len(cases) == len(names) and all(case.done for case in cases.values())):
            ended = [case for case in cases.values() if not (case.done or case.process.alive)]
            assert not ended, ended[0].process.output
            assert time.monotonic() < end, [
                case.process.output for case in cases.values() if not case.done
            ]
            running = [case for case in cases.values() if not case.done]
            starting = [case for case in running if case.started is None]
            if waiting and len(starting) < 2 and len(running) < TOGETHER:
                name = waiting.pop(0)
                case = cases[name] = CASES[name](probe)
                listening.append(
                    probe.node.create_subscription(
                        DiagnosticArray,
                        f'/{name}/{case.node}/status',
                        lambda message, case=case: case.hear('~/status', message),
                        latched,
                    )
                )
            probe.executor.spin_once(timeout_sec=0.002)
            for case in running:
                case.look(time.monotonic())
                if case.done:
                    case.process.signal(signal.SIGINT)
        Path(file).write_text(json.dumps({name: case.result() for name, case in cases.items()}))
    finally:
        for case in cases.values():
            if case.process.alive:
                case.process.signal(signal.SIGINT)
        for case in cases.values():
            case.close()
        probe.close()


def results(names, file):
    """What `world` writes, in a process of its own."""
    words = [sys.executable, '-Xfaulthandler', __file__, '--results', str(file), *names]
    child = subprocess.Popen(
        words, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
    )
    output = ''
    try:
        output, _ = child.communicate(timeout=WORLD + 20.0)
    except subprocess.TimeoutExpired:
        output = 'it did not end'
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)  # the nodes, too
        child.wait()
    if child.returncode:  # below 0: by a signal
        said = f'the process of {names} ended with {child.returncode}: {output}'
        warnings.warn(said, stacklevel=2)
    return json.loads(file.read_text()) if file.exists() else {}


def wrong(name, case):
    """What is not as expected in the result of a case."""
    kind, took, output = CASES[name], case['took'], case['output']
    if issubclass(kind, Fine):
        checks = {
            'the good news once': len(re.findall(kind.good.replace('SPACE', f'/{name}'), output))
            == 1,
            'no warning': 'WARN' not in output and 'ERROR' not in output,
            'OK in both topics': {way for way, _ in case['oks']} == {'~/status', '/diagnostics'},
        }
    else:
        last = max(took.values(), default=0.0)
        settled = last if kind.later else 0.0
        checks = {
            'reported in three ways': set(took) == WAYS,
            'in time': last <= kind.longest,
            'logged once': case['logged'] == 1,
            'the only error': not kind.error or output.count('[ERROR]') == 1,
            'never OK': kind.estimates or all(when <= settled for _, when in case['oks']),
        }
    return [what for what, holds in checks.items() if not holds]


@pytest.fixture(scope='module')
def cases(request, tmp_path_factory):
    """Results of the chosen cases; those that failed, or all of a crash, are run again once."""
    here = (item for item in request.session.items if item.path == request.path)
    chosen = {item.callspec.params['name'] for item in here if hasattr(item, 'callspec')}
    names = [name for name in CASES if name in chosen or not chosen]
    folder, found = tmp_path_factory.mktemp('silence'), {}
    for attempt in ('first', 'second'):
        again = [name for name in names if name not in found or wrong(name, found[name])]
        if again:
            found.update(results(again, folder / attempt))
    assert set(found) == set(names), 'see the warnings'
    return found


# A crash is reported by the fixture, after 240 s at most.
pytestmark = pytest.mark.timeout(280)


@pytest.mark.parametrize(
    'name',
    [
        pytest.param(name, marks=pytest.mark.slow if name in ALIKE else ())
        for name in (*FAULTS, 'Fine', 'SimulatedTime')
    ],
)
def test_a_fault_is_reported_in_three_ways_in_time_and_once_and_no_fault_never(cases, name):
    assert not wrong(name, cases[name]), cases[name]


def test_an_output_on_the_input_is_refused():
    done = subprocess.run(
        [sys.executable, '-m', *NODES.split(), 'joint_observer', '--ros-args']
        + ['-r', '~/estimate:=joint_states'],
        text=True,
        capture_output=True,
        timeout=dds.PATIENCE,
    )
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.splitlines() == [
        'joint_observer: ~/estimate and the input joint_states are the same topic /joint_states, '
        "so the node would read its own output: remap the input to the driver's topic, as in "
        "'-r joint_states:=joint_states_raw'"
    ]


def rows(cases):
    """Rows of the table in the docs."""
    for name in (name for name in FAULTS if name in cases):
        case, fault = cases[name], CASES[name].__doc__
        if name in ALIKE:
            continue
        took = max(case['took'].values(), default=float('nan'))
        text = case['text'].replace(f'/{name}/', '/').replace('|', '\\|')
        yield f'| {fault} | {text} | {took:.1f} |'


def shape(line):
    """A row without its numbers and its last column."""
    line = re.sub(r'; (did you mean|others of this type)[^|]*(?= \|)', '', line)
    return re.sub(r'\d+(\.\d+)?', 'N', line.rstrip().rstrip('|').rpartition('|')[0])


def test_the_docs_show_the_same_texts(cases):
    shown = {shape(line) for line in DOCS.read_text().splitlines() if line.startswith('| ')}
    assert not [line for line in map(shape, rows(cases)) if line not in shown]


if __name__ == '__main__':
    if sys.argv[1:2] == ['--results']:
        world(sys.argv[3:], sys.argv[2])
        sys.exit()
    with tempfile.TemporaryDirectory() as folder:
        found = results(sys.argv[1:] or list(CASES), Path(folder) / 'results.json')
    for name, case in found.items():
        print(f'== {name}: {wrong(name, case)}', case['output'], sep='\n', file=sys.stderr)
    print('| Fault | Report | After [s] |\n|---|---|---|', *rows(found), sep='\n')
