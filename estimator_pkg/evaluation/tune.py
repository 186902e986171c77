"""``velocity_estimator tune``: gains from data, as a YAML that the node loads."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from estimator_pkg import registry
from estimator_pkg.cli import Command
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.evaluation import tune_live, tune_output
from estimator_pkg.evaluation.entries import angle_observers
from estimator_pkg.evaluation.options import AUTO, MEASUREMENT, SMOOTHER, TRUTH, Options
from estimator_pkg.evaluation.reference import CLEARLY
from estimator_pkg.evaluation.search import Dimension, Search, search
from estimator_pkg.evaluation.text import number, table
from estimator_pkg.evaluation.tuning import (
    PREFERENCES,
    Part,
    Record,
    Result,
    Weights,
    cost,
    mean,
    measure,
    records,
)
from estimator_pkg.evaluation.workers import Map, expanded, workers
from estimator_pkg.parameters import build, declared, parse_assignments

TRIALS = 40
COMPILE_FROM = 400_000  # samples over all trials from which compiling pays
SAME = 1e-6             # errors this close are equal [part, or rad/s]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument('bags', nargs='*', metavar='BAG',
                        help='bags to tune on, or folders with bags in them')
    parser.add_argument('--live', type=float, metavar='SECONDS',
                        help='in place of bags: record the measurement of the live graph for so '
                             'long')
    parser.add_argument('--apply', metavar='NODE',
                        help='set the gains found on this running node (nothing is set without)')
    parser.add_argument('--observer', required=True, metavar='NAME', help='whose gains')
    parser.add_argument('--out', required=True, metavar='YAML', help='where the gains go')
    parser.add_argument('--prefer', choices=tuple(PREFERENCES), default='balanced',
                        help='what matters more: a quiet estimate, a prompt one, or the error '
                             'alone with a little of both (default)')
    parser.add_argument('--weights', metavar='E,D,N',
                        help='in place of --prefer: how much count the rms error, the error that '
                             'the delay makes, and the noise (all in rad/s)')
    parser.add_argument('--search', action='append', default=[], metavar='GAIN=LOW:HIGH',
                        help='seek this gain between these values; repeatable (default: the gains '
                             'that the observer names for it)')
    parser.add_argument('--set', action='append', default=[], metavar='KEY=VALUE',
                        help='hold this parameter; repeatable')
    parser.add_argument('--joint', action='append', default=[], metavar='NAME',
                        help='only this joint; repeatable')
    parser.add_argument('--per-joint', action='store_true',
                        help='gains for each joint of its own, in place of common ones')
    parser.add_argument('--held-out', type=float, default=0.3, metavar='PART',
                        help='part of each record, at its end, that is kept for the judgement '
                             '(default 0.3)')
    parser.add_argument('--trials', type=int, default=TRIALS, metavar='N',
                        help=f'how many gains are tried (default {TRIALS})')
    parser.add_argument('--seed', type=int, default=0, help='of the search (default 0)')
    parser.add_argument('--measurement', metavar='TOPIC',
                        help=f'JointState with the measured positions (default {MEASUREMENT})')
    parser.add_argument('--truth', metavar='TOPIC',
                        help=f'JointState with the true velocities (default {TRUTH})')
    parser.add_argument('--reference', choices=(AUTO, 'truth', SMOOTHER), default=AUTO,
                        help='as of evaluate')
    parser.add_argument('--wrap-period', type=float, default=2.0 * math.pi, metavar='RAD',
                        help='period of the positions; 0 for prismatic joints (default 2 pi)')
    parser.add_argument('--plot', metavar='FILE',
                        help='picture of noise against delay (default: beside the YAML, where '
                             'matplotlib is installed)')
    parser.add_argument('--jobs', type=int, default=1, metavar='N', help='local processes')
    parser.add_argument('--scheduler', metavar='ADDRESS', help='a Dask scheduler, in their place')
    parser.add_argument('--storage', metavar='URL',
                        help='Optuna storage that keeps the trials, e.g. sqlite:///study.db')
    parser.add_argument('--study', default='velocity_estimator', metavar='NAME',
                        help='name of the study in the storage; one that is there goes on')


def run(parsed: argparse.Namespace) -> dict[str, Any]:
    """Searches, judges on what was held out, writes."""
    observer, weights, fixed, dimensions = settings(parsed)
    out = Path(parsed.out)
    if not out.parent.is_dir():
        raise UserError(f'{out}: there is no folder {out.parent}')
    options = Options(parsed.measurement, parsed.truth, wrap_period=parsed.wrap_period,
                      correct_reference=True, reference=parsed.reference)
    with contextlib.ExitStack() as stack:
        run_many = stack.enter_context(workers(parsed.jobs, parsed.scheduler))
        if parsed.live is not None:
            parsed.bags = [stack.enter_context(tune_live.recorded(
                parsed.measurement or MEASUREMENT, parsed.truth or TRUTH, parsed.live))]
        found = [record for part in run_many(records, [
            (bag, options, parsed.held_out, tuple(parsed.joint)) for bag in expanded(parsed.bags)])
            for record in part]
        groups = _groups(found, parsed.per_joint)
        tuned = []
        for joint, chosen in groups.items():
            name = f'{parsed.study}/{joint}' if joint else parsed.study
            tuned.append(tune(joint, chosen, parsed.observer, fixed, dimensions, weights,
                              parsed.trials, parsed.seed, parsed.storage, name, run_many))
            if tuned[-1]['interrupted']:
                break
    wanted = parsed.prefer if not parsed.weights else f'weights {parsed.weights}'
    out.write_text(tune_output.as_yaml(observer, fixed, tuned, wanted, parsed.held_out),
                   encoding='utf-8')
    print(describe(tuned))
    print(f'gains: {out}')
    picture = tune_output.draw(tuned, parsed.plot, out.with_suffix('.png'), parsed.observer)
    if picture:
        print(f'noise against delay: {picture}')
    if parsed.apply:
        tune_live.apply(parsed.apply, tune_live.node_names(tuned))
        print(f'set on {parsed.apply}')
    for each in tuned:
        each.pop('trials')
    return {'observer': parsed.observer, 'preference': wanted, 'out': str(out), 'tuned': tuned}


def settings(parsed: argparse.Namespace
             ) -> tuple[Any, Weights, dict[str, Any], list[Dimension]]:
    """Observer, weights, what is held and what is sought; raises UsageError."""
    if bool(parsed.bags) == (parsed.live is not None):
        raise UsageError('name bags, or --live SECONDS without bags')
    if parsed.live is not None and not 1.0 <= parsed.live < math.inf:
        raise UsageError('--live must be 1 s or more')
    if not 0.0 <= parsed.held_out < 0.9:
        raise UsageError('--held-out must be a part from 0 to 0.9')
    if parsed.trials < 1:
        raise UsageError('--trials must be 1 or more')
    if not (math.isfinite(parsed.wrap_period) and parsed.wrap_period >= 0.0):
        raise UsageError('--wrap-period must be an angle of 0 or more')
    observer = registry.find(registry.OBSERVERS, parsed.observer)
    if observer.kind != 'angle':
        raise UsageError(f"observer '{parsed.observer}' needs more than an angle; these do not: "
                         f'{", ".join(angle_observers())}')
    fixed = parse_assignments(parsed.set)
    build(observer.gains, fixed, owner=observer.name)
    return observer, _weights(parsed), fixed, _dimensions(observer, parsed.search, fixed)


def tune(joint: str, chosen: Sequence[Record], observer: str, fixed: Mapping[str, Any],
         dimensions: Sequence[Dimension], weights: Weights, trials: int, seed: int,
         storage: str | None, study: str, run_many: Map) -> dict[str, Any]:
    """The best gains for these records, and how they do on what was held out.

    Raises
    ------
    UserError : no gains work; the reference is too coarse to judge; a gain changes nothing.
    """
    seen = [record.seen for record in chosen]
    fast = sum(len(part.stamps) for part in seen) * trials >= COMPILE_FROM
    start = _start(observer, fixed, dimensions)
    first = [measure(part, observer, fixed, fast) for part in seen]
    scale = [cost(result, part, weights) if result is not None else 1.0
             for result, part in zip(first, seen)]

    def judge(batch: list[dict[str, float]]) -> list[tuple[float, Any]]:
        jobs = [(part, observer, {**fixed, **values}, fast) for values in batch for part in seen]
        results = list(run_many(measure, jobs))
        judged = []
        for number_ in range(len(batch)):
            part_results = results[number_ * len(seen):(number_ + 1) * len(seen)]
            judged.append((_total(part_results, seen, weights, scale), part_results))
        return judged

    with _bar(f'{observer} {joint}'.strip(), trials) as told:
        found = search(dimensions, start, judge, trials, seed, storage, study, told)
    best = found.best
    if best is None:
        if found.interrupted:
            raise KeyboardInterrupt
        raise UserError(f"no gains of '{observer}' within the search work on these bags: widen "
                        '--search, or look at the sample rate')
    _check_effect(found, dimensions)
    held = [record.held_out for record in chosen if record.held_out is not None]
    judged_on = held or seen
    default, better = ([measure(part, observer, {**fixed, **values}, fast) for part in judged_on]
                       for values in ({}, best.values))
    _check_reference(chosen, best.details or better)
    return {'joint': joint, 'gains': best.values, 'default_gains': _defaults(observer, dimensions),
            'default_point': _point(first),
            'relative_cost': best.cost, 'evaluations': found.asked,
            'interrupted': found.interrupted, 'held_out': bool(held),
            'default': _summary(default, judged_on, weights),
            'best': _summary(better, judged_on, weights),
            'bags': sorted({record.bag for record in chosen}),
            'joints': sorted({record.joint for record in chosen}),
            'trials': [(trial.values, trial.cost, _point(trial.details)) for trial in found.trials]}


def _total(results: Sequence[Result | None], parts: Sequence[Part], weights: Weights,
           scale: Sequence[float]) -> float:
    """The mean over the records of the cost in units of the defaults'; inf where one fails."""
    if any(result is None for result in results):
        return math.inf
    return mean([cost(result, part, weights) / unit
                 for result, part, unit in zip(results, parts, scale) if result is not None])


def _summary(results: Sequence[Result | None], parts: Sequence[Part], weights: Weights
             ) -> dict[str, float] | None:
    known = [(result, part) for result, part in zip(results, parts) if result is not None]
    if len(known) < len(results):
        return None
    return {'error': math.sqrt(mean([result.error ** 2 for result, _ in known])),
            'delay_s': mean([result.delay for result, _ in known]),
            'noise': math.sqrt(mean([result.noise ** 2 for result, _ in known])),
            'published': mean([result.published for result, _ in known]),
            'cost': mean([cost(result, part, weights) for result, part in known])}


def _point(details: Sequence[Result | None] | None) -> tuple[float, float] | None:
    """(delay, noise) of a trial over its records."""
    if not details or any(result is None for result in details):
        return None
    known = [result for result in details if result is not None]
    return (mean([result.delay for result in known]),
            math.sqrt(mean([result.noise ** 2 for result in known])))


def _check_reference(chosen: Sequence[Record], results: Sequence[Result | None]) -> None:
    """A smoother that is no better than what it should judge must not choose."""
    for record, result in zip(chosen, results):
        if (result is not None and record.origin == SMOOTHER
                and result.error <= CLEARLY * record.uncertainty):
            raise UserError(
                f'{record.bag}, {record.joint}: no truth, and the bag is too coarse to judge: the '
                f'reference may be wrong by {number(record.uncertainty, 2)} rad/s, the best '
                f'estimate differs from it by {number(result.error, 2)}; tune on a recording with '
                'a truth or with more counts')


def _check_effect(found: Search, dimensions: Sequence[Dimension]) -> None:
    """Raises UserError if a gain was varied and the data never felt it."""
    errors = [[result.error for result in trial.details] for trial in found.trials
              if trial.details and None not in trial.details]
    if len(errors) < 3:
        return
    low, high = np.min(errors, axis=0), np.max(errors, axis=0)
    if np.all(high - low <= SAME * np.maximum(high, 1.0)):
        names = ' nor '.join(f"'{each.name}'" for each in dimensions)
        raise UserError(f'nothing in these bags depends on {names}: hold it with --set, or tune '
                        'on a bag with motion')


def _groups(found: Sequence[Record], per_joint: bool) -> dict[str, list[Record]]:
    if not per_joint:
        return {'': list(found)}
    groups: dict[str, list[Record]] = {}
    for record in found:
        groups.setdefault(record.joint, []).append(record)
    return groups


def _weights(parsed: argparse.Namespace) -> Weights:
    if not parsed.weights:
        return PREFERENCES[parsed.prefer]
    try:
        values = [float(text) for text in parsed.weights.split(',')]
    except ValueError:
        values = []
    if len(values) != 3 or min(values) < 0.0 or not 0.0 < sum(values) < math.inf:
        raise UsageError(f"--weights '{parsed.weights}' must be three numbers of 0 or more, as in "
                         '1,0.5,0')
    return Weights(*values)


def _dimensions(observer: Any, asked: Sequence[str], fixed: Mapping[str, Any]) -> list[Dimension]:
    known = declared(observer.gains)
    found = {}
    for text in asked:
        name, _, ends = text.partition('=')
        low, colon, high = ends.partition(':')
        if name not in known:
            raise UsageError(f"unknown parameter '{name}' of {observer.name}: "
                             f'{suggestion(name, known)}')
        try:
            bounds = float(low), float(high)
        except ValueError:
            bounds = (math.nan, math.nan)
        if not colon or not -math.inf < bounds[0] < bounds[1] < math.inf:
            raise UsageError(f"--search '{text}' is not of the form GAIN=LOW:HIGH")
        for value in bounds:
            known[name].check(value)
        found[name] = Dimension(name, *bounds)
    if not asked:
        found = {name: Dimension(name, *each.search) for name, each in known.items()
                 if each.search is not None}
    found = {name: each for name, each in found.items() if name not in fixed}
    if not found:
        raise UsageError(f"nothing to seek: '{observer.name}' names no gains for it, or --set "
                         'holds them all; name some with --search')
    return list(found.values())


def _start(observer: str, fixed: Mapping[str, Any], dimensions: Sequence[Dimension]
           ) -> dict[str, float]:
    """Where to begin: at the defaults within the search, in its middle where there is none."""
    known = declared(registry.find(registry.OBSERVERS, observer).gains)
    found = {}
    for each in dimensions:
        default = known[each.name].default
        found[each.name] = (each.value(0.5) if default is None
                            else min(max(float(default), each.low), each.high))
    return found


def _defaults(observer: str, dimensions: Sequence[Dimension]) -> dict[str, float | None]:
    """The defaults of what is sought; None: it follows from other parameters."""
    known = declared(registry.find(registry.OBSERVERS, observer).gains)
    return {each.name: known[each.name].default for each in dimensions}


@contextmanager
def _bar(label: str, trials: int) -> Iterator[Any]:
    """A progress bar with the best so far, where a person looks."""
    if not sys.stderr.isatty():
        yield lambda count, found: None
        return
    from rich import progress as rich
    from rich.console import Console
    with rich.Progress(rich.TextColumn('{task.description}'), rich.BarColumn(),
                       rich.MofNCompleteColumn(), rich.TextColumn('{task.fields[best]}'),
                       console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=trials, best='')

        def told(count: int, found: Search) -> None:
            best = found.best
            text = '' if best is None else (
                f'best {best.cost:.3f} of the defaults: '
                + ', '.join(f'{name} {value:.4g}' for name, value in best.values.items()))
            bar.update(task, advance=count, best=text)

        yield told


def describe(tuned: Sequence[Mapping[str, Any]]) -> str:
    """What was found, before and after, on what was held out."""
    rows = []
    for each in tuned:
        for label, gains, result in (('defaults', each['default_gains'], each['default']),
                                     ('tuned', each['gains'], each['best'])):
            text = ', '.join(f'{name} ' + ('-' if value is None else f'{value:.4g}')
                             for name, value in gains.items())
            cells = ['-'] * 4 if result is None else [
                number(result['error'], 4), number(result['delay_s'] * 1e3, 3),
                number(result['noise'], 3), number(result['cost'], 4)]
            rows.append((each['joint'] or 'all joints', label, text, *cells))
    judged = ('the part held out' if all(each['held_out'] for each in tuned)
              else 'the part that was tuned on: nothing was held out')
    text = (f'on {judged}, after {sum(each["evaluations"] for each in tuned)} trials\n'
            + table(('joint', '', 'gains', 'error rad/s', 'delay ms', 'noise rad/s', 'cost'), rows,
                    left=3))
    for each in tuned:
        if tune_output.worse(each):
            text += f'\n{each["joint"] or "all joints"}: {tune_output.WORSE}'
    if any(each['interrupted'] for each in tuned):
        text += '\ninterrupted: these are the best gains so far'
    return text


COMMAND = Command('gains from recorded bags, as a YAML that the node loads', arguments, run)
