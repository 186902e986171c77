# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The recordings as columns of the field.

The reference is the truth in a bag, without its own fitted lag and bias; for a bag without one it
is the off-line smoother. The field marks errors below the reference's own error.

The pendulum's torque was recorded: its parameters are identified on one bag and used on the others.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.columns import Column
from benchmarks.recorded import SKIPPED, recordings
from benchmarks.signals import Samples
from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.recording import measured
from estimator_pkg.bags.series import Series, joint_series
from estimator_pkg.bags.wiring import wired
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare.matching import match
from estimator_pkg.evaluation.compare.truth import truth
from estimator_pkg.evaluation.identify.joint import identify
from estimator_pkg.evaluation.options import MEASUREMENT, Options
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from estimator_pkg.progress import progress
from estimator_pkg.streams.angle import AngleStream
from estimator_pkg.streams.contract import Request

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
PENDULUM = 'dfki_simple_pendulum'
IDENTIFIED_ON = 'system_identification_300hz'
FRICTION_WIDTH = 0.05  # width of the smoothed sign of the Coulomb friction [rad/s]
# motion capture: bags, topic, field of its messages
CAPTURED = ('vicon/flybag', 'vicon/yawbag', 'vicon/yx2bag')
POSE, YAW = '/vicon/Group466CF/Group466CF/pose', 'pose.orientation.yaw'
JUDGES = 0.2  # a smoother with a larger error, as a fraction of the motion, is no reference


def recorded(folder: Path) -> tuple[list[Column], dict[str, str]]:
    """Return a column per joint of each bag below `folder`, and why other bags have none.

    Raises
    ------
    UserError : there is no bag.
    """
    bags = recordings(folder)
    joint, delay = _pendulum(folder)
    found = []
    with progress('reading the recordings', len(bags)) as advance:
        for path in bags:
            with open_bag(path) as bag:
                found += _of_bag(path, bag, joint, delay)
            advance(1)
    refused = {}
    for captured in CAPTURED:
        if not (folder / captured).is_dir():
            continue
        column = _captured(folder / captured)
        speeds = np.abs(column.samples.velocity)
        motion = float(np.nanpercentile(speeds, 90.0))  # single large ones are its own errors
        if column.noise <= JUDGES * motion:
            found.append(column)
        else:
            refused[column.name] = (
                f"the smoother's own error is {column.noise:.2g} rad/s, too large for a motion of "
                f'which 90 % is below {motion:.2g} rad/s'
            )
    return found, refused


def _of_bag(path: Path, bag: Bag, joint: dict[str, float], delay: float) -> list[Column]:
    measured = joint_series(bag, MEASUREMENT)
    true = truth(bag, str(path), measured, Options(correct_reference=True))
    found = []
    for name, series in measured.items():
        if name not in true.series:
            continue
        known = true.series[name]
        at = match(series.stamps_ns, known.stamps_ns, known.velocity, known.position, TURN)
        velocity = np.full(len(series.stamps_ns), np.nan)
        velocity[at.rows] = at.velocity
        noise = true.references[name].noise
        use = path.parent.name == PENDULUM and path.name != IDENTIFIED_ON
        found.append(
            Column(
                f'{path.name}/{name}',
                f'{path.parent.name}, {len(velocity)} samples',
                Samples(series.stamps_ns, series.position, velocity),
                quantum(series.position),
                SKIPPED,
                float(noise) if np.isfinite(noise) else 0.0,
                _torque(series, delay) if use and joint else None,
                joint if use else {},
                reference=true.name,
            )
        )
    return found


def _pendulum(folder: Path) -> tuple[dict[str, float], float]:
    """Return (parameters of the recorded pendulum, delay of its torque [s]); empty if missing."""
    path = folder / PENDULUM / IDENTIFIED_ON
    if not path.is_dir():
        return {}, 0.0
    with open_bag(path) as bag:
        series = next(iter(joint_series(bag, MEASUREMENT).values()))
    time = (series.stamps_ns - series.stamps_ns[0]) * 1e-9
    try:
        values = dict(identify(time, series.position, series.effort, FRICTION_WIDTH).values)
    except UserError:
        return {}, 0.0
    return values, values.pop('input_delay')


def _torque(series: Series, delay: float) -> Array:
    """Return the torque that was reported `delay` [s] earlier, constant between samples."""
    late = np.searchsorted(series.stamps_ns, series.stamps_ns - round(delay * 1e9), 'right') - 1
    torque: Array = np.nan_to_num(series.effort[np.maximum(late, 0)])
    return torque


def _captured(path: Path) -> Column:
    """Return the yaw measured by motion capture."""
    with open_bag(path) as bag:
        setup = wired(AngleStream, bag, {}, Request(angle=f'{POSE}:{YAW}'))
        ((stamp, angle, *_),) = measured(bag, setup).values()
    smoothed = smooth(stamp, angle, TURN)
    firm = smoothed.firm
    at = match(stamp, smoothed.stamps[firm], smoothed.velocity[firm], smoothed.position[firm], TURN)
    velocity = np.full(len(stamp), np.nan)
    velocity[at.rows] = at.velocity
    return Column(
        f'{path.name}/yaw',
        f'motion capture, {len(stamp)} samples',
        Samples(stamp, angle, velocity),
        quantum(angle),
        SKIPPED,
        smoothed.uncertainty,
        reference='the off-line smoother',
    )
