# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A node with second sensors: a reversed one is named, and so are typos of topic and joint."""

import numpy as np
from own_node import BEGIN

from estimator_pkg.messages.joint_state import TYPE

RATE, NAMES = 100, ('fine', 'reversed')


def test_a_reversed_source_and_typos_of_topic_and_joint_are_reported(own, capfd):
    values = {'quantum': 2.0 * np.pi / 4096, 'sources': ('g_fine', 'g_reversed', 'typo', 'other')}
    for k, (source, joint) in enumerate(zip(values['sources'], (*NAMES, 'fine', 'fin'))):
        topic = '/s/sensor' if source == 'typo' else '/s/sensors'
        named = {'topic': topic, 'field_type': TYPE, 'field': f'velocity[{k % 2}]', 'joint': joint}
        values |= {f'source.{source}.{key}': value for key, value in named.items()}
    node = own('angle', **values)
    node.publisher('driver')
    node.connect()
    feed, about = node.node.stream.feed, node.node.stream.about
    for k in range(3 * RATE):
        angle, speed = 0.5 * np.sin(4.0 * k / RATE), 2.0 * np.cos(4.0 * k / RATE)
        stamp = BEGIN + k * 10**9 // RATE
        sensors = node.encode(stamp, '', NAMES, [0.0] * 2, [speed, -speed])
        for port in (1, 2, 4):
            feed(port, sensors, 0)
        measured = node.encode(stamp, '', NAMES, [angle] * 2)
        if k % 10:
            feed(0, measured, 0)
        else:  # the node reads names where messages arrive
            node.take(measured)
    node.pass_time(1.5)
    said = capfd.readouterr().err
    assert 'reversed: g_reversed is withheld: its sign is reversed (it measured ' in said
    assert 'fine: typo is silent: no value on /s/sensor for 2.0 s; check topic' in said
    assert "does not carry joint 'fin': did you mean 'fine'?" in said
    assert 'g_fine ' not in said
    assert about('reversed')['source g_reversed'].startswith('withheld: its sign')
    assert about('fine')['source g_fine'].startswith('used, informs in ')
