# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""CPU per message of the live node, compared with a node that only receives and republishes.

Both run at the same time, as processes of their own, on the same stream and the same executor.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import Any

import psutil

from benchmarks.live.processes import JOINTS, NULL, cpu, observer, process, result
from benchmarks.timing import not_run, row
from estimator_pkg.ros.domain import free_domain

REQUIRED, ALLOWED = 'joint_observer', 1.5  # node with a largest ratio to the null node
RATE, SECONDS = 1000.0, 10.0  # [Hz]; measured [s], without the first second of the stream


def rows(name: str) -> list[dict[str, Any]]:
    """Return CPU per message [us] of one of `NODES` and of the null node, and their ratio."""
    domain = free_domain()
    with ExitStack() as stack:

        def start(*words: str):
            return stack.enter_context(process(*words, domain=domain))

        nodes = {'node': stack.enter_context(observer(name, domain)), 'null': start(NULL)}
        listeners = {
            'node': start('time_answers', f'/{name}/estimate'),
            'null': start('time_answers', f'/{NULL}/estimate'),
        }
        for listener in listeners.values():
            listener.stdout.readline()  # it listens
        time.sleep(2.0)
        publisher = start('publish', str(RATE), str(SECONDS + 2.0), str(JOINTS), '2')
        publisher.stdout.readline()
        time.sleep(1.0)
        meters = {which: psutil.Process(child.pid) for which, child in nodes.items()}
        before = {which: cpu(meter) for which, meter in meters.items()}
        begun = time.perf_counter()
        time.sleep(SECONDS)
        messages = RATE * (time.perf_counter() - begun)
        used = {which: cpu(meter) - before[which] for which, meter in meters.items()}
        published = result(publisher)['published']
        answered = {}
        for which, listener in listeners.items():
            listener.send_signal(2)
            answered[which] = result(listener)['answered']
    title = f'{name}, CPU per message, {RATE:g} Hz, {JOINTS} joints'
    for which, count in answered.items():
        if not count:
            deaf = name if which == 'node' else 'the null node'
            return [not_run(title, f'the listener received no answer of {deaf}')]
    cost = {which: 1e6 * used[which] / (messages * answered[which] / published) for which in nodes}
    limit = ALLOWED if name == REQUIRED else None
    counts = {'published': published, 'answered': answered['node']}
    return [
        row(title, cost['node'], 'us'),
        row(f'{name}: null node at the same time', cost['null'], 'us'),
        row(f'{name} / null node', cost['node'] / cost['null'], 'times', limit=limit, **counts),
    ]
