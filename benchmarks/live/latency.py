# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Latency of an observer node's answers, from the stamp to the receipt by another process.

The stamp is the time at which the message was sent. The difference to a node that only republishes
is the observer's. The two run in turn, each with the machine to itself.

    python -m benchmarks.live.latency [ROUNDS]
"""

from __future__ import annotations

import json
import signal
import statistics
import sys
import time
from contextlib import ExitStack

from benchmarks.live.processes import JOINTS, NODES, NULL, observer, process, result
from estimator_pkg.ros.domain import free_domain

RATE = 1000.0  # [Hz]
SECONDS = 5.0  # of which the first quarter is ignored
ROUNDS = 3
KEYS = ('median_ms', 'late_ms')


def once(name: str, rate: float = RATE, seconds: float = SECONDS) -> dict[str, float]:
    """Return median and 99 % of the latency [ms], and the number of answers."""
    domain = free_domain()
    with ExitStack() as stack:
        stack.enter_context(observer(name, domain))
        listener = stack.enter_context(process('time', f'/{name}/estimate', domain=domain))
        assert listener.stdout is not None
        listener.stdout.readline()
        time.sleep(1.5)
        stack.enter_context(process('feed', str(rate), domain=domain))
        time.sleep(1.0 + seconds)
        listener.send_signal(signal.SIGINT)
        return result(listener)


def measure(rounds: int = ROUNDS) -> dict:
    """Return for each node: medians over the rounds, difference and ratio to the null node."""
    names = (NULL, *NODES)
    found: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    for _ in range(rounds):
        for name in names:
            found[name].append(once(name))
    rows = []
    for name in names:
        pairs = [
            (mine, null)
            for mine, null in zip(found[name], found[NULL])
            if all(key in each for key in KEYS for each in (mine, null))
        ]
        row: dict = {
            'node': name,
            'rounds': len(pairs),
            'answered': sum(int(mine['answered']) for mine in found[name]),
        }
        for key in KEYS if pairs else ():
            row[key] = statistics.median(mine[key] for mine, _ in pairs)
            row[f'{key}_more'] = statistics.median(mine[key] - null[key] for mine, null in pairs)
            row[f'{key}_ratio'] = statistics.median(mine[key] / null[key] for mine, null in pairs)
        rows.append(row)
    return {'rate_hz': RATE, 'joints': JOINTS, 'rows': rows}


if __name__ == '__main__':
    print(json.dumps(measure(int(sys.argv[1]) if sys.argv[1:] else ROUNDS), indent=2))
