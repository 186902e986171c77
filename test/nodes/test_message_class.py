# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Type names come from bags and from other people's nodes: what they may import."""

import os
import subprocess
import sys

import dds
import pytest
from bag_making import STORE
from std_msgs.msg import Float64

from estimator_pkg.bags.definitions import define
from estimator_pkg.bags.definitions import fields_of as fields_of_definition
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.nodes.message_types import fields_of
from estimator_pkg.ros.message_class import message_class, message_types, packages_with_messages

FLOAT = 'std_msgs/msg/Float64'
HOSTILE = 'from pathlib import Path\nPath(__file__).with_name("imported").touch()\n'
NAMES = [
    'mine/msg/Foo',
    'mine.inner/msg/Foo',
    'this/msg/Foo',
    'sensor_msgs/msg/JointState',
    'rclpy/msg/Foo',
    'mine/msg/Foo/msg/Foo',
    '../mine/msg/Foo',
    'mine//Foo',
    '/msg/Foo',
    'sensor_msgs/mine/Foo',
    'MINE/msg/Foo',
    'mine/msg/foo',
]


@pytest.fixture
def hostile(tmp_path):
    """A folder with packages of the user's, one with the name of a ROS package."""
    for name in ('mine', 'sensor_msgs', 'this'):
        (tmp_path / name / 'msg').mkdir(parents=True)
        for file in (tmp_path / name / '__init__.py', tmp_path / name / 'msg' / '__init__.py'):
            file.write_text(HOSTILE + 'class Foo: ...\nclass JointState: ...\n')
    (tmp_path / 'mine' / 'inner').mkdir()
    (tmp_path / 'mine' / 'inner' / '__init__.py').write_text(HOSTILE)
    return tmp_path


def imported(folder):
    return [str(path) for path in folder.rglob('imported')]


def test_a_type_name_imports_nothing_of_the_current_folder(hostile):
    script = (
        'import sys\nfrom estimator_pkg.ros.message_class import message_class\n'
        'print([message_class(name) for name in sys.argv[1:]])'
    )
    done = subprocess.run(
        [sys.executable, '-c', script, *NAMES],
        cwd=hostile,
        text=True,
        # as without our conftest: the current folder comes first
        env={**os.environ, 'PYTHONPATH': os.pathsep, 'PYTHONSAFEPATH': ''},
        capture_output=True,
        timeout=60,
        check=True,
    )
    assert done.stdout.strip() == str([None] * len(NAMES))
    assert imported(hostile) == []


def test_play_imports_nothing_that_a_bag_names(hostile):
    with BagWriter(hostile / 'bag') as bag:
        for number, name in enumerate(NAMES):
            bag.add_topic(f'/topic{number}', name)
            bag.write(f'/topic{number}', 10**18, b'\0\1\0\0')
    done = subprocess.run(
        [sys.executable, '-m', 'estimator_pkg.cli', 'play', 'bag'],
        cwd=hostile,
        text=True,
        capture_output=True,
        timeout=dds.PATIENCE,
        env={**os.environ, 'PYTHONPATH': os.pathsep},
        check=False,
    )
    assert done.returncode == 1 and 'has no topic to play' in done.stderr, done.stderr
    assert done.stderr.count('is not played: its type') == len(NAMES)
    assert imported(hostile) == []


def test_every_installed_message_is_found_with_the_fields_of_its_definition():
    count = 0
    for package in packages_with_messages():
        for name in message_types(package):
            assert message_class(name).__name__ == name.rpartition('/')[2]
            if name in STORE.fielddefs:
                bases = {'char': 'uint8'}
                expected = {
                    field: kind._replace(base=bases.get(kind.base, kind.base))
                    for field, kind in fields_of_definition(name, '')(name).items()
                }
                assert fields_of(name) == expected, name
                count += 1
    assert count > 100


def test_a_number_of_a_package_of_the_machine(own, tmp_path, monkeypatch):
    """From an overlay, as colcon installs it: found in the ament index and by its Python path.

    Nothing here compiles messages, so the package borrows the type support of std_msgs/Float64.
    """
    package = tmp_path / 'machine_msgs'
    (package / 'msg').mkdir(parents=True)
    (package / '__init__.py').touch()
    (package / 'msg' / '__init__.py').write_text(
        'from std_msgs.msg import Float64\n'
        'class Reading(metaclass=type(Float64)):\n'
        "    __module__ = 'machine_msgs.msg._reading'\n"
        '    @classmethod\n'
        '    def get_fields_and_field_types(cls):\n'
        "        return {'height': 'double'}\n"
    )
    index = tmp_path / 'share' / 'ament_index' / 'resource_index'
    for resource, text in (('packages', ''), ('rosidl_interfaces', 'msg/Reading.msg\n')):
        (index / resource).mkdir(parents=True)
        (index / resource / 'machine_msgs').write_text(text)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}:{os.environ["AMENT_PREFIX_PATH"]}')
    monkeypatch.syspath_prepend(tmp_path)
    named = {'field_type': 'machine_msgs/msg/Reading', 'field': 'height', 'angle_joint': 'lift'}
    node = own('angle', input='field', wrap_period=0.0, **named)
    node.publisher('driver', Float64, 'angle')
    node.connect()
    node.take(*(bytes(STORE.serialize_cdr(STORE.types[FLOAT](0.01 * k), FLOAT)) for k in range(60)))
    lift = node.node.stream.bank.joints['lift']
    assert lift.used > 0 and lift.estimate()[0] == pytest.approx(0.59, abs=0.02)


def test_a_type_name_leads_to_no_file_outside_share(tmp_path, monkeypatch):
    (tmp_path / 'share').mkdir()
    for name in ('secret/msg/Foo.msg', 'share/own_msgs/msg/Foo.msg'):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text('float64 x\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert define('own_msgs/msg/Foo')[0] == 'float64 x\n'
    for name in ('../secret/msg/Foo', f'{tmp_path}/secret/msg/Foo', 'own_msgs/../own_msgs/msg/Foo'):
        assert define(name) == ('', '')


def test_the_type_hash_is_that_of_the_installed_package():
    """Of a type with `char`, too, for which rosbags 0.11.9 computes another one."""
    expected = 'RIHS01_3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9'
    assert define('std_msgs/msg/Char')[1] == expected
