# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find the best gains for a group of records, and validate them on held-out data.

Without a name, the best linear observer is tuned; it must then be better than the default observer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from estimator_pkg import interrupts
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.evaluation.text import number
from estimator_pkg.evaluation.tuning.objective import (
    Compared,
    Dataset,
    Errors,
    ErrorsByJoint,
    averaged_errors,
    compared,
    mean,
    measure,
    relative,
)
from estimator_pkg.evaluation.tuning.records import TuningRecord
from estimator_pkg.evaluation.tuning.search import GainValue, Search, Trial, alike, search
from estimator_pkg.evaluation.tuning.settings import Settings
from estimator_pkg.evaluation.workers import Map
from estimator_pkg.parameters import declared
from estimator_pkg.progress import progress
from estimator_pkg.streams.angle import AngleSettings

DEFAULT = AngleSettings.observer
BANDWIDTH = 'bandwidth_hz'  # the gain of a linear observer
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


def kept(joint: str, chosen: Sequence[TuningRecord], why: str = '') -> Tuned:
    """Return the result where the defaults stay without a search."""
    return Tuned(
        joint,
        sorted({record.bag for record in chosen}),
        sorted({joint for record in chosen for joint in record.joints}),
        _quanta(chosen),
        list(dict.fromkeys(each for record in chosen for each in record.cautions)),
        why,
    )


def tune(
    joint: str,
    chosen: Sequence[TuningRecord],
    judged: Sequence[TuningRecord],
    settings: Settings,
    run_many: Map,
    any_observer: bool = False,
) -> Tuned:
    """Return the best gains for these records.

    Parameters
    ----------
    joint : the joint of these gains; '' : all.
    judged : records for validation; empty: the held-out parts of those chosen.
    any_observer : compare them with the default observer, too.

    Raises
    ------
    KeyboardInterrupt : before any gains work.
    """
    fit = [record for record in chosen if not record.why]
    if not fit:
        return kept(joint, chosen, '; '.join(dict.fromkeys(record.why for record in chosen)))
    tuned = kept(joint, fit)
    seen = [record.seen for record in fit]
    found = _search(joint, seen, settings, run_many)
    tuned.evaluations, tuned.interrupted = len(found.trials), found.interrupted
    best = found.best
    if best is None:
        if found.interrupted:
            raise KeyboardInterrupt
        tuned.why = (
            f"no gains of '{settings.entry.observer}' in the search ranges work on these bags: "
            'widen --search, or check the sample rate'
        )
        return tuned
    interrupts.finish()  # validation takes as long as one trial
    if len(found.working) >= 3 and alike(found.working):
        names = ' nor '.join(f"'{name}'" for name in settings.ranges)
        tuned.why = f'nothing in these bags depends on {names}'
        return tuned
    held = [record.held_out for record in fit if record.held_out is not None]
    gains = {name: rounded(value) for name, value in best.values.items() if name not in found.idle}
    tuned.tried, tuned.idle, tuned.relative_cost = gains, found.idle, best.cost
    tuned.default_gains = {name: settings.defaults()[name] for name in gains}
    tuned.held_out = bool(held or judged)
    tuned.judged_on = sorted({record.bag for record in judged})
    _validate(tuned, [record.seen for record in judged] or held or seen, settings, any_observer)
    return tuned


def _search(joint: str, seen: Sequence[Dataset], settings: Settings, run_many: Map) -> Search:
    """Return the trials on these parts of records."""
    observer = settings.entry.observer

    def measured(batch: Sequence[Mapping[str, Any]]) -> list[list[ErrorsByJoint]]:
        jobs = [(part, observer, values, settings.weights) for values in batch for part in seen]
        results = list(run_many(measure, jobs))
        return [results[k : k + len(seen)] for k in range(0, len(results), len(seen))]

    def judge(batch: list[dict[str, GainValue]]) -> list[Trial]:
        return [
            Trial(
                values,
                relative(results, units),
                tuple(one.error for each in results for one in each.values() if all(results)),
            )
            for values, results in zip(batch, measured(batch))
        ]

    def report(count: int, so_far: Search) -> None:
        best = f': best cost {so_far.best.cost:.3f} of that of the defaults' if so_far.best else ''
        advance(count, f'{label}{best}')

    (units,) = measured([{}])
    label = f'{observer} {joint}'.strip()
    with progress(label, settings.trials) as advance:
        return search(
            settings.ranges, settings.start(), judge, settings.trials, settings.seed, report
        )


def _validate(
    tuned: Tuned, parts: Sequence[Dataset], settings: Settings, any_observer: bool
) -> None:
    """Compare the gains that were found with the defaults, and decide which are used."""
    observer, weights = settings.entry.observer, settings.weights
    tuned.default, tuned.best = (
        _summary([measure(part, observer, values, weights) for part in parts])
        for values in ({}, tuned.tried)
    )
    pair = compared(parts, observer, tuned.tried, weights)
    tuned.pair = None if pair is None else pair._asdict()
    tuned.why = why_defaults(pair, tuned.default, tuned.best)
    tuned.gains = {} if tuned.why else tuned.tried
    tuned.delay_known = tuned.default is not None and math.isfinite(tuned.default['delay_s'])
    if not any_observer:
        return
    own = f'{observer} {"with these gains" if tuned.gains else "at its defaults"}'
    if not tuned.delay_known:  # noise alone would decide
        tuned.against = f'the motion shows no delay, so {DEFAULT} stays, the default observer'
        return
    versus = compared(parts, observer, tuned.gains, weights, DEFAULT)
    if versus is None:
        tuned.against = (
            f'too few estimates for comparing {own} with {DEFAULT}, the default observer'
        )
        return
    tuned.versus = versus._asdict()
    tuned.against = versus.text(own, f'{DEFAULT}, the default observer as it is,')


def why_defaults(
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


def best_linear(seen: Sequence[TuningRecord], settings: Settings) -> str:
    """Return the linear observer whose defaults cost least on the data of the search."""
    linear = [
        name
        for name in angle_observers()
        if name != DEFAULT and BANDWIDTH in declared(type(Entry('', name).joint().observer.gains()))
    ]

    def measured(name: str) -> list[ErrorsByJoint]:
        return [measure(record.seen, name, {}, settings.weights) for record in seen]

    units = measured(DEFAULT)
    return min(linear, key=lambda name: relative(measured(name), units))


def replaces_default(versus: Sequence[Compared]) -> bool:
    """Return True if the mean over these comparisons is for the tuned observer (`chosen`)."""
    if not versus:
        return False
    difference = math.expm1(mean([math.log1p(pair.difference / 100.0) for pair in versus]))
    return Compared(max(pair.sign for pair in versus), 100.0 * difference, 0.0).used


def rounded(value: Any) -> Any:
    """Return a gain rounded to six digits, as it is validated and written."""
    return value if isinstance(value, str) else float(f'{value:.6g}')


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


def _summary(results: Sequence[ErrorsByJoint]) -> dict[str, Any] | None:
    """Return the mean errors over all parts and joints, and by joint; None if a part fails."""
    if not all(results):
        return None
    by_joint: dict[str, list[Errors]] = {}
    for result in results:
        for joint, one in result.items():
            by_joint.setdefault(joint, []).append(one)
    every = averaged_errors([one for each in by_joint.values() for one in each])
    means = {joint: averaged_errors(each)._asdict() for joint, each in by_joint.items()}
    return {**every._asdict(), 'by_joint': means}
