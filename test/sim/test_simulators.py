# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What every simulator does with parameters that no plant can have: one line, never a NaN."""

import math
import re
from pathlib import Path

import pytest

from estimator_pkg import params_file, registry
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.joint_state import Decoder
from estimator_pkg.models.load import load
from estimator_pkg.parameters import build, declared
from sim_pkg.mechanisms.cart_pendulum import Feedback
from sim_pkg.mechanisms.stream import MechanismParameters, fastest, stream

CONFIG = Path(__file__).resolve().parents[2] / 'config'


def simulated(name, seconds, **values):
    """Messages by topic, decoded."""
    simulator = registry.find(registry.SIMULATORS, name)
    parameters = build(simulator.parameters, values, owner=name)
    decode = Decoder().decode
    found = {topic.name: [] for topic in simulator.topics(parameters)}
    for chunk in simulator.generate(parameters, seconds, 1):
        for message in chunk:
            raw = bytes(message.encode(0))
            if 'joint_states' in message.topic:
                found[message.topic].append(decode(raw))
            elif 'samples' in message.topic:
                found[message.topic].append(drive_samples.decode(raw))
    return found


@pytest.mark.parametrize('name', registry.names(registry.SIMULATORS))
def test_the_examples_in_its_config_can_be_used(name):
    """The command in the head observes this plant."""
    path = CONFIG / f'{name}_sim.yaml'
    text = path.read_text()
    simulator = registry.find(registry.SIMULATORS, name)
    values = {
        key: value
        for key, value in params_file.load(path, f'{name}_sim').items()
        if key in declared(simulator.parameters)
    }
    assert values.keys() == declared(simulator.parameters).keys()
    simulator.generate(build(simulator.parameters, values), 0.1, 1)
    (command,) = re.findall(r'it:\n#   ros2 run velocity_estimator (.*(?:\n#     .*)?)', text)
    settings = dict(re.findall(r'(\w+):=(\[.*?\]|[^\s"]+)', command))
    numbers = settings.get('model_parameters', '[]').strip('[]')
    if command.startswith('mechanical_observer'):
        load(settings.get('model', 'single_joint'), tuple(numbers.split(', ')) if numbers else ())


@pytest.mark.parametrize(
    ('name', 'values', 'said'),
    [
        ('dc_motor', {'damping': 1e6}, 'a time constant of 2e-08 s'),
        ('dc_motor', {'inertia': 1e-9}, 'increase the inertia'),
        ('gripper', {'inertia': 1e-6}, 'at least 5e-05 s'),
        ('pendulum', {'model_parameters': ['inertia=1e-9']}, 'a time constant of 5e-08 s'),
        ('cart_pendulum', {'model_parameters': ['cart_damping=1e6']}, 'a time constant'),
        ('pmsm', {'inertia': 1e-9}, 'less than a sample'),
        ('pmsm', {'viscous': 1000.0}, 'less than a sample'),
        ('pendulum', {'quantum': [1.0, 2.0]}, "'quantum' has 2 numbers for 1 positions"),
        ('robotic_leg', {'noise': []}, "'noise' has 0 numbers for 3 positions"),
        ('pendulum', {'model_parameters': ['mass=1']}, "unknown parameter 'mass'"),
    ],
)
def test_what_cannot_be_simulated_is_refused_before_it_begins(name, values, said):
    simulator = registry.find(registry.SIMULATORS, name)
    with pytest.raises(UsageError, match=said):  # not with the first chunk: that is the live run's
        simulator.generate(build(simulator.parameters, values), 0.1, 1)


def test_a_quick_motor_follows_its_voltage():
    """Without inertia to speak of the velocity is Kv u / b: steps of 1 ms would give NaN."""
    found = simulated('dc_motor', 0.5, inertia=4e-6, stiffness=0.0, hold=0.01)
    for measured, true in zip(found['joint_states'][2:], found['ground_truth/joint_states'][2:]):
        assert true.velocities[0] == pytest.approx(0.6 / 0.04 * measured.efforts[0], rel=1e-3)


def test_a_quick_pendulum_swings_at_its_own_rate():
    """sqrt(g / J) = 12247 1/s: with steps of 0.5 ms it would be beyond all numbers at once."""
    numbers = ['inertia=1e-8', 'damping=0.0', 'coulomb=0.0', 'gravity=1.5']
    rate = math.sqrt(1.5 / 1e-8)
    assert fastest(load('single_joint', tuple(numbers)), (0.0,)) == pytest.approx(rate, rel=1e-6)
    found = simulated('pendulum', 0.1, rate=100.0, torque=0.1, model_parameters=numbers)
    moved = [true.velocities[0] for true in found['ground_truth/joint_states'][1:]]
    assert all(0.0 < abs(velocity) < 0.3 * rate for velocity in moved)  # 0.3 N m at the most


@pytest.mark.parametrize(
    'torque, said',
    [
        (lambda time: 1e11 * max(0.0, time - 0.5), r'the simulated plant diverged at 0\.\d+ s'),
        (lambda time: math.inf, 'diverged'),  # math.sin says ValueError of infinity
    ],
)
def test_a_plant_that_runs_away_says_when(torque, said):
    chunks = stream(
        load('single_joint', ()),
        MechanismParameters(rate=100.0),
        (0.0,),
        (0.0,),
        lambda time, y, v: (torque(time),),
        10.0,
        1,
    )
    with pytest.raises(UserError, match=said) as reported:
        list(chunks)
    assert '\n' not in str(reported.value) and reported.value.exit_code == 1


def test_an_estimate_that_is_no_number_steers_nothing():
    feedback = Feedback()
    feedback.put((math.nan, 0.1))
    assert feedback.velocities is None
    feedback.put((0.2, 0.1))
    feedback.put((0.3, math.inf))
    assert feedback.take() == (0.2, 0.1)
