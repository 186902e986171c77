# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A node with second sensors: a reversed one is named, and so are typos of topic and joint."""

import time

import dds
import numpy as np

from estimator_pkg.messages.joint_state import TYPE, Encoder

RATE, QUANTUM = 100, 2.0 * np.pi / 4096
NAMES = 'fine', 'reversed'


def test_a_reversed_source_and_typos_of_topic_and_joint_are_reported_within_5_s(probe):
    from sensor_msgs.msg import JointState

    values = {'quantum': QUANTUM, 'sources': ['g_fine', 'g_reversed', 'typo', 'other']}
    for k, (source, joint) in enumerate(zip(values['sources'], (*NAMES, 'fine', 'fin'))):
        topic = '/s/sensor' if source == 'typo' else '/s/sensors'
        own = {'topic': topic, 'field_type': TYPE, 'field': f'velocity[{k % 2}]', 'joint': joint}
        values |= {f'source.{source}.{key}': value for key, value in own.items()}
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
        probe.until(lambda: sensors.get_subscription_count() == 3)
        encode, begun = Encoder().encode, time.monotonic()
        for k in range(3 * RATE):
            angle, speed = 0.5 * np.sin(4.0 * k / RATE), 2.0 * np.cos(4.0 * k / RATE)
            stamp = 10**18 + k * 10**9 // RATE
            sensors.publish(encode(stamp, '', NAMES, [0.0] * 2, [speed, -speed]))
            time.sleep(0.001)  # it takes another way
            live.feed([encode(stamp, '', NAMES, [angle] * 2)])
        process.prints('reversed: g_reversed is withheld: its sign is reversed (it measured ')
        process.prints('fine: typo is silent: no value on /s/sensor for 2.0 s; check topic')
        process.prints("/s/measured does not carry joint 'fin': did you mean 'fine'?")
        assert time.monotonic() - begun < 5.0 + 3.0  # of which the messages take about 3

        def entry(name, source):
            return dds.value(live.statuses[name], f'source {source}')

        probe.until(lambda: entry('reversed', 'g_reversed').startswith('withheld: its sign'))
        assert entry('fine', 'g_fine').startswith('used, informs in ')
        assert 'g_fine ' not in process.output
