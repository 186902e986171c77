# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of the live programs in this folder, as rows of ``bench speed``.

The programs need ROS and psutil, and run in their own processes.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from typing import Any

from estimator_pkg.evaluation.compare.timing import not_run, row

COST, LOSS, START, LATENCY = (
    f'benchmarks.live.{program}' for program in ('cost', 'loss', 'start', 'latency')
)
LONGEST = 600.0  # [s]
NULL, REQUIRED = 'null_node', 'joint_observer'
Reader = Callable[[dict[str, Any]], list[dict[str, Any]]]


def live() -> list[dict[str, Any]]:
    """Return rows: CPU per message compared with the null node, losses and reported losses."""
    return _rows(COST, _cost) + _rows(LOSS, _loss)


def starts(rounds: int) -> list[dict[str, Any]]:
    """Return rows: time from process start to first estimate, compared with the null node."""
    return _rows(START, _start, str(rounds))


def latencies(rounds: int) -> list[dict[str, Any]]:
    """Return rows: time from a stamp to the receipt of its estimate, and of the null node."""
    return _rows(LATENCY, _latency, str(rounds))


def _rows(program: str, reader: Reader, *words: str) -> list[dict[str, Any]]:
    name = f'live nodes, {program.rpartition(".")[2]}'
    for needed in ('rclpy', 'psutil'):
        if importlib.util.find_spec(needed) is None:
            return [not_run(name, f'{needed} is not installed')]
    found, why = _run(program, *words)
    return reader(found) if found is not None else [not_run(name, why)]


def _run(program: str, *words: str) -> tuple[dict[str, Any] | None, str]:
    """Return (result of the program or None, why there is none)."""
    try:
        done = subprocess.run(
            [sys.executable, '-m', program, *words], capture_output=True, text=True, timeout=LONGEST
        )
        return json.loads(done.stdout), ''
    except subprocess.TimeoutExpired:
        return None, f'it took longer than {LONGEST:g} s'
    except json.JSONDecodeError:
        lines = done.stderr.strip().splitlines()
        return None, lines[-1] if lines else 'it printed nothing'


def _start(found: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for item in found['rows']:
        for what in ('message', 'cpu', 'estimate'):
            name = f'{item["node"]}: process start to first {what}'
            if what == 'cpu':
                name = f'{item["node"]}: CPU time to first message'
            if f'{what}_s' not in item:
                rows.append(
                    not_run(
                        name,
                        'none within 8 s: it learns longer' if what == 'estimate' else 'no message',
                    )
                )
                continue
            rows.append(row(name, item[f'{what}_s'], 's'))
            if item['node'] != NULL:
                rows.append(row(f'{name} / null node', item[f'{what}_ratio'], 'times'))
    return rows


def _latency(found: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for item in found['rows']:
        for key, title in (('median_ms', 'median'), ('late_ms', '99 %')):
            name = f'{item["node"]}: stamp to receipt, {title}'
            if key not in item:
                rows.append(not_run(name, 'no answer'))
                continue
            rows.append(row(name, item[key], 'ms'))
            if item['node'] != NULL:
                rows.append(row(f'{name}, minus the null node', item[f'{key}_more'], 'ms'))
                rows.append(row(f'{name} / null node', item[f'{key}_ratio'], 'times'))
    return rows


def _cost(found: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for item in found['rows']:
        at = f'{item["rate_hz"]:g} Hz, {item["joints"]} joints'
        rows += [
            row(f'{item["node"]}, CPU per message, {at}', item['node_us_per_message'], 'us'),
            row('null node at the same time', item['null_us_per_message'], 'us'),
            row(
                f'{item["node"]} / null node',
                item['ratio'],
                'times',
                limit=item['allowed'] if item['node'] == REQUIRED else None,
                published=item['published'],
                answered=item['answered'],
            ),
        ]
    return rows


def _loss(found: dict[str, Any]) -> list[dict[str, Any]]:
    rows = []
    for item in found['rows']:
        at = f'{item["rate_hz"]:g} Hz, {item["joints"]} joints'
        counts = {'published': item['published'], 'reported': item['reported']}
        if item['rate_hz'] <= 2000.0:
            rows.append(row(f'lost at {at}', item['true_loss'], 'messages', limit=0, **counts))
        else:
            rows.append(row(f'lost at {at}', item['true_loss'], 'messages', **counts))
            rows.append(
                row(
                    f'lost but not reported at {at}',
                    abs(item['true_loss'] - item['reported']),
                    'messages',
                    limit=0,
                )
            )
    return rows
