# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The recorded bags: as columns, and all observers at their defaults on them.

    python -m benchmarks.recorded bags > test/recordings_bounds.yaml

prints fresh bounds. Bounds guard against change: a case fails if it is worse than its bound or
better than half of it.

The truth of a recording is a sensor too: its fitted lag and bias are removed. For a bag without
one the reference is the off-line smoother.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmarks.columns import START, Column, referenced
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.recording import measured
from estimator_pkg.bags.series import joint_series
from estimator_pkg.bags.wiring import wired
from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.comparison import compare
from estimator_pkg.evaluation.compare.truth import truth
from estimator_pkg.evaluation.entries import Entry, at_defaults
from estimator_pkg.evaluation.options import MEASUREMENT, TRUTH, Options
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from estimator_pkg.printable import show
from estimator_pkg.progress import progress
from estimator_pkg.streams.angle import AngleStream
from estimator_pkg.streams.contract import Request

SECOND = ('base_with_slip', 'gyro', 'motor_encoder')  # with a second sensor: `benchmarks.second`
MARGIN = 1.15  # a new bound over the measured value
RAW = Entry('finite_difference, raw', 'finite_difference', (('bandwidth_hz', 1e6),))
TURN = 2.0 * math.pi
# motion capture: bag, topic, field of its messages. Two more have no reference fine enough.
CAPTURED = 'vicon/yx2bag'
POSE, YAW = '/vicon/Group466CF/Group466CF/pose', 'pose.orientation.yaw'


def recordings(folder: Path) -> list[Path]:
    """Return the bags below `folder` that contain a measurement, a truth and no second sensor.

    Raises
    ------
    UserError : there is no such bag.
    """
    found = []
    for metadata in sorted(folder.rglob(METADATA)):
        if metadata.parent.name in SECOND:
            continue
        with open_bag(metadata.parent) as bag:
            if MEASUREMENT in bag.topics and TRUTH in bag.topics:
                found.append(metadata.parent)
    if not found:
        raise UserError(
            f'{folder} contains no bag with {MEASUREMENT} and {TRUTH}: give another folder'
        )
    return found


def columns(folder: Path) -> list[Column]:
    """Return a column per joint of each bag below `folder`; raise UserError if there is none."""
    bags = recordings(folder)
    found = []
    with progress('reading the recordings', len(bags)) as advance:
        for path in bags:
            found += of_bag(path)
            advance(1)
    captured = folder / CAPTURED
    return [*found, _captured(captured)] if captured.is_dir() else found


def of_bag(path: Path) -> list[Column]:
    """Return a column per joint that has a truth."""
    found = []
    with open_bag(path) as bag:
        series = joint_series(bag, MEASUREMENT)
        true = truth(bag, str(path), series, Options(correct_reference=True))
        for joint, one in series.items():
            if joint not in true.series:
                continue
            known, noise = true.series[joint], true.references[joint].noise
            readings = one.stamps_ns, one.position
            moved = known.stamps_ns, known.velocity, known.position
            found.append(referenced(f'{path.name}/{joint}', readings, moved, noise, true.name))
    return found


def _captured(path: Path) -> Column:
    """Return the yaw measured by motion capture."""
    with open_bag(path) as bag:
        setup = wired(AngleStream, bag, {}, Request(angle=f'{POSE}:{YAW}'))
        ((stamp, angle, *_),) = measured(bag, setup).values()
    known = smooth(stamp, angle, TURN)
    firm = known.firm
    moved = known.stamps[firm], known.velocity[firm], known.position[firm]
    name, origin = f'{path.name}/yaw', 'the off-line smoother'
    return referenced(name, (stamp, angle), moved, known.uncertainty, origin)


def rows(folder: Path, entries: Sequence[Entry] | None = None) -> list[dict[str, Any]]:
    """Return one dictionary per recording, joint and observer; raises as `recordings`."""
    chosen = tuple(entries if entries is not None else [*at_defaults(), RAW])
    options = Options(observers=chosen, begin=START, correct_reference=True)
    bags = recordings(folder)
    result = []
    with progress('recordings', len(bags)) as advance:
        for bag in bags:
            found = compare(str(bag), options)
            result += [
                {
                    'stream': f'{bag.name}/{row.joint}',
                    'observer': row.source,
                    **row.velocity,
                    'coverage': row.coverage,
                    'reference_noise': found.references[row.joint].noise,
                    'reference_cannot_tell': row.reference_cannot_tell,
                }
                for row in found.rows
            ]
            advance(1)
    return result


def bounds(measured: Sequence[dict[str, Any]]) -> dict[str, dict[str, list[float]]]:
    """Return new bounds: case -> observer -> [rms, largest error]."""
    fresh: dict[str, dict[str, list[float]]] = {}
    for row in measured:
        fresh.setdefault(row['stream'], {})[row['observer']] = [
            float(f'{MARGIN * row[name]:.3g}') for name in ('rms', 'max_abs')
        ]
    return fresh


def judge(value: float, bound: float) -> str:
    """Return '' if `value` is between half of `bound` and `bound`; else what is wrong."""
    if not value <= bound:
        return f'{value:.4g} is worse than its bound {bound:.4g}'
    if value < 0.5 * bound:
        return f'{value:.4g} is better than half of its bound {bound:.4g}: print new bounds'
    return ''


def main(arguments: Sequence[str] | None = None) -> int:
    """Print new bounds as YAML; return the exit code."""
    parser = argparse.ArgumentParser(description='new bounds of all observers on recorded bags')
    parser.add_argument('folder', type=Path, help='folder of the bags')
    folder = parser.parse_args(arguments).folder
    try:
        print(
            yaml.safe_dump(bounds(rows(folder)), sort_keys=False, default_flow_style=None), end=''
        )
    except UserError as error:
        show(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == '__main__':
    sys.exit(main())
