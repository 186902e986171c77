# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How well the ranking without truth agrees with the truth.

    python -m benchmarks.ranking bags

Series with truth: recordings with the drive's own velocity, recordings made coarser (judged by the
fine original), and simulated motions. The estimators are ranked from the readings alone and from
the truth. Regret is the true rms error of the pick over that of the best candidate.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import recorded
from benchmarks.columns import published
from benchmarks.motions import FAILURES, MOTIONS, sampled
from benchmarks.signals import Samples
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.ranking.ranking import at_reference, rank
from estimator_pkg.evaluation.reference.motion import motion
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

TURN = 2.0 * math.pi
BANDWIDTHS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)  # [Hz], of observers that have one
BOUNDS = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7)  # of super_twisting
COARSER = (8.0, 32.0, 128.0)  # times the quantum of a recording
JUDGES = 0.4  # the truth's own error is at most this part of the best candidate's,
WHITE_JUDGES = 1.0  # and this part if it is white noise of a sensor of its own, which only adds
RECORDED, COARSENED, SIMULATED = 'recorded', 'coarser', 'simulated'
USUAL = (RECORDED, COARSENED, SIMULATED)
VIOLENT = 'system_identification_300hz'  # 3.9 s in which the truth itself lags and rounds off
HEADER = (
    'series',
    'number',
    "Kendall's tau",
    'regret: median, 90 %, worst',
    'of the six defaults: 90 %, worst',
    'pairs declared',
    'wrong',
    'best among the ties',
)


class Case(NamedTuple):
    """One series: readings of a joint and the velocity that judges.

    noise : error of that velocity [rad/s]. motion_hz : as in `rank`.
    """

    name: str
    group: str
    samples: Samples
    noise: float = 0.0
    motion_hz: float | None = None


class Outcome(NamedTuple):
    """Agreement of one series.

    tau : Kendall's, over all candidates. regret : of the pick among all; regret_of_six : among the
    defaults; regret_of_default : of edge_adaptive. pairs, declared, wrong, ratio (median of the
    estimated over the true error) : of the defaults.
    """

    group: str
    tau: float
    regret: float
    regret_of_six: float
    regret_of_default: float
    pairs: int
    declared: int
    wrong: int
    among_ties: bool
    ratio: float


def candidates() -> list[Entry]:
    """Return the six observers at their defaults, then each at several settings."""
    found = [Entry(name, name) for name in angle_observers()]
    for name in angle_observers():
        if name == 'edge_adaptive':
            found += [
                Entry(f'{name} {prefer}', name, (('prefer', prefer),))
                for prefer in ('smooth', 'fast')
            ]
        elif name == 'super_twisting':
            found += [Entry(f'{name} {bound:g}', name, (('bound', bound),)) for bound in BOUNDS]
        else:
            found += [
                Entry(f'{name} {hz:g} Hz', name, (('bandwidth_hz', hz),)) for hz in BANDWIDTHS
            ]
    return found


def cases(bags: Path) -> Iterator[Case]:
    """Yield every series with truth; those of `FAILURES` have their name as their group."""
    for path in recorded.recordings(bags):
        if path.parent.name == 'simulated':
            continue
        group = 'short and violent' if path.name == VIOLENT else RECORDED
        for column in recorded.of_bag(path):
            yield Case(column.name, group, column.samples, column.noise)
            yield from _coarser(column.name, column.samples)
    for name in MOTIONS:
        yield Case(name, SIMULATED, sampled(name))
    for name in FAILURES:
        group = name.partition(':')[0]
        yield Case(name, group, sampled(name))
        if group == 'hum':
            yield Case(f'{name}, answered', 'hum, --motion-hz 2', sampled(name), motion_hz=2.0)


def _coarser(name: str, fine: Samples) -> Iterator[Case]:
    """Yield a recording with coarser readings; its own smoothed motion is the truth."""
    reference = motion(fine.stamps, fine.angle, TURN)
    if reference is None or reference.seldom or reference.constant:
        return
    velocity = np.full(len(fine.stamps), np.nan)
    velocity[np.searchsorted(fine.stamps, reference.stamps)] = np.where(
        reference.firm, reference.velocity, np.nan
    )
    for times in COARSER:
        step = times * quantum(fine.angle)
        coarse = np.floor(fine.angle / step) * step
        samples = Samples(fine.stamps, coarse, velocity)
        yield Case(f'{name}, {times:g} times coarser', COARSENED, samples, reference.stddev)


def estimates(entry: Entry, samples: Samples) -> tuple[NDArray[np.int64], Array]:
    """Return (stamps, velocities) that the observer publishes."""
    out = entry.joint().run(samples.stamps, samples.angle)
    valid = published(out)
    return samples.stamps[valid], out.velocity[valid]


def judge(case: Case, entries: Sequence[Entry]) -> Outcome | None:
    """Return the agreement; None if the truth cannot rank, or nothing is ranked."""
    samples = case.samples
    reference = motion(samples.stamps, samples.angle, TURN)
    if reference is None or reference.seldom:
        return None
    found = {entry.label: at_reference(reference, *estimates(entry, samples)) for entry in entries}
    verdict = rank(found, reference, 'edge_adaptive', case.motion_hz)
    six = {name: found[name] for name in angle_observers()}
    small = rank(six, reference, 'edge_adaptive', case.motion_hz)
    if not verdict.best or not small.best:
        return None
    known = at_reference(reference, samples.stamps, samples.velocity)
    time = reference.time - reference.time[0]
    use = reference.firm & (time >= min(1.0, 0.15 * time[-1])) & np.isfinite(known)
    for name in verdict.rms:
        use &= np.isfinite(found[name])
    true = {
        name: max(float(np.mean((found[name] - known)[use] ** 2)) - case.noise**2, 1e-12) ** 0.5
        for name in verdict.rms
    }
    best = min(true, key=lambda name: true[name])
    if case.noise > (JUDGES if case.group == COARSENED else WHITE_JUDGES) * true[best]:
        return None
    declared = [pair for pair in small.pairs if pair.sign]
    return Outcome(
        case.group,
        kendall([verdict.rms[name] for name in true], list(true.values())),
        true[verdict.best] / true[best],
        true[small.best] / min(true[name] for name in small.rms),
        true['edge_adaptive'] / true[best],
        len(small.pairs),
        len(declared),
        sum(true[pair.first] > true[pair.second] for pair in declared),
        best == verdict.best or best in verdict.ties,
        float(np.median([verdict.rms[name] / true[name] for name in small.rms])),
    )


def kendall(one: Sequence[float], other: Sequence[float], same: float = 0.0) -> float:
    """Return Kendall's tau over the pairs whose `other` numbers differ by more than this part."""
    a, b = np.asarray(one), np.asarray(other)
    differ = np.abs(b[:, None] - b) > same * np.minimum(b[:, None], b)
    signs = np.sign(a[:, None] - a) * np.sign(b[:, None] - b)
    return float(np.mean(signs[differ])) if differ.any() else math.nan


def run(found: Sequence[Case]) -> list[Outcome]:
    """Return the outcome of every case that the truth can rank."""
    entries = candidates()
    outcomes = []
    with progress('ranking', len(found)) as advance:
        for case in found:
            judged = judge(case, entries)
            if judged is not None:
                outcomes.append(judged)
            advance(1)
    return outcomes


def summary(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Return the figures of a group of series."""
    regret = [each.regret for each in outcomes]
    six = [each.regret_of_six for each in outcomes]
    declared = sum(each.declared for each in outcomes)
    return {
        'series': len(outcomes),
        'tau': float(np.median([each.tau for each in outcomes])),
        'regret': float(np.median(regret)),
        'regret_90': float(np.quantile(regret, 0.9)),
        'regret_worst': max(regret),
        'six_90': float(np.quantile(six, 0.9)),
        'six_worst': max(six),
        'declared': declared,
        'pairs': sum(each.pairs for each in outcomes),
        'wrong': sum(each.wrong for each in outcomes),
        'among_ties': sum(each.among_ties for each in outcomes),
        'default_90': float(np.quantile([each.regret_of_default for each in outcomes], 0.9)),
        'default_worst': max(each.regret_of_default for each in outcomes),
        'ratio': float(np.median([each.ratio for each in outcomes])),
    }


def groups(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Return the outcomes by group, and all that are no known failure."""
    found: dict[str, list[Outcome]] = {}
    for each in outcomes:
        found.setdefault(each.group, []).append(each)
        if each.group in USUAL:
            found.setdefault('all three', []).append(each)
    return found


def describe(outcomes: Sequence[Outcome]) -> str:
    """Return the table as Markdown."""
    cells = (
        '{series}|{tau:.2f}|{regret:.2f}, {regret_90:.2f}, {regret_worst:.2f}|'
        '{six_90:.2f}, {six_worst:.2f}|{declared} of {pairs}|{wrong}|{among_ties}'
    )
    rows = [
        (group, *cells.format(**summary(each)).split('|'))
        for group, each in groups(outcomes).items()
    ]
    text = markdown(HEADER, rows)
    usual = groups(outcomes).get('all three')
    if usual:
        default = summary(usual)
        text += (
            f'\n\n- edge_adaptive at its defaults: regret {default["default_90"]:.2f} at 90 %, '
            f'{default["default_worst"]:.1f} at worst, over all three.'
        )
    return text


def main() -> None:
    """Rank every series, or those whose name or group contains a text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bags', nargs='?', default='bags', type=Path)
    parser.add_argument('--only', default='', metavar='TEXT', help='of a name or a group')
    parsed = parser.parse_args()
    chosen = [each for each in cases(parsed.bags) if parsed.only in each.name + each.group]
    print(describe(run(chosen)))


if __name__ == '__main__':
    main()
