"""What nodes of model-based observers say to a wrong start: one line, at once."""

from __future__ import annotations

import importlib
import subprocess
import sys

import dds
import pytest

from estimator_pkg.errors import UserError
from estimator_pkg.nodes.ros_parameters import ros_values

OWN = 'own_models:'
MOTOR = {'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
EXECUTABLES = [('mechanical', 'input:=torque'), ('adaptive', 'order:=9'),
               ('switched', 'joints:=[a, b]'), ('pmsm', 'resistance:=0.0')]

# node -> (parameters, what it says)
WRONG = {
    'joint': [
        ({'use_sim_time': 'true'}, "'use_sim_time' to 'true'"),
        ({'start_type_description_service': 5}, "'start_type_description_service' to '5'"),
        ({'qos_overrides./joint_states.subscription.depth': -3}, "'joint_states': depth -3 is o"),
        ({'qos_overrides./joint_states.subscription.depth': 0}, "'joint_states': depth 0 is out"),
        ({'qos_overrides./joint_states.subscription.depth': 10 ** 10}, 'is outside [1, '),
        ({'qos_overrides./joint_states.subscription.depth': 'many'}, "depth' to 'many'")],
    'mechanical': [
        ({'mechanisms': ['']}, "'mechanisms' names no mechanism"),
        ({'model': f'{OWN}TwoLinks'}, "use the observer 'hgo'"),
        ({'model': f'{OWN}Singular', 'observer': 'hgo'}, "own_models:Singular'"),
        ({'model': f'{OWN}WrongSize', 'observer': 'hgo'}, "own_models:WrongSize'"),
        ({'model': f'{OWN}Nope'}, "has no 'Nope'"),
        ({'model': 'no_such_module:Arm'}, "cannot import 'no_such_module'"),
        ({'model': 'pendulum'}, "'pendulum' is not one of "),
        ({'model_parameters': ['inertai=1.0']}, "did you mean 'inertia'?"),
        ({'L': [-1.0], 'K': [3.0]}, '-L is not Hurwitz'),
        ({'L': [3.0], 'Gamma': [-1.0]}, "'Gamma' is not positive definite"),
        ({'model': 'robotic_leg', 'operating_point': [0.0, 0.0, 0.0]}, 'operating point'),
        ({'joints': ['a', 'b']}, "has 1 joints (joint), but 'joints' names 2"),
        ({'mechanisms': ['a', 'b']}, "both have the joint 'joint'"),
        ({'mechanisms': ['a'], 'joints.b.bandwidth_hz': 3.0}, "a mechanism 'b'"),
        ({'observer': 'pll'}, 'take geso, hgo, ehgo or smo')],
    'adaptive': [
        ({'law': 'gradient', 'gamma': [1.0, 2.0]}, "'gamma' needs 1, 4 or 16 numbers"),
        ({'law': 'gradient', 'gamma': [-1.0]}, "'gamma' is not positive definite"),
        ({'observer_poles': [1.0, -2.0]}, "'observer_poles' = 1 is outside"),
        ({'observer_poles': [-2.0]}, "'observer_poles' needs 2 poles"),
        ({'parameters_file': '/no/such/folder/motor.yaml'}, 'there is no folder'),
        ({'input': 'effort_command', 'effort_command_type': 'Float64MultiArray'}, "set 'joints'"),
        ({'input_scale': [1.0, 2.0]}, '2 numbers for 1 input')],
    'switched': [
        ({'model': f'{OWN}Nope'}, "has no 'Nope'"),
        ({'model': f'{OWN}Singular'}, 'is no SwitchedModel'),
        ({'discrete': 'guess'}, "'guess' is not one of"),
        ({'joints': ['a', 'b']}, "'joints' must name the model's 1 output")],
    'pmsm': [
        (MOTOR, 'needs the motor data resistance'),
        ({**MOTOR, 'resistance': 0.0}, "'resistance' = 0 is outside"),
        ({**MOTOR, 'resistance': 0.06, 'observer': 'geso'}, 'currents and voltages')]}
CASES = [(node, *case) for node, cases in WRONG.items() for case in cases]


@pytest.mark.parametrize('node, values, told', CASES,
                         ids=[f'{node}-{told}' for node, _, told in CASES])
def test_a_wrong_start_is_one_line(node, values, told, probe):
    """The error of the node's class, which the executable prints (see the next test)."""
    module = importlib.import_module(f'estimator_pkg.nodes.{node}_observer')
    with pytest.raises(UserError) as error:
        getattr(module, f'{node.capitalize()}Observer')(parameter_overrides=ros_values(values))
    assert told in str(error.value) and '\n' not in str(error.value)


def test_executables_print_it_and_end():
    children = [subprocess.Popen(
        [sys.executable, '-m', f'estimator_pkg.nodes.{node}_observer', '--ros-args', '-p', given],
        text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for node, given in EXECUTABLES]
    for child, (_, given) in zip(children, EXECUTABLES):
        output, error = child.communicate(timeout=3.0 * dds.PATIENCE)
        assert child.returncode == 2, error
        assert given.split(':=')[0] in error and len(error.splitlines()) == 1 and output == ''
