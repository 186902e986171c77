# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part second``: the error of `edge_adaptive` with a second sensor over that without it.

Simulated gyros and motor encoders against the truth, and recordings of github.com/ssong47/
compute_relative_angle_between_two_IMUs (MIT; folder MatlabCode/Data, not shipped) against an
off-line smoother of encoder and gyro.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.driver.configuration import AS_ANGLE, Configuration, SourceSettings
from estimator_pkg.driver.fused import FusedJoint
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.doctor.second import candidates
from estimator_pkg.evaluation.text import markdown, number, table
from estimator_pkg.parameters import build
from sim_pkg.joints.encoder import SIMULATOR
from sim_pkg.simulate import write_bag

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

QUANTUM = 2.0 * math.pi / 4096
SKIPPED = 2.0  # ignored at the beginning [s]
GYRO = {'amplitude': 5.0 / (4.0 * math.pi), 'frequency': 2.0, 'gyro_rate': 1000.0}
MOTOR = {'amplitude': 0.5, 'frequency': 1.5 / math.pi, 'motor_ratio': 100.0}
AXES = {'yaw': 'z', 'roll': 'x', 'pitch': 'y'}
PART = 12_000  # samples of a recording: two minutes
JERKS = 10.0 ** np.arange(2.0, 7.0)  # of which the likeliest is the smoother's [rad/s^3/sqrt(Hz)]


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


def recorded(folder: Path) -> Iterator[Case]:
    """Yield the recordings below `folder`; raise UserError if there is none."""
    from scipy.io import loadmat

    paths = sorted(folder.rglob('raw_*_*.mat'))
    if not paths:
        raise UserError(f'{folder} has no raw_*_*.mat: give the folder MatlabCode/Data')
    for path in paths:
        data = {name: np.ravel(values)[:PART] for name, values in loadmat(path).items()}
        axis = AXES[path.stem.split('_')[1]]
        time, angle = data['all_time'], np.radians(data['all_encoder'])
        kept = np.diff(time, prepend=-np.inf) > 0.0
        time, angle = time[kept], angle[kept]
        rate = np.radians(data[f'all_gyro_2_{axis}'])[kept]
        stamps = 10**18 + np.rint(time * 1e9).astype(np.int64)
        truth, ratio, delay = smoothed(time - time[0], angle, rate)
        source = SourceSettings(ratio=ratio, delay=delay)
        yield Case(path.stem[4:], stamps, angle, source, stamps, rate, truth)


def smoothed(time: Array, angle: Array, rate: Array) -> tuple[Array, float, float]:
    """Return the velocity [rad/s] by an off-line smoother, shape (n,), ratio and delay [s].

    Bias, ratio and delay of the rate are those with the least squares of the angle. The smoother is
    that of Rauch, Tung and Striebel, with a white jerk of the likeliest intensity.
    """
    turned = np.r_[0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))]
    columns = np.c_[np.ones_like(time), time, turned, rate]
    _, bias, ratio, shift = np.linalg.lstsq(columns, angle, rcond=None)[0]
    value = np.interp(time + shift / ratio, time, ratio * rate + bias)
    noise = np.array([QUANTUM**2 / 12.0, max(np.var(np.diff(rate, 2)) / 6.0, 1e-8)])
    runs = [_smoothed(time, np.c_[angle, value], noise, jerk) for jerk in JERKS]
    return max(runs, key=lambda run: run[0])[1], ratio, shift / ratio


def _smoothed(time: Array, seen: Array, noise: Array, jerk: float) -> tuple[float, Array]:
    """Return the log likelihood and the velocity."""
    x, p, likelihood, kept = np.array([*seen[0], 0.0]), np.diag([1e-6, 1.0, 1e3]), 0.0, []
    for dt, measured in zip(np.diff(time, prepend=time[0]).tolist(), seen):
        f = np.array([[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
        g = np.array([dt**3 / 6.0, dt * dt / 2.0, dt])
        before, p_before = f @ x, f @ p @ f.T + jerk * jerk * np.outer(g, g) / max(dt, 1e-9)
        x, p = before, p_before
        for k in range(2):  # angle, rate
            nu, s = measured[k] - x[k], p[k, k] + noise[k]
            likelihood -= 0.5 * (math.log(s) + nu * nu / s)
            x, p = x + p[:, k] * (nu / s), p - np.outer(p[:, k], p[:, k]) / s
        kept.append((f, before, p_before, x, p))
    velocity = np.empty(len(time))
    for k in range(len(kept) - 1, -1, -1):
        velocity[k] = x[1]
        if k:
            f, before, p_before, *_ = kept[k]
            _, _, _, filtered, p = kept[k - 1]
            x = filtered + p @ f.T @ np.linalg.solve(p_before, x - before)
    return likelihood, velocity


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


def describe(rows: list[dict[str, Any]], as_markdown: bool) -> str:
    """Return the rows as a table."""
    columns = ['case', 'alone', 'better single', 'informed', 'ratio']
    cells = [[row['case'], *(number(row[name], 3) for name in columns[1:])] for row in rows]
    return (markdown if as_markdown else table)(columns, cells)
