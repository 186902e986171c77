# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The recorded bags as columns.

The truth of a recording is a sensor too: its fitted lag and bias are removed. For a bag without
one the reference is the off-line smoother.
"""

from __future__ import annotations

import math
from pathlib import Path

from benchmarks.columns import Column, referenced
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.recording import measured
from estimator_pkg.bags.series import joint_series
from estimator_pkg.bags.wiring import wired
from estimator_pkg.destination import METADATA
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.truth import truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import MEASUREMENT, TRUTH, Options
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from estimator_pkg.progress import progress
from estimator_pkg.streams.angle import AngleStream
from estimator_pkg.streams.contract import Request

SECOND = ('base_with_slip', 'gyro', 'motor_encoder')  # with a second sensor: `benchmarks.second`
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
    """Return the columns of `with_truth`, and motion capture judged by the off-line smoother."""
    captured = folder / CAPTURED
    return with_truth(folder) + ([_captured(captured)] if captured.is_dir() else [])


def with_truth(folder: Path) -> list[Column]:
    """Return a column per joint of each bag below `folder`; raise UserError if there is none."""
    bags = recordings(folder)
    found = []
    with progress('reading the recordings', len(bags)) as advance:
        for path in bags:
            found += of_bag(path)
            advance(1)
    return found


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
