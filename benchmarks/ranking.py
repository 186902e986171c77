# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How well the ranking without truth agrees with the truth.

    python -m benchmarks.ranking bags [--held-out FOLDER]

Series with truth: recordings with the drive's own velocity, recordings made coarser (judged by the
fine original), simulated motions, and the held-out lists if their files are there (in which no
check of `doctor` FAILs). The estimators are ranked from the readings alone and from the truth.
Regret is the true rms error of the pick over that of the best candidate.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kendalltau

from benchmarks import held_out, recorded
from benchmarks.columns import Column, published
from benchmarks.motions import FAILURES, MOTIONS, sampled
from estimator_pkg.evaluation.checks.joint import checked, failed, stretch
from estimator_pkg.evaluation.checks.joint import reference as moved
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.doctor import choice
from estimator_pkg.evaluation.doctor.choice import DEFAULT
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.ranking.ranking import at_reference, rank
from estimator_pkg.evaluation.ranking.verdict import Verdict
from estimator_pkg.evaluation.reference.motion import ReferenceMotion, motion
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

BANDWIDTHS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)  # [Hz], of observers that have one
BOUNDS = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7)  # of super_twisting
COARSER = (8.0, 32.0, 128.0)  # times the quantum of a recording
RECORDED, COARSENED, SIMULATED = 'recorded', 'coarser', 'simulated'
USUAL = (RECORDED, COARSENED, SIMULATED)
HELD_OUT = tuple(held_out.LISTS.values())
# The truth's own error is at most this part of the best candidate's. White noise of a sensor of its
# own only adds.
JUDGES = 1.0
LIMITS = {COARSENED: 0.4, **dict.fromkeys(HELD_OUT, 0.5)}
SEEN = 1.1  # a larger regret is named
FIGURES = {
    'regret': 'regret',
    'choice': 'regret_of_choice',
    'doctor': 'regret_of_doctor',
    'default': 'regret_of_default',
}
VIOLENT = 'system_identification_300hz'  # 3.9 s in which the truth itself lags and rounds off
HEADER = (
    'series',
    'number',
    "Kendall's tau",
    'regret: median, 90 %, worst',
    'choice of evaluate: 90 %, worst',
    'choice of doctor: 90 %, worst',
    'pairs declared',
    'wrong',
    'best among the ties',
)


class Case(NamedTuple):
    """A column that belongs to a group; motion_hz as in `rank`."""

    group: str
    column: Column
    motion_hz: float | None = None


class Outcome(NamedTuple):
    """Agreement of one series.

    tau : Kendall's, over all candidates. regret : of the pick among all; regret_of_choice : of what
    `evaluate` chooses among the defaults; regret_of_doctor : of what `doctor` chooses among its own
    candidates, nan without a choice; regret_of_default : of edge_adaptive. pairs, declared,
    wrong : of the defaults.
    """

    name: str
    group: str
    tau: float
    regret: float
    regret_of_choice: float
    regret_of_doctor: float
    regret_of_default: float
    pairs: int
    declared: int
    wrong: int
    among_ties: bool


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


def cases(bags: Path, files: Path | None = None) -> Iterator[Case]:
    """Yield every series with truth; those of `FAILURES` have their name as their group.

    Parameters
    ----------
    files : folder of the repositories of the held-out series; None: without these.
    """
    for path in recorded.recordings(bags):
        if path.parent.name == 'simulated':
            continue
        group = 'short and violent' if path.name == VIOLENT else RECORDED
        for column in recorded.of_bag(path):
            yield Case(group, column)
            yield from _coarser(column)
    for name in MOTIONS:
        yield Case(SIMULATED, Column(name, sampled(name), 0.0))
    for name in FAILURES:
        column, group = Column(name, sampled(name), 0.0), name.partition(':')[0]
        yield Case(group, column)
        if group == 'hum':
            yield Case('hum, --motion-hz 2', replace(column, name=f'{name}, answered'), 2.0)
    if files is None:
        return
    for which, title in held_out.LISTS.items():
        for each in held_out.listed(which):
            column = held_out.column(files, each)
            if not failed(checked(_readings(column))):
                yield Case(title, column)


def _readings(column: Column) -> Readings:
    """Return the readings as `doctor` has them."""
    stamps, angle = column.samples.stamps, column.samples.angle
    nothing = np.full(len(angle), np.nan)
    return Readings('', stamps, stamps, angle, nothing, column.period, int(stamps[0]))


def _coarser(column: Column) -> Iterator[Case]:
    """Yield a recording with coarser readings; its own smoothed motion is the truth."""
    fine = column.samples
    reference = motion(fine.stamps, fine.angle, column.period)
    if reference is None or reference.seldom or reference.constant:
        return
    velocity = np.full(len(fine.stamps), np.nan)
    velocity[np.searchsorted(fine.stamps, reference.stamps)] = np.where(
        reference.firm, reference.velocity, np.nan
    )
    for times in COARSER:
        step = times * quantum(fine.angle)
        coarse = np.floor(fine.angle / step) * step
        samples, name = fine._replace(angle=coarse, velocity=velocity), f'{column.name}, {times:g}'
        yield Case(
            COARSENED, Column(f'{name} times coarser', samples, step, noise=reference.stddev)
        )


def estimates(entry: Entry, column: Column) -> tuple[NDArray[np.int64], Array]:
    """Return (stamps, velocities) that the observer publishes."""
    samples = column.samples
    out = entry.joint(wrap_period=column.period).run(samples.stamps, samples.angle)
    valid = published(out)
    return samples.stamps[valid], out.velocity[valid]


def judge(case: Case, entries: Sequence[Entry]) -> Outcome | None:
    """Return the agreement; None if the truth cannot rank, or nothing is ranked."""
    column = case.column
    reference = motion(column.samples.stamps, column.samples.angle, column.period)
    if reference is None or reference.seldom:
        return None
    found = {entry.label: at_reference(reference, *estimates(entry, column)) for entry in entries}
    verdict = rank(found, reference, DEFAULT, case.motion_hz)
    six = {name: found[name] for name in angle_observers()}
    small = rank(six, reference, DEFAULT, case.motion_hz)
    if not verdict.best or not small.best:
        return None
    true = _true(column, reference, found, verdict)
    best = min(true, key=lambda name: true[name])
    if column.noise > LIMITS.get(case.group, JUDGES) * true[best]:
        return None
    declared = [pair for pair in small.pairs if pair.sign]
    return Outcome(
        column.name,
        case.group,
        float(kendalltau([verdict.rms[name] for name in true], [*true.values()]).statistic),
        true[verdict.best] / true[best],
        true[small.choice] / min(true[name] for name in small.rms),
        _of_doctor(case),
        true[DEFAULT] / true[best],
        len(small.pairs),
        len(declared),
        sum(true[pair.first] > true[pair.second] for pair in declared),
        best == verdict.best or best in verdict.ties,
    )


def _true(
    column: Column, reference: ReferenceMotion, found: Mapping[str, Array], verdict: Verdict
) -> dict[str, float]:
    """Return the true rms errors of the candidates that are ranked, where all have an estimate."""
    known = at_reference(reference, column.samples.stamps, column.samples.velocity)
    time = reference.time - reference.time[0]
    use = reference.firm & (time >= min(1.0, 0.15 * time[-1])) & np.isfinite(known)
    for name in verdict.rms:
        use &= np.isfinite(found[name])
    return {
        name: max(float(np.mean((found[name] - known)[use] ** 2)) - column.noise**2, 1e-12) ** 0.5
        for name in verdict.rms
    }


def _of_doctor(case: Case) -> float:
    """Return the regret of the choice of `doctor`; nan where it compares nothing."""
    seen = _readings(case.column)
    rows = np.sort(stretch(seen))
    reference = moved(seen, rows)
    if reference is None:
        return math.nan
    made = choice.answer(seen, reference, rows, case.motion_hz)
    if not made.compared:
        return math.nan
    labels = made.verdict.rms
    found = {
        entry.label: choice.estimates(seen, reference, entry, rows)
        for entry in choice.candidates(1.0 / seen.step)
        if entry.label in labels
    }
    true = _true(case.column, reference, found, made.verdict)
    return true[choice.choose({'': made}).label('')] / min(true.values())


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

    def of(name: str, part: float) -> float:
        values = [getattr(each, name) for each in outcomes]
        known = [each for each in values if math.isfinite(each)]
        return float(np.quantile(known, part)) if known else math.nan

    return {
        'series': len(outcomes),
        'tau': of('tau', 0.5),
        'regret': of('regret', 0.5),
        **{
            f'{name}_{"worst" if part == 1.0 else "90"}': of(figure, part)
            for name, figure in FIGURES.items()
            for part in (0.9, 1.0)
        },
        'declared': sum(each.declared for each in outcomes),
        'pairs': sum(each.pairs for each in outcomes),
        'wrong': sum(each.wrong for each in outcomes),
        'among_ties': sum(each.among_ties for each in outcomes),
    }


def groups(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Return the outcomes by group, and all that are no known failure."""
    found: dict[str, list[Outcome]] = {}
    for each in outcomes:
        found.setdefault(each.group, []).append(each)
        for title, several in (('all three', USUAL), ('held out', HELD_OUT)):
            if each.group in several:
                found.setdefault(title, []).append(each)
    return found


def describe(outcomes: Sequence[Outcome]) -> str:
    """Return the table as Markdown."""
    cells = (
        '{series}|{tau:.2f}|{regret:.2f}, {regret_90:.2f}, {regret_worst:.2f}|'
        '{choice_90:.2f}, {choice_worst:.2f}|{doctor_90:.2f}, {doctor_worst:.2f}|'
        '{declared} of {pairs}|{wrong}|{among_ties}'
    )
    rows = [
        (group, *cells.format(**summary(each)).replace('nan, nan', '-').split('|'))
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
    for each in outcomes:
        worst = max(each.regret_of_choice, each.regret_of_doctor)
        if worst > SEEN and each.group in (*USUAL, *HELD_OUT):
            text += (
                f'\n- {each.name}, {each.group}: {each.regret_of_choice:.2f} of evaluate, '
                f'{each.regret_of_doctor:.2f} of doctor'
            )
    return text


def main() -> None:
    """Rank every series, or those whose name or group contains a text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bags', nargs='?', default='bags', type=Path)
    parser.add_argument('--only', default='', metavar='TEXT', help='of a name or a group')
    parser.add_argument(
        '--held-out', type=Path, metavar='FOLDER', help='of the repositories of these series'
    )
    parsed = parser.parse_args()
    every = cases(parsed.bags, parsed.held_out)
    chosen = [each for each in every if parsed.only in each.column.name + each.group]
    print(describe(run(chosen)))


if __name__ == '__main__':
    main()
