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
from benchmarks.timing import compared, interleave, not_run, row
from estimator_pkg.bags.writer import BagWriter
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.options import MEASUREMENT
from estimator_pkg.messages.joint_state import TYPE, Encoder
from estimator_pkg.progress import progress

MESSAGES = 1_000_000
JOINTS = 7
OBSERVER = 'hybrid_angle'
WITH, ROSBAGS = 'replay with --out', 'rosbags'  # which reads and deserialises
# Required speed over rosbags' reading; with --out, three messages are written for each by mcap.
FACTORS = {'replay without --out': 3.0, WITH: 0.4}
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
                extra = ('--out', str(out)) if label == WITH else ()
                costs.setdefault(label, []).append(run_process(*words, *extra))
                shutil.rmtree(out, ignore_errors=True)
                return costs[label][-1].cpu

            return timed

        replay = (REPLAY, 'replay', str(bag), '--observer', OBSERVER)
        sides = {label: side(label, *replay) for label in FACTORS}
        sides[ROSBAGS] = side(ROSBAGS, PEER, str(bag))
        with progress('replay', (rounds + 1) * len(sides)) as advance:
            times = interleave(sides, rounds, advance)
    rate = 'messages/s of CPU'
    rows = compared('', times, lambda seconds: messages / seconds, rate, ROSBAGS, FACTORS)
    full = max(cost.memory for cost in costs[WITH])
    return [*rows, row(f'peak memory with --out, {messages} messages', full, 'MB')]
