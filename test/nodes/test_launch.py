# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Launch files: their arguments, read as text; and all of them executed, where launch is there.

PyPI has no launch; a ROS 2 installation has. There the nodes run, and what they publish is heard.
"""

import ast
import importlib.metadata
import itertools
import os
import signal
from pathlib import Path

import dds
import pytest
import yaml

from estimator_pkg import streams
from estimator_pkg.parameters import declared

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / 'launch'
COMBINED = {'simulator_and_observer.launch.py', 'two_arms.launch.py', 'joint_observer.launch.xml'}
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
BASE = {'radius': [0.1], 'track': 0.5}


def nodes():
    """Names of the executables that are nodes."""
    return {
        script.name
        for script in importlib.metadata.entry_points(group='console_scripts')
        if '_pkg.nodes.' in script.value
    }


def call_in(name):
    """(function, its arguments) that the launch file of a node returns."""
    path = FOLDER / f'{name}.launch.py'
    tree = ast.parse(path.read_text())
    assert f'ros2 launch velocity_estimator {path.name}' in ast.get_docstring(tree)
    (function,) = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert function.name == 'generate_launch_description'
    assert f'config/{name}.yaml' in ast.get_docstring(function)
    (returned,) = [part for part in ast.walk(function) if isinstance(part, ast.Return)]
    keywords = {each.arg: ast.literal_eval(each.value) for each in returned.value.keywords}
    assert [ast.literal_eval(each) for each in returned.value.args] == [name]
    return returned.value.func.id, keywords


def topics_of(stream):
    """Every input topic of a stream, whatever the parameters that choose the topics."""
    known = declared(stream.SETTINGS)
    choices = [known[name].choices for name in ('input', 'angle_type') if name in known]
    topics = set()
    for words in itertools.product(*choices):
        chosen = dict(zip([name for name in ('input', 'angle_type') if name in known], words))
        if chosen.get('angle_type') == 'UInt16' or 'Int' in chosen.get('angle_type', ''):
            chosen['counts_per_revolution'] = 4096
        values = {name: one.default for name, one in known.items()} | chosen
        values |= {name: value for name, value in BASE.items() if name in known}
        try:
            topics |= ports(stream, values)
        except streams.contract.UserError:  # a choice that needs further parameters
            continue
    return topics


def ports(stream, values):
    given = {name: value for name, value in values.items() if value is not None}
    settings = stream.SETTINGS(**given)
    observer = settings.find_observer()
    common = {name: MOTOR[name] for name in declared(observer.gains) if name in MOTOR}
    started = stream.start(settings, stream.configure(observer, settings, common, {}))
    return {port.topic for port in started.inputs}


def test_every_node_has_its_launch_file():
    assert {path.name for path in FOLDER.iterdir() if path.is_file()} == {
        f'{node}.launch.py' for node in nodes()
    } | COMBINED


@pytest.mark.parametrize('name', sorted(nodes()))
def test_a_launch_file_starts_the_node_of_its_name(name):
    function, _ = call_in(name)
    assert function == ('simulator' if name.endswith('_sim') else 'observer')
    config = yaml.safe_load((ROOT / 'config' / f'{name}.yaml').read_text())
    assert list(config) == ['/**']  # holds whatever the node is called


@pytest.mark.parametrize('stream', streams.every(), ids=lambda stream: stream.NODE)
def test_every_input_topic_has_an_argument(stream):
    _, keywords = call_in(stream.NODE)
    assert set(keywords['inputs']) == topics_of(stream)
    named = {name for name in declared(stream.SETTINGS) if name.endswith('_topic')}
    assert {name for name, _ in keywords.get('parameters', {}).values()} == named


# Executed


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """The installed package alone where launch looks for it: pip has the executables in bin."""
    for name in ('launch', 'launch_ros', 'launch_xml'):
        pytest.importorskip(name, reason=f'{name} is part of ROS 2, PyPI does not have it')
    from ament_index_python.packages import get_package_prefix

    installed = Path(get_package_prefix('velocity_estimator'))
    if not (installed / 'lib' / 'velocity_estimator').is_dir():
        index = 'share/ament_index/resource_index/packages/velocity_estimator'
        for place in ('lib/velocity_estimator', 'share/velocity_estimator', index):
            (tmp_path / place).parent.mkdir(parents=True)
            (tmp_path / place).symlink_to(
                installed / place.replace('lib/velocity_estimator', 'bin')
            )
        monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}:{os.environ["AMENT_PREFIX_PATH"]}')
    return monkeypatch


def observed_by():
    """The observer of each simulator."""
    tree = ast.parse((FOLDER / 'simulator_and_observer.launch.py').read_text())
    (table,) = [
        part.value
        for part in tree.body
        if isinstance(part, ast.Assign) and ast.unparse(part.targets[0]) == 'OBSERVED'
    ]
    return {key.value: value.elts[0].value for key, value in zip(table.keys, table.values)}


PAIRS = observed_by()
BOTH = 'simulator_and_observer.launch.py'
RUNS = {  # launch files and their arguments, with the estimates that are heard
    **{
        simulator: (
            [(BOTH, f'simulator:={simulator}', 'namespace:=pair')],
            [f'/pair/{observer}/estimate'],
        )
        for simulator, observer in PAIRS.items()
        if simulator != 'encoder_sim'
    },
    'combined': (
        [
            (BOTH, 'namespace:=pair'),
            (
                'two_arms.launch.py',
                'left_joint_states:=/pair/joint_states',
                'right_joint_states:=/pair/joint_states',
                'log_level:=warn',
            ),
            (
                'joint_observer.launch.xml',
                'joint_states:=/pair/joint_states',
                'estimate:=/complete/joint_states',
                'respawn:=true',
            ),
        ],
        [
            '/pair/joint_observer/estimate',
            '/left/joint_observer/estimate',
            '/right/joint_observer/estimate',
            '/complete/joint_states',
        ],
    ),
}
LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource

service = LaunchService(noninteractive=True)
for words in ' '.join(sys.argv[1:]).split(' , '):
    file, *arguments = words.split()
    arguments = [tuple(each.split(':=')) for each in arguments]
    source = AnyLaunchDescriptionSource(file)
    group = GroupAction([IncludeLaunchDescription(source, launch_arguments=arguments)])
    service.include_launch_description(LaunchDescription([group]))
sys.exit(service.run())
"""


def test_every_node_is_in_a_run():
    assert {*PAIRS, *PAIRS.values()} == nodes()
    files = {file for launched, _ in RUNS.values() for file, *_ in launched}
    assert files == COMBINED


def launching(prefix, folder, launched):
    """The process that executes these launch files."""
    (folder / 'launch_all.py').write_text(LAUNCH)
    words = ' , '.join(' '.join((str(FOLDER / file), *rest)) for file, *rest in launched).split()
    prefix.setenv('PYTHONPATH', f'{folder}:{os.environ.get("PYTHONPATH", "")}')
    return dds.NodeProcess('launch_all', *words)


@pytest.mark.parametrize('run', RUNS)
def test_every_launch_file_is_executed(run, prefix, probe, tmp_path):
    """Each simulator with its observer, so each node's own file; then the files that combine."""
    from sensor_msgs.msg import JointState

    launched, topics = RUNS[run]
    awaited = set(topics)

    def heard(topic):
        def came(message):
            if any(velocity == velocity for velocity in message.velocity):
                awaited.discard(topic)

        return came

    subscriptions = [
        probe.node.create_subscription(JointState, topic, heard(topic), 10) for topic in topics
    ]
    with launching(prefix, tmp_path, launched) as process:
        probe.until(lambda: not awaited or not process.alive)
        process.signal(signal.SIGINT)
        assert process.ends() == 0, process.output
    for subscription in subscriptions:
        probe.node.destroy_subscription(subscription)
    assert not awaited, process.output
    assert 'process has died' not in process.output
