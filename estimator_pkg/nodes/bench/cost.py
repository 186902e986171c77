"""CPU per message of the live node beside that of a node that only receives and republishes.

Both run at the same time, as processes of their own, on the same stream and the same executor.

    python -m estimator_pkg.nodes.bench.cost
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack

import psutil

from estimator_pkg.nodes.bench.processes import own_domain, process, result

ALLOWED = 1.5  # times the null node


def measure(rate: float = 1000.0, joints: int = 7, seconds: float = 10.0,
            observer: str = 'hybrid_angle') -> dict:
    """CPU per message [us] of both nodes, their ratio, and how many messages each answered.

    Parameters
    ----------
    rate : messages per second.
    seconds : length of the measured window; the first second of the stream is not in it.
    """
    domain = own_domain()
    chosen = ('--ros-args', '-p', f'observer:={observer}')
    with ExitStack() as stack:
        def start(*words: str, extra: tuple[str, ...] = ()):
            return stack.enter_context(process(*words, domain=domain, extra=extra))

        nodes = {'node': start('node', extra=chosen), 'null': start('null')}
        listeners = {'node': start('listen', '/joint_observer/estimate'),
                     'null': start('listen', '/null_node/estimate')}
        time.sleep(2.0)
        publisher = start('publish', str(rate), str(seconds + 2.0), str(joints), '2')
        publisher.stdout.readline()
        time.sleep(1.0)
        meters = {name: psutil.Process(child.pid) for name, child in nodes.items()}
        before = {name: _cpu(meter) for name, meter in meters.items()}
        begun = time.perf_counter()
        time.sleep(seconds)
        messages = rate * (time.perf_counter() - begun)
        used = {name: _cpu(meter) - before[name] for name, meter in meters.items()}
        published = result(publisher)['published']
        answered = {}
        for name, listener in listeners.items():
            listener.send_signal(2)
            answered[name] = result(listener)['received']
    cost = {name: 1e6 * used[name] / (messages * answered[name] / published) for name in nodes}
    ratio = cost['node'] / cost['null']
    return {'rate_hz': rate, 'joints': joints, 'observer': observer, 'published': published,
            'answered': answered['node'], 'null_answered': answered['null'],
            'node_us_per_message': cost['node'], 'null_us_per_message': cost['null'],
            'ratio': ratio, 'allowed': ALLOWED, 'ok': ratio <= ALLOWED}


def _cpu(meter: psutil.Process) -> float:
    times = meter.cpu_times()
    return times.user + times.system


if __name__ == '__main__':
    print(json.dumps(measure(observer=(sys.argv[1:] or ['hybrid_angle'])[0]), indent=2))
