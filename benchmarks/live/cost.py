# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""CPU per message of the live node, compared with a node that only receives and republishes.

Both run at the same time, as processes of their own, on the same stream and the same executor.

    python -m benchmarks.live.cost
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack

import psutil

from benchmarks.live.processes import JOINTS, NODES, cpu, observer, process, result
from estimator_pkg.ros.domain import free_domain

ALLOWED = 1.5  # largest ratio to the null node


def measure(name: str = 'joint_observer', rate: float = 1000.0, seconds: float = 10.0) -> dict:
    """Return CPU per message [us] of both nodes, their ratio, and the number of answers of each.

    Without the costs, but with `why`, if a listener received none of the answers.

    Parameters
    ----------
    name : one of `NODES`.
    rate : messages per second.
    seconds : length of the measured window, which excludes the first second of the stream.
    """
    domain = free_domain()
    with ExitStack() as stack:

        def start(*words: str):
            return stack.enter_context(process(*words, domain=domain))

        nodes = {'node': stack.enter_context(observer(name, domain)), 'null': start('null')}
        listeners = {
            'node': start('time_answers', f'/{name}/estimate'),
            'null': start('time_answers', '/null_node/estimate'),
        }
        for listener in listeners.values():
            listener.stdout.readline()  # it listens
        time.sleep(2.0)
        publisher = start('publish', str(rate), str(seconds + 2.0), str(JOINTS), '2')
        publisher.stdout.readline()
        time.sleep(1.0)
        meters = {which: psutil.Process(child.pid) for which, child in nodes.items()}
        before = {which: cpu(meter) for which, meter in meters.items()}
        begun = time.perf_counter()
        time.sleep(seconds)
        messages = rate * (time.perf_counter() - begun)
        used = {which: cpu(meter) - before[which] for which, meter in meters.items()}
        published = result(publisher)['published']
        answered = {}
        for which, listener in listeners.items():
            listener.send_signal(2)
            answered[which] = result(listener)['answered']
    found = {
        'rate_hz': rate,
        'joints': JOINTS,
        'node': name,
        'published': published,
        'answered': answered['node'],
        'null_answered': answered['null'],
        'allowed': ALLOWED,
    }
    if not all(answered.values()):
        deaf = name if not answered['node'] else 'the null node'
        return {**found, 'ok': False, 'why': f'the listener received no answer of {deaf}'}
    cost = {which: 1e6 * used[which] / (messages * answered[which] / published) for which in nodes}
    ratio = cost['node'] / cost['null']
    return {
        **found,
        'node_us_per_message': cost['node'],
        'null_us_per_message': cost['null'],
        'ratio': ratio,
        'ok': ratio <= ALLOWED,
    }


if __name__ == '__main__':
    rows = [measure(name) for name in sys.argv[1:] or NODES]
    print(json.dumps({'rows': rows, 'ok': all(row['ok'] for row in rows)}, indent=2))
