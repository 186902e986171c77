# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS parameter files."""

import pytest

from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.params_file import load, split


def write(tmp_path, text):
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    return path


def test_sections_for_this_node_win_over_those_for_all(tmp_path):
    path = write(
        tmp_path,
        """
joint_observer: {ros__parameters: {order: 2}}
/**:
  ros__parameters:
    order: 3
    form: robust
    bandwidth_hz: 1e1
    quantum: 1.5e-3
    per_joint:
      arm.left: {noise: 0.1, low_speed_bound: false}
other: {ros__parameters: {order: 7}}
""",
    )
    values = load(path)
    assert values == {
        'order': 2,
        'form': 'robust',
        'bandwidth_hz': 10.0,
        'quantum': 0.0015,
        'per_joint.arm.left.noise': 0.1,
        'per_joint.arm.left.low_speed_bound': False,
    }
    assert split(values) == (
        {'order': 2, 'form': 'robust', 'bandwidth_hz': 10.0, 'quantum': 0.0015},
        {'arm.left': {'noise': 0.1, 'low_speed_bound': False}},
    )
    assert load(path, 'other')['order'] == 7


@pytest.mark.parametrize('section', ['/robot/joint_observer', '*', '/*', '/**/joint_observer'])
def test_every_way_to_name_the_node(section, tmp_path):
    assert load(write(tmp_path, f"'{section}':\n  ros__parameters: {{a: 1}}")) == {'a': 1}
    nested = 'robot:\n  joint_observer:\n    ros__parameters: {a: 1}'
    assert load(write(tmp_path, nested)) == {'a': 1}


def test_a_list_of_joints_is_no_override():
    assert split({'joints': ['a', 'b'], 'per_joint.a.order': 2}) == (
        {'joints': ['a', 'b']},
        {'a': {'order': 2}},
    )


def test_no_name_is_that_of_a_value_and_of_a_group():
    with pytest.raises(UsageError, match='rename the joint') as caught:
        split({'per_joint.a.noise': 0.1, 'per_joint.a.noise.b.quantum': 0.1})
    assert '\n' not in str(caught.value)
    split({'per_joint.a.noise': 0.1, 'per_joint.a.noise_b.quantum': 0.1})


@pytest.mark.parametrize(
    'text, said',
    [
        ('a: [1', 'is no YAML (line 1)'),
        ('- 1', 'is no parameter file'),
        ('/**: &a {ros__parameters: *a}', 'has an alias to what it is part of'),
        ('/**: {ros__parameters: &a {b: *a}}', 'has an alias to what it is part of'),
        ('', 'is no parameter file'),
        ('bandwidth_hz: 3', "'bandwidth_hz' must hold 'ros__parameters:'"),
        ('other: {ros__parameters: {a: 1}}', "no section for 'joint_observer'; it has 'other'"),
        ('/**: {ros__parameters: 3}', 'must hold keys and values'),
        ('/**: {ros__parameters: {a: 1, a: 2}}', "'a' occurs twice"),
        ('/**: {a: {b: {}}}', "no 'ros__parameters' at all"),
    ],
)
def test_wrong_files_are_refused_in_one_line(text, said, tmp_path):
    with pytest.raises(UsageError) as caught:
        load(write(tmp_path, text))
    assert said in str(caught.value)
    assert '\n' not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(UserError, match=r'cannot read .*No such file'):
        load(tmp_path / 'nowhere.yaml')
    (tmp_path / 'binary').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(UserError, match='is not text'):
        load(tmp_path / 'binary')
    assert load(write(tmp_path, '/**:\n  ros__parameters:\n')) == {}  # sets nothing
