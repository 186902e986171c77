# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What nodes of model-based observers say to a wrong start: one line, at once."""

import math
import signal
import subprocess
import sys
from pathlib import Path

import dds
import nursery
import pytest

from estimator_pkg.errors import UserError
from estimator_pkg.nodes.observer import ObserverNode
from estimator_pkg.nodes.ros_parameters import ros_values

ROOT, MODULE = Path(__file__).parents[2], 'estimator_pkg.nodes.executables'
KIND_OF = {
    'joint': 'angle',
    'mechanical': 'mechanical',
    'adaptive': 'angle_and_input',
    'switched': 'switched',
    'pmsm': 'drive',
}
OWN = 'own_models:'
HYBRID = {'observer': 'hybrid_angle'}
MOTOR = {'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
POSE = 'geometry_msgs/msg/PoseStamped'
QUOTES = "write texts in quotes, joints: ['y']"
EXECUTABLES = [  # node, arguments of ROS, line of a parameter file, what it prints
    ('mechanical', ['-p', 'input:=torque'], '', 'input'),
    ('joint', ['--params-file', 'no_such_file.yaml'], '', 'no_such_file.yaml'),
    ('joint', ['-p', 'bandwidth_hz'], '', 'bandwidth_hz'),
    ('joint', ['--', 'observer=pll'], '', "not 'observer=pll'"),
    (
        'joint',
        [],
        'joints: [y]',
        f'not [True]: y, n, yes, no, on and off are booleans in YAML; {QUOTES}',
    ),
    (
        'joint',
        [],
        'joints: [x, y, z]',
        "Sequence should be of same type. Value type 'bool' do not "
        "belong at line_num 3; write texts in quotes, as in ['x', 'y']",
    ),
    ('joint', [], 'joints:', 'No value at line 3'),
]
IN_DOCS = ('joints: [y]', 'joints: [x, y, z]')  # word for word in Troubleshooting

# node -> (parameters, what it says)
WRONG = {
    'joint': [
        ({'use_sim_time': 'true'}, "'use_sim_time' to 'true'"),
        ({'start_type_description_service': 5}, "'start_type_description_service' to '5'"),
        ({'qos_overrides./joint_states.subscription.depth': 0}, "'joint_states': depth 0 is out"),
        ({'qos_overrides./joint_states.subscription.depth': 'many'}, "depth' to 'many'"),
        ({'qos_overrides./joint_states.subscription.reliability': 'relyable'}, 'relyable'),
        ({**HYBRID, 'bandwidth_hz': -3.0}, "'bandwidth_hz' = -3 is outside [0.001, 1e+06]"),
        ({**HYBRID, 'noise': math.nan}, "parameter 'noise' must be finite, not nan"),
        ({'per_joint.a.gap_max': 'long'}, "parameter 'per_joint.a.gap_max' must be a number"),
        ({'input': 'angle', 'angle_joint': ''}, "'angle_joint' must not be empty"),
        ({'input': 'angle', 'joints': ['other']}, "'joint' is not in 'joints'"),
        ({'observer': 'hybrid_angel'}, "did you mean 'hybrid_angle'?"),
        ({'observer': 'geso'}, 'run the node mechanical_observer'),
        ({'input': 'angle', 'angle_type': 'Int32'}, "set 'counts_per_revolution'"),
        ({**HYBRID, 'order': 3, 'form': 'paper'}, "form 'paper' is of second order"),
    ],
    'joint, of a field': [
        ({'field': 'data'}, f"needs 'field_type': set it, as in {POSE}"),
        ({'field_type': POSE}, "needs 'field': set it"),
        ({'field_type': 'geometry_msgs/PoseStamped', 'field': 'x'}, f'type: write it as {POSE}'),
        ({'field_type': '../etc/msg/Foo', 'field': 'x'}, 'is not a message type'),
        ({'field_type': f'{POSE[:-2]}d', 'field': 'x'}, f"did you mean '{POSE}'?"),
        (
            {'field_type': 'geometry_msg/msg/PoseStamped', 'field': 'x'},
            "the package 'geometry_msg' is not installed, or has no messages: did you mean "
            "'geometry_msgs'? Otherwise install it, or source its workspace",
        ),
        (
            {'field_type': 'machine_of_mine/msg/Encoder', 'field': 'x'},
            "the package 'machine_of_mine' is not installed, or has no messages: install it, or "
            'source its workspace',
        ),
        (
            {'field_type': POSE, 'field': 'pose.orientatoin.yaw'},
            "geometry_msgs/msg/Pose has no field 'orientatoin': did you mean 'orientation'?",
        ),
        ({'field_type': POSE, 'field': 'header.frame_id'}, 'is a string: name a numeric field'),
        ({'field_type': POSE, 'field': 'pose.position'}, 'name one of its fields, x, y, z'),
        ({'field_type': POSE, 'field': 'pose.orientation'}, "yaw with 'pose.orientation.yaw'"),
        ({'field_type': 'std_msgs/msg/Int16', 'field': 'data'}, "set 'counts_per_revolution'"),
        ({'field_type': 'std_msgs/msg/Float32MultiArray', 'field': 'data'}, "as in 'data[0]'"),
        ({'field_type': POSE, 'field': 'pose.'}, 'is not a field: write it as'),
    ],
    'mechanical': [
        ({'mechanisms': ['']}, "'mechanisms' is empty"),
        ({'model': f'{OWN}TwoLinks'}, "use the observer 'hgo'"),
        ({'model': f'{OWN}Singular', 'observer': 'hgo'}, "own_models:Singular'"),
        ({'model': f'{OWN}WrongSize', 'observer': 'hgo'}, "own_models:WrongSize'"),
        ({'model': f'{OWN}Nope'}, "has no 'Nope'"),
        ({'model': 'no_such_module:Arm'}, "cannot import 'no_such_module'"),
        ({'model': 'pendulum'}, "'pendulum' is not one of "),
        ({'model_parameters': ['inertai=1.0']}, "did you mean 'inertia'?"),
        ({'L': [-1.0], 'K': [3.0]}, '-L is not Hurwitz'),
        ({'L': [3.0], 'Gamma': [-1.0]}, "'Gamma' is not positive definite"),
        ({'model': 'robotic_leg', 'operating_point': [0.0, 0.0, 0.0]}, 'operating_point'),
        ({'joints': ['a', 'b']}, "has 1 joints (joint), but 'joints' names 2"),
        ({'mechanisms': ['a', 'b']}, "both have the joint 'joint'"),
        ({'mechanisms': ['a'], 'per_joint.b.bandwidth_hz': 3.0}, "unknown mechanism 'b'"),
        ({'observer': 'pll'}, 'choose geso, hgo, ehgo or smo'),
    ],
    'adaptive': [
        ({'law': 'gradient', 'gamma': [1.0, 2.0]}, "'gamma' needs 1, 4 or 16 numbers"),
        ({'law': 'gradient', 'gamma': [-1.0]}, "'gamma' is not positive definite"),
        ({'observer_poles': [-2.0]}, "'observer_poles' needs 2 poles"),
        (
            {'parameters_file': '/no/such/folder/motor.yaml'},
            'the folder /no/such/folder does not exist',
        ),
        ({'input': 'effort_command', 'effort_command_type': 'Float64MultiArray'}, "set 'joints'"),
        ({'input_scale': [1.0, 2.0]}, '2 numbers for 1 input'),
    ],
    'switched': [
        ({'model': f'{OWN}Singular'}, 'is not a SwitchedModel'),
        ({'discrete': 'guess'}, "'guess' is not one of"),
        ({'joints': ['a', 'b']}, "'joints' must name the model's 1 output"),
    ],
    'pmsm': [
        (MOTOR, 'needs the motor data resistance'),
        ({**MOTOR, 'resistance': 0.0}, "'resistance' = 0 is outside"),
        ({**MOTOR, 'resistance': 0.06, 'observer': 'geso'}, 'currents and voltages'),
    ],
}
CASES = [(node, *case) for node, cases in WRONG.items() for case in cases]


@pytest.mark.parametrize(
    'node, values, reported', CASES, ids=[f'{node}-{reported}' for node, _, reported in CASES]
)
def test_a_wrong_start_is_one_line(node, values, reported, probe):
    """The error of the node's class, which the executable prints (see the next test)."""
    node, _, of_field = node.partition(',')
    values = {**values, 'input': 'field'} if of_field else values
    with pytest.raises(UserError) as error:
        ObserverNode(KIND_OF[node], parameter_overrides=ros_values(values))
    assert reported in str(error.value) and '\n' not in str(error.value)


def test_executables_print_it_and_end(tmp_path):
    page, runs = (ROOT / 'docs/troubleshooting.md').read_text(encoding='utf-8'), []
    for node, words, text, _ in EXECUTABLES:
        path = tmp_path / f'{len(runs)}.yaml'
        path.write_text(f'/**:\n  ros__parameters:\n    {text}\n')
        words = words or ['--params-file', str(path)]
        runs.append(nursery.Run(MODULE, f'{node}_observer', '--ros-args', *words))
    for k, (run, (_, words, text, reported)) in enumerate(zip(runs, EXECUTABLES)):
        code, output, error = run.done(dds.PATIENCE)
        assert code == 2, (words, error)
        assert reported in error and len(error.splitlines()) == 1 and output == '', (words, error)
        if text in IN_DOCS:
            path = str(tmp_path / f'{k}.yaml')
            assert error.strip().partition(': ')[2].replace(path, 'FILE') in page


def test_a_refused_start_is_reported_and_ends_also_if_dds_hangs():
    """Seen once: DDS waited for ever while it destroyed a node that it had just made."""
    script = (
        'import time\n'
        'from estimator_pkg import interrupts\n'
        f'from {MODULE} import pmsm_observer\n'
        'from rclpy.node import Node\n'
        'Node.destroy_node = lambda self: time.sleep(60.0)\n'
        'interrupts.LONGEST_END = 0.2\n'
        'pmsm_observer()'
    )
    done = subprocess.run(
        [sys.executable, '-c', script, *dds.ros_args('resistance:=0.0')],
        text=True,
        capture_output=True,
        timeout=dds.PATIENCE,
        check=False,
    )
    assert done.returncode == -signal.SIGALRM
    assert "'resistance'" in done.stderr and done.stderr.count('\n') == 1


def test_a_parameters_file_with_a_list_of_joints_is_one_line(tmp_path, probe):
    path = tmp_path / 'motor.yaml'
    path.write_text('adaptive_parameters: 1\njoints: [a, b]\n')
    with pytest.raises(UserError, match=f"{path}: 'joints' must map each joint's name"):
        ObserverNode(
            'angle_and_input', parameter_overrides=ros_values({'parameters_file': str(path)})
        )
