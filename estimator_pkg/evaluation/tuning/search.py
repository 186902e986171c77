# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The search for gains: trials that Optuna's TPE sampler suggests, in batches of a fixed size.

They are recorded in a fixed order, so the result depends on the seed and not on the number of
workers. The first batch has the defaults, and the defaults with one gain changed at a time: a gain
without effect there is no longer searched. The last trials are near the best.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg import interrupts

BATCH = 8
EFFECT_STEP = 0.3  # change of a gain that shows its effect, as a fraction of its range
NARROWED = {0.6: 0.25, 0.8: 0.05}  # after this part of the trials: width around the best
ERROR_TOLERANCE = 1e-6  # errors this close are equal [relative, or rad/s]

GainValue = float | str


class Range(NamedTuple):
    """The values of a gain that are searched: from `low` to `high`, or one of the choices.

    Optuna searches the part of the range, from 0 to 1. It is logarithmic if both ends are positive.
    """

    low: float = 0.0
    high: float = 1.0
    choices: tuple[str, ...] = ()

    def at(self, part: float) -> GainValue:
        """Return the value at this part of the range."""
        if self.choices:
            return self.choices[int(min(part, 0.999) * len(self.choices))]
        if self.low > 0.0:
            return min(max(self.low * (self.high / self.low) ** part, self.low), self.high)
        return self.low + part * (self.high - self.low)

    def part(self, value: GainValue) -> float:
        """Return the inverse of `at`; the middle of a choice."""
        if self.choices:
            return (self.choices.index(str(value)) + 0.5) / len(self.choices)
        number = float(value)
        if self.low > 0.0:
            part = math.log(number / self.low) / math.log(self.high / self.low)
        else:
            part = (number - self.low) / (self.high - self.low)
        return min(max(part, 0.0), 1.0)


class Trial(NamedTuple):
    """Gains, their cost (inf if they do not work), and their errors by part and joint [rad/s]."""

    values: dict[str, GainValue]
    cost: float
    errors: tuple[float, ...] = ()


@dataclass
class Search:
    """All trials in order; `idle` gains have no effect and are no longer searched."""

    trials: list[Trial] = field(default_factory=list)
    interrupted: bool = False
    idle: list[str] = field(default_factory=list)

    @property
    def working(self) -> list[Trial]:
        """The trials whose gains work."""
        return [trial for trial in self.trials if math.isfinite(trial.cost)]

    @property
    def best(self) -> Trial | None:
        """The trial with the lowest cost; None if none works."""
        return min(self.working, key=lambda trial: trial.cost, default=None)


def search(
    ranges: Mapping[str, Range],
    start: Mapping[str, GainValue],
    judge: Callable[[list[dict[str, GainValue]]], list[Trial]],
    trials: int,
    seed: int = 0,
    report: Callable[[int, Search], None] = lambda count, so_far: None,
) -> Search:
    """Search the gains with the lowest cost; Ctrl-C ends it with the best so far.

    Parameters
    ----------
    ranges : of the gains. start : start values of the gains.
    judge : a batch of gains -> the trial of each, in the same order.
    trials : largest number of trials.
    report : called after each batch with the number of new trials.
    """
    sampler, found = _sampler(seed), Search()
    points = [{name: start[name] for name in ranges}]
    if len(ranges) > 1:
        for name, each in ranges.items():
            part = each.part(start[name])
            moved = part + EFFECT_STEP if part + EFFECT_STEP <= 1.0 else part - EFFECT_STEP
            points.append({**points[0], name: each.at(moved)})
    try:
        while len(found.trials) < trials:
            size = min(BATCH, trials - len(found.trials))
            points = points[:size]
            points += _suggested(sampler, ranges, found, trials, size - len(points))
            found.trials += judge(points)
            if len(found.trials) == size > len(ranges) > 1:
                changed = zip(ranges, found.trials[1:])
                idle = [name for name, each in changed if alike([found.trials[0], each])]
                if len(idle) < len(ranges):  # else all are searched on
                    found.idle = idle
                    ranges = {name: each for name, each in ranges.items() if name not in idle}
            points = []
            report(size, found)
            if interrupts.came():  # an exception may be lost during clean-up
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        interrupts.finish()
        found.interrupted = True
    return found


def alike(trials: Sequence[Trial]) -> bool:
    """Return True if all these trials work, and gave the same errors."""
    if not all(trial.errors for trial in trials):
        return False
    errors = np.array([trial.errors for trial in trials])
    return np.allclose(errors, errors[0], ERROR_TOLERANCE, ERROR_TOLERANCE)


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


def _suggested(
    sampler: Any, ranges: Mapping[str, Range], found: Search, trials: int, count: int
) -> list[dict[str, GainValue]]:
    """Return `count` gains that the sampler suggests; the last of all `trials` near the best."""
    import optuna

    study = optuna.create_study(sampler=sampler)
    whole = dict.fromkeys(ranges, optuna.distributions.FloatDistribution(0.0, 1.0))
    for trial in found.trials:
        parts = {name: each.part(trial.values[name]) for name, each in ranges.items()}
        study.add_trial(
            optuna.trial.create_trial(params=parts, distributions=whole, value=trial.cost)
        )
    widths = [width for part, width in NARROWED.items() if len(found.trials) >= part * trials]
    near = whole
    if widths and found.best is not None:
        for name, each in ranges.items():
            width = 1.0 if each.choices else widths[-1]
            low = min(max(each.part(found.best.values[name]) - 0.5 * width, 0.0), 1.0 - width)
            near = {**near, name: optuna.distributions.FloatDistribution(low, low + width)}
    asked = (study.ask(near).params for _ in range(count))
    return [{name: ranges[name].at(part) for name, part in each.items()} for each in asked]
