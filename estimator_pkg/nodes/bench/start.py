"""How long an observer node takes from its process's start to its first estimate.

Beside a node that only republishes; both find a stream that runs already, and both are seen by a
listener that runs already. They take turns.

    python -m estimator_pkg.nodes.bench.start [ROUNDS]
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

from estimator_pkg.nodes.bench.processes import NODES, NULL, observer, own_domain, process

RATE = 200.0        # [Hz] of the stream
LONGEST = 8.0       # [s] to wait for a first estimate
ROUNDS = 5


def once(name: str) -> dict[str, float]:
    """Seconds to the node's first message, and to the first with a joint in it (if it came)."""
    domain = own_domain()
    with ExitStack() as stack:
        stack.enter_context(process('feed', str(RATE), domain=domain))
        listener = stack.enter_context(process('time', f'/{name}/estimate', domain=domain))
        assert listener.stdout is not None
        listener.stdout.readline()
        time.sleep(1.0)  # the stream runs
        begun = time.time_ns()
        stack.enter_context(observer(name, domain))
        return {what: 1e-9 * (at - begun) for what, at in _said(listener).items()}


def _said(listener: subprocess.Popen) -> dict[str, int]:
    """When the first message and the first estimate came [ns]; waits for both, but not for ever."""
    found: dict[str, int] = {}
    both = threading.Event()

    def read() -> None:
        assert listener.stdout is not None
        for line in listener.stdout:
            found.update(json.loads(line))
            if 'estimate' in found:
                break
        both.set()

    threading.Thread(target=read, daemon=True).start()
    both.wait(LONGEST)
    return {what: at for what, at in found.items() if what in ('message', 'estimate')}


def measure(rounds: int = ROUNDS) -> dict:
    """Median seconds of each node, and their ratio to those of the null node round by round."""
    names = (NULL, *NODES)
    times: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    for _ in range(rounds):
        for name in names:
            times[name].append(once(name))
    null = [each.get('message') for each in times[NULL]]
    rows = []
    for name in names:
        row: dict = {'node': name, 'rounds': rounds}
        for what in ('message', 'estimate'):
            pairs = [(each[what], other) for each, other in zip(times[name], null)
                     if what in each and other is not None]
            if pairs:
                row[f'{what}_s'] = statistics.median(mine for mine, _ in pairs)
                row[f'{what}_ratio'] = statistics.median(mine / other for mine, other in pairs)
        rows.append(row)
    return {'rate_hz': RATE, 'rows': rows}


if __name__ == '__main__':
    print(json.dumps(measure(int(sys.argv[1]) if sys.argv[1:] else ROUNDS), indent=2))
