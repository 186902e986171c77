# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The search for gains: an Optuna study, whose TPE sampler suggests the trials.

Trials run in batches of a fixed size and are recorded in a fixed order, so the result depends on
the seed and not on the number of workers. The first batch contains the defaults, and the defaults
with one gain changed at a time: a gain without effect there is no longer searched. The last trials
are near the best.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from estimator_pkg import interrupts

BATCH = 8
EFFECT_STEP = 0.3  # change of a gain that shows its effect, as a fraction of its range
NARROWED = {
    0.6: 0.25,
    0.8: 0.05,
}  # after this part of the trials: width around the best, as such a fraction

GainValue = float | str
Ranges = dict[str, Any]  # distributions of Optuna by gain


@dataclass
class Trial:
    """The gains of a trial and its cost, inf if they do not work."""

    values: dict[str, GainValue]
    cost: float
    details: Any = None


@dataclass
class Search:
    """All trials in order, and the best of them.

    idle : gains without effect; they are no longer searched.
    """

    trials: list[Trial] = field(default_factory=list)
    interrupted: bool = False
    idle: list[str] = field(default_factory=list)

    @property
    def best(self) -> Trial | None:
        """The trial with the lowest cost; None if none works."""
        working = [trial for trial in self.trials if math.isfinite(trial.cost)]
        return min(working, key=lambda trial: trial.cost) if working else None


def search(
    ranges: Ranges,
    start: Mapping[str, GainValue],
    judge: Callable[[list[dict[str, GainValue]]], list[tuple[float, Any]]],
    trials: int,
    seed: int = 0,
    report: Callable[[int, Search], None] = lambda count, so_far: None,
    same: Callable[[Trial, Trial], bool] = lambda one, other: False,
) -> Search:
    """Search the gains with the lowest cost.

    Parameters
    ----------
    ranges : of the gains. start : start values of the gains.
    judge : a batch of gains -> (cost, details) of each, in the same order.
    trials : largest number of trials.
    report : called after each batch with the number of new trials.
    same : whether two trials gave the same. A gain without effect at the start is dropped.
    """
    study = _study(seed)
    found = Search()
    try:
        while len(found.trials) < trials:
            size = min(BATCH, trials - len(found.trials))
            first = not found.trials
            if first:
                points = _first(ranges, start)[:size]
            else:
                points = _near(study.sampler, ranges, found, len(found.trials) / trials, size)
            suggested = [study.ask(ranges) for _ in range(size - len(points))]
            points += [trial.params for trial in suggested]
            for values, trial, (cost, details) in zip(
                points, [*[None] * (size - len(suggested)), *suggested], judge(points)
            ):
                if trial is None:
                    _add(study, ranges, Trial(values, cost))
                else:
                    study.tell(trial, cost)
                found.trials.append(Trial(values, cost, details))
            if first and size > len(ranges) > 1:
                begin, *changed = found.trials[: 1 + len(ranges)]
                idle = [name for name, each in zip(ranges, changed) if same(begin, each)]
                if len(idle) < len(ranges):  # else all are searched on
                    found.idle = idle
                    ranges = {name: each for name, each in ranges.items() if name not in idle}
            report(size, found)
            if interrupts.came():  # an exception may be lost during clean-up
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        interrupts.finish()
        found.interrupted = True
    return found


def _study(seed: int) -> Any:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # about experimental options
        sampler = optuna.samplers.TPESampler(
            seed=seed,
            multivariate=True,
            n_startup_trials=BATCH,
            n_ei_candidates=64,
            constant_liar=True,
            consider_magic_clip=False,  # narrow kernels: costs are smooth and free of noise
        )
    return optuna.create_study(sampler=sampler)


def _first(ranges: Ranges, start: Mapping[str, GainValue]) -> list[dict[str, GainValue]]:
    """Return the start, and, for several gains, the start with one gain changed at a time."""
    begin = {name: start[name] for name in ranges}
    if len(ranges) == 1:
        return [begin]
    return [begin, *({**begin, name: moved(each, begin[name])} for name, each in ranges.items())]


def _near(
    sampler: Any, ranges: Ranges, found: Search, done: float, count: int
) -> list[dict[str, GainValue]]:
    """Return gains near the best, by a study of their own; none before the parts `NARROWED`."""
    import optuna

    widths = [width for part, width in NARROWED.items() if done >= part]
    if not widths or found.best is None:
        return []
    near = {
        name: _around(each, found.best.values[name], widths[-1]) for name, each in ranges.items()
    }
    study = optuna.create_study(sampler=sampler)
    for trial in found.trials:
        _add(study, ranges, trial)
    return [study.ask(near).params for _ in range(count)]


def _add(study: Any, ranges: Ranges, trial: Trial) -> None:
    """Add a trial that another study, or nobody, suggested."""
    from optuna.trial import create_trial

    values = {name: trial.values[name] for name in ranges}
    study.add_trial(create_trial(params=values, distributions=ranges, value=trial.cost))


def _around(gain: Any, value: GainValue, width: float) -> Any:
    """Return the part of a range around a value, of this fraction of its width; choices as is."""
    if hasattr(gain, 'choices'):
        return gain
    into, back = (math.log, math.exp) if gain.log else (float, float)
    low, high, at = into(gain.low), into(gain.high), into(float(value))
    width *= high - low
    start = min(max(at - 0.5 * width, low), high - width)
    ends = max(back(start), gain.low), min(back(start + width), gain.high)
    return type(gain)(*ends, log=gain.log)


def moved(gain: Any, value: GainValue | None = None) -> GainValue:
    """Return a value at a distance of `EFFECT_STEP` from this one; without one, the middle."""
    choices = getattr(gain, 'choices', None)
    if choices:
        at = (len(choices) - 1) // 2 if value is None else choices.index(value) + 1
        return str(choices[at % len(choices)])
    into, back = (math.log, math.exp) if gain.log else (float, float)
    low, high = into(gain.low), into(gain.high)
    if value is None:
        return back(0.5 * (low + high))
    at, step = into(float(value)), EFFECT_STEP * (high - low)
    return back(at + step if at + step <= high else at - step)
