# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Time of an observer node from its process's start to its first estimate.

It is compared with a node that only republishes. Both join a running stream, with a running
listener, in turn. CPU time until the first message is reported too: other load on the machine
does not change it.

    python -m benchmarks.live.start [ROUNDS]
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import psutil

from benchmarks.live.processes import NODES, NULL, cpu, observer, process
from estimator_pkg.ros.domain import free_domain

RATE = 200.0  # [Hz] of the stream
LONGEST = 8.0  # [s] to wait for a first estimate
ROUNDS = 5


def once(name: str) -> dict[str, float]:
    """Return seconds to the node's first message and first estimate, and CPU seconds till then.

    An estimate is a message with a joint in it; a missing one has no key.
    """
    domain = free_domain()
    with ExitStack() as stack:
        stack.enter_context(process('feed', str(RATE), domain=domain))
        listener = stack.enter_context(process('time', f'/{name}/estimate', domain=domain))
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
    return {what: found[what] for what in ('message', 'cpu', 'estimate') if what in found}


def measure(rounds: int = ROUNDS) -> dict:
    """Return median seconds of each node, and the median ratio to the null node in each round."""
    names = (NULL, *NODES)
    times: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    for _ in range(rounds):
        for name in names:
            times[name].append(once(name))
    rows = []
    for name in names:
        row: dict = {'node': name, 'rounds': rounds}
        for what in ('message', 'cpu', 'estimate'):
            same = 'message' if what == 'estimate' else what  # the null node has no estimate
            pairs = [
                (each[what], other[same])
                for each, other in zip(times[name], times[NULL])
                if what in each and same in other
            ]
            if pairs:
                row[f'{what}_s'] = statistics.median(mine for mine, _ in pairs)
                row[f'{what}_ratio'] = statistics.median(mine / other for mine, other in pairs)
        rows.append(row)
    return {'rate_hz': RATE, 'rows': rows}


if __name__ == '__main__':
    print(json.dumps(measure(int(sys.argv[1]) if sys.argv[1:] else ROUNDS), indent=2))
