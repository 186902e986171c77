# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part soak``: a node for an hour with a faulty driver that is killed and started again.

The driver publishes seven joints at 1 kHz and counts in a shared file what it published, by kind of
fault. The number of a message is the effort of its first joint, which the node copies into the
answer. A witness receives the answers and changes gains live. What the driver published is then
compared with what the node counted, and with the answers.
"""

from __future__ import annotations

import math
import random
import signal
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.live import node, process, result
from benchmarks.timing import row
from estimator_pkg.errors import UserError
from estimator_pkg.messages.joint_state import Encoder
from estimator_pkg.progress import progress

RATE = 1000.0  # [Hz]
NAMES = [f'joint_{k}' for k in range(7)]
QUANTUM = 2.0 * math.pi / 4096
APART = 50  # messages from one fault to the next, at least, so that each is counted as its kind
FAULTY = 0.02  # probability of a fault, at every message after those
# Kinds of faults. The guard drops the samples of the first five: the node counts each kind.
DROPPED = ('duplicate', 'late', 'zero_stamp', 'non_finite', 'malformed')
KINDS = (*DROPPED, 'stray', 'jump', 'missing', 'held', 'pause')
COUNTED = ('messages', 'samples', *KINDS)  # by the driver; of the kinds that are dropped: samples
LIVES = 20.0, 60.0  # of a driver, until it is killed or interrupted [s]
PAUSE = 3.0  # until the next one starts, at most [s]
LOOK = 2.0  # between two looks at the memory [s]
WARM = 0.2  # part of the run after which the memory must not grow
GROWTH = 3.0  # of the memory, between the medians of the two halves of the rest, at most [MB]


def counts(path: str) -> NDArray[np.int64]:
    """Return the counts in a file, shape (len(COUNTED),): what is written is in the file."""
    return np.memmap(path, np.int64, 'r+', shape=len(COUNTED))


class Driver:
    """The messages of a faulty driver, whose random seed is the number of its first message."""

    def __init__(self, counted: NDArray[np.int64]) -> None:
        self._counted = counted
        self._random = random.Random(int(counted[0]))
        self._encode = Encoder().encode
        self._last = self._offset = 0  # stamp and what is added to the time [ns]
        self._held = self._wait = 0  # messages for which the readings stay, and without a fault
        self._angles = [0.0] * len(NAMES)

    def message(self) -> tuple[bytes, float]:
        """Return the next message, counted, and the pause before it [s]."""
        kind, pause = '', 0.0
        self._wait -= 1
        if self._wait < 0 and self._random.random() < FAULTY:
            kind, self._wait = self._random.choice(KINDS), APART
        if kind == 'jump':
            self._offset += self._random.choice((-10, 10)) * 10**9
        elif kind == 'held':
            self._held = self._random.randint(2, 20)
        elif kind == 'pause':
            pause = min(2.0, self._random.expovariate(10.0))
        return self._made(kind, time.time_ns() + round(1e9 * pause)), pause

    def _made(self, kind: str, now: int) -> bytes:
        number = int(self._counted[0])
        stamp = {
            'duplicate': self._last,
            'late': self._last - 5_000_000,
            'zero_stamp': 0,
            'stray': now + self._offset + 3600 * 10**9,
        }.get(kind, now + self._offset)
        if not kind:
            self._last = stamp
        self._held -= 1
        if self._held < 0:
            speeds = range(1, len(NAMES) + 1)
            angles = (math.sin(0.3 * speed * 1e-9 * (now % 10**13)) for speed in speeds)
            self._angles = [QUANTUM * math.floor(each / QUANTUM) for each in angles]
        names, readings = NAMES, list(self._angles)
        if kind == 'missing':
            names, readings = NAMES[:-1], readings[:-1]
        elif kind == 'non_finite':
            readings[-1] = math.nan
        raw = self._encode(stamp, '', names, readings, (), [float(number)] * len(names))
        raw = raw[: len(raw) // 2] if kind == 'malformed' else raw
        self._count('messages', 1)
        self._count('samples', 0 if kind == 'malformed' else len(names))
        whole = kind in ('duplicate', 'late', 'zero_stamp')
        if kind:
            self._count(kind, len(names) if whole else 1)
        return raw

    def _count(self, kind: str, number: int) -> None:
        self._counted[COUNTED.index(kind)] += number


def soak(minutes: float) -> list[dict[str, Any]]:
    """Return rows: what was published and counted, answers, memory; raise UserError."""
    import psutil

    from estimator_pkg.ros.domain import free_domain

    domain, chance, kills, memory = free_domain(), random.Random(1), 0, list[float]()
    with (
        tempfile.TemporaryDirectory() as folder,
        process(*node('joint_observer'), domain=domain) as observer,
        process('benchmarks.roles', 'witness', 'joint_observer', domain=domain) as witness,
        progress('soak [s]', round(60.0 * minutes)) as advance,
    ):
        path = str(Path(folder) / 'counts')
        np.zeros(len(COUNTED), np.int64).tofile(path)
        assert witness.stdout and witness.stdout.readline()  # it listens
        meter, end = psutil.Process(observer.pid), time.monotonic() + 60.0 * minutes

        def wait(seconds: float) -> None:
            until = min(time.monotonic() + seconds, end)
            while (left := until - time.monotonic()) > 0.0:
                time.sleep(min(left, LOOK))
                advance(round(min(left, LOOK)))
                if observer.poll() is not None:
                    raise UserError(f'the node ended with code {observer.returncode}')
                memory.append(1e-6 * meter.memory_info().rss)

        while time.monotonic() < end:
            with process('benchmarks.roles', 'faulty', path, domain=domain) as driver:
                wait(chance.uniform(*LIVES))
                if chance.random() < 0.5:
                    driver.kill()
                kills += 1
            wait(chance.uniform(0.0, PAUSE))
        time.sleep(3.0)  # the diagnostics that count the last message
        witness.send_signal(signal.SIGINT)
        found, published = result(witness), dict(zip(COUNTED, counts(path).tolist()))
    return rows(published, found, kills, memory)


def rows(
    published: dict[str, int], found: dict[str, Any], kills: int, memory: list[float]
) -> list[dict[str, Any]]:
    """Return the rows of `soak`.

    Parameters
    ----------
    published : by the driver, by `COUNTED`. found : what the witness printed.
    kills : ends of the driver, each of which may lose one message before it is sent.
    memory : of the node, in order [MB].
    """
    node = {name: int(text) for name, text in found['counters'].items() if text.isdigit()}
    dropped = {name: number for name, number in node.items() if name.startswith('dropped.')}
    lost = node['lost_by_dds']
    missing = published['messages'] - node['messages_received'] - lost
    gone = len(NAMES) * (lost + missing)  # samples of these messages, if none has fewer
    fewer = len(NAMES) * published['malformed'] + published['missing']
    wrong = {
        kind: published[kind] - node.get(f'dropped.{kind}', node.get(f'messages_dropped.{kind}', 0))
        for kind in DROPPED
    }
    # of a kind, the lost part; and a message less is a duplicate or late where one was lost before
    part_lost = 3.0 * lost / published['messages']
    # Messages of which no sample is used have no answer: those of three kinds of faults, and some
    # of those whose readings repeat.
    whole = sum(node[f'dropped.{kind}'] for kind in DROPPED[:3]) / len(NAMES)
    repeated = node['dropped.repeated'] // len(NAMES)
    part = memory[round(WARM * len(memory)) :]
    half = len(part) // 2
    grown = statistics.median(part[half:]) - statistics.median(part[:half])
    unused = node['received'] - node['used'] - sum(dropped.values())
    unanswered = node['messages_used'] - math.ceil(whole) - found['answers']
    found_rows: list[tuple[str, float, float | None]] = [  # name, value, requirement
        ('messages published', published['messages'], None),
        *((f'published {kind}', published[kind], None) for kind in KINDS),
        ('ends of the driver', kills, None),
        ('live changes of gains', found['changed'], None),
        ('live changes refused', found['refused'], 0),
        ('messages received', node['messages_received'], None),
        ('messages lost by DDS, counted', lost, None),
        ('messages neither received nor counted as lost', abs(missing), kills),
        ('samples received', node['received'], None),
        ('samples used', node['used'], None),
        *((f'samples {name}', number, None) for name, number in dropped.items()),
        ('samples received - used - dropped', abs(unused), 0),
        (
            'samples published - received - those of lost messages',
            abs(published['samples'] - node['received'] - gone),
            fewer,
        ),
        *(
            (
                f'{kind}: published - counted',
                abs(number),
                math.ceil(part_lost * published[kind]) + len(NAMES) * kills,
            )
            for kind, number in wrong.items()
        ),
        ('answers', found['answers'], None),
        ('messages used - answers - those without a used sample', abs(unanswered), repeated),
        ('answers that came twice', found['twice'], 0),
        ('answers that went backwards', found['backwards'], 0),
        ('memory of the node [MB]', part[-1], None),
        ('memory, growth [MB]', grown, GROWTH),
    ]
    return [row(name, value, '', limit=limit) for name, value, limit in found_rows]
