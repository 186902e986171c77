# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find the best gains for a group of records, and validate them on held-out data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator_pkg import interrupts
from estimator_pkg.evaluation.text import number
from estimator_pkg.evaluation.tuning.held_out import Compared, compared
from estimator_pkg.evaluation.tuning.objective import (
    Dataset,
    ErrorsByJoint,
    JointErrors,
    Weights,
    costs,
    mean,
    measure,
)
from estimator_pkg.evaluation.tuning.output import written
from estimator_pkg.evaluation.tuning.records import TuningRecord
from estimator_pkg.evaluation.tuning.search import GainValue, Search, Trial, search
from estimator_pkg.evaluation.tuning.settings import TuneSettings
from estimator_pkg.evaluation.workers import Map
from estimator_pkg.progress import progress

QUANTUM_TOLERANCE = 0.01  # quanta of a joint in several bags agree within this fraction
ERROR_TOLERANCE = 1e-6  # errors this close are equal [relative, or rad/s]

Details = Sequence[ErrorsByJoint | None]  # of a trial, by part


def seek(
    joint: str,
    chosen: Sequence[TuningRecord],
    judged: Sequence[TuningRecord],
    tuning: TuneSettings,
    run_many: Map,
) -> dict[str, Any]:
    """Return the best gains for these records, as a dictionary for output and JSON.

    Parameters
    ----------
    joint : the joint of these gains; '' : all.
    judged : records for validation; empty: the held-out parts of those chosen.

    The gains are those to use: empty where the search does not beat the defaults on held-out data
    (`why` has the reason, `tried` the gains that it found).
    """
    observer, weights = tuning.entry.observer, tuning.weights
    seen = [record.seen for record in chosen]
    first = list(run_many(measure, [(part, observer, {}) for part in seen]))
    units = [
        {
            name: value if math.isfinite(value) and value > 0.0 else 1.0
            for name, value in costs(result, part, weights).items()
        }
        for result, part in zip(first, seen)
    ]

    def judge(batch: list[dict[str, GainValue]]) -> list[tuple[float, Any]]:
        results = list(
            run_many(measure, [(part, observer, values) for values in batch for part in seen])
        )
        every = [results[k : k + len(seen)] for k in range(0, len(results), len(seen))]
        return [(_total(details, seen, weights, units), details) for details in every]

    label = f'{observer} {joint}'.strip()
    with progress(label, tuning.trials) as advance:
        found = search(
            tuning.ranges,
            tuning.start(),
            judge,
            tuning.trials,
            tuning.seed,
            lambda count, so_far: advance(count, f'{label}{_so_far(so_far)}'),
            same=lambda one, other: _alike([one, other]),
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
    working = [trial for trial in found.trials if _flat(trial.details)]
    if len(working) >= 3 and _alike(working):
        names = ' nor '.join(f"'{name}'" for name in tuning.ranges)
        return kept(joint, chosen, f'nothing in these bags depends on {names}', found)
    idle = found.idle
    gains = {name: rounded(value) for name, value in best.values.items() if name not in idle}
    held = [record.held_out for record in chosen if record.held_out is not None]
    parts = [record.seen for record in judged] or held or seen
    default, better = (
        _summary([measure(part, observer, values) for part in parts], parts, weights)
        for values in ({}, gains)
    )
    pair = compared(parts, observer, gains, weights)
    why = _why(pair, default, better, bool(held or judged))
    return {
        **kept(joint, chosen, why, found),
        'gains': {} if why else gains,
        'tried': gains,
        'pair': None if pair is None else pair._asdict(),
        'default_gains': {
            name: value for name, value in tuning.defaults().items() if name not in idle
        },
        'idle': idle,
        'delay_known': _delay_known([first, *(trial.details for trial in found.trials)]),
        'relative_cost': best.cost,
        'held_out': bool(held or judged),
        'judged_on': sorted({record.bag for record in judged}),
        'default': default,
        'best': better,
    }


def kept(
    joint: str, chosen: Sequence[TuningRecord], why: str, found: Search | None = None
) -> dict[str, Any]:
    """Return the result where the defaults stay without a comparison; keys as those of `seek`."""
    found = found or Search()
    return {
        'joint': joint,
        'gains': {},
        'tried': {},
        'why': why,
        'pair': None,
        'cautions': list(dict.fromkeys(each for record in chosen for each in record.cautions)),
        'quanta': _quanta(chosen),
        'default_gains': {},
        'idle': [],
        'delay_known': False,
        'relative_cost': 1.0,
        'evaluations': len(found.trials),
        'interrupted': found.interrupted,
        'held_out': False,
        'judged_on': [],
        'default': None,
        'best': None,
        'bags': sorted({record.bag for record in chosen}),
        'joints': sorted({joint for record in chosen for joint in record.joints}),
    }


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
    pair: Compared | None,
    default: Mapping[str, Any] | None,
    best: Mapping[str, Any] | None,
    held_out: bool,
) -> str:
    """Return why the defaults stay; '' if the tuned gains are used."""
    where = 'on held-out data' if held_out else 'on the data of the search'
    if best is None:
        return f'the tuned gains do not work {where}'
    if default is None:
        return ''
    if pair is None:
        return f'there are too few estimates {where}'
    if pair.difference == 0.0 == pair.resolution:
        return 'the search finds no better gains'
    if pair.used and best['cost'] <= default['cost']:
        if number(best['cost']) == number(default['cost']):
            return f'the tuned gains cost as much as the defaults {where}'
        return ''
    if pair.sign == 0 and pair.difference > -pair.resolution:
        within = number(max(abs(pair.difference), 0.0) + pair.resolution, 2)
        return (
            f'the tuned gains and the defaults cannot be distinguished {where}: within {within} %'
        )
    return f'the tuned gains do not beat the defaults {where}'


def _total(
    results: Details,
    parts: Sequence[Dataset],
    weights: Weights,
    units: Sequence[Mapping[str, float]],
) -> float:
    """Return the mean over records and joints of the cost over that of the defaults; inf if one
    fails.
    """
    return mean(
        [
            value / unit[joint]
            for result, part, unit in zip(results, parts, units)
            for joint, value in costs(result, part, weights).items()
        ]
    )


def _summary(results: Details, parts: Sequence[Dataset], weights: Weights) -> dict[str, Any] | None:
    """Return error, delay, noise and cost over all parts and joints, and by joint."""
    if any(result is None for result in results):
        return None
    by_joint: dict[str, list[tuple[Any, float]]] = {}
    for result, part in zip(results, parts):
        worth = costs(result, part, weights)
        for joint, one in (result or {}).items():
            by_joint.setdefault(joint, []).append((one, worth[joint]))
    every = [pair for pairs in by_joint.values() for pair in pairs]
    return {**_of(every), 'by_joint': {joint: _of(pairs) for joint, pairs in by_joint.items()}}


def _of(pairs: Sequence[tuple[Any, float]]) -> dict[str, float]:
    known = [result for result, _ in pairs if math.isfinite(result.half)]
    return {
        'error': math.sqrt(mean([result.error**2 for result, _ in pairs])),
        'delay_s': mean([each.delay for each in known]) if known else math.nan,
        'delay_95_s': math.hypot(*(each.half for each in known)) / len(known)
        if known
        else math.nan,
        'noise': math.sqrt(mean([result.noise**2 for result, _ in pairs])),
        'published': mean([result.published for result, _ in pairs]),
        'cost': mean([worth for _, worth in pairs]),
    }


def _delay_known(trials: Sequence[Details | None]) -> bool:
    """Return True if the motion determines the delay of the first trial.

    A record on which no trial has a delay (constant speed) is ignored.
    """
    every = [_flat(details) for details in trials]
    if not every[0]:
        return False
    known = np.isfinite([[one.delay for one in results] for results in every if results])
    telling = known.any(axis=0)
    return bool(telling.any() and known[0][telling].all())


def _flat(details: Details | None) -> list[JointErrors]:
    """Return the results of all records and joints; none if one is missing."""
    if not details or None in details:
        return []
    return [one for result in details if result is not None for one in result.values()]


def _alike(trials: Sequence[Trial]) -> bool:
    """Return True if these trials work, and gave the same errors."""
    every = [_flat(trial.details) for trial in trials]
    if not all(every):
        return False
    errors = np.array([[one.error for one in results] for results in every])
    low, high = np.min(errors, axis=0), np.max(errors, axis=0)
    return bool(np.all(high - low <= ERROR_TOLERANCE * np.maximum(high, 1.0)))
