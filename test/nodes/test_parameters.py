# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the nodes through ROS: types, automatic values, ranges, dumps."""

import math
import re
from contextlib import contextmanager

import numpy as np
import pytest
import yaml
from own_node import in_context
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from estimator_pkg import observers, registry, streams
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.nodes.observer import ObserverNode
from estimator_pkg.nodes.ros_parameters import RosParameters
from estimator_pkg.parameters import declared
from sim_pkg.contract import RunSettings

MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
MACHINE = {**MOTOR, 'radius': [0.1], 'track': 0.5}  # what must be set
STREAMS = {stream.NODE: stream for stream in streams.every()}
OBSERVERS = {  # one of each node; test_parameters.py has the values of all
    stream.KIND: 'hybrid_angle' if stream.NODE == 'joint_observer' else name
    for stream in STREAMS.values()
    for name in observers.names()
    if observers.find(name).kind == stream.KIND
}
NODES = {  # the classes that declare the parameters, and how many of them declare those of joints
    name: (
        (stream.SETTINGS, observers.find(OBSERVERS[stream.KIND]).gains, stream.PER_JOINT),
        2 if stream.OVERRIDES else 0,
    )
    for name, stream in STREAMS.items()
}
SIMULATORS = {
    f'{name}_sim': ((RunSettings, registry.find(registry.SIMULATORS, name).parameters), 0)
    for name in registry.names(registry.SIMULATORS)
}
EVERY = {**NODES, **SIMULATORS}
JOINT_OBSERVER, _ = NODES['joint_observer']
TYPES = {float: 'DOUBLE', int: 'INTEGER', bool: 'BOOL', str: 'STRING'}
TYPES |= {tuple: 'STRING_ARRAY', list: 'DOUBLE_ARRAY'}


def must(known):
    """The parameters without a default that a node needs."""
    return {
        name: value
        for name, value in MACHINE.items()
        if name in known and isinstance(value, known[name].kind)
    }


@contextmanager
def declaring(classes, values, tmp_path, overridable=()):
    """A bare node with the parameters of a real one, read from a file: (node, RosParameters).

    It checks nothing but parameters: extreme gains need not suit each other.
    """
    file = tmp_path / 'values.yaml'
    file.write_text(yaml.dump({'/**': {'ros__parameters': values}}))
    with in_context(file) as where:
        node = Node(
            'bare',
            **where,
            allow_undeclared_parameters=bool(overridable),
            start_parameter_services=False,
            enable_rosout=False,
        )
        try:
            ros = RosParameters(node)
            for cls in classes:
                ros.declare(cls)
            if overridable:
                ros.allow_overrides(overridable)
            ros.watch(lambda values, overrides: None, lambda: None)
            yield node, ros
        finally:
            node.destroy_node()


def parameters_of(classes):
    return {name: one for cls in classes for name, one in declared(cls).items()}


def extremes(parameter):
    """What is set, by 'automatic', 'minimum' and 'maximum', where it makes sense."""
    found = {}
    if parameter.automatic is not None:
        found['automatic'] = parameter.plain(None)
    if parameter.choices:
        words = [word for word in parameter.choices if ':' not in word]
        found |= {'minimum': words[0], 'maximum': words[-1]}
    elif parameter.kind is bool:
        found |= {'minimum': False, 'maximum': True}
    elif parameter.kind in (int, float):
        found = found | {'minimum': parameter.kind(parameter.minimum)}
        found['maximum'] = parameter.kind(parameter.maximum)
    elif parameter.kind is list:
        low, high = parameter.minimum, parameter.maximum
        found |= {'minimum': [float(low or 0.0)], 'maximum': [float(high or 1.0)]}
    return found


def alike(one, other):
    """Equal in type and value, NaN included; whole numbers are not floats."""
    return repr(one) == repr(other)


def plain(value):
    return list(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value


def values_of(node):
    return {
        name: plain(node.get_parameter(name).value) for name in node.list_parameters([], 0).names
    }


def dumped(name, values):
    """What ``ros2 param dump`` prints."""
    tree = {}
    for key, value in values.items():
        *groups, leaf = key.split('.')
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        assert leaf not in branch and isinstance(branch, dict), f'{key} is leaf and branch'
        branch[leaf] = value
    return yaml.dump({name: {'ros__parameters': tree}}, default_flow_style=False)


def read_again(values, tmp_path):
    """What a node gets that starts with the dump of another one with these values."""
    file = tmp_path / 'dump.yaml'
    file.write_text(dumped('/bare', values))
    with in_context(file) as where:
        node = Node('bare', **where, start_parameter_services=False, enable_rosout=False)
        given = {name: plain(one.value) for name, one in node._parameter_overrides.items()}
        node.destroy_node()
    if 'no_estimate' in given and given['no_estimate'] != given['no_estimate']:
        given['no_estimate'] = 'nan'  # rcl reads the word as a number, the node takes the word
    return given


@pytest.mark.parametrize('classes, per_joint', NODES.values(), ids=NODES)
@pytest.mark.parametrize('which', ['automatic', 'minimum', 'maximum'])
def test_a_file_with_extreme_values_is_read_and_its_dump_again(
    which, classes, per_joint, probe, tmp_path
):
    known = parameters_of(classes)
    overridable = [name for cls in classes[len(classes) - per_joint :] for name in declared(cls)]
    given = {name: extremes(one).get(which) for name, one in known.items()}
    given = {name: value for name, value in given.items() if value is not None}
    with declaring(classes, {**must(known), **given}, tmp_path, overridable) as (node, _):
        before = values_of(node)
        for name, parameter in known.items():
            found = node.get_parameter(name)
            assert found.type_.name == TYPES[parameter.kind], name
            assert name not in given or alike(plain(found.value), given[name]), name
    read = read_again(before, tmp_path)
    assert read.keys() == before.keys()
    assert all(alike(read[name], before[name]) for name in read)


def forms(parameter):
    """Return the values that a file may have for a parameter, in each form that is read."""
    if parameter.kind in (str, bool, tuple):
        words = [word for word in parameter.choices if ':' not in word]
        found = words or ([False, True] if parameter.kind is bool else [])
    else:
        default = parameter.default
        (number, *_) = default if isinstance(default, tuple) else (default,)
        if number is None:
            number = min(max(parameter.minimum or 0.0, 1.0), parameter.maximum or 1.0)
        found = [number, math.ceil(number)]
        found += [[value] for value in found] if parameter.kind is list else []
    return found if parameter.automatic is None else [parameter.plain(None), *found]


def samples(node):
    """Return two messages for the measurement of a node."""
    stamps = [1_000_000_000, 1_001_000_000]
    if node.stream.NODE == 'pmsm_observer':
        return [drive_samples.encode(np.array([stamp]), np.ones((1, 4))) for stamp in stamps]
    names = sorted(node.stream.needed()) or ['a']
    numbers = [0.1] * len(names)
    return [Encoder().encode(stamp, '', names, numbers, (), numbers) for stamp in stamps]


@pytest.mark.parametrize('name', NODES)
def test_each_live_parameter_is_set_in_each_form_while_joints_run(name, own):
    family, known = STREAMS[name], parameters_of(NODES[name][0])
    observer = OBSERVERS[family.KIND]
    given = {
        'observer': observer,
        'model': 'gripper' if observer == 'switched' else '',
        **must(known),
    }
    node = own(
        family, **{key: value for key, value in given.items() if value and key in known}
    ).node
    live = {key: parameter for key, parameter in known.items() if not parameter.structural}
    of_joints = declared(family.PER_JOINT) | declared(observers.find(observer).gains)
    for raw in samples(node):
        node.stream.feed(0, raw, 0)
    joints = node.stream.bank.joints
    assert all(joint.used == 2 for joint in joints.values())
    for key, parameter in live.items():
        overridable = family.OVERRIDES and key in of_joints
        for full in (key, f'per_joint.{min(joints)}.{key}')[: 1 + overridable]:
            before = node.get_parameter(key).value
            for value in [*forms(parameter), before]:
                (result,) = node.set_parameters([RosParameter(full, value=value)])
                assert result.successful or result.reason, (full, value)
                for each in joints.values():
                    assert each.used == 2 and len(each.estimate()) == 4
            assert result.successful, (full, before, result.reason)


@pytest.mark.parametrize('name', ['joint_observer', 'pmsm_observer'])
def test_the_start_names_what_is_not_the_default_and_unknown_names_are_refused(
    name, probe, tmp_path, capfd
):
    """A file for another node changes nothing, which the line of the start shows."""
    file, motor = tmp_path / 'params.yaml', must(parameters_of(NODES[name][0]))
    own = {'no_estimate': 'skip', 'gap_max': 0.2, 'timeout': 0.7}
    for others, reported in (({}, {*motor, 'no_estimate', 'timeout'}), ({'other': own}, {*motor})):
        sections = {**others, name: motor if others else {**own, **motor}}
        file.write_text(
            yaml.dump({owner: {'ros__parameters': section} for owner, section in sections.items()})
        )
        with in_context(file) as where:
            node = ObserverNode(STREAMS[name], **where)
            (refused,) = node.set_parameters([RosParameter('gap_mx', value=0.3)])
            node.destroy_node()
        [named] = re.findall(r' estimates .*/estimate \((.*)\)', capfd.readouterr().err)
        changed = set(named.removeprefix('not the defaults: ').split(', '))
        assert changed == (reported or {'all parameters are defaults'})
        assert not refused.successful
        assert refused.reason == "unknown parameter 'gap_mx': did you mean 'gap_max'?"


@pytest.mark.parametrize('call', ['check', 'apply'])
def test_an_exception_at_a_change_is_one_line_and_the_call_is_answered(
    call, own, monkeypatch, capfd
):
    def fails(configuration):
        raise IndexError('of a model')

    node = own('mechanical')
    monkeypatch.setattr(node.node.stream, call, fails)
    assert bool(node.set(bandwidth_hz=20.0)) == (call == 'check')
    said = capfd.readouterr().err
    assert "observer 'geso' failed: IndexError: of a model (line " in said
    assert len(said.splitlines()) == 2  # that of the start, and this one


@pytest.mark.parametrize('classes, per_joint', EVERY.values(), ids=EVERY)
def test_descriptors_have_ranges_with_the_automatic_value(classes, per_joint, probe, tmp_path):
    known = parameters_of(classes)
    motor = must(known)
    overridable = [name for cls in classes[len(classes) - per_joint :] for name in declared(cls)]
    live = [name for name in overridable if not known[name].structural]
    with declaring(classes, motor, tmp_path, overridable) as (node, ros):
        if overridable:  # one set live has the descriptor of the common one
            override = f'per_joint.any.{live[0]}'
            (result,) = node.set_parameters(
                [RosParameter(override, value=known[live[0]].plain(ros.values[live[0]]))]
            )
            assert result.successful and node.describe_parameter(override).description
            (refused,) = node.set_parameters([RosParameter(f'per_joint.new.{live[0]}', value='x')])
            assert not refused.successful
            assert f'per_joint.new.{live[0]}' not in values_of(node)
        for name, parameter in known.items():
            described = node.describe_parameter(name)
            assert described.type == node.get_parameter(name).type_.value != 0, name
            assert described.dynamic_typing and described.read_only == parameter.structural
            assert described.additional_constraints == parameter.range_text()
            if parameter.kind not in (int, float):
                continue
            ranges = described.floating_point_range, described.integer_range
            (found,) = ranges[parameter.kind is int]
            low, automatic = parameter.minimum, parameter.automatic
            assert found.from_value == (low if automatic is None else min(low, automatic))
            assert found.to_value == parameter.maximum and found.step == 0
            if parameter.kind is int:  # rqt_reconfigure's slider has 32 bits
                assert -(2**31) <= found.from_value < found.to_value < 2**31, name
            for wrong in (math.nan, float(found.to_value * 2 + 1)):
                (result,) = node.set_parameters([RosParameter(name, value=wrong)])
                assert not result.successful
                if not parameter.structural:  # in our words
                    assert f"'{name}'" in result.reason


def test_a_misspelt_group_is_named_with_the_right_one(probe, tmp_path):
    given = dict.fromkeys(['per_joints.a.noise', 'per_joint.a.nose', 'a.noise', 'a.b.noise'], 0.1)
    with declaring(JOINT_OBSERVER, given, tmp_path, ['noise']) as (_, ros):
        assert ros.unknown() == {
            'per_joints.a.noise': "did you mean 'per_joint.a.noise'?",
            'per_joint.a.nose': "did you mean 'noise'?",
            'a.noise': "did you mean 'per_joint.a.noise'?",
            'a.b.noise': "did you mean 'per_joint.a.b.noise'?",
        }
