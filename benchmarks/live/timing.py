# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Time of an observer node to its first estimate, and latency of its answers.

Each is compared with a node that only republishes. The nodes run in turn, each with the machine to
itself. A latency is from the stamp, the time at which the message was sent, to the receipt by
another process.
"""

from __future__ import annotations

import json
import signal
import statistics
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from benchmarks.live.processes import DRIVES, NODES, NULL, NULL_DRIVE, observer, process, result
from benchmarks.timing import not_run, row
from estimator_pkg.progress import progress
from estimator_pkg.ros.domain import free_domain

LONGEST = 8.0  # [s] to wait for a first estimate
# key -> (title, unit)
START = {'estimate': ('process start to first estimate', 's')}
LATENCY = {
    'median_ms': ('stamp to receipt, median', 'ms'),
    'late_ms': ('stamp to receipt, 99 %', 'ms'),
}
# the null node of each node, which takes and publishes the same types
OF_JOINTS = dict.fromkeys(NODES, NULL)
ALL = OF_JOINTS | dict.fromkeys(DRIVES, NULL_DRIVE)
# largest ratio of the latencies at 99 %: of observers in plain Python, and of one with two
# messages a sample, what is reached (1.5 to 1.65) and a margin
MOST = dict.fromkeys(ALL, 2.0) | {'joint_observer': 1.3, 'mechanical_observer': 1.3}


def start(name: str, rate: float = 200.0) -> dict[str, float]:
    """Return the seconds to the node's first estimate; without one there is no key.

    An estimate is a message with a joint in it, of the null node any message.
    """
    domain = free_domain()
    with ExitStack() as stack:
        stack.enter_context(process('feed', str(rate), domain=domain))
        listener = stack.enter_context(process('time_answers', f'/{name}/estimate', domain=domain))
        output = listener.stdout
        assert output is not None
        output.readline()
        time.sleep(1.0)  # until the stream runs
        begun, found = time.time_ns(), list[str]()
        stack.enter_context(observer(name, domain))
        reading = threading.Thread(target=lambda: found.append(output.readline()), daemon=True)
        reading.start()
        reading.join(LONGEST)
        return {'estimate': 1e-9 * (json.loads(found[0])['estimate'] - begun)} if found else {}


def latency(name: str, rate: float = 1000.0, seconds: float = 5.0) -> dict[str, float]:
    """Return median and 99 % of the latency [ms], and the number of answers."""
    domain = free_domain()
    with ExitStack() as stack:
        stack.enter_context(observer(name, domain))
        listener = stack.enter_context(process('time_answers', f'/{name}/estimate', domain=domain))
        assert listener.stdout is not None
        listener.stdout.readline()
        time.sleep(1.5)
        feeder = 'feed_drive' if name in (*DRIVES, NULL_DRIVE) else 'feed'
        stack.enter_context(process(feeder, str(rate), domain=domain))
        time.sleep(1.0 + seconds)
        listener.send_signal(signal.SIGINT)
        return result(listener)


def rows(
    once: Callable[[str], dict[str, float]],
    titles: dict[str, tuple[str, str]],
    rounds: int,
    null_of: dict[str, str],
) -> list[dict[str, Any]]:
    """Return for each node the medians over the rounds, and the ratio to its null node's."""
    names = list(dict.fromkeys([*null_of.values(), *null_of]))
    found: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    with progress(once.__name__, rounds * len(names)) as advance:
        for _ in range(rounds):
            for name in names:
                found[name].append(once(name))
                advance(1)
    made = []
    for name in names:
        for key, (title, unit) in titles.items():
            pairs = [
                (mine[key], null[key])
                for mine, null in zip(found[name], found[null_of.get(name, name)])
                if key in mine and key in null
            ]
            if not pairs:
                made.append(not_run(f'{name}: {title}', f'none within {LONGEST:g} s'))
                continue
            median = statistics.median(mine for mine, _ in pairs)
            made.append(row(f'{name}: {title}', median, unit))
            if name in null_of:
                ratio = statistics.median(mine / null for mine, null in pairs)
                most = MOST[name] if key == 'late_ms' else None
                made.append(row(f'{name}: {title} / null node', ratio, 'times', limit=most))
    return made
