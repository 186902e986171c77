# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find the best gains for a group of records, and validate them on held-out data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator_pkg import interrupts
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.options import SMOOTHER
from estimator_pkg.evaluation.reference.reference import CLEARLY
from estimator_pkg.evaluation.text import number
from estimator_pkg.evaluation.tuning.bar import bar
from estimator_pkg.evaluation.tuning.objective import (
    Part,
    Result,
    Results,
    Weights,
    costs,
    mean,
    measure,
)
from estimator_pkg.evaluation.tuning.records import Record
from estimator_pkg.evaluation.tuning.search import Search, search
from estimator_pkg.evaluation.tuning.settings import TuneSettings
from estimator_pkg.evaluation.tuning.study import Trial, Value
from estimator_pkg.evaluation.workers import Map

COMPILE_FROM = 400_000  # number of samples over all trials from which compiling pays
SAME = 1e-6  # errors this close are equal [relative, or rad/s]

Details = Sequence[Results | None]  # of a trial, by part


def seek(
    joint: str,
    chosen: Sequence[Record],
    judged: Sequence[Record],
    tuning: TuneSettings,
    trials: int,
    seed: int,
    storage: str | None,
    study: str,
    run_many: Map,
) -> dict[str, Any]:
    """Return the best gains for these records, as a dictionary for output and JSON.

    Parameters
    ----------
    joint : the joint of these gains; '' : all.
    judged : records for validation; empty: the held-out parts of those chosen.
    study : its name in the storage.

    Raises
    ------
    UserError : no gains work; the reference is too inaccurate; no gain has an effect.
    """
    observer, weights = tuning.entry.observer, tuning.weights
    seen = [record.seen for record in chosen]
    fast = sum(part.recording.size() for part in seen) * trials >= COMPILE_FROM
    first = list(run_many(measure, [(part, observer, {}, fast) for part in seen]))
    units = [
        {
            name: value if math.isfinite(value) and value > 0.0 else 1.0
            for name, value in costs(result, part, weights).items()
        }
        for result, part in zip(first, seen)
    ]

    def judge(batch: list[dict[str, Value]]) -> list[tuple[float, Any]]:
        results = list(
            run_many(measure, [(part, observer, values, fast) for values in batch for part in seen])
        )
        judged_ = []
        for index in range(len(batch)):
            details = results[index * len(seen) : (index + 1) * len(seen)]
            judged_.append((_total(details, seen, weights, units), details))
        return judged_

    with bar(f'{observer} {joint}'.strip(), trials) as report:
        found = search(
            tuning.dimensions,
            tuning.start(),
            judge,
            trials,
            seed,
            storage,
            study,
            report,
            about=_about(chosen, tuning),
            same=_same,
        )
    best = found.best
    if best is None:
        if found.interrupted:
            raise KeyboardInterrupt
        raise UserError(
            f"no gains of '{observer}' in the search ranges work on these bags: widen "
            '--search, or check the sample rate'
        )
    interrupts.finish()  # validation takes as long as one trial
    _check_effect(found, tuning)
    idle = found.idle
    gains = {name: value for name, value in best.values.items() if name not in idle}
    held = [record.held_out for record in chosen if record.held_out is not None]
    parts = [record.seen for record in judged] or held or seen
    default, better = (
        [measure(part, observer, values, fast) for part in parts] for values in ({}, gains)
    )
    _check_reference(
        chosen, best.details or [measure(part, observer, gains, fast) for part in seen]
    )
    points = _points([first, *(trial.details for trial in found.trials)])
    return {
        'joint': joint,
        'gains': gains,
        'default_gains': {
            name: value for name, value in tuning.defaults().items() if name not in idle
        },
        'idle': idle,
        'default_point': points[0],
        'relative_cost': best.cost,
        'evaluations': found.asked,
        'interrupted': found.interrupted,
        'held_out': bool(held or judged),
        'judged_on': sorted({record.bag for record in judged}),
        'default': _summary(default, parts, weights),
        'best': _summary(better, parts, weights),
        'bags': sorted({record.bag for record in chosen}),
        'joints': sorted({joint for record in chosen for joint in record.joints}),
        'trials': [
            (trial.values, trial.cost, point) for trial, point in zip(found.trials, points[1:])
        ],
    }


def _about(chosen: Sequence[Record], tuning: TuneSettings) -> str:
    """Return everything but the gains that the costs depend on, for a storage."""
    parts = [f'{record.bag}:{record.label}:{record.seen.recording.size()}' for record in chosen]
    return (
        f'{tuning.entry.observer} {sorted(tuning.held.items())} {tuning.weights} {" ".join(parts)}'
    )


def _total(
    results: Details, parts: Sequence[Part], weights: Weights, units: Sequence[Mapping[str, float]]
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


def _summary(results: Details, parts: Sequence[Part], weights: Weights) -> dict[str, Any] | None:
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
    delays = [result.delay for result, _ in pairs if math.isfinite(result.delay)]
    return {
        'error': math.sqrt(mean([result.error**2 for result, _ in pairs])),
        'delay_s': mean(delays) if delays else math.nan,
        'noise': math.sqrt(mean([result.noise**2 for result, _ in pairs])),
        'published': mean([result.published for result, _ in pairs]),
        'cost': mean([worth for _, worth in pairs]),
    }


def _points(trials: Sequence[Details | None]) -> list[tuple[float, float] | None]:
    """Return (delay, noise) of each trial over its records; None without a delay.

    A record that never has a delay (constant speed) is ignored.
    """
    every = [_flat(details) for details in trials]
    delays = np.array([[abs(one.delay) for one in results] for results in every if results])
    telling = np.isfinite(delays).any(axis=0) if delays.size else np.zeros(0, bool)
    found: list[tuple[float, float] | None] = []
    for results in every:
        late = np.array([abs(one.delay) for one in results])[telling] if results else np.zeros(0)
        if not len(late) or not np.isfinite(late).all():
            found.append(None)
        else:
            found.append((float(np.mean(late)), math.sqrt(mean([one.noise**2 for one in results]))))
    return found


def _flat(details: Details | None) -> list[Result]:
    """Return the results of all records and joints; none if one is missing."""
    if not details or None in details:
        return []
    return [one for result in details if result is not None for one in result.values()]


def _check_reference(chosen: Sequence[Record], results: Details) -> None:
    """A smoother that is no better than what it should judge must not choose."""
    for record, result in zip(chosen, results):
        for joint, one in (result or {}).items():
            if (
                record.origin[joint] == SMOOTHER
                and one.error <= CLEARLY * record.uncertainty[joint]
            ):
                raise UserError(
                    f'{record.bag}, {joint}: no truth, and the bag is too coarse to judge: the '
                    f'reference may be wrong by {number(record.uncertainty[joint], 2)} rad/s, the '
                    f'best estimate differs from it by {number(one.error, 2)}; tune on a recording '
                    'with a truth or with more counts'
                )


def _check_effect(found: Search, tuning: TuneSettings) -> None:
    """Raises UserError if the gains were varied and the data never felt it."""
    working = [trial for trial in found.trials if _works(trial)]
    if len(working) >= 3 and _alike(working):
        names = ' nor '.join(f"'{each.name}'" for each in tuning.dimensions)
        raise UserError(
            f'nothing in these bags depends on {names}: hold it with --set, or tune '
            'on a bag with motion'
        )


def _same(one: Trial, other: Trial) -> bool:
    return _works(one) and _works(other) and _alike([one, other])


def _works(trial: Trial) -> bool:
    return bool(_flat(trial.details))


def _alike(trials: Sequence[Trial]) -> bool:
    """Return True if these trials gave the same errors."""
    errors = np.array(
        [[one.error for result in trial.details for one in result.values()] for trial in trials]
    )
    low, high = np.min(errors, axis=0), np.max(errors, axis=0)
    return bool(np.all(high - low <= SAME * np.maximum(high, 1.0)))
