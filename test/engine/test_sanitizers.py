# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The C text of all other tests here, once under the sanitizers of gcc."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.skipif(shutil.which('gcc') is None, reason='needs gcc')
def test_nothing_is_undefined_and_no_memory_is_touched_beyond_its_end():
    find = ['gcc', '-print-file-name=libasan.so']
    asan = subprocess.run(find, capture_output=True, text=True, check=True).stdout.strip()
    if not Path(asan).is_absolute():
        pytest.skip('gcc has no libasan here')
    environment = {
        **os.environ,
        'LD_PRELOAD': asan,
        'ASAN_OPTIONS': 'detect_leaks=0',
        'ENGINE_TEST_CFLAGS': '-fsanitize=undefined,address,float-cast-overflow '
        '-fno-sanitize-recover=all',
    }
    tests = [
        Path(__file__).with_name(f'test_{name}.py')
        for name in ('constructs', 'records', 'random', 'kalman')
    ]
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', *map(str, tests)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
