# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``bench speed``, part 3: read a bag of JointStates and estimate, compared with rosbags' reading.

Every run is its own process, so start-up and compiling count, and its peak memory is known. Rates
are per second of CPU time, which does not depend on other load or on threads; the JSON also has the
shortest wall-clock time.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.signals import RATE, START_NS, encoder, sine
from benchmarks.update import MAIN
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.timing import best_and_median, interleave, not_run, ratio, row
from estimator_pkg.evaluation.options import MEASUREMENT
from estimator_pkg.messages.joint_state import TYPE, Encoder
from estimator_pkg.progress import progress

MESSAGES = 1_000_000
JOINTS = 7
ROUNDS = 2
READ_FACTOR = 3.0  # required speed of reading and estimating over rosbags' reading
WRITE_FACTOR = 1.0  # the same with --out
FLAT = 1.1  # largest ratio of peak memory at full length to that at a quarter of it
CHUNK = 10_000

PEER = """
import sys
from pathlib import Path
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
with AnyReader([Path(sys.argv[1])], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
    for connection, _, raw in reader.messages():
        reader.deserialize(raw, connection.msgtype)
"""
# The memory that wait4 reports includes the parent's at the fork, so the child measures its own.
WEIGHED_FILE = 'VELOCITY_ESTIMATOR_WEIGHED'
WEIGHED = """
def weigh():
    import os, sys
    try:
        with open('/proc/self/status') as status:
            peak = next(int(line.split()[1]) * 1024 for line in status if line.startswith('VmHWM'))
    except OSError:
        import resource
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        peak *= 1 if sys.platform == 'darwin' else 1024
    with open(os.environ['VELOCITY_ESTIMATOR_WEIGHED'], 'w') as out:
        out.write(str(peak))
import atexit
atexit.register(weigh)
"""
REPLAY = 'import sys; from estimator_pkg.cli import main; sys.exit(main(sys.argv[1:]))'


class Cost(NamedTuple):
    """Resources of a process: wall-clock time [s], CPU time [s], peak memory [MB]."""

    wall: float
    cpu: float
    memory: float


def write_bag(path: Path, messages: int, joints: int = JOINTS) -> None:
    """Write a bag of `messages` JointStates at 1 kHz, sampled with jitter."""
    names = [f'joint_{i}' for i in range(joints)]
    motion = sine(5.0, 2.0)
    random = np.random.default_rng(1)
    message = Encoder()
    with BagWriter(path) as bag, progress('writing the bag', messages) as advance:
        bag.add_topic(MEASUREMENT, TYPE)
        for first in range(0, messages, CHUNK):
            count = min(CHUNK, messages - first)
            steps = first + 1 + np.arange(count) + random.uniform(-0.4, 0.4, count)
            stamps = np.rint(steps * (1e9 / RATE)).astype(np.int64)
            turned = motion(stamps.astype(np.float64) * 1e-9)[0]
            positions = np.stack(
                [encoder(turned * (1.0 + 0.1 * i) + i) for i in range(joints)], axis=1
            )
            for stamp, row_of in zip((stamps + START_NS).tolist(), positions.tolist()):
                bag.write(MEASUREMENT, stamp, message.encode(stamp, 'base', names, row_of))
            advance(count)


def run_process(code: str, *arguments: str) -> Cost:
    """Run this Python code, with these arguments in `sys.argv`, in its own process to its end.

    Raises
    ------
    UserError : it failed; the message contains its last line of output.
    """
    begun = time.perf_counter()
    with tempfile.TemporaryFile() as errors, tempfile.NamedTemporaryFile('r') as weighed:
        child = subprocess.Popen(
            [sys.executable, '-c', WEIGHED + code, *arguments],
            stdout=subprocess.DEVNULL,
            stderr=errors,
            env={**os.environ, WEIGHED_FILE: weighed.name},
        )
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - begun
        if child.returncode:
            errors.seek(0)
            lines = errors.read().decode('utf-8', 'replace').strip().splitlines()
            raise UserError(f'a benchmarked process failed: {lines[-1] if lines else "no output"}')
        return Cost(wall, used.ru_utime + used.ru_stime, float(weighed.read()) * 1e-6)


def replays(messages: int = MESSAGES, rounds: int = ROUNDS) -> list[dict[str, Any]]:
    """Return messages per second of CPU with and without --out, compared with rosbags; memory."""
    if importlib.util.find_spec('resource') is None:
        return [not_run('replay', 'this platform does not report resources of a process')]
    with tempfile.TemporaryDirectory(prefix='velocity_estimator_bench') as name:
        folder = Path(name)
        bag, quarter = folder / 'bag', folder / 'quarter'
        write_bag(bag, messages)
        write_bag(quarter, messages // 4)
        costs: dict[str, list[Cost]] = {}

        def side(label: str, *words: str) -> Callable[[int], float]:
            def timed(number: int) -> float:
                extra = []
                if label == 'with':
                    out = folder / f'out{number}'
                    extra = ['--out', str(out)]
                cost = run_process(*words, *extra)
                if extra:
                    _remove(out)
                costs.setdefault(label, []).append(cost)
                return cost.cpu

            return timed

        replay = (REPLAY, 'replay', str(bag), '--observer', MAIN)
        sides = {
            'without': side('without', *replay),
            'with': side('with', *replay),
            'peer': side('peer', PEER, str(bag)),
        }
        with progress('replay', (rounds + 1) * len(sides)) as advance:
            times = interleave(sides, rounds, advance)
        out = folder / 'quarter_out'
        short = run_process(REPLAY, 'replay', str(quarter), '--observer', MAIN, '--out', str(out))
    rows = []
    for label, title in (
        ('without', 'replay without --out'),
        ('with', 'replay with --out'),
        ('peer', 'rosbags reads and deserialises'),
    ):
        least, median = best_and_median(times[label])
        rows.append(
            row(
                title,
                messages / least,
                'messages/s of CPU',
                median=messages / median,
                wall_s=min(cost.wall for cost in costs[label]),
            )
        )
    rows.append(
        row(
            'rosbags / replay without --out',
            ratio(times['peer'], times['without']),
            'times',
            limit=READ_FACTOR,
            at_least=True,
        )
    )
    rows.append(
        row(
            'rosbags / replay with --out',
            ratio(times['peer'], times['with']),
            'times',
            limit=WRITE_FACTOR,
            at_least=True,
        )
    )
    full = max(cost.memory for cost in costs['with'])
    rows.append(row(f'peak memory with --out, {messages} messages', full, 'MB'))
    rows.append(row(f'peak memory with --out, {messages // 4} messages', short.memory, 'MB'))
    rows.append(row('peak memory, four times the length', full / short.memory, 'times', limit=FLAT))
    return rows


def _remove(bag: Path) -> None:
    for file in bag.iterdir():
        file.unlink()
    bag.rmdir()
