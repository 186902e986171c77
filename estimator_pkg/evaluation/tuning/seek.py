# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find the best gains for a group of records, and validate them on held-out data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from estimator_pkg import interrupts
from estimator_pkg.evaluation.text import number
from estimator_pkg.evaluation.tuning.any_observer import against_default
from estimator_pkg.evaluation.tuning.objective import (
    Compared,
    Dataset,
    ErrorsByJoint,
    JointErrors,
    Weights,
    compared,
    costs,
    mean,
    measure,
)
from estimator_pkg.evaluation.tuning.output import written
from estimator_pkg.evaluation.tuning.records import TuningRecord
from estimator_pkg.evaluation.tuning.search import GainValue, Search, Trial, alike, search
from estimator_pkg.evaluation.tuning.settings import TuneSettings
from estimator_pkg.evaluation.workers import Map
from estimator_pkg.progress import progress

QUANTUM_TOLERANCE = 0.01  # quanta of a joint in several bags agree within this fraction


@dataclass
class Tuned:
    """The gains of a joint ('' : of all) and how they compare with the defaults; see ``--json``.

    gains : those to use; empty where the defaults stay, because of `why`. tried : those that the
    search found. pair : of `Compared`. default, best : errors and costs of both.
    against, versus : the comparison with the default observer, in words and as `pair`.
    """

    joint: str
    bags: list[str]
    joints: list[str]
    quanta: dict[str, float]
    cautions: list[str]
    why: str = ''
    gains: dict[str, GainValue] = field(default_factory=dict)
    tried: dict[str, GainValue] = field(default_factory=dict)
    default_gains: dict[str, GainValue | None] = field(default_factory=dict)
    idle: list[str] = field(default_factory=list)
    pair: dict[str, Any] | None = None
    delay_known: bool = False
    relative_cost: float = 1.0
    evaluations: int = 0
    interrupted: bool = False
    held_out: bool = False
    judged_on: list[str] = field(default_factory=list)
    default: dict[str, Any] | None = None
    best: dict[str, Any] | None = None
    against: str = ''
    versus: dict[str, Any] | None = None


def kept(
    joint: str, chosen: Sequence[TuningRecord], why: str, found: Search | None = None
) -> Tuned:
    """Return the result where the defaults stay without a comparison."""
    found = found or Search()
    return Tuned(
        joint,
        sorted({record.bag for record in chosen}),
        sorted({joint for record in chosen for joint in record.joints}),
        _quanta(chosen),
        list(dict.fromkeys(each for record in chosen for each in record.cautions)),
        why,
        evaluations=len(found.trials),
        interrupted=found.interrupted,
    )


def seek(
    joint: str,
    chosen: Sequence[TuningRecord],
    judged: Sequence[TuningRecord],
    tuning: TuneSettings,
    run_many: Map,
    any_observer: bool = False,
) -> Tuned:
    """Return the best gains for these records.

    Parameters
    ----------
    joint : the joint of these gains; '' : all.
    judged : records for validation; empty: the held-out parts of those chosen.
    any_observer : compare them with the default observer, too.
    """
    observer, weights = tuning.entry.observer, tuning.weights
    seen = [record.seen for record in chosen]

    def measured(batch: Sequence[Mapping[str, Any]]) -> list[list[ErrorsByJoint | None]]:
        jobs = [(part, observer, values) for values in batch for part in seen]
        results = list(run_many(measure, jobs))
        return [results[k : k + len(seen)] for k in range(0, len(results), len(seen))]

    (first,) = measured([{}])
    units = [costs(result, part, weights) for result, part in zip(first, seen)]

    def judge(batch: list[dict[str, GainValue]]) -> list[Trial]:
        return [
            Trial(values, _relative(results, seen, weights, units), _errors(results))
            for values, results in zip(batch, measured(batch))
        ]

    label = f'{observer} {joint}'.strip()
    with progress(label, tuning.trials) as advance:
        found = search(
            tuning.ranges,
            tuning.start(),
            judge,
            tuning.trials,
            tuning.seed,
            lambda count, so_far: advance(count, f'{label}{_so_far(so_far)}'),
        )
    best = found.best
    if best is None:
        if found.interrupted:
            raise KeyboardInterrupt
        return kept(
            joint,
            chosen,
            f"no gains of '{observer}' in the search ranges work on these bags: widen "
            '--search, or check the sample rate',
            found,
        )
    interrupts.finish()  # validation takes as long as one trial
    if len(found.working) >= 3 and alike(found.working):
        names = ' nor '.join(f"'{name}'" for name in tuning.ranges)
        return kept(joint, chosen, f'nothing in these bags depends on {names}', found)
    gains = {name: rounded(value) for name, value in best.values.items() if name not in found.idle}
    held = [record.held_out for record in chosen if record.held_out is not None]
    parts = [record.seen for record in judged] or held or seen
    default, better = (
        _summary([measure(part, observer, values) for part in parts], parts, weights)
        for values in ({}, gains)
    )
    pair = compared(parts, observer, gains, weights)
    tuned = kept(joint, chosen, _why(pair, default, better), found)
    tuned.gains, tuned.tried = {} if tuned.why else gains, gains
    tuned.default_gains = {name: tuning.defaults()[name] for name in gains}
    tuned.idle, tuned.relative_cost = found.idle, best.cost
    tuned.pair = None if pair is None else pair._asdict()
    tuned.delay_known = default is not None and math.isfinite(default['delay_s'])
    tuned.held_out = bool(held or judged)
    tuned.judged_on = sorted({record.bag for record in judged})
    tuned.default, tuned.best = default, better
    if any_observer:
        pair, tuned.against = against_default(parts, tuned.gains, tuning, tuned.delay_known)
        tuned.versus = None if pair is None else pair._asdict()
    return tuned


def rounded(value: Any) -> Any:
    """Return a gain rounded to six digits, as it is validated and written."""
    return value if isinstance(value, str) else float(f'{value:.6g}')


def _so_far(found: Search) -> str:
    """Return the best trial as text for the progress bar."""
    if found.best is None:
        return ''
    gains = ', '.join(f'{name} {written(value)}' for name, value in found.best.values.items())
    return f': best cost {found.best.cost:.3f} of that of the defaults: {gains}'


def _quanta(chosen: Sequence[TuningRecord]) -> dict[str, float]:
    """Return the quantum of each joint's readings [rad]; a joint whose bags differ has none."""
    found: dict[str, list[float]] = {}
    for record in chosen:
        for joint, value in record.quanta.items():
            found.setdefault(joint, []).append(value)
    return {
        joint: rounded(values[0])
        for joint, values in found.items()
        if 0.0 < max(values) <= (1.0 + QUANTUM_TOLERANCE) * min(values)
    }


def _why(
    pair: Compared | None, default: Mapping[str, Any] | None, best: Mapping[str, Any] | None
) -> str:
    """Return why the defaults stay; '' if the tuned gains are used."""
    if best is None:
        return 'the tuned gains do not work on held-out data'
    if default is None:
        return ''
    if pair is None:
        return 'there are too few estimates on held-out data'
    if float(number(best['cost'])) >= float(number(default['cost'])):
        return 'the tuned gains cost no less than the defaults'
    return '' if pair.used else pair.text()


def _relative(
    results: Sequence[ErrorsByJoint | None],
    parts: Sequence[Dataset],
    weights: Weights,
    units: Sequence[Mapping[str, float]],
) -> float:
    """Return the mean over parts and joints of the cost over that of the defaults; inf if one
    fails.
    """
    return mean(
        [
            value / unit[joint] if 0.0 < unit[joint] < math.inf else value
            for result, part, unit in zip(results, parts, units)
            for joint, value in costs(result, part, weights).items()
        ]
    )


def _errors(results: Sequence[ErrorsByJoint | None]) -> tuple[float, ...]:
    """Return the errors of all parts and joints [rad/s]; none if a part fails."""
    if None in results:
        return ()
    return tuple(one.error for result in results if result for one in result.values())


def _summary(
    results: Sequence[ErrorsByJoint | None], parts: Sequence[Dataset], weights: Weights
) -> dict[str, Any] | None:
    """Return error, delay, noise and cost over all parts and joints, and by joint."""
    if None in results:
        return None
    by_joint: dict[str, list[tuple[JointErrors, float]]] = {}
    for result, part in zip(results, parts):
        worth = costs(result, part, weights)
        for joint, one in (result or {}).items():
            by_joint.setdefault(joint, []).append((one, worth[joint]))
    every = [pair for pairs in by_joint.values() for pair in pairs]
    return {**_of(every), 'by_joint': {joint: _of(pairs) for joint, pairs in by_joint.items()}}


def _of(pairs: Sequence[tuple[JointErrors, float]]) -> dict[str, float]:
    known = [result for result, _ in pairs if math.isfinite(result.half)]
    some = bool(known)
    return {
        'error': math.sqrt(mean([result.error**2 for result, _ in pairs])),
        'delay_s': mean([each.delay for each in known]) if some else math.nan,
        'delay_95_s': math.hypot(*(each.half for each in known)) / len(known) if some else math.nan,
        'noise': math.sqrt(mean([result.noise**2 for result, _ in pairs])),
        'published': mean([result.published for result, _ in pairs]),
        'cost': mean([worth for _, worth in pairs]),
    }
