# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Words of parameters that YAML reads as something else: none of ours, and help with a user's."""

import math
import re
from pathlib import Path

import pytest
from declaring import declaring

from estimator_pkg import params_file, yaml_text
from estimator_pkg.driver.efforts import DrivenSettings
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.adaptive.structure import Gains
from estimator_pkg.parameters import build, declared, parse_assignments
from estimator_pkg.streams.angle import AngleSettings

ROOT = Path(__file__).parent.parent
# https://yaml.org/type: bool, null, int, float, timestamp, merge and value of YAML 1.1
YAML_1_1 = [
    re.compile(pattern)
    for pattern in (
        r'y|Y|yes|Yes|YES|n|N|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF',
        r'~|null|Null|NULL|',
        r'[-+]?0b[0-1_]+|[-+]?0[0-7_]+|[-+]?(0|[1-9][0-9_]*)|[-+]?0x[0-9a-fA-F_]+'
        r'|[-+]?[1-9][0-9_]*(:[0-5]?[0-9])+',
        r'[-+]?([0-9][0-9_]*)?\.[0-9.]*([eE][-+]?[0-9]+)?|[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+\.[0-9_]*'
        r'|[-+]?\.?(inf|Inf|INF)|\.?(nan|NaN|NAN)|[-+]?[0-9]+[eE][-+]?[0-9]+|infinity',
        r'\d\d\d\d-\d\d?-\d\d?.*',
        r'<<|=',
    )
]


def test_no_choice_of_any_parameter_is_a_boolean_a_null_or_a_number():
    classes = declaring()
    assert {DrivenSettings, AngleSettings, Gains} <= set(classes.values())
    wrong, seen = [], 0
    for owner, cls in classes.items():
        for one in declared(cls).values():
            for word in (*one.choices, *one.among):
                seen += 1
                if word == 'nan':  # YAML of ROS makes a NaN of it, which is taken for the word
                    assert [one.check(value) for value in ('nan', math.nan)] == ['nan', 'nan']
                elif any(pattern.fullmatch(word) for pattern in YAML_1_1):
                    wrong.append((owner, one.name, word))
            if isinstance(one.default, str) and one.default not in ('', 'nan'):
                assert yaml_text.is_text(one.default), (owner, one.name)
    assert seen and not wrong


def test_a_choice_that_comes_as_a_boolean_shows_the_quoting():
    with pytest.raises(UsageError) as caught:
        build(Gains, {'gate': False})
    assert str(caught.value).endswith("write texts in quotes, gate: 'noise'")
    assert '\n' not in str(caught.value)
    with pytest.raises(UsageError, match="angle_joint: '3'"):
        build(AngleSettings, {'angle_joint': 3})


@pytest.mark.parametrize(
    'value, shown',
    [
        ([True], "['y']"),
        ([True, False], "['y', 'n']"),
        ([1, 2], "['1', '2']"),
        (['x', True, 'z'], "['x', 'y', 'z']"),
        (True, "['y']"),
    ],
)
def test_names_that_come_as_booleans_or_numbers_show_the_quoting(value, shown):
    with pytest.raises(UsageError) as caught:
        build(AngleSettings, {'joints': value})
    assert str(caught.value).endswith(f'joints: {shown}')
    assert '\n' not in str(caught.value)


def test_words_of_the_command_line_need_no_quotes():
    values = parse_assignments(['joints=[x, y, on]', 'angle_joint=off'])
    made = build(AngleSettings, values)
    assert made.joints == ('x', 'y', 'on') and made.angle_joint == 'off'
    assert build(Gains, parse_assignments(['adapt=off', 'load=yes'])).adapt is False
    assert build(Gains, parse_assignments(['load=yes', 'gravity=On'])).load is True


# What the parser of rcl gave for each of these words on ROS 2 Jazzy.
OF_ROS = {
    'y': True,
    'N': False,
    'off': False,
    'Yes': True,
    '1:30': '1:30',
    '1_000': '1_000',
    '2026-01-01': '2026-01-01',
    '017': 15,
    '0x1F': 31,
    '1e3': 1000.0,
    '08': 8.0,
    '0b11': '0b11',
    '0o17': '0o17',
    '+1': 1,
    '1.': 1.0,
    '.5': 0.5,
    '"y"': 'y',
    "''": '',
    '!!str y': 'y',
    'inf': float('inf'),
    '-.inf': float('-inf'),
    'infinity': float('inf'),
}


@pytest.mark.parametrize('word', OF_ROS)
def test_parameter_files_are_read_as_ros_reads_them(word, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(f'/**: {{ros__parameters: {{p: {word}}}}}')
    value = params_file.load(path)['p']
    assert value == OF_ROS[word] and type(value) is type(OF_ROS[word])


def test_names_of_joints_may_be_keys_without_quotes(tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text('/**: {ros__parameters: {per_joint: {y: {noise: 1.0}, 1: {noise: 2.0}}}}')
    assert params_file.load(path) == {'per_joint.y.noise': 1.0, 'per_joint.1.noise': 2.0}


@pytest.mark.parametrize('word', ['!!int a', '!!python/name:os.system ""', '!!int [1]'])
def test_wrong_tags_are_one_line(word, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    p: {word}\n')
    with pytest.raises(UsageError, match='is no YAML') as caught:
        params_file.load(path)
    assert '\n' not in str(caught.value)
