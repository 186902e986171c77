# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Which room knows which: the table in docs/architecture.md is the imports, and nothing more."""

import ast
import sys
from pathlib import Path

import pytest

from docs.tools import rooms

ROS = {
    'rclpy',
    'rcl_interfaces',
    'builtin_interfaces',
    'std_msgs',
    'sensor_msgs',
    'std_srvs',
    'geometry_msgs',
    'trajectory_msgs',
    'diagnostic_msgs',
    'launch',
    'launch_ros',
    'ament_index_python',
    'ament_copyright',
    'ros2cli',
    'ros2doctor',
}
PACKAGES = {  # room: packages that its files may import, wherever in a file
    'observers': {'numpy'},
    'models': {'numpy'},
    'messages': {'numpy'},
    'driver': {'numpy', 'yaml'},
    'streams': {'numpy'},
    'ros': ROS,
    'nodes': ROS,
}
TOP = {path.stem for path in rooms.PACKAGE.glob('*.py')}


def imported(room):
    """(file, package, the rest of the name) of every import of a room."""
    for path in (rooms.PACKAGE / room).rglob('*.py'):
        for name in rooms.imported(path):
            package, _, inner = name.partition('.')
            yield path.name, package, inner


@pytest.mark.long
def test_the_table_is_of_these_imports():
    page = rooms.PACKAGE.parent / 'docs' / 'architecture.md'
    assert rooms.table() in page.read_text(), 'python -m docs.tools.rooms prints it'


@pytest.mark.long
def test_a_room_imports_only_rooms_below_it():
    order = list(rooms.CAPTIONS)
    assert set(order) == rooms.rooms()
    upwards = {(a, b) for a, b in rooms.arrows() if order.index(a) > order.index(b)}
    assert not upwards


@pytest.mark.parametrize('room', PACKAGES)
def test_a_room_imports_the_packages_that_it_may(room):
    own = {'estimator_pkg', *sys.stdlib_module_names, *PACKAGES[room]}
    assert {package for _, package, _ in imported(room)} <= own


@pytest.mark.parametrize('room', ['observers', 'models', 'messages', 'driver', 'streams', 'ros'])
def test_these_rooms_know_no_command_line(room):
    top = {inner for _, package, inner in imported(room) if package == 'estimator_pkg'} & TOP
    assert top.isdisjoint({'cli', 'listing', 'progress', 'destination', 'estimator'})


@pytest.mark.long
def test_nothing_in_the_package_knows_simulators_benchmarks_or_docs():
    for path in Path(rooms.PACKAGE).rglob('*.py'):
        outside = {name.split('.')[0] for name in rooms.imported(path)}
        assert outside.isdisjoint({'sim_pkg', 'benchmarks', 'docs', 'test'}), path


# Rooms of `evaluation`, the lowest first; its own files are below them all.
STEPS = ('reference', 'checks', 'ranking', 'compare', 'identify', 'tuning', 'doctor', 'report')


def steps_above(room):
    """(file, what it imports) wherever a file of `evaluation` imports a room above its own."""
    above = STEPS[STEPS.index(room) + 1 :] if room else STEPS
    place = rooms.PACKAGE / 'evaluation' / room
    for path in place.rglob('*.py') if room else place.glob('*.py'):
        tree = ast.parse(path.read_text())
        names = [
            name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module
            for name in [node.module, *(f'{node.module}.{each.name}' for each in node.names)]
        ]
        yield from (
            (path.name, name)
            for name in {*names, *rooms.imported(path)}
            if f'{name}.'.startswith(tuple(f'estimator_pkg.evaluation.{each}.' for each in above))
        )


@pytest.mark.parametrize('room', ['', *STEPS])
def test_evaluation_imports_go_one_way(room):
    folders = {path.parent.name for path in (rooms.PACKAGE / 'evaluation').glob('*/__init__.py')}
    assert folders == set(STEPS)
    assert not list(steps_above(room))
