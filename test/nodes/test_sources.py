# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of a second sensor, live: each is withheld within 1 s, reported, and used again.

``python test/nodes/test_sources.py`` prints the table of docs/second_sensor.md.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

import pytest

if __name__ == '__main__':
    TEST = Path(__file__).parents[1]
    sys.path[:0] = [str(TEST), str(TEST / 'support')]
    import conftest  # noqa: F401  the profile of discovery

import dds
import numpy as np

from estimator_pkg import observers
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.parameters import build

MODULE = 'estimator_pkg.nodes.executables joint_observer'
DOCS = Path(__file__).parents[2] / 'docs/second_sensor.md'
RATE, SECONDS, FAULT = 500, 14.0, (5.0, 8.0)
LONGEST = 1.0  # [s] from the first wrong value until the source is withheld
QUANTUM = 2.0 * np.pi / 4096
TIME = np.arange(int(RATE * SECONDS)) / RATE
ANGLE, SPEED = 0.5 * np.sin(4.0 * TIME) + 0.1 * TIME, 2.0 * np.cos(4.0 * TIME) + 0.1
DURING = (FAULT[0] <= TIME) & (FAULT[1] > TIME)
FAULTS = {
    'dead': ('it sends zeros', lambda gyro: 0.0 * gyro),
    'stuck': ('it repeats a value', lambda gyro: np.full_like(gyro, gyro[0])),
    'biased': ('its bias steps by 0.5 rad/s', lambda gyro: gyro + 0.5),
    'reversed': ('its sign is reversed', lambda gyro: -gyro),
    'late': (
        'its values are 20 ms late',
        lambda gyro: np.interp(TIME[: len(gyro)] - 0.02, TIME[: len(gyro)], gyro),
    ),
    'wrong_joint': ('it is of another joint', lambda gyro: np.cos(7.0 * TIME[: len(gyro)])),
    'saturated': ('it saturates at 1 rad/s', lambda gyro: np.clip(gyro, -1.0, 1.0)),
    'silent': ('it sends nothing', lambda gyro: np.full_like(gyro, np.nan)),
}
SOURCES = {  # name of the joint: fault, ratio
    **{f'{fault}_{ratio:.0f}': (fault, ratio) for fault in FAULTS for ratio in (0.0, 1.0)},
    'fine_0': ('', 0.0),
}


def gyro_of(fault):
    gyro = SPEED - 0.03 + 0.005 * np.random.default_rng(1).standard_normal(len(TIME))
    if fault:
        gyro[DURING] = FAULTS[fault][1](gyro[DURING])
    return gyro


def alone(readings):
    """The velocity from the angle alone."""
    observer = observers.find('edge_adaptive')
    joint = Joint(observer, build(observer.gains, {'quantum': QUANTUM}), build(JointSettings, {}))
    stamps = 10**18 + np.round(TIME * 1e9).astype(np.int64)
    return joint.run(stamps, readings).velocity


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


class Run:
    """All sources side by side, each of a joint of its own, with the same readings.

    Attributes
    ----------
    output : of the node. entries : of ~/status at the end, by joint.
    reasons : why a source was withheld, in ~/status while it was, by joint.
    velocity, alone : published, by row and joint; and from the angle alone, by row [rad/s].
    """

    def __init__(self, probe, folder):
        from sensor_msgs.msg import JointState

        file, self.reasons = folder / 'params.yaml', {}
        readings = np.floor(ANGLE / QUANTUM + 0.3) * QUANTUM
        sources = [
            f'    source.g_{name}: {{topic: sensors, field_type: sensor_msgs/msg/JointState, '
            f"field: 'velocity[{k}]', joint: {name}, ratio: {ratio}}}\n"
            for k, (name, (_, ratio)) in enumerate(SOURCES.items())
        ]
        file.write_text(
            '/**:\n  ros__parameters:\n'
            f'    sources: [{", ".join(f"g_{name}" for name in SOURCES)}]\n'
            f'    quantum: {QUANTUM}\n{"".join(sources)}'
        )
        words = dds.ros_args(
            remap=('joint_states:=/s/measured', '__ns:=/s', '__node:=o'), file=file
        )
        with (
            dds.NodeProcess(MODULE, *words) as process,
            dds.Observer(probe, '/s/o', '/s/measured') as self.live,
        ):
            sensors = probe.node.create_publisher(JointState, '/s/sensors', 100)
            self.live.connect()
            probe.until(lambda: sensors.get_subscription_count() == len(SOURCES))
            answers = self.live.feed(self.messages(sensors, readings))
            self.live.next_report()
            for name in list(SOURCES)[:-1]:
                process.prints(f'{name}: g_{name} agrees again and is used')
            self.output = process.output
        self.velocity = np.array([answer.velocities for answer in answers])
        self.alone = alone(readings)
        self.entries = {name: self.entry(name) for name in SOURCES}

    def messages(self, sensors, readings):
        """The messages of the angle, each after that of the sensors."""
        sensed, measured, names = Encoder(), Encoder(), list(SOURCES)
        gyros = np.array([gyro_of(fault) for fault, _ in SOURCES.values()]).T
        for k, reading in enumerate(readings.tolist()):
            stamp, same = 10**18 + round(TIME[k] * 1e9), [reading] * len(names)
            sensors.publish(sensed.encode(stamp, '', names, same, gyros[k].tolist()))
            time.sleep(0.001)  # it takes another way
            if DURING[k] and k % 50 == 0:
                for name in filter(self.live.statuses.get, SOURCES):
                    reason = self.entry(name)[f'source g_{name}']
                    if reason.startswith(('withheld', 'silent')):
                        self.reasons[name] = reason.partition(', bias')[0]
            yield measured.encode(stamp, '', names, same)

    def entry(self, name):
        return {item.key: item.value for item in self.live.statuses[name].values}

    def error(self, name):
        """The error of a joint over that of the angle alone."""
        velocity, rows = self.velocity[:, list(SOURCES).index(name)], TIME > 1.0
        return rms((velocity - SPEED)[rows]) / rms((self.alone - SPEED)[rows])

    def after(self, name):
        """From the first wrong value until the angle alone is published; at most 2 s [s]."""
        informed = self.velocity[:, list(SOURCES).index(name)] != self.alone
        first = int(np.argmax(gyro_of(SOURCES[name][0]) != gyro_of('')))
        assert informed[:first][-RATE:].mean() > 0.5, name
        since = np.flatnonzero(informed[first : first + round(2.0 * LONGEST * RATE)])
        return float(np.max(since, initial=-1) + 1) / RATE

    def report(self, name):
        """What the terminal showed when the source was withheld."""
        return re.search(rf'{name}: (g_{name} is (withheld|silent).*)', self.output)[1]

    def rows(self):
        """Rows of the table in the docs."""
        for fault, (text, _) in FAULTS.items():
            name = f'{fault}_1'
            report = self.report(name).replace(f'g_{name}', 'gyro')
            yield f'| {text} | wheel: {report} | {self.after(name):.2f} | {self.error(name):.2f} |'


@pytest.fixture(scope='module')
def run(probe, tmp_path_factory):
    return Run(probe, tmp_path_factory.mktemp('sources'))


@pytest.mark.parametrize('name', list(SOURCES)[:-1])
def test_a_fault_of_a_source_is_withheld_within_a_second_and_reported(run, name):
    assert run.after(name) <= LONGEST
    assert run.error(name) <= 1.05
    report = run.report(name)
    assert run.reasons[name] in report  # what ~/status showed while it was withheld
    assert run.output.count(f': g_{name} is ') <= 2  # again when what was learnt meanwhile ends


@pytest.mark.parametrize('name', SOURCES)
def test_a_source_that_agrees_is_used_and_its_bias_is_learnt(run, name):
    used = re.match(r'used, bias (\S+) \+- \S+ rad/s', run.entries[name][f'source g_{name}'])
    assert used and abs(float(used[1]) - 0.03) < 1e-3, run.entries[name]


def test_a_source_without_a_fault_pays_and_is_not_reported(run):
    assert run.error('fine_0') < 0.5
    assert 'g_fine_0 ' not in run.output and 'Traceback' not in run.output


def shape(line):
    """A row without its numbers."""
    return re.sub(r'-?\d+(\.\d+)?(e-\d+)?', 'N', line)


def test_the_docs_show_the_same_texts(run):
    shown = {shape(line) for line in DOCS.read_text().splitlines()}
    assert not [line for line in map(shape, run.rows()) if line not in shown]


if __name__ == '__main__':
    import tempfile

    the_probe = dds.Probe()
    with tempfile.TemporaryDirectory() as made:
        found = Run(the_probe, Path(made))
    the_probe.close()
    print('| Fault | Report | After [s] | Error |\n|---|---|---|---|', *found.rows(), sep='\n')
