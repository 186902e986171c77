# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How well the verdict on a drive without truth agrees with the truth.

    python -m benchmarks.drive_ranking

Simulated drives: speeds, noise, lost samples, and motor data that are wrong. The forms of `pmsm`
are ranked from currents and voltages alone and from the truth. Regret is the true rms error of the
pick over that of the best form.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.ranking import kendall
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.recording import recording
from estimator_pkg.bags.series import at_stamps
from estimator_pkg.bags.wiring import wired
from estimator_pkg.cli import main as velocity_estimator
from estimator_pkg.evaluation.checks.readings import WARN
from estimator_pkg.evaluation.doctor import drive
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.messages import drive_samples
from estimator_pkg.streams.contract import Request
from estimator_pkg.streams.drive import DriveStream

MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
TRUE = '/ground_truth/samples'
SAME = 0.01  # forms whose true errors differ by less are equal
# name -> (settings of the simulator, factors on the motor data that the observer has)
CONDITIONS: dict[str, tuple[tuple[str, ...], Mapping[str, float]]] = {
    'usual': ((), {}),
    'slow, 1500 rpm': (('speed_rpm=1500',), {}),
    'fast, 9000 rpm': (('speed_rpm=9000',), {}),
    'reversals': (('profile=reversal',), {}),
    'ramps': (('profile=ramps', 'profile_time=2'), {}),
    'little noise': (('current_noise=0.01',), {}),
    'much noise': (('current_noise=0.3',), {}),
    '5 kHz': (('publish_rate=5000', 'batch=50'), {}),
    '5 % lost': (('lost=0.05',), {}),
    'R 20 % low': ((), {'resistance': 0.8}),
    'R 20 % high': ((), {'resistance': 1.2}),
    'R half': ((), {'resistance': 0.5}),
    'L 20 % low': ((), {'inductance': 0.8}),
    'L 20 % high': ((), {'inductance': 1.2}),
    'flux 30 % low': ((), {'flux': 0.7}),
    'flux 50 % high': ((), {'flux': 1.5}),
}
HEADER = ('condition', "Kendall's tau", 'regret', 'error estimated / true', 'pairs declared')


class Outcome(NamedTuple):
    """Agreement of one condition; ratio : expected over true rms error of the default form."""

    name: str
    tau: float
    regret: float
    ratio: float
    declared: int
    wrong: int
    pairs: int
    warned: tuple[str, ...]


def simulated(path: Path, settings: Sequence[str], seconds: float) -> None:
    """Write a bag of a simulated drive with the truth of every sample."""
    words = [word for each in settings for word in ('--set', each)]
    with contextlib.redirect_stdout(io.StringIO()):
        code = velocity_estimator(
            ['simulate', 'pmsm', '--out', str(path), '--duration', f'{seconds}', *words]
        )
    if code:
        raise RuntimeError(f'the simulation of {path} failed')


def judge(name: str, path: Path, motor: Mapping[str, float]) -> Outcome:
    """Return the agreement of the verdict without truth with the truth in the bag."""
    with open_bag(path) as bag:
        values = {'observer': drive.OBSERVER, **motor}
        setup = wired(DriveStream, bag, values, Request(None, None))
        found = drive.examine(bag, setup)
        batches = [drive_samples.decode(bytes(each.raw)) for each in bag.messages([TRUE])]
        whole = recording(bag, setup, {}).per_sample()
    stamps = np.concatenate([batch.stamps_ns for batch in batches])
    speed = np.concatenate([batch.values[:, 1] for batch in batches])
    verdict = found.verdict
    warned = tuple(each.check for each in found.findings if each.level == WARN)
    if verdict is None or not verdict.best:
        return Outcome(name, np.nan, np.nan, np.nan, 0, 0, 0, warned)
    velocity = {}
    for entry in drive.candidates():
        if entry.label in verdict.rms:
            made = whole.run(drive.OBSERVER, dict(entry.values))[found.name]
            velocity[entry.label] = at_stamps(stamps, made.stamps, made.velocity)
    late = stamps - stamps[0] > 0.15 * (stamps[-1] - stamps[0])
    use = late & np.isfinite(list(velocity.values())).all(axis=0)
    true = {
        label: float(np.sqrt(np.mean((each - speed)[use] ** 2))) for label, each in velocity.items()
    }
    declared = [pair for pair in verdict.pairs if pair.sign]
    return Outcome(
        name,
        kendall([verdict.rms[label] for label in true], list(true.values()), SAME),
        true[verdict.best] / min(true.values()),
        verdict.rms[drive.OBSERVER] / true[drive.OBSERVER],
        len(declared),
        sum(true[pair.first] > true[pair.second] for pair in declared),
        len(verdict.pairs),
        warned,
    )


def run(names: Sequence[str] = tuple(CONDITIONS), seconds: float = 2.0) -> list[Outcome]:
    """Return the outcome of every condition."""
    found: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            settings, factors = CONDITIONS[name]
            path = Path(folder) / str(len(found))
            simulated(path, settings, seconds)
            motor = {key: value * factors.get(key, 1.0) for key, value in MOTOR.items()}
            motor['pole_pairs'] = MOTOR['pole_pairs']
            found.append(judge(name, path, motor))
    return found


def describe(outcomes: Sequence[Outcome]) -> str:
    """Return the table as Markdown."""
    cells = '{name}|{tau:.2f}|{regret:.2f}|{ratio:.2f}|{declared} of {pairs}|{wrong}'
    rows = [
        (*cells.format(**each._asdict()).split('|'), ', '.join(each.warned) or '-')
        for each in outcomes
    ]
    return markdown((*HEADER, 'wrong', 'warns of'), rows)


if __name__ == '__main__':
    print(describe(run()))
