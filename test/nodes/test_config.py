# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What the parameter files of the nodes teach, and settings that follow from others."""

import math
import re
from pathlib import Path

import pytest
import yaml

from estimator_pkg import observers, params_file, streams
from estimator_pkg.driver.configuration import Configuration, JointSettings
from estimator_pkg.observers.angle.shared import AngleGains
from estimator_pkg.parameters import build, declared
from estimator_pkg.streams.angle import AngleSettings

CONFIG = Path(__file__).parents[2] / 'config'
YAML = CONFIG / 'joint_observer.yaml'
KEY = re.compile(r'    (#?)([\w.]+): (.+)$')
MOTOR = ('resistance', 'inductance', 'flux', 'pole_pairs')


def yaml_sections():
    """{section: {key: (value, is set)}}; every key stands below its sentence."""
    sections, section = {}, None
    lines = YAML.read_text().splitlines()
    for number, line in enumerate(lines):
        title = re.match(r'    # ---- ([\w ]+?) -+$', line)
        if title:
            section = sections.setdefault(title[1], {})
        key = KEY.match(line)
        if key and section is not None:
            assert key[2] not in section
            section[key[2]] = (yaml.safe_load(key[3]), not key[1])
            before = lines[number - 1]
            assert (
                before.startswith('    # ')
                or before.startswith('    #per_joint.')
                or before.startswith('    #qos_')
            ), line
    return sections


def angle_observers():
    found = [observers.find(name) for name in observers.names()]
    return [observer for observer in found if observer.kind == 'angle']


def assert_taught(section, parameters):
    """Each parameter is there, with its default; automatic ones with the value that says so."""
    for name, parameter in parameters.items():
        assert name in section, f'{name} is missing in {YAML.name}'
        value, _ = section[name]
        assert parameter.check(value) == parameter.default, name
    extra = {name for name in section if '.' not in name} - set(parameters)
    assert not extra


def test_yaml_teaches_every_key():
    sections, shared = yaml_sections(), declared(AngleGains)
    assert_taught(sections.pop('input'), declared(AngleSettings))
    assert_taught(sections.pop('joints'), {**declared(JointSettings), **shared})
    for observer in angle_observers():
        own = {name: one for name, one in declared(observer.gains).items() if name not in shared}
        assert_taught(sections.pop(observer.name), own)
    assert set(sections) == {'quality of service'}


@pytest.mark.parametrize('observer', angle_observers(), ids=lambda observer: observer.name)
def test_what_the_yaml_sets_suits_every_observer(observer):
    values, overrides = params_file.split(params_file.load(YAML))
    assert overrides == {}
    node = {name: value for name, value in values.items() if name in declared(AngleSettings)}
    settings = build(AngleSettings, node)
    settings.find_observer()
    rest = {name: value for name, value in values.items() if name not in node}
    assert Configuration(observer, rest).for_joint('any') == Configuration(observer).for_joint(
        'any'
    )


@pytest.mark.parametrize('name', ['adaptive_observer', 'pmsm_observer', 'wheel_odometry'])
def test_config_teaches_every_parameter_with_its_default(name):
    """test_mechanism.py and test_simulators.py have the others."""
    lines = (CONFIG / f'{name}.yaml').read_text().splitlines()
    found = {key[2]: yaml.safe_load(key[3]) for key in map(KEY.match, lines) if key}
    (stream,) = [each for each in streams.every() if name == each.NODE]
    (gains,) = [
        observer.gains
        for observer in map(observers.find, observers.names())
        if observer.kind == stream.KIND
    ]
    for cls in (stream.SETTINGS, gains, stream.PER_JOINT):
        for key, parameter in declared(cls).items():
            assert key in found, key
            if parameter.default is not None or parameter.automatic is not None:
                assert parameter.check(found[key]) == parameter.default, key


@pytest.mark.parametrize('file', ['pmsm_motor_servo_400w', 'pmsm_observer'])
def test_motor_data_suit_node_and_simulator(file):
    simulated = 'pmsm_sim' if file == 'pmsm_observer' else file
    node = params_file.load(CONFIG / f'{file}.yaml', 'pmsm_observer')
    simulator = params_file.load(CONFIG / f'{simulated}.yaml', 'pmsm_sim')
    gains, _ = Configuration(
        observers.find('pmsm'), {name: node[name] for name in MOTOR}
    ).for_joint('')
    assert all(getattr(gains, name) == node[name] == simulator[name] for name in MOTOR)


def test_counts_imply_the_quantum_unless_it_is_set():
    counted = build(AngleSettings, {'input': 'angle', 'counts_per_revolution': 1000})
    assert counted.implied({'quantum': 0.0, 'noise': 1.0}) == {
        'quantum': pytest.approx(2.0 * math.pi / 1000),
        'noise': 1.0,
    }
    assert counted.implied({'quantum': 0.5}) == {'quantum': 0.5}
    degrees = {'input': 'angle', 'counts_per_revolution': 360}  # with digits, which are no counts
    assert build(AngleSettings, degrees).implied({}) == {}
    assert 'quantum' in build(AngleSettings, {**degrees, 'angle_type': 'Int32'}).implied({})
    stated = build(AngleSettings, {'counts_per_revolution': 1000})  # not used with joint_states
    assert stated.implied({'quantum': 0.0}) == {'quantum': 0.0}
