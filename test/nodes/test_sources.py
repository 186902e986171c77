# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults of a second sensor: each is withheld within 1 s, reported, and used again.

The stream of the node takes the messages in this process, in their order. ``python
test/nodes/test_sources.py`` prints the table of docs/second_sensor.md.
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

from estimator_pkg.messages.field import Field
from estimator_pkg.messages.joint_state import TYPE, Decoder, Encoder
from estimator_pkg.nodes import message_types
from estimator_pkg.streams.angle import AngleStream

DOCS = Path(__file__).parents[2] / 'docs/second_sensor.md'
RATE, SECONDS, FAULT = 200, 14.0, (5.0, 8.0)
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
FINE = 'fine'
NAMES = (*FAULTS, FINE)  # of the joints, and of their sources


def gyro_of(name):
    gyro = SPEED - 0.03 + 0.005 * np.random.default_rng(1).standard_normal(len(TIME))
    if name != FINE:
        gyro[DURING] = FAULTS[name][1](gyro[DURING])
    return gyro


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def stamp_of(k):
    return 10**18 + round(TIME[k] * 1e9)


def sources(topic, names, ratio=1.0):
    """Parameters of a source for each joint, all on one topic."""
    return {
        'sources': [f'g_{name}' for name in names],
        'quantum': QUANTUM,
        **{
            f'source.g_{name}.{key}': value
            for k, name in enumerate(names)
            for key, value in (
                ('topic', topic),
                ('field_type', TYPE),
                ('field', f'velocity[{k}]'),
                ('joint', name),
                ('ratio', 0.0 if name == FINE else ratio),
            )
        },
    }


def stream_of(values):
    """A stream whose fields are known, as a node makes it."""
    stream = AngleStream.of(values)
    for number, port in enumerate(stream.inputs):
        if port.field:
            field = Field(message_types.fields_of, port.type, port.field)
            stream.read_field(field, number)
    return stream


class Run:
    """All sources at once, each of a joint of its own, with the same readings.

    Attributes
    ----------
    notices : which the node logs. entries : of ~/status at the end, by joint.
    reasons : why a source was withheld, in ~/status while it was, by joint.
    velocity, alone : published, by row and joint; and from the angle alone, by row [rad/s].
    """

    def __init__(self):
        stream, alone = stream_of(sources('sensors', NAMES)), AngleStream.of({'quantum': QUANTUM})
        encode, decode = Encoder().encode, Decoder().decode
        self.notices, self.reasons = [], {}
        gyros = np.array([gyro_of(name) for name in NAMES]).T.tolist()
        readings = np.floor(ANGLE / QUANTUM + 0.3) * QUANTUM
        velocity = []
        for k, reading in enumerate(readings.tolist()):
            sensed, measured = (
                encode(stamp_of(k), '', NAMES, [reading] * len(NAMES), speeds)
                for speeds in (gyros[k], ())
            )
            for port in range(1, len(stream.inputs)):
                assert not stream.feed(port, sensed, 0)
            answers = *stream.feed(0, measured, 0), *alone.feed(0, measured, 0)
            velocity.append([decode(answer[0]).velocities for answer in answers])
            self.notices += stream.notices()
            if DURING[k] and k % 25 == 0:
                for name in FAULTS:
                    reason = stream.about(name)[f'source g_{name}']
                    if reason.startswith(('withheld', 'silent')):
                        self.reasons[name] = reason.partition(', bias')[0]
        self.velocity, self.alone = np.array(velocity).transpose(1, 0, 2)
        self.alone = self.alone[:, 0]
        self.entries = {name: stream.about(name)[f'source g_{name}'] for name in NAMES}

    def error(self, name):
        """The error of a joint over that of the angle alone."""
        velocity, rows = self.velocity[:, NAMES.index(name)], TIME > 1.0
        return rms((velocity - SPEED)[rows]) / rms((self.alone - SPEED)[rows])

    def after(self, name):
        """From the first wrong value until the angle alone is published; at most 2 s [s]."""
        informed = self.velocity[:, NAMES.index(name)] != self.alone
        first = int(np.argmax(gyro_of(name) != gyro_of(FINE)))
        assert informed[:first][-RATE:].mean() > 0.5, name
        since = np.flatnonzero(informed[first : first + round(2.0 * LONGEST * RATE)])
        return float(np.max(since, initial=-1) + 1) / RATE

    def reports(self, name):
        """What the terminal shows of a source, in order."""
        return [text.removeprefix(f'{name}: ') for text in self.notices if f'g_{name} ' in text]

    def rows(self):
        """Rows of the table in the docs."""
        for name, (text, _) in FAULTS.items():
            report = self.reports(name)[0].replace(f'g_{name}', 'gyro')
            yield f'| {text} | wheel: {report} | {self.after(name):.2f} | {self.error(name):.2f} |'


@pytest.fixture(scope='module')
def run():
    return Run()


@pytest.mark.parametrize('name', FAULTS)
def test_a_fault_of_a_source_is_withheld_within_a_second_and_reported(run, name):
    assert run.after(name) <= LONGEST
    assert run.error(name) <= 1.05
    reports = run.reports(name)
    assert len(reports) <= 4  # twice: again when what was learnt meanwhile ends
    assert all(
        text.startswith((f'g_{name} is withheld', f'g_{name} is silent')) for text in reports[::2]
    )
    assert set(reports[1::2]) == {f'g_{name} agrees again and is used'}
    assert run.reasons[name] in reports[0]  # what ~/status showed while it was withheld


@pytest.mark.parametrize('name', NAMES)
def test_a_source_that_agrees_is_used_and_its_bias_is_learnt(run, name):
    used = re.match(r'used, bias (\S+) \+- \S+ rad/s', run.entries[name])
    assert used and abs(float(used[1]) - 0.03) < 1e-3, run.entries[name]


def test_a_source_without_a_fault_pays_and_is_not_reported(run):
    assert run.error(FINE) < 0.5 and not run.reports(FINE)


def shape(line):
    """A row without its numbers."""
    return re.sub(r'-?\d+(\.\d+)?(e-\d+)?', 'N', line)


def test_the_docs_show_the_same_texts(run):
    shown = {shape(line) for line in DOCS.read_text().splitlines()}
    assert not [line for line in map(shape, run.rows()) if line not in shown]


def test_a_node_reports_a_reversed_source_and_uses_the_other(probe):
    from sensor_msgs.msg import JointState

    names = [FINE, 'reversed']
    values = sources('/s/sensors', names)
    words = dds.ros_args(
        *(f'{key}:={value}' for key, value in values.items()),
        remap=('joint_states:=/s/measured', '__ns:=/s', '__node:=o'),
    )
    with (
        dds.NodeProcess('estimator_pkg.nodes.executables joint_observer', *words) as process,
        dds.Observer(probe, '/s/o', '/s/measured') as live,
    ):
        sensors = probe.node.create_publisher(JointState, '/s/sensors', 1000)
        live.connect()
        probe.until(lambda: sensors.get_subscription_count() == len(names))
        encode = Encoder().encode
        for k in range(0, 3 * RATE, 2):  # 3 s at 100 Hz
            speeds = [SPEED[k], SPEED[k] if k < 2 * RATE else -SPEED[k]]
            sensors.publish(encode(stamp_of(k), '', names, [0.0] * 2, speeds))
            time.sleep(0.001)  # it takes another way
            live.feed([encode(stamp_of(k), '', names, [ANGLE[k]] * 2)])
        process.prints('reversed: g_reversed is withheld: it measures ')

        def entry(name):
            return dds.value(live.statuses[name], f'source g_{name}').partition(', bias')[0]

        probe.until(lambda: entry('reversed').startswith('withheld: it measures '))
        assert entry('reversed') in process.output
        assert entry(FINE) == 'used' and 'g_fine ' not in process.output


if __name__ == '__main__':
    print('| Fault | Report | After [s] | Error |\n|---|---|---|---|', *Run().rows(), sep='\n')
