# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The layouts for PlotJuggler and Foxglove name nothing that the contract's topics do not have.

How the programs read them was taken from their sources: PlotJuggler 3.16 (`xmlLoadState` of the
main window, the tabs, the docks and the plots; its parser of JointState) and Lichtblick, the open
continuation of Foxglove Studio (the Plot panel's config, the grammar of message paths).
"""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

LAYOUTS = Path(__file__).resolve().parents[2] / 'layouts'
JOINT_STATE = 'sensor_msgs/msg/JointState'
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
CONTRACT = {
    '/joint_states': JOINT_STATE,
    '/ground_truth/joint_states': JOINT_STATE,
    '/joint_observer/estimate': JOINT_STATE,
    '/joint_observer/estimate_stddev': JOINT_STATE,
    '/joint_observer/acceleration': 'trajectory_msgs/msg/JointTrajectory',
    '/joint_observer/status': DIAGNOSTICS,
    '/diagnostics': DIAGNOSTICS,
}
STORE = get_typestore(Stores.ROS2_JAZZY)
BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4  # rosbags' kinds of field
NUMBER = re.compile(r'u?int\d+|float\d+')
JOINT = 'wheel'  # of the simulators and of the recordings made by them


def ends_in_a_number(kind, parts):
    """True if this path of (field, has an index) leads through messages of `kind` to a number."""
    for name, indexed in parts:
        fields = dict(STORE.fielddefs[kind][1]) if kind in STORE.fielddefs else {}
        if name not in fields:
            return False
        what, inner = fields[name]
        if (what in (ARRAY, SEQUENCE)) != indexed:
            return False
        if indexed:
            what, inner = inner[0]
        kind = inner[0] if what == BASE else inner
    return NUMBER.fullmatch(kind) is not None


def foxglove_path(text):
    """(topic, [(field, has an index)]) by the grammar of message paths."""
    match = re.fullmatch(r'(/[\w/]+)((?:\.\w+(?:\[(?:-?\d+|\$\w+)\])?)*)', text)
    assert match, text
    return match[1], [
        (name, bool(index)) for name, index in re.findall(r'\.(\w+)(\[[^\]]*\])?', match[2])
    ]


def plotjuggler_path(text):
    """As `foxglove_path`, of a curve: joints by name in a JointState, else fields and indices."""
    topic = max((each for each in CONTRACT if text.startswith(each + '/')), key=len)
    parts = text[len(topic) + 1 :].split('/')
    if CONTRACT[topic] == JOINT_STATE:
        joint, field = parts
        assert joint == JOINT, text
        return topic, [(field, True)]
    return topic, [(part.partition('[')[0], '[' in part) for part in parts]


def plotjuggler():
    return ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()


def foxglove():
    return json.loads((LAYOUTS / 'foxglove.json').read_text())


CURVES = [curve.get('name') for curve in plotjuggler().iter('curve')]
PATHS = [
    path['value']
    for config in foxglove()['configById'].values()
    for path in config.get('paths', [])
]


@pytest.mark.parametrize(
    'read, text',
    [(plotjuggler_path, text) for text in CURVES] + [(foxglove_path, text) for text in PATHS],
)
def test_a_curve_is_a_number_in_a_topic(read, text):
    topic, parts = read(text)
    assert ends_in_a_number(CONTRACT[topic], parts)


def test_both_show_every_number_of_the_contract():
    wanted = set(CONTRACT) - {'/joint_observer/status', '/diagnostics'}
    assert {plotjuggler_path(text)[0] for text in CURVES} == wanted
    assert {foxglove_path(text)[0] for text in PATHS} == wanted
    shown = {
        config['topicToRender']
        for config in foxglove()['configById'].values()
        if 'topicToRender' in config
    }
    assert shown == {'/joint_observer/status', '/diagnostics'}
