# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The engine, and the C text of the other tests here, under the sanitizers of gcc."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from estimator_pkg.engine.entries import entries, installed
from estimator_pkg.engine.load import PACKAGE
from estimator_pkg.engine.translate import FLAGS, translate

TEST = Path(__file__).parents[1]
SANITIZERS = ['-fsanitize=address,undefined,float-cast-overflow', '-fno-sanitize-recover=all']


def sanitized(*command, **variables):
    """Run Python with the runtime of the address sanitizer; return what it prints."""
    find = ['gcc', '-print-file-name=libasan.so']
    asan = subprocess.run(find, capture_output=True, text=True, check=True).stdout.strip()
    if not Path(asan).is_absolute():
        pytest.skip('gcc has no libasan here')
    variables |= {'LD_PRELOAD': asan, 'ASAN_OPTIONS': 'detect_leaks=0', 'PYTHONMALLOC': 'malloc'}
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        capture_output=True,
        text=True,
        env={**os.environ, **variables},
        cwd=TEST.parent,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


pytestmark = pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')


@pytest.mark.long
@pytest.mark.parametrize('runs', [1, pytest.param(10, marks=pytest.mark.slow)])
def test_random_streams_through_the_whole_engine_are_clean(runs, tmp_path):
    root = PACKAGE.parent
    every = entries(installed(), root)
    (tmp_path / 'engine.c').write_text(translate(every, root))
    command = ['gcc', *FLAGS, '-O0', '-g1', *SANITIZERS, '-fPIC', '-shared', 'engine.c', '-lm']
    subprocess.run([*command, '-o', 'engine.so'], cwd=tmp_path, check=True)
    script = TEST / 'support' / 'engine_streams.py'
    called = sanitized(script, tmp_path / 'engine.so', runs, PYTHONPATH=str(script.parent))
    assert {each.name for each in every} == {*called.split()}


@pytest.mark.slow
def test_the_small_modules_of_other_tests_are_clean():
    files = 'engine/test_constructs', 'engine/test_records', 'engine/test_random'
    paths = [TEST / f'{file}.py' for file in (*files, 'observers/angle/test_kalman')]
    words = '-m', 'pytest', '-q', '-p', 'no:cacheprovider', *paths
    assert '[100%]' in sanitized(*words, ENGINE_TEST_CFLAGS=' '.join(SANITIZERS))
