# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Exported headers give the driver's estimates, to the last bit, in C99 and C++17.

`make test-export` runs all of it. The quick part takes gcc and the settings as they are.
"""

import ctypes
import math
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from estimator_pkg import registry
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import joint_series
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint
from estimator_pkg.evaluation.entries import angle_observers
from estimator_pkg.export import folder, vectors
from estimator_pkg.export.header import exported
from estimator_pkg.sensor.guard import DUPLICATE

FLAGS = ['-O2', '-Wall', '-Wextra', '-Wpedantic', '-Werror', '-ffp-contract=off', '-fwrapv']
COMPILERS = {'gcc': '-std=c99', 'clang': '-std=c99', 'g++': '-std=c++17'}
LOOP = """\
#include "{name}.h"
#ifdef __cplusplus
extern "C"
#endif
void run(int64_t n, const int64_t *stamps, const double *angles, double *out, int32_t *flags)
{{
    static {name} joint;
    {name}_init(&joint);
    for (int64_t i = 0; i < n; i++) {{
        {name}_estimate e;
        flags[2 * i] = {name}_update(&joint, stamps[i], {real}angles[i]);
        {name}_get(&joint, &e);
        flags[2 * i + 1] = e.status;
        out[5 * i] = e.position;
        out[5 * i + 1] = e.velocity;
        out[5 * i + 2] = e.acceleration;
        out[5 * i + 3] = e.position_stddev;
        out[5 * i + 4] = e.velocity_stddev;
    }}
}}
"""
RECORDINGS = Path(__file__).parents[2] / 'bags'
SETTINGS = ({}, {'unwrap': True}, {'wrap_period': 0.0}, {'quantum': 0.001, 'gap_max': 0.01})
EACH = pytest.mark.parametrize('name', angle_observers())


def made(name, values=None, float32=False):
    """Return an observer of one angle with its gains and settings, and its header."""
    observer = registry.find(registry.OBSERVERS, name)
    gains, settings = Configuration(observer, values).for_joint('')
    return (observer, gains, settings), exported(observer, gains, settings, name, float32)


def compiled(path, name, header, compiler='gcc', real=''):
    """Return the loop over samples, as a function of a library."""
    if shutil.which(compiler) is None:
        pytest.skip(f'{compiler} is not installed')
    (path / f'{name}.h').write_text(header)
    source = path / ('loop.cpp' if compiler == 'g++' else 'loop.c')
    source.write_text(LOOP.format(name=name, real=real))
    library = path / f'{name}.so'
    command = [compiler, COMPILERS[compiler], *FLAGS, '-shared', '-fPIC', str(source)]
    subprocess.run([*command, '-o', str(library), '-lm'], check=True)
    return ctypes.CDLL(str(library)).run


def run(loop, stamps, angles):
    """Return what the header makes of samples: estimates (n, 5), used (n,), status (n,)."""
    out, flags = np.empty((len(stamps), 5)), np.empty((len(stamps), 2), np.int32)
    arrays = np.ascontiguousarray(stamps), np.ascontiguousarray(angles), out, flags
    loop(ctypes.c_int64(len(stamps)), *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
    return out, flags[:, 0] > 0, flags[:, 1]


def differing(loop, joint, stamps, angles):
    """Return the rows in which header and driver differ in any bit."""
    out, used, status = run(loop, stamps, angles)
    own = Joint(*joint).run(stamps, angles)
    columns = own.position, own.velocity, own.acceleration, own.position_stddev
    numbers = np.stack((*columns, own.velocity_stddev), axis=1)
    other = numbers.view(np.int64) != out.view(np.int64)
    other &= ~(np.isnan(numbers) & np.isnan(out))
    taken = own.verdict < DUPLICATE
    rows = (used != taken) | (taken & (other.any(axis=1) | (status != own.status)))
    return np.flatnonzero(rows)


def motion(seed, quantum, turns=1.0, count=6000):
    """Return stamps and readings of an encoder of a joint with faults of every kind."""
    chance = np.random.default_rng(seed)
    time = np.arange(count) * 1e-3
    speed = turns * 20.0 * np.sin(2.0 * time) * np.sin(0.3 * time) + np.sin(30.0 * time)
    speed[count // 3 : count // 3 + 900] = 0.0
    angle = np.cumsum(speed) * 1e-3 + chance.normal(0.0, 1e-4, count)
    angle = np.round(angle / quantum) * quantum
    if turns == 1.0:
        angle = np.mod(angle + math.pi, math.tau) - math.pi
    stamps = 10**9 + np.arange(count) * 10**6 + chance.integers(-20_000, 20_000, count)
    for i in chance.integers(1, count, 120):
        fault = chance.integers(0, 9)
        if fault < 4:
            angle[i] = (math.nan, math.inf, -1e300, angle[i] + 0.7)[fault]
        elif fault == 4:
            stamps[i:] += int(chance.choice([300, 2_000])) * 10**6
        else:
            stamps[i] = (stamps[i - 1], stamps[i] - 5 * 10**7, stamps[i] + 10**12, 0)[fault - 5]
    stamps[count // 2 :] -= 5 * 10**9
    angle[count // 4 : count // 4 + 400 : 2] = angle[count // 4 + 1 : count // 4 + 401 : 2]
    return stamps, angle


@pytest.mark.long
@EACH
def test_a_header_gives_the_estimates_of_the_driver(name, tmp_path):
    joint, header = made(name)
    loop = compiled(tmp_path, name, header.header)
    cases = [motion(0, math.tau / 1024), motion(1, math.tau / 16, 5.0)]
    samples = vectors.with_faults(vectors.simulated(header.joint))
    cases.append((samples.stamps, samples.readings[:, 0].copy()))
    for stamps, angles in cases:
        assert list(differing(loop, joint, stamps, angles)) == []


@pytest.mark.slow
@pytest.mark.parametrize('compiler', COMPILERS)
@pytest.mark.parametrize('values', SETTINGS, ids=str)
@EACH
def test_other_compilers_and_settings(name, values, compiler, tmp_path):
    joint, header = made(name, values)
    loop = compiled(tmp_path, name, header.header, compiler)
    for seed, counts in enumerate((16, 1024, 65_536)):
        for turns in (1.0, 5.0):
            stamps, angles = motion(seed, math.tau / counts, turns, 20_000)
            assert list(differing(loop, joint, stamps, angles)) == []


@pytest.mark.slow
@EACH
def test_shipped_recordings(name, tmp_path):
    joint, header = made(name)
    loop = compiled(tmp_path, name, header.header)
    samples = 0
    for path in sorted(RECORDINGS.rglob('*.mcap')):
        with open_bag(path) as bag:
            try:
                found = joint_series(bag, measurement_topic(bag))
            except Exception:  # a bag of a drive, or of one message
                continue
        for series in found.values():
            samples += len(series.stamps_ns)
            assert list(differing(loop, joint, series.stamps_ns, series.position)) == []
    assert samples > 70_000


@EACH
def test_a_reader_takes_it_for_hand_written(name):
    _, header = made(name)
    code = re.sub(r'//[^\n]*|/\*.*?\*/', '', header.header, flags=re.S)
    names = set(re.findall(r'\b[A-Za-z_]\w*', code))
    assert not {each for each in names if re.search(r'tmp|temp$|result\d|item\d', each)}
    gains = {'edge_adaptive': 'QUANTUM', 'kalman': 'DENSITY', 'pll': 'DECAY'}
    if name in gains:
        assert f'static const double {name.upper()}_{gains[name]} = ' in header.header
    assert max(map(len, header.header.splitlines())) <= 112


def test_two_headers_are_in_one_file(tmp_path):
    for prefix in ('elbow', 'wrist'):
        joint, _ = made('kalman')
        (tmp_path / f'{prefix}.h').write_text(exported(*joint, prefix).header)
    (tmp_path / 'both.c').write_text('#include "elbow.h"\n#include "wrist.h"\n')
    command = ['gcc', '-std=c99', *FLAGS, '-Wno-unused-function', '-c', 'both.c']
    subprocess.run(command, check=True, cwd=tmp_path)


@pytest.mark.parametrize('name', ['finite_difference', 'hybrid_angle', 'pll'])
def test_float32_is_near_double(name, tmp_path):
    joint, header = made(name, float32=True)
    loop = compiled(tmp_path, name, header.header, real='(float)')
    samples = vectors.simulated(header.joint)
    angles = samples.readings[:, 0].copy()
    out, _, _ = run(loop, samples.stamps, angles)
    own = Joint(*joint).run(samples.stamps, angles)
    error = out[:, 1] - own.velocity
    assert np.sqrt(np.mean(error**2)) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize('target', ['aarch64-linux-musl', 'arm-linux-musleabihf'])
@EACH
def test_other_machines(name, target, tmp_path):
    emulator = shutil.which(f'qemu-{target.partition("-")[0]}')
    if emulator is None or find_spec('ziglang') is None:
        pytest.skip('needs qemu-user, and ziglang from the package index')
    _, header = made(name)
    folder.write(tmp_path / 'out', header, vectors.with_faults(vectors.simulated(header.joint)))
    command = [sys.executable, '-m', 'ziglang', 'cc', '-target', target, *folder.FLAGS.split()]
    subprocess.run([*command, 'main.c', '-o', 'check', '-lm'], check=True, cwd=tmp_path / 'out')
    done = subprocess.run(
        [emulator, './check'], capture_output=True, text=True, cwd=tmp_path / 'out'
    )
    print(name, target, done.stdout)
    pattern = r'(\d+) samples: .* (\d+) within 1e-9, (\d+) flips'
    count, within, flips = map(int, re.search(pattern, done.stdout).groups())
    assert flips == 0 and within >= 0.99 * count
