# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part second``: the error of `edge_adaptive` with a second sensor over that without it.

Simulated gyros and motor encoders against the truth.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.runner import Part, Table
from estimator_pkg import observers
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.driver.configuration import AS_ANGLE, Configuration, SourceSettings
from estimator_pkg.driver.fused import FusedJoint
from estimator_pkg.driver.joint import Joint
from estimator_pkg.evaluation.doctor.second import candidates
from estimator_pkg.evaluation.text import number
from estimator_pkg.parameters import build
from sim_pkg.joints.encoder import SIMULATOR
from sim_pkg.simulate import write_bag

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

QUANTUM = 2.0 * math.pi / 4096
SKIPPED = 2.0  # ignored at the beginning [s]
GYRO = {'amplitude': 5.0 / (4.0 * math.pi), 'frequency': 2.0, 'gyro_rate': 1000.0}
MOTOR = {'amplitude': 0.5, 'frequency': 1.5 / math.pi, 'motor_ratio': 100.0}


class Case(NamedTuple):
    """Readings of a joint, a second sensor, and the velocity; arrays in the order of arrival."""

    name: str
    stamps: Stamps
    angle: Array
    source: SourceSettings
    source_stamps: Stamps
    values: Array
    velocity: Array


def simulated() -> Iterator[Case]:
    """Yield the simulated cases."""
    for noise in (0.005, 0.02, 0.3):
        yield _simulated(f'gyro, noise {noise} rad/s', {**GYRO, 'gyro_noise': noise}, 0.0)
    for play in (0.1, 0.5, 2.0):
        settings = {**MOTOR, 'backlash': math.radians(play)}
        yield _simulated(f'motor encoder, backlash {play} deg', settings, 0.01)


def _simulated(name: str, settings: dict[str, Any], ratio: float) -> Case:
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder, 'bag'))
        write_bag(SIMULATOR, build(SIMULATOR.parameters, settings), 10.0, 1, path)
        with open_bag(path) as bag:
            angle = joint_series(bag, '/joint_states')['wheel']
            truth = joint_series(bag, '/ground_truth/joint_states')['wheel']
            wanted = '/motor/joint_states' if ratio else '/imu'
            *_, second = (each for each in candidates(bag) if each.topic == wanted)
    source = SourceSettings(kind=second.kind, ratio=ratio or 1.0)
    readings = angle.stamps_ns, angle.position
    return Case(name, *readings, source, second.stamps_ns, second.values, truth.velocity)


def judged(case: Case) -> dict[str, Any]:
    """Return the errors without, with and of the second sensor alone, and what was learnt."""
    observer = observers.find('edge_adaptive')
    gains = Configuration(observer, {'quantum': QUANTUM}).for_joint('')
    joint, at, found = FusedJoint(observer, *gains, [(0, 'second', case.source)]), 0, []
    values = list(zip(case.source_stamps.tolist(), case.values.tolist()))
    for stamp, angle in zip(case.stamps.tolist(), case.angle.tolist()):
        while at < len(values) and values[at][0] <= stamp:
            joint.receive(0, *values[at])
            at += 1
        joint.update(stamp, angle)
        found.append((joint.alone.estimate()[1], joint.estimate()[1]))
    rows = case.stamps > case.stamps[0] + round(SKIPPED * 1e9)
    error = np.array(found)[rows] - case.velocity[rows, None]
    alone, informed = np.sqrt(np.mean(error**2, axis=0)).tolist()
    own, single = joint.sources[0], alone
    if case.source.kind == AS_ANGLE:
        second = Joint(observer, *gains).run(case.source_stamps, case.values)
        of_second = case.source.ratio * second.velocity[rows] - case.velocity[rows]
        single = min(alone, math.sqrt(np.mean(of_second**2)))
    return {
        'case': case.name,
        'alone': alone,
        'better single': single,
        'informed': informed,
        'ratio': informed / single,
        'state': own.text(),
    }


def part() -> Part:
    """Return the figures of all cases, and their table."""
    rows = [judged(case) for case in simulated()]
    columns = 'case', 'alone', 'better single', 'informed', 'ratio'
    cells = [[row['case'], *(number(row[name], 3) for name in columns[1:])] for row in rows]
    return rows, [Table(columns, cells)]
