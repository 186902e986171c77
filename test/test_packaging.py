# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The package as pip and as colcon install it: index entry, share/, executables."""

import ast
import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import sysconfig
import textwrap
from pathlib import Path

import pytest
import setuptools
from foreign_package import OBSERVER

import estimator_pkg
from estimator_pkg import optional

ROOT = Path(__file__).parent.parent
PARTS = [
    'setup.py',
    'setup.cfg',
    'pyproject.toml',
    'package.xml',
    'LICENSE',
    'MANIFEST.in',
    'README.md',
    'CHANGELOG.rst',
    'QUALITY_DECLARATION.md',
    'resource',
    'launch',
    'layouts',
    'config',
    'estimator_pkg',
    'sim_pkg',
]


@pytest.fixture(scope='module')
def source(tmp_path_factory):
    """A copy of the sources, so that a build leaves nothing in the checkout."""
    copy = tmp_path_factory.mktemp('source') / 'velocity_estimator'
    copy.mkdir()
    for part in PARTS:
        path = ROOT / part
        if path.is_dir():
            shutil.copytree(path, copy / part, ignore=shutil.ignore_patterns('__pycache__'))
        else:
            shutil.copy(path, copy / part)
    return copy


def run(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def engine_of(folder, python=sys.executable):
    """Return what `load` says of the engine of the packages in a folder."""
    code = 'from estimator_pkg.engine import load; print(load.__file__, *load.load())'
    loaded = run(str(python), '-c', code, cwd=folder, env={**os.environ, 'PYTHONPATH': str(folder)})
    assert loaded.startswith(str(folder)), loaded
    return loaded.partition(' ')[2].strip()


def assert_installed(prefix, executables):
    """The folders of ament, what is not Python, and the executables are where they belong."""
    assert {'velocity_estimator', 'joint_observer', 'encoder_sim'} <= {
        path.name for path in (prefix / executables).iterdir()
    }
    assert len(list((prefix / 'lib').rglob('sim_pkg/reproduce/*/references.csv'))) == 5
    share = prefix / 'share' / 'velocity_estimator'
    assert (share / 'package.xml').is_file()
    assert (share / 'LICENSE').is_file()
    layouts = {path.name for path in (share / 'layouts').iterdir()}
    assert layouts == {'foxglove.json', 'plotjuggler.xml'}
    launch = {path.name for path in (share / 'launch').iterdir() if path.is_file()}
    assert launch == {path.name for path in (ROOT / 'launch').iterdir() if path.is_file()}
    templates = 'export/**/*.in'
    installed = {path.name for path in (prefix / 'lib').rglob(f'estimator_pkg/{templates}')}
    assert installed == {path.name for path in (ROOT / 'estimator_pkg').glob(templates)}
    config = {path.relative_to(share / 'config') for path in (share / 'config').rglob('*')}
    assert config == {path.relative_to(ROOT / 'config') for path in (ROOT / 'config').rglob('*')}
    found = run(
        sys.executable,
        '-c',
        'from ament_index_python.packages import get_package_share_directory as share\n'
        "print(share('velocity_estimator'))",
        env={**os.environ, 'AMENT_PREFIX_PATH': str(prefix)},
    )
    assert Path(found.strip()) == share


def copied(source, copy):
    """Return a copy of the sources without what another build left there."""
    return shutil.copytree(
        source, copy, ignore=shutil.ignore_patterns('build', '*.so', '*.egg-info')
    )


def pip_install(source, prefix, **options):
    """Return the folder into which pip installed the packages."""
    run(
        sys.executable,
        *shlex.split(
            '-m pip install --quiet --no-compile --no-build-isolation --no-deps --ignore-installed'
        ),
        '--prefix',
        str(prefix),
        '.',
        cwd=source,
        **options,
    )
    return next((prefix / 'lib').rglob('estimator_pkg')).parent


def with_observer(source, copy, text=OBSERVER):
    """Return a copy of the sources with an observer, added as CONTRIBUTING.md says."""
    copied(source, copy)
    (copy / 'estimator_pkg' / 'observers' / 'angle' / 'mine.py').write_text(textwrap.dedent(text))
    group = "'velocity_estimator.observers': [\n"
    setup = (copy / 'setup.py').read_text()
    assert setup.count(group) == 1
    line = "'mine = estimator_pkg.observers.angle.mine:AlphaBeta',\n"
    (copy / 'setup.py').write_text(setup.replace(group, group + line))
    return copy


@pytest.fixture(scope='module')
def installed(source, tmp_path_factory):
    """The prefix and the packages of a pip installation with one more observer."""
    folder = tmp_path_factory.mktemp('pip')
    prefix, compiler = folder / 'prefix', folder / 'cc'
    compiler.write_text('#!/bin/bash\nexec cc "${@/#-O2/-O0}"\n')  # a fifth of the time
    compiler.chmod(0o755)
    environment = {**os.environ, 'CC': str(compiler)}
    return prefix, pip_install(with_observer(source, folder / 'source'), prefix, env=environment)


@pytest.mark.long
def test_pip_installs_all_of_it(installed):
    prefix, packages = installed
    assert_installed(prefix, 'bin')
    assert engine_of(packages).startswith('<PyDLL')


@pytest.mark.long
def test_an_observer_of_a_file_and_a_line_is_compiled_and_exported(installed, tmp_path):
    _, packages = installed
    path = os.pathsep.join([str(packages), str(ROOT / 'test' / 'support')])
    environment = {**os.environ, 'PYTHONPATH': path}
    script = (
        'from observer_cases import beside, make, stream\n'
        "print(make('mine').compiled is not None)\n"
        "for one, other in beside('mine', {}, *stream(1)): assert repr(one) == repr(other)\n"
    )
    assert run(sys.executable, '-c', script, env=environment) == 'True\n'
    command = sys.executable, '-m', 'estimator_pkg'
    assert 'plain Python' not in run(*command, 'list', 'mine', env=environment)
    said = run(*command, 'export', 'mine', '--out', str(tmp_path / 'out'), env=environment)
    assert re.search(r'(\d+) samples: \1 equal to the last bit', said)


@pytest.fixture(scope='module')
def built(source, tmp_path_factory):
    """The folder of the wheel and the sdist that `python -m build` makes."""
    folder = tmp_path_factory.mktemp('dist')
    run(
        sys.executable,
        '-m',
        'build',
        '--outdir',
        str(folder),
        '.',
        cwd=copied(source, folder / 's'),
    )
    return folder


@pytest.fixture(scope='module')
def empty(built, tmp_path_factory):
    """An environment with the libraries that the wheel requires, and without the package."""
    prefix = tmp_path_factory.mktemp('empty')
    run(sys.executable, '-m', 'venv', str(prefix))
    (wheel,) = built.glob('*.whl')
    pip = str(prefix / 'bin' / 'python'), '-m', 'pip'
    run(*pip, 'install', '--quiet', f'{wheel}[ros,report]')
    run(*pip, 'uninstall', '--quiet', '--yes', 'velocity_estimator')
    return prefix


def assert_runs(executable, folder, **options):
    """The command examines a recording, and its simulator and node run over DDS."""
    doctor = str(executable), 'doctor', str(ROOT / 'bags' / 'simulated' / 'sine_12bit')
    assert 'VERDICT' in run(*doctor, cwd=folder, **options)
    demo = str(executable), 'demo', '--duration', '2', '--json', 'demo.json'
    run(*demo, cwd=folder, **options)
    assert json.loads((folder / 'demo.json').read_text())['estimates'] > 500


@pytest.mark.slow
@pytest.mark.parametrize(
    'kind, compiler, engine',
    [
        ('*.whl', '/bin/false', '<PyDLL'),
        ('*.tar.gz', 'cc', '<PyDLL'),
        ('*.tar.gz', '/bin/false', 'None no engine was built: install a C compiler'),
    ],
)
def test_wheel_and_sdist_run_in_an_empty_environment(
    kind, compiler, engine, built, empty, tmp_path
):
    (archive,) = built.glob(kind)
    here = {'HOME': str(tmp_path), 'PATH': f'{empty}/bin:/usr/bin:/bin', 'CC': compiler}
    # pip would take its own wheel of the same sdist from its cache
    pip = 'python', '-m', 'pip', 'install', '--no-deps', '--no-cache-dir', str(archive)
    run(*pip, env={**os.environ, **here})
    assert_installed(empty, 'bin')
    packages = next((empty / 'lib').rglob('estimator_pkg')).parent
    assert engine_of(packages, empty / 'bin' / 'python').startswith(engine)
    assert_runs(empty / 'bin' / 'velocity_estimator', tmp_path, env=here)
    run(*pip[:3], 'uninstall', '--yes', 'velocity_estimator', env={**os.environ, **here})


@pytest.mark.slow
def test_the_wheel_is_small_and_of_its_platform(built):
    (wheel,) = built.glob('*.whl')
    platform = sysconfig.get_platform().replace('-', '_').replace('.', '_')
    assert wheel.name.endswith(f'-cp310-abi3-{platform}.whl')
    assert wheel.stat().st_size < 2e6


def colcon(source, folder, *words, **variables):
    """Return what colcon prints for the sources; its folders are in `folder`."""
    path = f'{Path(sys.executable).parent}:{os.environ["PATH"]}'
    return run(
        *('colcon', '--log-base', str(folder / 'log'), *words),
        *(f'--{name}-base={folder / name}' for name in ('build', 'install') if 'build' in words),
        cwd=source,
        env={**os.environ, 'PATH': path, 'PYTHONDONTWRITEBYTECODE': '1', **variables},
    )


@pytest.mark.long
def test_colcon_knows_it_as_an_ament_python_package(source, tmp_path):
    listed = colcon(source, tmp_path, 'list')
    assert listed.split() == ['velocity_estimator', '.', '(ros.ament_python)']


@pytest.mark.slow
def test_colcon_installs_all_of_it(source, tmp_path):
    colcon(source, tmp_path, 'build')
    prefix = tmp_path / 'install' / 'velocity_estimator'
    assert_installed(prefix, 'lib/velocity_estimator')
    packages = next((prefix / 'lib').rglob('estimator_pkg')).parent
    assert engine_of(packages).startswith('<PyDLL')
    here = {
        **os.environ,
        'PYTHONPATH': str(packages),
        'AMENT_PREFIX_PATH': f'{prefix}:{sys.prefix}',
    }
    assert_runs(prefix / 'lib' / 'velocity_estimator' / 'velocity_estimator', tmp_path, env=here)


def test_there_is_one_version():
    places = {
        'setup.py': r"version='(.+)'",
        'package.xml': '<version>(.+)</version>',
        'CHANGELOG.rst': r'\n([\d.]+) \(\d{4}-\d\d-\d\d\)\n-',
        'QUALITY_DECLARATION.md': r'The version is ([\d.]+),',
    }
    found = {re.search(pattern, (ROOT / name).read_text())[1] for name, pattern in places.items()}
    assert found == {estimator_pkg.__version__}


def test_every_package_folder_is_installed():
    folders = {
        path.parent.relative_to(ROOT)
        for package in ('estimator_pkg', 'sim_pkg')
        for path in (ROOT / package).rglob('*.py')
    }
    installed = Path(estimator_pkg.__file__).parents[1]
    assert len(folders) > 20
    assert all((installed / folder / '__init__.py').is_file() for folder in folders)


def imported():
    """The first part of every module that the packages import, or name for their lazy imports."""
    for package in optional.OWN:
        for path in (ROOT / package).rglob('*.py'):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    names = [each.name for each in node.names]
                elif isinstance(node, ast.ImportFrom) and not node.level:
                    names = [node.module]
                elif isinstance(node, ast.Call) and ast.unparse(node.func) == 'Lazy':
                    names = [each.value for each in node.args if isinstance(each, ast.Constant)]
                else:
                    continue
                yield from (name.partition('.')[0] for name in names)


@pytest.mark.long
def test_every_imported_library_is_a_requirement(monkeypatch):
    declared = {}
    monkeypatch.setattr(setuptools, 'setup', lambda **options: declared.update(options))
    runpy.run_path(str(ROOT / 'setup.py'))
    every = declared['install_requires'], *declared['extras_require'].values()
    required = {re.match(r'[\w.-]+', text)[0] for texts in every for text in texts}
    libraries = {
        optional.COMES_WITH.get(name, name)
        for name in set(imported()) - sys.stdlib_module_names - {*optional.OWN}
        if not optional.OF_ROS.fullmatch(name)
    }
    assert libraries - required <= {
        'launch',
        'launch_ros',
        'ros2doctor',
        'ros2cli',
        'ament_copyright',
    }
    assert {'apsw', 'lz4', 'zstandard'} <= libraries


@pytest.mark.long
def test_every_package_of_ros_that_is_used_is_a_dependency_and_declared():
    used = {name for name in imported() if optional.OF_ROS.fullmatch(name)}
    for package in optional.OWN:
        for path in (ROOT / package).rglob('*.py'):
            used.update(re.findall(r"'(\w+_msgs)/msg/", path.read_text()))
    listed = (ROOT / 'package.xml').read_text()
    depends = set(re.findall('<exec_depend>(.*)</exec_depend>', listed))
    assert 'nav_msgs' in used and used <= depends
    declaration = (ROOT / 'QUALITY_DECLARATION.md').read_text()
    of_ros = {name for name in depends if not name.startswith('python3-')}
    assert {name for name in of_ros if f'`{name}`' not in declaration} == set()
    assert '_engine.so' in listed and declaration.count('_engine.so') > 1
