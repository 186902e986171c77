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
import contextlib
import io
import itertools
import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from estimator_pkg import params_file
from estimator_pkg.cli import main as velocity_estimator
from estimator_pkg.evaluation.compare.comparison import Row, compare
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.text import table

SKIPPED = 2.0  # ignored at the start [s]
CLOSE = 1e-4  # accuracy of a delay [s]
WIDTH = 'coulomb_speed=0.05'  # rad/s: the quantum of these recordings resolves no finer one
ANGLE_ONLY = ('hybrid_angle', 'kalman', 'pll')


@dataclass(frozen=True)
class Study:
    """A pair of recordings and the observer for it.

    identified, judged : bags.
    observer, model : those that use the torque. joints : of the model, as the bags name them.
    bandwidths, disturbances : the grid [Hz].
    """

    identified: str
    judged: str
    observer: str
    model: str
    joints: tuple[str, ...]
    bandwidths: tuple[float, ...]
    disturbances: tuple[float, ...]


SLOW = (8.0, 11.0, 15.0, 18.0, 22.0, 27.0, 36.0, 50.0)
FAST = (27.0, 40.0, 55.0, 70.0, 90.0)
_SIMPLE, _DOUBLE = 'dfki_simple_pendulum/', 'dfki_double_pendulum/'
_ONE = 'geso', 'single_joint', ('pendulum',), SLOW, (0.0, 2.0, 8.0)
_TWO = 'hgo', 'two_links', ('shoulder', 'elbow'), FAST, (0.0, 4.0, 8.0)
STUDIES = (
    Study(_SIMPLE + 'system_identification_300hz', _SIMPLE + 'sac_200hz_multiturn', *_ONE),
    Study(_SIMPLE + 'energy_shaping_200hz', _SIMPLE + 'sac_200hz_multiturn', *_ONE),
    Study(_DOUBLE + 'sys_id_500hz', _DOUBLE + 'trajectory_665hz', *_TWO),
    Study(_DOUBLE + 'trajectory_665hz', _DOUBLE + 'sys_id_500hz', *_TWO),
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


@lru_cache
def _identified(path: Path, model: str, joints: tuple[str, ...]) -> tuple[dict[str, Any], float]:
    """Return (parameters of the observer, explained fraction of held-out motion)."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        out, result = Path(folder) / 'model.yaml', Path(folder) / 'result.json'
        words = ['identify', str(path), '--model', model, '--set', WIDTH, '--out', str(out)]
        words += [word for joint in joints for word in ('--joint', joint)]
        if velocity_estimator([*words, '--json', str(result)]):
            raise RuntimeError(f'{model} cannot be identified on {path}')
        explained = json.loads(result.read_text())['explained_elsewhere']
        return params_file.load(out, 'mechanical_observer'), explained


def study(folder: Path, which: Study, angle_only: tuple[str, ...] = ANGLE_ONLY) -> Iterator[Line]:
    """Yield a line for each joint; raise UserError if a recording does not exist."""
    model, explained = _identified(folder / which.identified, which.model, which.joints)
    lags = sorted({0.0, model.pop('input_delay')})

    def entries(scale: float, lags: list[float]) -> list[Entry]:
        return [
            Entry(
                f'{which.observer}, {hertz:g} Hz, disturbance {slow:g} Hz, {1e3 * lag:.1f} ms late',
                which.observer,
                tuple(
                    (
                        model
                        | {'bandwidth_hz': hertz, 'disturbance_hz': slow}
                        | {'input_delay': (lag,), 'input_scale': (scale,)}
                    ).items()
                ),
            )
            for hertz in which.bandwidths
            for slow in which.disturbances
            for lag in lags
        ]

    alone = [
        Entry(f'{name}, {hertz:g} Hz', name, (('bandwidth_hz', hertz),))
        for name, hertz in itertools.product(angle_only, which.bandwidths)
    ]
    every = [
        [*_judged(folder / which.judged, each)]
        for each in (alone, entries(1.0, lags), entries(0.0, [0.0]))
    ]
    for joint in which.joints:
        angle, torque, idle = (
            [_result(row) for row in rows if row.joint == joint] for rows in every
        )
        best = min(angle)
        yield Line(
            which,
            joint,
            next(row.reference_noise for row in every[0] if row.joint == joint),
            explained,
            best,
            _best(torque, best.delay),
            _best(idle, best.delay),
        )


def _judged(path: Path, entries: list[Entry]) -> tuple[Row, ...]:
    options = Options(observers=tuple(entries), begin=SKIPPED, correct_reference=True)
    return compare(str(path), options).rows


def _result(row: Row) -> Result:
    error = math.sqrt(max(row.velocity['rms'] ** 2 - row.reference_noise**2, 0.0))
    return Result(error, row.velocity['delay_s'], row.source)


def _best(results: list[Result], longest: float) -> Result:
    """Return the least error at a delay of at most `longest`; of all if none is that fast."""
    fast = [result for result in results if result.delay <= longest + CLOSE]
    return min(fast or results)


HEADER = (
    *('judged on', 'joint', 'identified on', 'explained', 'reference noise', 'angle alone', 'by'),
    *('delay [ms]', 'with torque', 'by', 'delay [ms]', 'torque 0', 'ratio'),
)


def text(lines: list[Line]) -> str:
    """Return the table as text."""
    rows = [
        (
            line.study.judged.partition('/')[2],
            line.joint,
            line.study.identified.partition('/')[2],
            f'{100.0 * line.explained:.1f} %',
            f'{line.noise:.3f}',
            f'{line.angle.error:.3f}',
            line.angle.what,
            f'{1e3 * line.angle.delay:.2f}',
            f'{line.torque.error:.3f}',
            line.torque.what,
            f'{1e3 * line.torque.delay:.2f}',
            f'{line.without.error:.3f}',
            f'{line.ratio:.2f}' if line.angle.error > 0.0 else '-',
        )
        for line in lines
    ]
    return table(HEADER, rows)


def main() -> None:
    """Print every study on the bags in a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('folder', type=Path, help='folder of the recordings (bags)')
    folder = parser.parse_args().folder
    print(text([line for each in STUDIES for line in study(folder, each)]))


if __name__ == '__main__':
    main()
