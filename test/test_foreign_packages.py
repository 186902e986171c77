# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers and models of another package, as docs/architecture.md says: one file, one line."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from foreign_package import OBSERVER, install

BAG = Path(__file__).parent.parent / 'bags' / 'dfki_simple_pendulum' / 'energy_shaping_200hz'
CONTRACT = Path(__file__).parent / 'observers' / 'test_contract.py'
MODEL = '''
    """A slide on a spring."""

    from dataclasses import dataclass

    import numpy as np

    from estimator_pkg.models.mechanics import Model
    from estimator_pkg.parameters import structural


    @dataclass(frozen=True)
    class Parameters:
        joints = ('slide',)
        periods = (0.0,)

        stiffness: float = structural(20.0, unit='N/m', range=(0.0, 1e6),
                                      description='of the spring')

        def inertia(self, q):
            return np.array([[2.0]])

        def force(self, q, v, u):
            return u - self.stiffness * q


    MODEL = Model(name='slide', summary='a slide on a spring', parameters=Parameters)
'''
ENTRY_POINTS = """
    [velocity_estimator.observers]
    mine = mine:OBSERVER
    other = other:OBSERVER
    broken = broken:OBSERVER
    nameless = mine:NOTHING
    a_number = mine:math
    [velocity_estimator.models]
    slide = slide:MODEL
    ruin = broken:MODEL
"""


@pytest.fixture(scope='module')
def foreign(tmp_path_factory):
    """A folder with an installed package in it; two of its entry points lead nowhere."""
    other = OBSERVER.replace("'mine'", "'other'").replace('rate * error', 'rate * sum([error])')
    files = {'mine.py': OBSERVER, 'slide.py': MODEL, 'broken.py': 'def (', 'other.py': other}
    return install(tmp_path_factory.mktemp('site'), files, ENTRY_POINTS)


def environment(foreign):
    """The variables of a process in which that package is installed too."""
    return {**os.environ, 'PYTHONPATH': os.pathsep.join([str(foreign), *sys.path])}


def reported(foreign, *words, code=0):
    """What `velocity_estimator` prints where that package is installed too."""
    done = subprocess.run(
        [sys.executable, '-m', 'estimator_pkg.cli', *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        env=environment(foreign),
    )
    assert done.returncode == code, done.stderr
    return done.stdout if code == 0 else done.stderr


@pytest.mark.long
def test_the_list_knows_them_and_says_what_cannot_be_imported(foreign):
    said = reported(foreign, 'list')
    assert re.search(r'  mine +an alpha-beta filter', said)
    assert re.search(r'  slide +a slide on a spring', said)
    said = reported(foreign, 'list', 'observers') + reported(foreign, 'list', 'models')
    said = ' '.join(said.split())
    assert "(observer 'broken' (broken:OBSERVER) cannot be imported: SyntaxError" in said
    assert "has no attribute 'NOTHING')" in said
    assert ' hybrid_angle ' in said


@pytest.mark.long
def test_an_observer_of_another_package_replays_and_is_judged(foreign, tmp_path):
    words = ['--observer', 'mine', '--set', 'alpha=0.2', '--out', tmp_path / 'out']
    assert 'tracking' in reported(foreign, 'replay', BAG, *words)
    said = reported(foreign, 'evaluate', BAG, '--observer', 'mine')
    assert 'mine' in said and 'rms' in said


@pytest.mark.long
def test_an_observer_of_another_package_is_exported_and_runs_as_plain_python(foreign, tmp_path):
    said = reported(foreign, 'export', 'mine', '--out', tmp_path / 'out')
    assert re.search(r'(\d+) samples: \1 equal to the last bit', said)
    said = ' '.join(reported(foreign, 'list', 'mine').split())
    assert "plain Python: the engine has observers of this package alone, and 'mine' is" in said


@pytest.mark.long
def test_an_observer_of_another_package_that_is_not_translated_has_its_line(foreign, tmp_path):
    said = reported(foreign, 'export', 'other', '--out', tmp_path / 'out', code=2)
    assert said.startswith("velocity_estimator export: 'other' cannot be exported: other.py:")


@pytest.mark.long
def test_the_tests_of_the_contract_run_on_an_observer_of_another_package(foreign):
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-v', '-k', '[mine', CONTRACT],
        capture_output=True,
        text=True,
        env=environment(foreign),
    )
    assert done.returncode == 0, done.stdout
    assert int(re.search(r'(\d+) passed', done.stdout)[1]) >= 20


@pytest.mark.long
def test_a_model_of_another_package_serves_every_observer_of_mechanisms(foreign, tmp_path):
    model = ['--set', 'model=slide', '--set', 'model_parameters=[stiffness=5.0]']
    assert 'effect of the gains' in reported(foreign, 'list', 'geso', *model)
    words = ['--observer', 'geso', *model, '--set', 'joints=[pendulum]', '--out', tmp_path / 'out']
    assert 'received' in reported(foreign, 'replay', BAG, *words)


@pytest.mark.long
@pytest.mark.parametrize(
    'words, wanted',
    [
        ('broken', 'SyntaxError'),
        ('a_number', 'which is not an Observer'),
        ('geso --set model=ruin', 'SyntaxError'),
    ],
)
def test_what_cannot_be_used_is_one_line(foreign, tmp_path, words, wanted):
    words = ['--observer', *words.split(), '--out', tmp_path / 'out']
    said = reported(foreign, 'replay', BAG, *words, code=1)
    assert wanted in said and len(said.strip().splitlines()) == 1
