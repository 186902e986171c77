# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part live``: the nodes over real DDS, next to a node that only republishes.

The measured nodes are processes of their own. The programs here need ROS and psutil.
"""

from __future__ import annotations

import importlib.util
from typing import Any

from benchmarks.timing import not_run, row
from estimator_pkg.errors import UserError

REQUIRED = 'joint_observer'  # node with a required cost
LOSSLESS = 2000.0  # [Hz] up to which nothing may be lost
Rows = list[dict[str, Any]]


def live(quick: bool = False) -> Rows:
    """Return rows: CPU per message, losses, starts, latencies, and the drive; raise UserError."""
    for needed in ('rclpy', 'psutil'):
        if importlib.util.find_spec(needed) is None:
            raise UserError(f'{needed} is not installed')
    from benchmarks.live import cost, drive, loss, timing

    found = [made for name in cost.NODES for made in costs(cost.measure(name))]
    found += [made for rate, joints in loss.CASES for made in losses(loss.measure(rate, joints))]
    found += timing.rows(timing.start, timing.START, 1 if quick else 5)
    found += timing.rows(timing.latency, timing.LATENCY, 1 if quick else 3)
    batches = drive.measure(drive.BATCHES, drive.RATE)
    at = f'pmsm_observer at {drive.RATE:g} Hz in batches'
    found.append(row(f'{at}: load of a core', batches['load'], '', limit=drive.LOAD))
    unused = batches['samples'] - batches['used']
    found.append(row(f'{at}: samples not used', unused, '', limit=0))
    late = batches.get('round_trip_ms')
    found.append(
        not_run(f'{at}: sent to estimate received', 'no batch was answered')
        if late is None
        else row(f'{at}: sent to estimate received, median', late, 'ms', limit=drive.LATENCY)
    )
    for rate in drive.RATES:
        topics = drive.measure(drive.TOPICS, rate)
        at = f'pmsm_observer at {rate:g} Hz on two topics'
        found.append(row(f'{at}: load of a core', topics['load'], ''))
        found.append(row(f'{at}: samples not used', topics['samples'] - topics['used'], ''))
    return found


def costs(item: dict[str, Any]) -> Rows:
    """Return the rows of one result of `cost.measure`."""
    name = f'{item["node"]}, CPU per message, {item["rate_hz"]:g} Hz, {item["joints"]} joints'
    if 'why' in item:
        return [not_run(name, item['why'])]
    return [
        row(name, item['node_us_per_message'], 'us'),
        row(f'{item["node"]}: null node at the same time', item['null_us_per_message'], 'us'),
        row(
            f'{item["node"]} / null node',
            item['ratio'],
            'times',
            limit=item['allowed'] if item['node'] == REQUIRED else None,
            published=item['published'],
            answered=item['answered'],
        ),
    ]


def losses(item: dict[str, Any]) -> Rows:
    """Return the rows of one result of `loss.measure`."""
    name = f'lost at {item["rate_hz"]:g} Hz, {item["joints"]} joints'
    if 'why' in item:
        return [not_run(name, item['why'])]
    lost, reported = item['true_loss'], item['reported']
    counts = {'published': item['published'], 'reported': reported}
    if item['rate_hz'] <= LOSSLESS:
        return [row(name, lost, 'messages', limit=0, **counts)]
    unreported = row(f'{name}, not reported', abs(lost - reported), 'messages', limit=0)
    return [row(name, lost, 'messages', **counts), unreported]
