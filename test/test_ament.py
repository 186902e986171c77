# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The linters of ament: ament_copyright, ament_flake8, ament_pep257 (see CONTRIBUTING.md).

The latter two take 12 s, and ruff checks the same rules in one: they run with the slow tests.
"""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DEBIAN = Path('/usr/lib/python3/dist-packages')  # apt-get install python3-ament-copyright
CODE = ['estimator_pkg', 'launch', 'setup.py', 'sim_pkg']  # installed; ruff checks the rest too
CHECKS = {
    'ament_copyright': [*CODE, 'bags', 'benchmarks', 'docs', 'test'],
    'ament_flake8': ['--config', 'setup.cfg', *CODE],
    'ament_pep257': [
        *('--convention', 'numpy', '--add-ignore', 'D105', 'D205', 'D400', 'D401', 'D403'),
        *('--', *CODE),
    ],
}


def checked(linter, *arguments, folder=ROOT):
    """(exit code, output) of a linter; the test is skipped without it."""
    paths = []
    if importlib.util.find_spec(linter) is None:
        if not (DEBIAN / linter).is_dir():
            pytest.skip(f'{linter} is not installed (package ros-jazzy-{linter.replace("_", "-")})')
        paths = [str(DEBIAN)]  # after ours
    code = (
        # ament_copyright looks up its entry points twice for each file
        'import functools, importlib.metadata as known, sys; '
        'known.entry_points = functools.lru_cache(known.entry_points); '
        f'sys.path += {paths}; from {linter}.main import main; '
        'sys.exit(main(sys.argv[1:]))'
    )
    done = subprocess.run(
        [sys.executable, '-c', code, *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
    )
    return done.returncode, done.stdout + done.stderr


def assert_clean(linter, *arguments):
    code, output = checked(linter, *arguments)
    assert code == 0 and 'No problems found' in output, output


@pytest.mark.slow
@pytest.mark.parametrize('linter', ['ament_flake8', 'ament_pep257'])
def test_linter(linter):
    assert_clean(linter, *CHECKS[linter])


@pytest.mark.long
def test_copyright():
    assert_clean('ament_copyright', *CHECKS['ament_copyright'])
