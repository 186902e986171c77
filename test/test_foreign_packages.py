# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers and models of another package, as docs/architecture.md says: one file, one line."""

import json
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

        def gradient(self, q):
            return self.stiffness * q

        def inputs(self, q):
            return np.eye(1)


    MODEL = Model(name='slide', summary='a slide on a spring', parameters=Parameters)
'''
ENTRY_POINTS = """
    [velocity_estimator.observers]
    alpha_beta = alpha_beta:AlphaBeta
    other = other:AlphaBeta
    broken = broken:OBSERVER
    nameless = alpha_beta:NOTHING
    a_number = alpha_beta:LAG_2
    [velocity_estimator.models]
    slide = slide:MODEL
    ruin = broken:MODEL
"""


@pytest.fixture(scope='module')
def foreign(tmp_path_factory):
    """A folder with an installed package in it; two of its entry points lead nowhere."""
    other = OBSERVER.replace("'alpha_beta'", "'other'").replace('/ dt', '/ sum([dt])')
    files = {'alpha_beta.py': OBSERVER, 'slide.py': MODEL, 'broken.py': 'def (', 'other.py': other}
    return install(tmp_path_factory.mktemp('site'), files, ENTRY_POINTS)


def environment(foreign):
    """The variables of a process in which that package is installed too."""
    return {**os.environ, 'PYTHONPATH': os.pathsep.join([str(foreign), *sys.path])}


MODEL_OF_SLIDE = '--set model=slide --set model_parameters=[stiffness=5.0]'
REPLAY = f'replay {BAG} --out OUT --observer'
RUNS = {  # words of a command -> its exit code, and what it prints
    'list': (0, ' alpha_beta an alpha-beta filter', ' slide a slide on a spring'),
    'list observers': (
        0,
        r"\(observer 'broken' \(broken:OBSERVER\) cannot be imported: ",
        r"\(observer 'nameless' \(alpha_beta:NOTHING\) cannot be ",
        ' hybrid_angle ',
    ),
    f'{REPLAY} alpha_beta --set alpha=0.2': (0, 'tracking'),
    f'evaluate {BAG} --observer alpha_beta': (0, 'alpha_beta', 'rms'),
    f'tune {BAG} --observer alpha_beta --trials 3 --out OUT': (0, 'alpha'),
    'export alpha_beta --out OUT': (0, r'(\d+) samples: \1 equal to the last bit'),
    'list alpha_beta': (
        0,
        "plain Python: the engine has observers of this package alone, and 'alpha_beta' is",
        r'alpha\b.*weight of the innovation',
    ),
    'export other --out OUT': (
        2,
        "^velocity_estimator export: 'other' cannot be exported: other.py:",
    ),
    f'list geso {MODEL_OF_SLIDE}': (0, 'effect of the gains'),
    f'{REPLAY} geso {MODEL_OF_SLIDE} --set joints=[pendulum]': (0, 'received'),
    f'{REPLAY} broken': (1, 'SyntaxError'),
    f'{REPLAY} a_number': (1, 'which is not an Observer'),
    f'{REPLAY} geso --set model=ruin': (1, 'SyntaxError'),
}
EACH = """
import contextlib, io, json, sys
from estimator_pkg.cli import main
found = {}
for words in sys.argv[1:]:
    said, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(error):
        code = main(words.replace('OUT', f'out_{len(found)}').split())
    found[words] = code, said.getvalue(), error.getvalue()
print(json.dumps(found))
"""


@pytest.fixture(scope='module')
def ran(foreign, tmp_path_factory):
    """(exit code, what is printed, errors) of each command, where that package is installed."""
    done = subprocess.run(
        [sys.executable, '-c', EACH, *RUNS],
        capture_output=True,
        text=True,
        timeout=200,
        cwd=tmp_path_factory.mktemp('runs'),
        env=environment(foreign),
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.long
@pytest.mark.parametrize('words', RUNS, ids=lambda words: words.replace(str(BAG), 'BAG'))
def test_a_command_with_an_observer_or_a_model_of_another_package(words, ran):
    (code, *patterns), (ended, said, error) = RUNS[words], ran[words]
    assert ended == code, error
    said = ' '.join((error if code else said).split())
    assert all(re.search(pattern, said) for pattern in patterns), said
    assert not code or error.count('\n') == 1


@pytest.mark.long
def test_the_tests_of_the_contract_run_on_an_observer_of_another_package(foreign):
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-v', '-k', '[alpha_beta', CONTRACT],
        capture_output=True,
        text=True,
        env=environment(foreign),
    )
    assert done.returncode == 0, done.stdout
    assert int(re.search(r'(\d+) passed', done.stdout)[1]) >= 20


@pytest.mark.long
def test_the_tables_of_the_documentation_have_an_observer_of_another_package(foreign):
    script = 'from docs.tools.parameters import pages; print(pages()["joint_observer.md"])'
    folder = Path(__file__).parent.parent
    page = subprocess.check_output(
        [sys.executable, '-c', script], cwd=folder, env=environment(foreign), text=True
    )
    assert '## Observer alpha_beta' in page and '| `alpha` | 0.3 |' in page
