# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Losses of the live node on a fast stream, and whether it reports them."""

from __future__ import annotations

import time
from contextlib import ExitStack

from benchmarks.live.processes import process, result
from estimator_pkg.ros.domain import free_domain

# rates [Hz] and joints; no Python node keeps up with the last
CASES = ((1000.0, 7), (2000.0, 7), (5000.0, 7), (5000.0, 150))


def measure(rate: float, joints: int = 7, seconds: float = 5.0) -> dict:
    """Return the messages published, received and reported lost at `rate`, with the default QoS.

    ``true_loss`` counts published messages that never reached the node's callback; ``reported`` is
    the number in the node's diagnostics.
    """
    domain = free_domain()
    with ExitStack() as stack:

        def start(*words: str):
            return stack.enter_context(process(*words, domain=domain))

        start('node')
        watcher = start('diagnose')
        time.sleep(2.0)
        sent = result(start('publish', str(rate), str(seconds), str(joints)))
        time.sleep(2.5)  # the diagnostics that count the last message come every second
        watcher.send_signal(2)
        counters = result(watcher)
    found = {'rate_hz': rate, 'joints': joints, **sent}
    if 'messages_received' not in counters:
        return {**found, 'why': 'no diagnostics of the node were received'}
    received, reported = int(counters['messages_received']), int(counters['lost_by_dds'])
    return {**found, 'true_loss': sent['published'] - received, 'reported': reported}
