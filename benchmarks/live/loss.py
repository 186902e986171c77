# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Losses of the live node on a fast stream, and whether it reports them."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import Any

from benchmarks.live.processes import process, result
from benchmarks.timing import not_run, row
from estimator_pkg.ros.domain import free_domain

# rates [Hz] and joints; no Python node keeps up with the last
CASES = ((1000.0, 7), (2000.0, 7), (5000.0, 7), (5000.0, 150))


LOSSLESS = 2000.0  # [Hz] up to which nothing may be lost
SECONDS = 5.0


def rows(rate: float, joints: int) -> list[dict[str, Any]]:
    """Return the messages lost at `rate`, with the default QoS, and those not reported as lost.

    Lost are published messages that never reached the node's callback; reported is the number in
    the node's diagnostics.
    """
    domain = free_domain()
    with ExitStack() as stack:

        def start(*words: str):
            return stack.enter_context(process(*words, domain=domain))

        start('node')
        watcher = start('diagnose')
        time.sleep(2.0)
        sent = result(start('publish', str(rate), str(SECONDS), str(joints)))
        time.sleep(2.5)  # the diagnostics that count the last message come every second
        watcher.send_signal(2)
        counters = result(watcher)
    name = f'lost at {rate:g} Hz, {joints} joints'
    if 'messages_received' not in counters:
        return [not_run(name, 'no diagnostics of the node were received')]
    lost = sent['published'] - int(counters['messages_received'])
    counts = {'published': sent['published'], 'reported': int(counters['lost_by_dds'])}
    if rate <= LOSSLESS:
        return [row(name, lost, 'messages', limit=0, **counts)]
    unreported = abs(lost - counts['reported'])
    return [
        row(name, lost, 'messages', **counts),
        row(f'{name}, not reported', unreported, 'messages', limit=0),
    ]
