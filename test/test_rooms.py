"""Which room may know which: docs/architecture.md, held against the imports."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# small files that every room may use
SHARED = {'params_file', 'errors', 'parameters', 'registry', 'optional', 'printable', 'yaml_text'}
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
}
# room: (rooms, packages) that its files may import, wherever in a file
MAY_KNOW = {
    'observers': ({'models'}, {'numpy'}),
    'models': ({'observers'}, {'numpy'}),
    'messages': (set(), {'numpy'}),
    'driver': ({'observers', 'models', 'messages'}, {'numpy', 'yaml', 'numba'}),
    'streams': ({'driver', 'observers', 'models', 'messages'}, {'numpy'}),
    'nodes': ({'streams', 'driver', 'observers', 'messages'}, ROS),
}


def imported(path):
    """Dotted names of what a file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module == 'estimator_pkg':
            yield from (f'estimator_pkg.{alias.name}' for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


@pytest.mark.parametrize('room', MAY_KNOW)
def test_a_room_imports_what_it_may_know(room):
    rooms, packages = MAY_KNOW[room]
    for path in (ROOT / 'estimator_pkg' / room).rglob('*.py'):
        for name in imported(path):
            package, _, inner = name.partition('.')
            if package == 'estimator_pkg':
                assert inner.split('.')[0] in {room} | rooms | SHARED, (path.name, name)
            elif package not in sys.stdlib_module_names:
                assert package in packages, (path.name, name)


def test_nothing_in_the_package_knows_the_simulators():
    for path in (ROOT / 'estimator_pkg').rglob('*.py'):
        assert not any(name.split('.')[0] == 'sim_pkg' for name in imported(path)), path
