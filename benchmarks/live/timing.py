# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Time of an observer node to its first estimate, and latency of its answers.

Each is compared with a node that only republishes. The nodes run in turn, each with the machine to
itself. A latency is from the stamp, the time at which the message was sent, to the receipt by
another process. CPU time until the first message does not depend on other load on the machine.
"""

from __future__ import annotations

import json
import signal
import statistics
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import psutil

from benchmarks.live.processes import NODES, NULL, cpu, observer, process, result
from benchmarks.timing import not_run, row
from estimator_pkg.progress import progress
from estimator_pkg.ros.domain import free_domain

LONGEST = 8.0  # [s] to wait for a first estimate
# key -> (title, unit, key of the null node that it is compared with)
START = {
    'message': ('process start to first message', 's', 'message'),
    'cpu': ('CPU time to first message', 's', 'cpu'),
    'estimate': ('process start to first estimate', 's', 'message'),
}
LATENCY = {
    'median_ms': ('stamp to receipt, median', 'ms', 'median_ms'),
    'late_ms': ('stamp to receipt, 99 %', 'ms', 'late_ms'),
}


def start(name: str, rate: float = 200.0) -> dict[str, float]:
    """Return seconds to the node's first message and first estimate, and CPU seconds till then.

    An estimate is a message with a joint in it; a missing one has no key.
    """
    domain = free_domain()
    with ExitStack() as stack:
        stack.enter_context(process('feed', str(rate), domain=domain))
        listener = stack.enter_context(process('time_answers', f'/{name}/estimate', domain=domain))
        assert listener.stdout is not None
        listener.stdout.readline()
        time.sleep(1.0)  # until the stream runs
        begun = time.time_ns()
        node = stack.enter_context(observer(name, domain))
        found = _times(listener, psutil.Process(node.pid))
        return {what: at if what == 'cpu' else 1e-9 * (at - begun) for what, at in found.items()}


def _times(listener: subprocess.Popen, node: psutil.Process) -> dict[str, float]:
    """Return when the first message and estimate arrived [ns], and the node's CPU time then [s].

    Waits for both, at most `LONGEST` seconds.
    """
    found: dict[str, float] = {}
    both = threading.Event()

    def read() -> None:
        assert listener.stdout is not None
        for line in listener.stdout:
            said = json.loads(line)
            if 'message' in said:
                found['cpu'] = cpu(node)
            found.update(said)
            if 'estimate' in found:
                break
        both.set()

    threading.Thread(target=read, daemon=True).start()
    both.wait(LONGEST)
    return {what: found[what] for what in START if what in found}


def latency(name: str, rate: float = 1000.0, seconds: float = 5.0) -> dict[str, float]:
    """Return median and 99 % of the latency [ms], and the number of answers."""
    domain = free_domain()
    with ExitStack() as stack:
        stack.enter_context(observer(name, domain))
        listener = stack.enter_context(process('time_answers', f'/{name}/estimate', domain=domain))
        assert listener.stdout is not None
        listener.stdout.readline()
        time.sleep(1.5)
        stack.enter_context(process('feed', str(rate), domain=domain))
        time.sleep(1.0 + seconds)
        listener.send_signal(signal.SIGINT)
        return result(listener)


def rows(
    once: Callable[[str], dict[str, float]], titles: dict[str, tuple[str, str, str]], rounds: int
) -> list[dict[str, Any]]:
    """Return for each node the medians over the rounds, and the ratio to the null node's."""
    names = (NULL, *NODES)
    found: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    with progress(once.__name__, rounds * len(names)) as advance:
        for _ in range(rounds):
            for name in names:
                found[name].append(once(name))
                advance(1)
    made = []
    for name in names:
        for key, (title, unit, same) in titles.items():
            pairs = [
                (mine[key], null[same])
                for mine, null in zip(found[name], found[NULL])
                if key in mine and same in null
            ]
            if not pairs:
                made.append(not_run(f'{name}: {title}', f'none within {LONGEST:g} s'))
                continue
            median = statistics.median(mine for mine, _ in pairs)
            made.append(row(f'{name}: {title}', median, unit))
            if name != NULL:
                ratio = statistics.median(mine / null for mine, null in pairs)
                made.append(row(f'{name}: {title} / null node', ratio, 'times'))
    return made
