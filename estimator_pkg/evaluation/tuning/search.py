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
    sampler, found = _sampler(seed), Search()
    try:
        while len(found.trials) < trials:
            size = min(BATCH, trials - len(found.trials))
            first = not found.trials
            points = _first(ranges, start)[:size] if first else []
            done = len(found.trials) / trials
            points += _suggested(sampler, ranges, found, done, size - len(points))
            for values, (cost, details) in zip(points, judge(points)):
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


def _sampler(seed: int) -> Any:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # about experimental options
        return optuna.samplers.TPESampler(
            seed=seed,
            multivariate=True,
            n_startup_trials=BATCH,
            n_ei_candidates=64,
            constant_liar=True,
            consider_magic_clip=False,  # narrow kernels: costs are smooth and free of noise
        )


def _first(ranges: Ranges, start: Mapping[str, GainValue]) -> list[dict[str, GainValue]]:
    """Return the start, and, for several gains, the start with one gain changed at a time."""
    begin = {name: start[name] for name in ranges}
    if len(ranges) == 1:
        return [begin]
    return [begin, *({**begin, name: moved(each, begin[name])} for name, each in ranges.items())]


def _suggested(
    sampler: Any, ranges: Ranges, found: Search, done: float, count: int
) -> list[dict[str, GainValue]]:
    """Return the gains that the sampler suggests after these trials; the last ones near the best.

    Parameters
    ----------
    done : the part of the trials that is behind.
    """
    import optuna

    study = optuna.create_study(sampler=sampler)
    for trial in found.trials:
        values = {name: trial.values[name] for name in ranges}
        known = {'params': values, 'distributions': ranges, 'value': trial.cost}
        study.add_trial(optuna.trial.create_trial(**known))
    widths = [width for part, width in NARROWED.items() if done >= part]
    if widths and found.best is not None:
        best = found.best.values
        ranges = {name: _around(each, best[name], widths[-1]) for name, each in ranges.items()}
    return [study.ask(ranges).params for _ in range(count)]


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
