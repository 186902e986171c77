# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Without the optional libraries: help works, and one line says how to install what is missing."""

import json
import os
import subprocess
import sys
import textwrap
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from estimator_pkg import optional, registry

NEEDED = {*optional.OWN, 'numpy', 'yaml', '_yaml'}
LIBRARIES = {*packages_distributions(), 'rclpy', 'sensor_msgs', 'std_msgs'} - NEEDED
# A process in which these cannot be imported, whether or not they are installed here.
WITHOUT = """
    import importlib.util, sys
    class Without:
        def find_spec(self, name, path=None, target=None):
            if name.partition('.')[0] in {names!r}:
                raise ModuleNotFoundError(f"No module named '{{name}}'", name=name)
    sys.meta_path.insert(0, Without())
    {code}
"""
CLI = 'from estimator_pkg.cli import main; sys.exit(main(sys.argv[1:]))'
ROOT = Path(__file__).parent.parent
COMMANDS = registry.names(registry.COMMANDS)


def without(names, *words, code=CLI, cwd=None):
    """What a process prints in which these libraries are not there."""
    script = textwrap.dedent(WITHOUT).format(names=tuple(names), code=code)
    done = subprocess.run(
        [sys.executable, '-c', script, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=cwd,
        env={**os.environ, 'COLUMNS': '200'},
    )
    assert 'Traceback' not in done.stderr, done.stderr
    return done


EACH = """
    import contextlib, io, json
    from estimator_pkg.cli import main
    found = {}
    for word in sys.argv[1:]:
        with contextlib.redirect_stdout(io.StringIO()) as said:
            try:
                code = main([word, '--help'])
            except SystemExit as end:
                code = end.code
        found[word] = code, said.getvalue()
    print(json.dumps(found))
"""


@pytest.mark.long
def test_every_command_has_its_help():
    done = without(LIBRARIES, *COMMANDS, code=textwrap.dedent(EACH))
    assert done.returncode == 0 and not done.stderr
    found = json.loads(done.stdout)
    assert list(found) == COMMANDS
    for command, (code, text) in found.items():
        assert not code and '--json' in text and f'{command} [-h]' in text, (command, text)


@pytest.mark.parametrize(
    ('module', 'main'),
    [
        ('estimator_pkg.nodes.executables', 'joint_observer'),
        ('sim_pkg.nodes.executables', 'encoder_sim'),
    ],
)
def test_every_node_has_its_help_and_names_ros(module, main):
    code = f'from {module} import {main} as main; sys.exit(main(sys.argv[1:]))'
    done = without(LIBRARIES, '--help', code=code)
    assert done.returncode == 0 and 'usage: ' in done.stdout
    done = without(LIBRARIES, code=code)
    assert done.returncode == 1 and done.stderr.count('\n') == 1
    assert "'rclpy' is not installed" in done.stderr and 'setup.bash' in done.stderr


@pytest.mark.long
@pytest.mark.parametrize(
    'library, words',
    [
        ('zstandard', ('simulate', 'encoder', '--out', 'OUT', '--duration', '0.1')),
        ('mcap', ('replay', 'BAG', '--observer', 'pll')),
        ('lz4', ('evaluate', 'BAG', '--observer', 'pll')),
        ('rosbags', ('identify', 'BAG')),
        ('scipy', ('identify', 'MOTION')),
        ('rclpy', ('play', 'BAG')),
        ('optuna', ('tune', 'BAG', '--observer', 'pll', '--out', 'OUT')),
        ('matplotlib', ('evaluate', 'BAG', '--observer', 'pll', '--plot', 'OUT.png')),
        (
            'distributed',
            ('evaluate', 'BAG', '--observer', 'pll', '--scheduler', 'tcp://127.0.0.1:1'),
        ),
        ('bokeh', ('doctor', 'BAG', '--html', 'OUT.html')),
        ('scipy', ('reproduce', 'pmsm')),
    ],
)
def test_a_missing_library_is_one_line_with_the_command(library, words, tmp_path):
    bags = {
        'BAG': 'bags/simulated/sine_12bit',
        'MOTION': 'bags/dfki_simple_pendulum/system_identification_300hz',
    }
    words = [
        str(ROOT / bags[word]) if word in bags else word.replace('OUT', str(tmp_path / 'out'))
        for word in words
    ]
    done = without([library], *words, cwd=tmp_path)
    assert done.returncode == 1, done.stdout + done.stderr
    assert done.stderr.count('\n') == 1, done.stderr
    assert f"'{library}' is not installed" in done.stderr
    assert ' -m pip install ' in done.stderr and sys.executable in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('managed', [True, False])
@pytest.mark.parametrize('virtual', [True, False])
def test_a_python_that_the_system_manages(managed, virtual, tmp_path, monkeypatch):
    """PEP 668: pip refuses outside of a virtual environment; one that sees the system's has ROS."""
    if managed:
        (tmp_path / 'EXTERNALLY-MANAGED').write_text('[externally-managed]\nError=no\n')
    monkeypatch.setattr(optional.sysconfig, 'get_path', lambda *arguments: str(tmp_path))
    monkeypatch.setattr(sys, 'base_prefix', '/somewhere/else' if virtual else sys.prefix)
    line = optional.install('mcap<2,>=1.2')
    if managed and not virtual:
        assert f'{sys.executable} -m venv --system-site-packages ~/velocity_estimator_venv' in line
        assert "~/velocity_estimator_venv/bin/pip install 'mcap<2,>=1.2'" in line
        assert '~/velocity_estimator_venv/bin/python -m estimator_pkg.cli' in line
    else:
        assert line == f"{sys.executable} -m pip install 'mcap<2,>=1.2'"
