"""``bench speed``, part 4: the live node, over real DDS, by `estimator_pkg.nodes.bench`.

Its programs need ROS and psutil, and run as processes of their own.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from typing import Any

from estimator_pkg.evaluation.timing import not_run, row

COST, LOSS = 'estimator_pkg.nodes.bench.cost', 'estimator_pkg.nodes.bench.loss'
LONGEST = 300.0  # [s]


def live() -> list[dict[str, Any]]:
    """CPU per message beside a node that only republishes, and losses beside those reported."""
    rows: list[dict[str, Any]] = []
    for program, reader in ((COST, _cost), (LOSS, _loss)):
        name = f'live node, {program.rpartition(".")[2]}'
        if importlib.util.find_spec('rclpy') is None:
            rows.append(not_run(name, 'rclpy is not installed'))
        elif importlib.util.find_spec('psutil') is None:
            rows.append(not_run(name, 'psutil is not installed'))
        else:
            found, why = _run(program)
            rows += reader(found) if found is not None else [not_run(name, why)]
    return rows


def _run(program: str) -> tuple[dict[str, Any] | None, str]:
    """(what the program found, why it did not)."""
    try:
        done = subprocess.run([sys.executable, '-m', program], capture_output=True, text=True,
                              timeout=LONGEST)
        return json.loads(done.stdout), ''
    except subprocess.TimeoutExpired:
        return None, f'it took longer than {LONGEST:g} s'
    except json.JSONDecodeError:
        lines = done.stderr.strip().splitlines()
        return None, lines[-1] if lines else 'it said nothing'


def _cost(found: dict[str, Any]) -> list[dict[str, Any]]:
    at = f'{found["rate_hz"]:g} Hz, {found["joints"]} joints'
    return [row(f'live node, CPU per message, {at}', found['node_us_per_message'], 'us'),
            row(f'null node, CPU per message, {at}', found['null_us_per_message'], 'us'),
            row('live node / null node', found['ratio'], 'times', limit=found['allowed'],
                published=found['published'], answered=found['answered'])]


def _loss(found: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for item in found['rows']:
        at = f'{item["rate_hz"]:g} Hz, {item["joints"]} joints'
        counts = {'published': item['published'], 'reported': item['reported']}
        if item['rate_hz'] <= 2000.0:
            rows.append(row(f'lost at {at}', item['true_loss'], 'messages', limit=0, **counts))
        else:
            rows.append(row(f'lost at {at}', item['true_loss'], 'messages', **counts))
            rows.append(row(f'lost but not reported at {at}',
                            abs(item['true_loss'] - item['reported']), 'messages', limit=0))
    return rows
