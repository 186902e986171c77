# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Losses of the live node on a fast stream, and whether it reports them.

python -m benchmarks.live.loss
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack

from benchmarks.live.processes import process, result
from estimator_pkg.observers import DEFAULT
from estimator_pkg.ros.domain import free_domain

OVERLOAD = 150  # number of joints with which no Python node keeps up at 5 kHz


def measure(rate: float, joints: int = 7, seconds: float = 5.0, observer: str = DEFAULT) -> dict:
    """Return the messages published, received and reported lost at `rate`, with the default QoS.

    ``true_loss`` counts published messages that never reached the node's callback; ``reported`` is
    the number in the node's diagnostics.
    """
    domain = free_domain()
    chosen = ('--ros-args', '-p', f'observer:={observer}')
    with ExitStack() as stack:

        def start(*words: str, extra: tuple[str, ...] = ()):
            return stack.enter_context(process(*words, domain=domain, extra=extra))

        start('node', extra=chosen)
        watcher = start('diagnose')
        time.sleep(2.0)
        sent = result(start('publish', str(rate), str(seconds), str(joints)))
        time.sleep(2.5)  # the diagnostics that count the last message come every second
        watcher.send_signal(2)
        counters = result(watcher)
    received, reported = int(counters['messages_received']), int(counters['lost_by_dds'])
    true_loss = sent['published'] - received
    return {
        'rate_hz': rate,
        'joints': joints,
        'observer': observer,
        'published': sent['published'],
        'published_rate_hz': sent['published'] / sent['seconds'],
        'received': received,
        'true_loss': true_loss,
        'reported': reported,
        'ok': true_loss == reported,
    }


def measure_all(observer: str = DEFAULT) -> dict:
    """Return rows: no loss at 1 and 2 kHz; at 5 kHz and in overload, losses reported correctly."""
    rows = [measure(rate, observer=observer) for rate in (1000.0, 2000.0, 5000.0)]
    rows.append(measure(5000.0, joints=OVERLOAD, observer=observer))
    for row in rows[:2]:
        row['ok'] = row['ok'] and row['true_loss'] == 0
    return {'rows': rows, 'ok': all(row['ok'] for row in rows)}


if __name__ == '__main__':
    print(json.dumps(measure_all((sys.argv[1:] or [DEFAULT])[0]), indent=2))
