# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The package for ros2_control, compiled without ROS: positions in, estimates out."""

import ast
import math
import shlex
import shutil
import subprocess
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from estimator_pkg import cli, observers
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import VALID
from estimator_pkg.export.command import COMMAND
from estimator_pkg.export.ros2_control import package

NAME = 'joint_velocity'  # of run.cpp
MS = 1_000_000
START = 1_700_000_000_000_000_000
INITIALISING, TRACKING, COASTING, LOST = 0, 1, 2, 3
FLAGS = ['-std=c++17', '-O1', '-Wall', '-Wextra', '-Werror', '-ffp-contract=off', '-fwrapv']
RUN = Path(__file__).with_name('run.cpp')
needs_compiler = pytest.mark.skipif(shutil.which('g++') is None, reason='no g++')


def configured(observer='edge_adaptive', overrides=None):
    return Configuration(observers.find(observer), overrides=overrides)


@pytest.fixture(scope='module')
def compiled(tmp_path_factory):
    """Return the program of a configuration."""

    @lru_cache
    def build(observer, wrist=None, float32=False):
        folder = tmp_path_factory.mktemp('package')
        overrides = {'wrist': {'wrap_period': wrist}} if wrist is not None else {}
        setup = configured(observer, overrides)
        files = package(NAME, setup, ['elbow', 'wrist'], float32)
        for path, text in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text)
        sources = [path for path in folder.glob('src/*.cpp') if path.stem != 'controller']
        done = subprocess.run(
            [
                'g++',
                *FLAGS,
                '-Iinclude',
                *sources,
                str(Path(__file__).with_name('run.cpp')),
                '-o',
                'run',
            ],
            cwd=folder,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return folder / 'run', setup

    return build


def run(program, lines, joints=('elbow',), hold=0.02):
    """Return what each line gives, shape (lines, joints, 9): six values, three counts."""
    text = '\n'.join(
        'p' if line is None else ' '.join([*map(str, line[:2]), *map(float.hex, line[2:])])
        for line in lines
    )
    done = subprocess.run(
        [program, str(hold), *joints], input=text, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    numbers = [
        [float.fromhex(word) if 'x' in word or 'n' in word else float(word) for word in row.split()]
        for row in done.stdout.splitlines()
    ]
    return np.array(numbers).reshape(len(lines), len(joints), 9)


def driven(setup, joint, stamps, positions):
    """Return what the driver, and so replay, has at each used sample; NaN for the others."""
    driver = Joint(setup.observer, *setup.for_joint(joint))
    found = np.full((len(stamps), 6), math.nan)
    for row, stamp, position in zip(found, stamps, positions):
        if driver.update(int(stamp), float(position)):
            estimate, sigma = driver.estimate(), driver.stddev()
            row[5] = estimate[3]
            if estimate[3] in VALID:
                row[:5] = *estimate[:3], *sigma
    return found


def motion(times, quantum=2 * math.pi / 4096):
    return np.round((0.8 * np.sin(3.0 * times) + 0.4 * times) / quantum) * quantum


def moved(count=3000, jitter=0.0, period=2 * MS, seed=0):
    """Return periods [ns], stamps [ns] and positions of samples."""
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, count)
    periods = np.round(period * (1.0 + noise)).astype(np.int64)
    stamps = np.cumsum(periods)
    return periods, stamps, motion(stamps * 1e-9)


def updates(periods, *positions, begin=0):
    """Return the lines of updates whose clock begins with `begin`."""
    times = begin + np.cumsum(periods)
    return [
        (int(time), int(period), *map(float, row))
        for time, period, *row in zip(times, periods, *positions)
    ]


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize('observer', ['edge_adaptive', 'kalman', 'hybrid_angle'])
@pytest.mark.parametrize('jitter', [0.0, 0.4])
def test_the_estimates_are_those_of_replay(compiled, observer, jitter):
    program, setup = compiled(observer)
    periods, stamps, positions = moved(jitter=jitter)
    found = run(program, updates(periods, positions))[:, 0]
    expected = driven(setup, 'elbow', stamps, positions)
    used = ~np.isnan(expected[:, 5])
    assert used.mean() > 0.99
    assert np.isin(expected[used, 5], VALID).mean() > 0.9
    np.testing.assert_array_equal(found[used, :6], expected[used])


@pytest.mark.long
@needs_compiler
def test_float32_is_near_replay(compiled):
    program, setup = compiled('edge_adaptive', float32=True)
    periods, stamps, positions = moved()
    found = run(program, updates(periods, positions))[100:, 0, 1]
    errors = found - driven(setup, 'elbow', stamps, positions)[100:, 1]
    assert 0.0 < np.sqrt(np.mean(errors**2)) < 1e-2


@pytest.mark.long
@needs_compiler
def test_each_joint_has_its_own_gains(compiled):
    program, setup = compiled('edge_adaptive', wrist=0.0)
    periods, stamps, positions = moved(1500)
    turned = (positions + math.pi) % (2 * math.pi) - math.pi
    found = run(program, updates(periods, turned, positions), ('elbow', 'wrist'))
    for k, (joint, values) in enumerate([('elbow', turned), ('wrist', positions)]):
        expected = driven(setup, joint, stamps, values)
        used = ~np.isnan(expected[:, 5])
        np.testing.assert_array_equal(found[used, k, :6], expected[used])


@needs_compiler
@pytest.mark.parametrize('missing', [math.nan, math.inf, -math.inf])
def test_a_missing_position_keeps_the_estimate_for_the_hold_time(compiled, missing):
    program, setup = compiled('edge_adaptive')
    periods, stamps, positions = moved(1500)
    positions[1000:1040] = missing  # 80 ms
    found = run(program, updates(periods, positions), hold=0.02)[:, 0]
    last = found[999]
    assert last[5] == TRACKING
    held, gone = found[1000:1010], found[1010:1040]
    np.testing.assert_array_equal(held[:, :5], np.tile(last[:5], (10, 1)))
    assert (held[:, 5] == COASTING).all()
    assert np.isnan(gone[:, :5]).all() and (gone[:, 5] == LOST).all()
    assert found[-1, 6:].tolist() == [1460, 40, 0]
    expected = driven(setup, 'elbow', stamps, positions)
    used = ~np.isnan(expected[:, 5])
    np.testing.assert_array_equal(found[used, :6], expected[used])  # those after the gap, too


@needs_compiler
def test_without_any_position_there_is_no_estimate(compiled):
    periods, _, positions = moved(200)
    positions[:] = math.nan
    found = run(compiled('edge_adaptive')[0], updates(periods, positions))[:, 0]
    assert np.isnan(found[:, :5]).all()
    assert (found[:, 5] == INITIALISING).all()
    assert found[-1, 6:].tolist() == [0, 200, 0]


@needs_compiler
def test_one_joint_without_positions_leaves_the_others_alone(compiled):
    periods, _, positions = moved(600)
    program, _ = compiled('edge_adaptive')
    alone = run(program, updates(periods, positions))[:, 0]
    silent = np.full(600, math.nan)
    both = run(program, updates(periods, positions, silent), ('elbow', 'wrist'))
    np.testing.assert_array_equal(both[:, 0], alone)
    assert np.isnan(both[:, 1, :5]).all()


@needs_compiler
@pytest.mark.parametrize('seconds', [0.01, 0.15, 10.0])
def test_after_a_pause_the_estimates_are_those_of_replay(compiled, seconds):
    program, setup = compiled('edge_adaptive')
    periods, stamps, positions = moved(2000)
    pause = round(seconds * 1e9)
    stamps[1000:] += pause
    positions[1000:] = motion(stamps[1000:] * 1e-9)
    before, after = periods[:1000], periods[1000:]
    # controller_manager passes the nominal period to the first update; its clock shows the pause
    lines = updates(before, positions[:1000], begin=START)
    lines.append(None)
    lines += updates(after, positions[1000:], begin=lines[-2][0] + pause)
    found = run(program, lines)[:, 0]
    stopped, found = found[1000], np.delete(found, 1000, axis=0)
    assert np.isnan(stopped[:5]).all() and stopped[5] == INITIALISING
    offset = int(START)  # the first stamp is that of the clock
    expected = driven(setup, 'elbow', stamps + offset, positions)
    used = ~np.isnan(expected[:, 5])
    np.testing.assert_array_equal(found[used, :6], expected[used])
    if seconds > 1.0:  # nothing of the speed before a long pause
        assert np.isnan(found[1000, 1])


@needs_compiler
@pytest.mark.parametrize('step', [-7 * 10**9, -1, 5 * 10**9])
def test_a_step_of_the_clock_between_updates_changes_nothing(compiled, step):
    """The time that controller_manager passes is that of the system, which NTP sets."""
    program, _ = compiled('edge_adaptive')
    periods, _, positions = moved(1000)
    steady = updates(periods, positions, begin=START)
    stepped = [(time + step * (k > 500), *rest) for k, (time, *rest) in enumerate(steady)]
    np.testing.assert_array_equal(run(program, stepped), run(program, steady))


@needs_compiler
def test_a_period_of_zero_is_dropped_and_counted(compiled):
    """As from a paused simulation."""
    periods, _, positions = moved(600)
    periods[500] = 0
    found = run(compiled('edge_adaptive')[0], updates(periods, positions))[:, 0]
    assert found[500, 5] == COASTING
    assert found[-1, 6:].tolist() == [599, 0, 1]


def test_the_files_of_a_package_fit_together():
    setup = configured(overrides={'wrist': {'wrap_period': 0.0}})
    files = package(NAME, setup, ['elbow', 'wrist'])
    assert not [path for path, text in files.items() if '@' in path or 'XYZ@' in text]
    plugin = ElementTree.fromstring(files[f'{NAME}.xml'])
    assert ElementTree.fromstring(files['package.xml']).find('name').text == NAME
    built = files['CMakeLists.txt']
    assert f'add_library({plugin.get("path")} SHARED' in built
    assert {f'src/{Path(path).name}' for path in files if path.endswith('.cpp')} == {
        word for word in built.split() if word.endswith('.cpp')
    }
    exported = f'{plugin.find("class").get("type")}, {plugin.find("class").get("base_class_type")}'
    assert exported in files['src/controller.cpp']
    ast.parse(files['test/test_controller.py'])
    declared = yaml.safe_load(files['src/parameters.yaml'])[f'{NAME}_parameters']
    example = yaml.safe_load(files['config/controllers.yaml'])
    used = {name: section['ros__parameters'] for name, section in example.items()}
    assert used['controller_manager'][NAME] == {'type': plugin.find('class').get('name')}
    assert set(used[NAME]) <= set(declared)
    assert used[NAME]['joints'] == ['elbow', 'wrist']
    behind = used['speed_controller']
    assert behind['reference_and_state_dof_names'] == [f'{NAME}/elbow', f'{NAME}/wrist']
    assert set(behind['gains']) == set(behind['dof_names']) == {'elbow', 'wrist'}


def export(*words):
    prog = 'velocity_estimator export'
    return cli.guarded(lambda: cli.run(COMMAND, list(words), prog), prog)


OF = '--ros2-control --name joint_velocity'


@pytest.mark.parametrize(
    ('words', 'line'),
    [
        ('kalman --ros2-control --name Elbow', "--name 'Elbow' is no name of a ROS package: use"),
        ('kalman --ros2-control --name 2nd', "--name '2nd' is no name of a ROS package: use"),
        ('kalman --ros2-control --name a__b', "--name 'a__b' is no name of a ROS package: use"),
        ('kalman --ros2-control', '--ros2-control needs a name for package and controller: add'),
        ('kalman --name elbow', '--name names a package: add --ros2-control, or omit it'),
        (f'kalman {OF} --bag x.mcap', '--bag checks a header: omit it with --ros2-control'),
        (f"kalman {OF} --joint 'my elbow'", "joint 'my elbow' cannot be in the name of an interf"),
        (f"kalman {OF} --joint 'a\"b'", "joint 'a\"b' cannot be in the name of an interface: use"),
        (f'pmsm {OF}', "observer 'pmsm' needs more than the angle of a joint: choose one of joint"),
        (f'adaptive {OF}', "'adaptive' cannot be exported: a header is for observers of one angle"),
        (f'kalmann {OF}', "unknown observer 'kalmann'"),
        (f'kalman {OF} --set bandwith=3', "unknown parameter 'bandwith': did you mean 'bandw"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(words, line, tmp_path, capsys):
    out = tmp_path / 'package'
    assert export(*shlex.split(words), '--out', str(out)) == 2
    said = capsys.readouterr().err
    assert said.startswith(f'velocity_estimator export: {line}')
    assert said.count('\n') == 1
    assert not out.exists()


@pytest.mark.long
def test_the_command_writes_a_package_once(tmp_path, capsys):
    params = tmp_path / 'joint_observer.yaml'
    params.write_text(
        'joint_observer:\n  ros__parameters:\n    joints: [elbow, wrist]\n'
        '    per_joint: {wrist: {wrap_period: 0.0}}\n'
    )
    words = f'edge_adaptive {OF} --params {params} --out {tmp_path / "package"}'.split()
    assert export(*words) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].endswith('package joint_velocity, edge_adaptive for elbow, wrist')
    values = {'wrist': {'wrap_period': 0.0}}
    setup = Configuration(observers.find('edge_adaptive'), {}, values)
    files = package(NAME, setup, ['elbow', 'wrist'])
    written = [path for path in (tmp_path / 'package').rglob('*') if path.is_file()]
    assert {str(path.relative_to(tmp_path / 'package')): path.read_text() for path in written} == (
        files
    )
    assert export(*words) == 1
    assert 'exists: name another folder, or remove it' in capsys.readouterr().err


@pytest.mark.long
def test_joints_whose_names_differ_in_signs_alone_get_a_header_each():
    own = {'a-b': {'wrap_period': 1.0}, 'a_b': {'wrap_period': 2.0}, 'A.b': {'wrap_period': 3.0}}
    files = package(NAME, configured('kalman', own), list(own))
    headers = {path: text for path, text in files.items() if path.endswith('.h')}
    assert len(headers) == 4
    for joint, values in own.items():
        assert f'if (joint == "{joint}")' in files['src/observers.cpp']
        assert (
            sum(f'wrap_period = {values["wrap_period"]}' in each for each in headers.values()) == 1
        )
