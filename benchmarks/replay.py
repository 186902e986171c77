# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part speed``: read a bag of JointStates and estimate, compared with rosbags' reading.

Every run is its own process, so start-up and compiling count, and its peak memory is known. Rates
are per second of CPU time, which does not depend on other load or on threads.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import outside
from benchmarks.signals import RATE, START_NS, encoder, sine
from benchmarks.timing import best_and_median, interleave, not_run, ratio, row
from benchmarks.update import MAIN
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.options import MEASUREMENT
from estimator_pkg.messages.joint_state import TYPE, Encoder
from estimator_pkg.progress import progress

MESSAGES = 1_000_000
JOINTS = 7
READ_FACTOR = 3.0  # required speed of reading and estimating over rosbags' reading
WRITE_FACTOR = 1.0  # the same with --out
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
# The last line of output: CPU time [s] and peak memory [kB] of the process itself.
WEIGHED = """
import atexit, time
def weigh():
    with open('/proc/self/status') as status:
        peak = next(line.split()[1] for line in status if line.startswith('VmHWM'))
    print(f'\\n{time.process_time()} {peak}')
atexit.register(weigh)
"""
REPLAY = 'import sys; from estimator_pkg.cli import main; sys.exit(main(sys.argv[1:]))'


class Cost(NamedTuple):
    """Resources of a process: CPU time [s], peak memory [MB]."""

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
    words = [sys.executable, '-c', WEIGHED + code, *arguments]
    done = subprocess.run(words, capture_output=True, text=True, errors='replace', **outside())
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise UserError(f'a benchmarked process failed: {lines[-1] if lines else "no output"}')
    cpu, memory = map(float, done.stdout.splitlines()[-1].split())
    return Cost(cpu, 1.024e-3 * memory)


def replays(messages: int = MESSAGES, rounds: int = 2) -> list[dict[str, Any]]:
    """Return messages per second of CPU with and without --out, compared with rosbags; memory."""
    if not Path('/proc/self/status').exists():
        return [not_run('replay', 'this platform does not report the memory of a process')]
    with tempfile.TemporaryDirectory(prefix='velocity_estimator_bench') as name:
        folder = Path(name)
        bag = folder / 'bag'
        write_bag(bag, messages)
        costs: dict[str, list[Cost]] = {}

        def side(label: str, *words: str) -> Callable[[int], float]:
            def timed(number: int) -> float:
                out = folder / f'out{number}'
                extra = ('--out', str(out)) if label == 'with' else ()
                costs.setdefault(label, []).append(run_process(*words, *extra))
                shutil.rmtree(out, ignore_errors=True)
                return costs[label][-1].cpu

            return timed

        replay = (REPLAY, 'replay', str(bag), '--observer', MAIN)
        sides = {label: side(label, *replay) for label in ('without', 'with')}
        sides['peer'] = side('peer', PEER, str(bag))
        with progress('replay', (rounds + 1) * len(sides)) as advance:
            times = interleave(sides, rounds, advance)
    rows = []
    for label, title in (
        ('without', 'replay without --out'),
        ('with', 'replay with --out'),
        ('peer', 'rosbags reads and deserialises'),
    ):
        least, median = (messages / seconds for seconds in best_and_median(times[label]))
        rows.append(row(title, least, 'messages/s of CPU', median=median))
    for label, factor in (('without', READ_FACTOR), ('with', WRITE_FACTOR)):
        value = ratio(times['peer'], times[label])
        name = f'rosbags / replay {label} --out'
        rows.append(row(name, value, 'times', limit=factor, at_least=True))
    full = max(cost.memory for cost in costs['with'])
    rows.append(row(f'peak memory with --out, {messages} messages', full, 'MB'))
    return rows
