# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The benefit of a reported torque: observers with and without it on recorded pendulums.

    python -m benchmarks.torque bags

A model is identified on one recording and used by the observer on another. The reference is the
drive's own velocity (its lag and bias removed, its noise in quadrature). Every observer has the
best setting of its grid in hindsight; observers with the torque only settings whose delay does not
exceed that of the best angle-only one. The same model with zero torque shows whether the torque is
the reason.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import joint_series
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.evaluation.compare.truth import truth
from estimator_pkg.evaluation.delay import delay
from estimator_pkg.evaluation.identify.command import first_guess
from estimator_pkg.evaluation.identify.data import recording
from estimator_pkg.evaluation.identify.fit import fit
from estimator_pkg.evaluation.identify.model import unknowns
from estimator_pkg.evaluation.identify.pieces import Recording, accumulated
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.options import MEASUREMENT, Options
from estimator_pkg.evaluation.text import table
from estimator_pkg.models.load import load
from estimator_pkg.parameters import build

Array = NDArray[np.float64]

SKIPPED = 2.0  # ignored at the start [s]
CLOSE = 1e-4  # accuracy of a delay [s]
TURN = 2.0 * math.pi
WIDTH = 'coulomb_speed=0.05'  # rad/s: the quantum of these recordings resolves no finer one
ANGLE_ONLY = ('hybrid_angle', 'kalman', 'pll')


@dataclass(frozen=True)
class Study:
    """A pair of recordings and the observer for it.

    identified, judged : bags.
    observer, model : those that use the torque.
    bandwidths, disturbances : the grid [Hz].
    """

    identified: str
    judged: str
    observer: str
    model: str
    bandwidths: tuple[float, ...]
    disturbances: tuple[float, ...]


SLOW = (8.0, 11.0, 15.0, 18.0, 22.0, 27.0, 36.0, 50.0)
FAST = (27.0, 40.0, 55.0, 70.0, 90.0)
_SIMPLE, _DOUBLE = 'dfki_simple_pendulum/', 'dfki_double_pendulum/'
STUDIES = (
    *(
        Study(
            _SIMPLE + each,
            _SIMPLE + 'sac_200hz_multiturn',
            'geso',
            'single_joint',
            SLOW,
            (0.0, 2.0, 8.0),
        )
        for each in ('system_identification_300hz', 'energy_shaping_200hz')
    ),
    *(
        Study(_DOUBLE + one, _DOUBLE + other, 'hgo', 'two_links', FAST, (0.0, 4.0, 8.0))
        for one, other in itertools.permutations(('sys_id_500hz', 'trajectory_665hz'))
    ),
)


class Result(NamedTuple):
    """An observer at one setting on one joint: rms error without the reference's noise, delay."""

    error: float  # rad/s
    delay: float  # s
    what: str


class Line(NamedTuple):
    """The result for one joint of a pair."""

    study: Study
    joint: str
    noise: float  # of the reference [rad/s]
    explained: float  # fraction of held-out motion that the model explains
    angle: Result
    torque: Result
    without: Result  # the same observer with zero torque

    @property
    def ratio(self) -> float:
        """Error with the torque over that of the best angle-only observer."""
        return self.torque.error / self.angle.error


class _Judged:
    """A recording with its reference."""

    def __init__(self, path: Path, model: str) -> None:
        with open_bag(path) as bag:
            measured = joint_series(bag, MEASUREMENT)
            self.samples, self.names = recording(bag, MEASUREMENT, load(model), tuple(measured))
            known = truth(bag, str(path), measured, Options(correct_reference=True))
        first = measured[self.names[0]].stamps_ns[0]
        self.stamps = np.round(self.samples.time * 1e9).astype(np.int64) + int(first)
        self.noise = [float(known.references[name].noise) for name in self.names]
        self._matched = [
            match(
                self.stamps,
                known.series[name].stamps_ns,
                known.series[name].velocity,
                known.series[name].position,
                TURN,
            )
            for name in self.names
        ]

    def judge(self, velocities: Array, what: str) -> list[Result]:
        """Return results per joint; `velocities` has shape (N, n), nan without an estimate."""
        found = []
        for column, at in enumerate(self._matched):
            estimate = velocities[at.rows, column]
            good = np.isfinite(estimate) & (self.samples.time[at.rows] > SKIPPED)
            error = float(np.mean((estimate[good] - at.velocity[good]) ** 2))
            found.append(
                Result(
                    math.sqrt(max(error - self.noise[column] ** 2, 0.0)),
                    delay(self.samples.time[at.rows][good], estimate[good], at.velocity[good]),
                    what,
                )
            )
        return found


def _late(samples: Recording, lag: float) -> Array:
    """Return the inputs as they acted, `lag` [s] after they were reported."""
    time, total = samples.time, accumulated(samples.time, samples.inputs)
    found = np.zeros_like(samples.inputs)
    for column in range(found.shape[1]):
        found[1:, column] = np.diff(np.interp(time - lag, time, total[:, column])) / np.diff(time)
    return found


def _run(observer: str, gains: dict[str, Any], judged: _Judged, inputs: Array | None) -> Array:
    """Return velocities, shape (N, n): of the mechanism, or of each joint alone without inputs."""
    record = observers.find(observer)
    settings: Any = build(record.gains, gains, owner=observer)
    positions, stamps = judged.samples.positions, judged.stamps.tolist()
    velocities = np.full_like(positions, np.nan)
    if inputs is not None:
        joint = Joint(record, settings, JointSettings())
        for k, stamp in enumerate(stamps):
            if joint.update(stamp, tuple(positions[k].tolist()), tuple(inputs[k].tolist())):
                velocities[k] = joint.estimate()[1]
        return velocities
    for column, angles in enumerate(positions.T.tolist()):
        joint = Joint(record, settings, JointSettings())
        for k, stamp in enumerate(stamps):
            if joint.update(stamp, angles[k]):
                velocities[k, column] = joint.estimate()[1]
    return velocities


@lru_cache
def _identified(path: Path, model: str) -> tuple[tuple[str, ...], float, float]:
    """Return (assignments, delay of the inputs [s], explained fraction of held-out motion)."""
    given = {'coulomb_speed': float(WIDTH.partition('=')[2])}
    wanted, lag = unknowns(model, given, {}), 0.0
    with open_bag(path) as bag:
        samples, _ = recording(
            bag, MEASUREMENT, wanted.make(wanted.start), tuple(joint_series(bag, MEASUREMENT))
        )
    if model == 'single_joint':
        wanted, lag = first_guess(samples, wanted, given, {})
    found = fit(samples, wanted, lag)
    return (
        wanted.texts(found.values[:-1]),
        max(0.0, float(found.values[-1])),
        found.explained_elsewhere,
    )


def study(folder: Path, which: Study, angle_only: tuple[str, ...] = ANGLE_ONLY) -> Iterator[Line]:
    """Yield a line for each joint.

    Raises
    ------
    UserError : a recording does not exist, or its model cannot be identified.
    """
    judged = _Judged(folder / which.judged, which.model)
    texts, lag, explained = _identified(folder / which.identified, which.model)
    alone = [
        judged.judge(_run(name, {'bandwidth_hz': hertz}, judged, None), f'{name}, {hertz:g} Hz')
        for name in angle_only
        for hertz in which.bandwidths
    ]
    driven, idle = [], []
    lags = sorted({0.0, round(lag, 6)})
    for hertz in which.bandwidths:
        for disturbance in which.disturbances:
            gains = {
                'model': which.model,
                'model_parameters': list(texts),
                'bandwidth_hz': hertz,
                'disturbance_hz': disturbance,
            }
            what = f'{which.observer}, {hertz:g} Hz, disturbance {disturbance:g} Hz'
            for late in lags:
                driven.append(
                    judged.judge(
                        _run(which.observer, gains, judged, _late(judged.samples, late)),
                        f'{what}, {1e3 * late:.1f} ms late',
                    )
                )
            idle.append(
                judged.judge(
                    _run(which.observer, gains, judged, np.zeros_like(judged.samples.inputs)), what
                )
            )
    for column, name in enumerate(judged.names):
        best = min(row[column] for row in alone)
        yield Line(
            which,
            name,
            judged.noise[column],
            explained,
            best,
            _best([row[column] for row in driven], best.delay),
            _best([row[column] for row in idle], best.delay),
        )


def _best(results: list[Result], longest: float) -> Result:
    """Return the least error at a delay of at most `longest`; of all if none is that fast."""
    fast = [result for result in results if result.delay <= longest + CLOSE]
    return min(fast or results)


def text(lines: list[Line]) -> str:
    """Return the table as text."""
    rows = [
        {
            'judged on': line.study.judged.partition('/')[2],
            'joint': line.joint,
            'identified on': line.study.identified.partition('/')[2],
            'explained': f'{100.0 * line.explained:.1f} %',
            'reference noise': f'{line.noise:.3f}',
            'angle alone': f'{line.angle.error:.3f}',
            'by': line.angle.what,
            'delay [ms]': f'{1e3 * line.angle.delay:.2f}',
            'with torque': f'{line.torque.error:.3f}',
            'by ': line.torque.what,
            'delay [ms] ': f'{1e3 * line.torque.delay:.2f}',
            'torque 0': f'{line.without.error:.3f}',
            'ratio': f'{line.ratio:.2f}' if line.angle.error > 0.0 else '-',
        }
        for line in lines
    ]
    return table(tuple(rows[0]), [tuple(row.values()) for row in rows])


def main() -> None:
    """Print every study on the bags in a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('folder', type=Path, help='folder of the recordings (bags)')
    folder = parser.parse_args().folder
    print(text([line for each in STUDIES for line in study(folder, each)]))


if __name__ == '__main__':
    main()
