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

ROOT = Path(__file__).parents[2]
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
EXECUTABLES = [  # node, arguments of ROS, what it prints
    ('mechanical', ['-p', 'input:=torque'], 'input'),
    ('adaptive', ['-p', 'order:=9'], 'order'),
    ('switched', ['-p', 'joints:=[a, b]'], 'joints'),
    ('pmsm', ['-p', 'resistance:=0.0'], 'resistance'),
    ('joint', ['-p', 'observer:=hybrid_angel'], "did you mean 'hybrid_angle'?"),
    ('joint', ['--params-file', 'no_such_file.yaml'], 'no_such_file.yaml'),
    ('joint', ['-p', 'bandwidth_hz'], 'bandwidth_hz'),
    ('joint', ['--', 'observer=pll'], "not 'observer=pll'"),
]

# node -> (parameters, what it says)
WRONG = {
    'joint': [
        ({'use_sim_time': 'true'}, "'use_sim_time' to 'true'"),
        ({'start_type_description_service': 5}, "'start_type_description_service' to '5'"),
        ({'qos_overrides./joint_states.subscription.depth': -3}, "'joint_states': depth -3 is o"),
        ({'qos_overrides./joint_states.subscription.depth': 0}, "'joint_states': depth 0 is out"),
        ({'qos_overrides./joint_states.subscription.depth': 10**10}, 'is outside [1, '),
        ({'qos_overrides./joint_states.subscription.depth': 'many'}, "depth' to 'many'"),
        ({'qos_overrides./joint_states.subscription.reliability': 'relyable'}, 'relyable'),
        ({**HYBRID, 'bandwidth_hz': -3.0}, "'bandwidth_hz' = -3 is outside [0.001, 1e+06]"),
        ({**HYBRID, 'noise': math.nan}, "parameter 'noise' must be finite, not nan"),
        ({'per_joint.a.gap_max': 'long'}, "parameter 'per_joint.a.gap_max' must be a number"),
        ({'observer': 'hybrid_angel'}, "did you mean 'hybrid_angle'?"),
        ({'observer': 'geso'}, 'run the node mechanical_observer'),
        ({'input': 'angle', 'angle_type': 'Int32'}, "set 'counts_per_revolution'"),
        ({**HYBRID, 'order': 3, 'form': 'paper'}, "form 'paper' is of second order"),
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
        ({'observer_poles': [1.0, -2.0]}, "'observer_poles' = 1 is outside"),
        ({'observer_poles': [-2.0]}, "'observer_poles' needs 2 poles"),
        (
            {'parameters_file': '/no/such/folder/motor.yaml'},
            'the folder /no/such/folder does not exist',
        ),
        ({'input': 'effort_command', 'effort_command_type': 'Float64MultiArray'}, "set 'joints'"),
        ({'input_scale': [1.0, 2.0]}, '2 numbers for 1 input'),
    ],
    'switched': [
        ({'model': f'{OWN}Nope'}, "has no 'Nope'"),
        ({'model': f'{OWN}Singular'}, 'is not a SwitchedModel'),
        ({'discrete': 'guess'}, "'guess' is not one of"),
        ({'joints': ['a', 'b']}, "'joints' must name the model's 1 output"),
    ],
    'pmsm': [
        (MOTOR, 'needs the motor data resistance'),
        ({**MOTOR, 'resistance': 0.0}, "'resistance' = 0 is outside"),
        ({**MOTOR, 'resistance': 0.06, 'flux': -1.0}, "'flux' = -1 is outside"),
        ({**MOTOR, 'resistance': 0.06, 'pole_pairs': 0}, "'pole_pairs' = 0 is outside"),
        ({**MOTOR, 'resistance': 0.06, 'observer': 'geso'}, 'currents and voltages'),
        ({**MOTOR, 'resistance': 0.06, 'observer': 'kalman'}, 'currents and voltages'),
        ({**MOTOR, 'resistance': 0.06, 'observer': 'pmsn'}, "did you mean 'pmsm'?"),
    ],
}
CASES = [(node, *case) for node, cases in WRONG.items() for case in cases]


@pytest.mark.parametrize(
    'node, values, reported', CASES, ids=[f'{node}-{reported}' for node, _, reported in CASES]
)
def test_a_wrong_start_is_one_line(node, values, reported, probe):
    """The error of the node's class, which the executable prints (see the next test)."""
    with pytest.raises(UserError) as error:
        ObserverNode(KIND_OF[node], parameter_overrides=ros_values(values))
    assert reported in str(error.value) and '\n' not in str(error.value)


def test_executables_print_it_and_end():
    module = 'estimator_pkg.nodes.executables'
    runs = [
        nursery.Run(module, f'{node}_observer', '--ros-args', *words)
        for node, words, _ in EXECUTABLES
    ]
    for run, (_, words, reported) in zip(runs, EXECUTABLES):
        code, output, error = run.done(dds.PATIENCE)
        assert code == 2, (words, error)
        assert reported in error and len(error.splitlines()) == 1 and output == '', (words, error)


@pytest.mark.parametrize(
    ('module', 'given'),
    [
        ('estimator_pkg.nodes.executables pmsm_observer', 'resistance:=0.0'),
        ('sim_pkg.nodes.executables encoder_sim', 'rate:=-1.0'),
    ],
)
def test_a_refused_start_is_reported_and_ends_also_if_dds_hangs(module, given):
    """Seen once: DDS waited for ever while it destroyed a node that it had just made."""
    package, name = module.split()
    script = (
        'import time\n'
        'from estimator_pkg import interrupts\n'
        f'from {package} import {name}\n'
        'from rclpy.node import Node\n'
        'Node.destroy_node = lambda self: time.sleep(60.0)\n'
        'interrupts.LONGEST_END = 0.2\n'
        f'{name}()'
    )
    done = subprocess.run(
        [sys.executable, '-c', script, *dds.ros_args(given)],
        text=True,
        capture_output=True,
        timeout=dds.PATIENCE,
        check=False,
    )
    assert done.returncode == -signal.SIGALRM
    assert f"'{given.split(':')[0]}'" in done.stderr and done.stderr.count('\n') == 1


FILES = {  # what a parameter file says of joint_observer -> what the executable prints
    'joints: [y]': 'not [True]: y, n, yes, no, on and off are booleans in YAML; write texts in '
    "quotes, joints: ['y']",
    'joints: [x, y, z]': "Sequence should be of same type. Value type 'bool' do not belong at "
    "line_num 3; write texts in quotes, as in ['x', 'y']",
    'joints:': 'No value at line 3',
}


def ended(module, *arguments):
    """The line that a node printed when it ended with a usage error."""
    code, output, error = nursery.run('estimator_pkg.nodes.executables', module, *arguments)
    assert code == 2 and output == '', error
    (line,) = error.splitlines()
    return line


@pytest.mark.parametrize('text, reported', FILES.items())
def test_a_name_without_quotes_is_one_line_that_shows_them(text, reported, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    {text}\n')
    line = ended('joint_observer', *dds.ros_args(file=path))
    assert reported in line
    if text in ('joints: [y]', 'joints: [x, y, z]'):  # word for word in Troubleshooting
        page = (ROOT / 'docs/troubleshooting.md').read_text(encoding='utf-8')
        assert line.partition(': ')[2].replace(str(path), 'FILE') in page


def test_a_parameters_file_with_a_list_of_joints_is_one_line(tmp_path):
    path = tmp_path / 'motor.yaml'
    path.write_text('adaptive_parameters: 1\njoints: [a, b]\n')
    line = ended('adaptive_observer', *dds.ros_args(f'parameters_file:={path}'))
    assert f"{path}: 'joints' must map each joint's name" in line
