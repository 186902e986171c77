# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A fault of the cache of compiled functions costs time and one line, never the answer."""

import os
import subprocess
import sys

import nursery
import pytest

pytest.importorskip('numba')

ALONE = """
    import os, sys
    from numba.core import config
    sys.dont_write_bytecode = True
    os.environ['NUMBA_CACHE_DIR'] = sys.argv[2]
    config.reload_config()
"""
CALL = """
    import resource, sys
    if sys.argv[1] != '-1':
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
    from estimator_pkg.driver.compiled import compiled
    from estimator_pkg.observers.circle import wrap
    twin = compiled(wrap)
    assert twin(7.0, 6.0) == wrap(7.0, 6.0)
    print('hits', sum(twin.stats.cache_hits.values()))
"""
DRIVE = """
    import sys
    from estimator_pkg import observers
    from estimator_pkg.driver import drive
    from estimator_pkg.driver.drive import DriveJoint
    from estimator_pkg.driver.configuration import JointSettings
    from estimator_pkg.parameters import build
    observer = observers.find('pmsm')
    gains = build(observer.gains, {'resistance': 0.2, 'inductance': 3e-4, 'pole_pairs': 4,
                                   'flux': 0.01})
    joint = DriveJoint(observer, gains, JointSettings(), sample_period=1e-4, fast=True)
    joint.warm_up()
    assert joint.fast
    print('hits', sum(drive._twin(joint._drive_batch).stats.cache_hits.values()))
"""


PERIODS = """
    import math, sys
    import numpy as np
    from estimator_pkg.driver.compiled import compiled
    from estimator_pkg.evaluation.entries import Entry
    time = np.arange(3000)
    stamps, angle = 10**15 + 10**6 * time, 5.0 * np.sin(0.003 * time)
    angle = np.floor(angle * 4096 / math.tau) * math.tau / 4096
    hits = 0
    for period in map(float, sys.argv[1].split('-')):
        readings = (angle + math.pi) % math.tau - math.pi if period else angle
        joint = Entry('edge_adaptive', 'edge_adaptive').joint(wrap_period=period)
        plain = Entry('edge_adaptive', 'edge_adaptive').joint(wrap_period=period)
        out = joint.run(stamps, readings, fast=True)
        same = plain.run(stamps, readings, fast=False)
        assert np.array_equal(out.velocity, same.velocity, equal_nan=True), period
        hits += sum(compiled(joint._batch).stats.cache_hits.values())
    print('hits', hits)
"""


def call(cache, size=-1, script=CALL):
    """(cache hits, further lines) that a process prints which compiles a function."""
    code, output = nursery.run_script(ALONE + script, size, cache)
    assert code == 0, output
    *lines, hits = output.splitlines()
    return int(hits.removeprefix('hits ')), lines


@pytest.fixture(scope='module')
def kept(tmp_path_factory):
    """A cache folder in which the function is kept."""
    folder = tmp_path_factory.mktemp('cache')
    assert call(folder) == (0, [])
    assert call(folder) == (1, [])
    return folder


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def empty(path):
    path.write_bytes(b'')


def garbage(path):
    path.write_bytes(b'\x80\x05garbage' * 10)


def flipped(path):
    raw = bytearray(path.read_bytes())
    for place in range(len(raw) // 2, len(raw) - 200, 997):
        raw[place] ^= 0xFF
    path.write_bytes(raw)


def folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.long
@pytest.mark.parametrize(
    'pattern, damage',
    [
        ('*.nbi', empty),
        ('*.nbc', flipped),
        *(
            pytest.param(pattern, damage, marks=pytest.mark.slow)
            for pattern, damage in (
                ('*.nbi', cut),
                ('*.nbi', garbage),
                ('*.nbc', empty),
                ('*.nbc', cut),
                ('*.nbc', garbage),
            )
        ),
    ],
)
def test_a_damaged_cache_is_one_line_and_is_mended(kept, pattern, damage):
    for path in kept.glob(f'*/{pattern}'):
        damage(path)
    hits, lines = call(kept)
    assert hits == 0
    assert len(lines) == 1 and 'a damaged file in' in lines[0] and str(kept) in lines[0]
    assert call(kept) == (1, [])


@pytest.mark.long
def test_a_folder_in_place_of_a_file_is_one_line(kept):
    for path in kept.glob('*/*.nbi'):
        folder(path)
    hits, lines = call(kept)
    assert hits == 0 and len(lines) == 1 and 'Is a directory' in lines[0]
    for path in kept.glob('*/*.nbi'):
        path.rmdir()
    assert call(kept) == (0, [])


@pytest.mark.long
def test_a_full_disk_is_one_line(tmp_path):
    hits, lines = call(tmp_path, size=0)
    assert hits == 0 and len(lines) == 1, lines
    assert 'is not loaded from disk' in lines[0]
    hits, lines = call(tmp_path, size=2000)  # room for the index, not for the code
    assert hits == 0 and len(lines) == 1 and 'File too large' in lines[0]
    assert call(tmp_path) == (0, [])
    assert call(tmp_path) == (1, [])


@pytest.mark.slow
def test_the_loop_of_pmsm_observer_compiles_with_a_truncated_cache(tmp_path):
    call(tmp_path, script=DRIVE)
    for path in tmp_path.glob('*/*.nbi'):
        cut(path)
    hits, lines = call(tmp_path, script=DRIVE)
    assert hits == 0 and len(lines) == 1 and 'a damaged file in' in lines[0]


def test_a_numba_that_cannot_be_imported_is_one_line(tmp_path):
    (tmp_path / 'numba').mkdir()
    (tmp_path / 'numba/__init__.py').write_text("raise OSError('no shared object file')\n")
    done = subprocess.run(
        [
            sys.executable,
            '-c',
            'from estimator_pkg.driver.compiled import available\nprint(available(), available())',
        ],
        capture_output=True,
        text=True,
        timeout=100,
        env={**os.environ, 'PYTHONPATH': f'{tmp_path}:{os.environ.get("PYTHONPATH", "")}'},
    )
    assert done.stdout == 'False False\n'
    assert done.stderr == 'warning: Numba cannot be used: no shared object file\n'


@pytest.mark.slow
def test_functions_of_one_name_from_two_processes_are_not_mixed(tmp_path):
    """The two differ in a closure; the second to be loaded called functions of the first."""
    assert call(tmp_path, '6.283185307179586', PERIODS) == (0, [])
    assert call(tmp_path, '0', PERIODS) == (0, [])
    assert call(tmp_path, '6.283185307179586-0', PERIODS) == (2, [])
