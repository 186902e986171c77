# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Hall captures of a motor controller, judged by that controller's own metric and thresholds.

    python -m benchmarks accuracy --part moteus

moteus (Apache-2.0, github.com/mjbots/moteus, commit db1a762, fw/test/data) tests its Hall velocity
estimator on these captures. The true velocity is constant between two neighbouring falling edges;
the thresholds are those of its test. bags/README.md has the format.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column
from benchmarks.signals import START_NS, Samples
from estimator_pkg import registry
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.text import fixed, markdown, number, table
from estimator_pkg.parameters import declared
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

PLAIN = Entry('edge_adaptive, sensor_map: none', 'edge_adaptive', (('sensor_map', 'none'),))
OF_EDGES = 'edge_adaptive, times that of the edges'  # row
FOLDER = 'moteus_hall'  # of the bags
RATE = 30_000  # [Hz]
COUNTS = 90  # a turn
QUANTUM = 2.0 * math.pi / COUNTS
MARK = 0x5A  # first byte of a record
RECORD = 3  # bytes
HEADERS = 5  # in a row, where a capture starts
SECTOR = np.array([0, 0, 2, 1, 4, 5, 3, 0])  # of the six codes of three Hall lines
BLOCK = 15_000  # samples for which what was learnt before is used
WINDOW = 3000  # samples in which the bias is taken
STEADY = 0.05  # relative change of the true speed in such a window, at most
SLOW = 50.0  # [counts/s] the bias is not taken below
REQUIRED, BIASED = 0.7, 0.01  # of the threshold and of the speed, at most
# mean square error [(counts/s)^2] that moteus allows itself
THRESHOLDS = {
    '20250616-speed-cycle': 421.0,
    '20250616-back-and-forth': 132.0,
    '20250616-hboard-cycle': 29.4,
    '20250615-new-slow': 320.0,
    '20260618-spindle-sweep': 117.0,
}


class Capture(NamedTuple):
    """A capture; arrays of shape (n,).

    stamps [ns], counts, true velocity [counts/s], True where a line fell.
    """

    name: str
    stamps: NDArray[np.int64]
    counts: NDArray[np.int64]
    velocity: Array
    fell: NDArray[np.bool_]


def codes(data: bytes) -> NDArray[np.int64]:
    """Return the Hall lines of each record, three bits each; broken records are left out."""
    raw = np.frombuffer(data, np.uint8)
    marked = np.append(raw == MARK, np.zeros(HEADERS * RECORD, bool))
    starts = np.all([marked[RECORD * k : RECORD * k + len(raw)] for k in range(HEADERS)], axis=0)
    found, at = [], 0
    while True:
        rest = np.flatnonzero(starts[at:])
        if not len(rest):
            break
        at += int(rest[0])
        chain = marked[at : len(raw) : RECORD]
        length = len(chain) if chain.all() else int(np.argmin(chain))
        rows = at + RECORD * np.arange(length)
        rows = rows[rows + RECORD <= len(raw)]
        found.append(raw[rows + 1] & 7)
        at += RECORD * length
    return np.concatenate(found).astype(np.int64) if found else np.zeros(0, np.int64)


def capture(name: str, lines: NDArray[np.int64]) -> Capture:
    """Return a capture with the velocity between neighbouring falling edges."""
    steps = (np.diff(SECTOR[lines], prepend=0) + 3) % 6 - 3
    count = np.cumsum(steps)
    fell, changed = lines[:-1] & ~lines[1:], lines[:-1] ^ lines[1:]
    falling = 1 + np.flatnonzero((fell == changed) & np.isin(changed, (1, 2, 4)))
    speeds = np.diff(count[falling]) * RATE / np.diff(falling)
    velocity = np.zeros(len(lines))
    if len(falling):
        velocity[falling[0] : falling[-1]] = np.repeat(speeds, np.diff(falling))
    stamps = START_NS + np.rint(np.arange(len(lines)) * (1e9 / RATE)).astype(np.int64)
    fallen = np.zeros(len(lines), bool)
    fallen[falling] = True
    return Capture(name, stamps, count, velocity, fallen)


def captures(folder: Path) -> list[Capture]:
    """Return the captures of a folder.

    Raises
    ------
    UserError : there is none.
    """
    paths = [folder / f'{name}.dat.gz' for name in THRESHOLDS]
    found = [
        capture(path.name.removesuffix('.dat.gz'), codes(gzip.decompress(path.read_bytes())))
        for path in paths
        if path.exists()
    ]
    if not found:
        raise UserError(
            f'{folder} has no capture such as {paths[0].name}: '
            'give the folder of the bags with --bags'
        )
    return found


def columns(folder: Path) -> list[Column]:
    """Return the captures as columns of the field, in radians; raises as `captures`."""
    return [
        Column(
            each.name,
            'a motor with Hall sensors, 90 counts a turn, 30 kHz',
            Samples(each.stamps, each.counts.astype(np.float64) * QUANTUM, each.velocity * QUANTUM),
            QUANTUM,
            skip=0.0,
        )
        for each in captures(folder)
    ]


def judge(found: Capture, velocity: Array) -> dict[str, float]:
    """Return the metric of moteus for an estimate [counts/s], shape (n,).

    Returns
    -------
    square : mean square error over its threshold. largest : error [counts/s]. bias : of the worst
    steady window, over its speed.
    """
    estimate = np.nan_to_num(velocity)
    error = found.velocity - estimate
    worst = 0.0
    for at in range(0, len(error) - WINDOW + 1, WINDOW):
        true = found.velocity[at : at + WINDOW]
        mean = float(np.mean(true))
        if np.min(np.abs(true)) >= SLOW and np.ptp(true) <= STEADY * abs(mean):
            worst = max(worst, abs(float(np.mean(estimate[at : at + WINDOW])) - mean) / abs(mean))
    return {
        'square': float(np.mean(error * error)) / THRESHOLDS[found.name],
        'largest': float(np.max(np.abs(error))),
        'bias': worst,
    }


def of_edges(found: Capture, *, fast: bool | None = None) -> Array:
    """Return the velocity [counts/s] of the edges, from that of the shaft and what is learnt.

    Notes
    -----
    The metric takes each falling edge to be where it should be, so its true velocity repeats the
    errors of the edges. From one falling edge to the next the shaft turns by two counts and by how
    much the errors e of the two edges differ, and the metric's velocity is that of the shaft times
    2 / (2 + e' - e). The errors are those learnt before the block of samples: the estimate is
    causal.
    """
    joint = Entry('', 'edge_adaptive').joint(quantum=QUANTUM)
    rows = np.arange(len(found.counts))
    last = np.maximum.accumulate(np.where(found.fell, rows, 0))
    heading = np.diff(found.counts, prepend=found.counts[0])[last]
    edge = (found.counts[last] - 0.5 * heading) * QUANTUM
    edges = np.zeros(len(rows))
    for at in range(0, len(rows), BLOCK):
        block = slice(at, at + BLOCK)
        before = [(way, joint.sensor_errors(way)) for way in (1, -1)]
        out = joint.run(
            found.stamps[block], found.counts[block].astype(np.float64) * QUANTUM, fast=fast
        )
        velocity = np.nan_to_num(out.velocity)
        ratio = np.ones(len(velocity))
        for way, errors in before:
            there = heading[block] == way
            start, speeds = edge[block][there], velocity[there]
            step = 2.0 * way * QUANTUM
            further = errors(start + step, speeds) - errors(start, speeds)
            ratio[there] = step / (step + further)
        edges[block] = velocity / QUANTUM * ratio
    return edges


def run(
    folder: Path, entries: Iterable[Entry] | None = None, *, fast: bool | None = None
) -> list[dict[str, Any]]:
    """Return one row per capture and observer; each knows the quantum alone."""
    chosen = [*at_defaults(), PLAIN] if entries is None else list(entries)
    rows = []
    found = captures(folder)
    with progress('captures', len(found) * (len(chosen) + (entries is None))) as advance:
        for each in found:
            for entry in chosen:
                joint = entry.joint(**_known(entry))
                out = joint.run(each.stamps, each.counts.astype(np.float64) * QUANTUM, fast=fast)
                rows.append(
                    {
                        'capture': each.name,
                        'observer': entry.label,
                        **judge(each, out.velocity / QUANTUM),
                    }
                )
                advance(1)
            if entries is None:
                edges = judge(each, of_edges(each, fast=fast))
                rows.append({'capture': each.name, 'observer': OF_EDGES, **edges})
                advance(1)
    return rows


def _known(entry: Entry) -> dict[str, float]:
    observer = registry.find(registry.OBSERVERS, entry.observer)
    return {'quantum': QUANTUM} if 'quantum' in declared(observer.gains) else {}


def describe(rows: list[dict[str, Any]], as_markdown: bool = False) -> str:
    """Return the table: mean square error over its threshold, and bias, per capture."""
    observers = list(dict.fromkeys(row['observer'] for row in rows))
    cells = {(row['capture'], row['observer']): row for row in rows}
    lines = [
        (
            name,
            number(THRESHOLDS[name], 3),
            *(
                f'{fixed(cells[name, each]["square"], 2)}, '
                f'{fixed(100.0 * cells[name, each]["bias"], 2)} %'
                for each in observers
            ),
        )
        for name in dict.fromkeys(row['capture'] for row in rows)
    ]
    return (
        'mean square error over the threshold of moteus (1 is its own limit), and bias of the '
        'worst steady\nwindow. Each observer has the quantum and its defaults\n\n'
        + (markdown if as_markdown else table)(
            ('capture', 'threshold [(counts/s)^2]', *observers), lines
        )
    )
