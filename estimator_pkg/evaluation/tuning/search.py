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
Ranges = dict[str, Any]  # distributions of Optuna by gain


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
    ranges: Ranges,
    start: Mapping[str, GainValue],
    judge: Callable[[list[dict[str, GainValue]]], list[Trial]],
    trials: int,
    seed: int = 0,
    report: Callable[[int, Search], None] = lambda count, so_far: None,
) -> Search:
    """Search the gains with the lowest cost.

    Parameters
    ----------
    ranges : of the gains. start : start values of the gains.
    judge : a batch of gains -> the trial of each, in the same order.
    trials : largest number of trials.
    report : called after each batch with the number of new trials.
    """
    sampler, found = _sampler(seed), Search()
    begin = {name: start[name] for name in ranges}
    first = [begin]
    if len(ranges) > 1:
        first += [{**begin, name: _moved(each, begin[name])} for name, each in ranges.items()]
    try:
        while len(found.trials) < trials:
            size = min(BATCH, trials - len(found.trials))
            points = first[:size] if not found.trials else []
            points += _suggested(sampler, ranges, found, trials, size - len(points))
            found.trials += judge(points)
            if len(found.trials) == size > len(ranges) > 1:
                changed = zip(ranges, found.trials[1:])
                idle = [name for name, each in changed if alike([found.trials[0], each])]
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
    sampler: Any, ranges: Ranges, found: Search, trials: int, count: int
) -> list[dict[str, GainValue]]:
    """Return `count` gains that the sampler suggests; the last of all `trials` near the best."""
    import optuna

    study = optuna.create_study(sampler=sampler)
    for trial in found.trials:
        values = {name: trial.values[name] for name in ranges}
        known = {'params': values, 'distributions': ranges, 'value': trial.cost}
        study.add_trial(optuna.trial.create_trial(**known))
    widths = [width for part, width in NARROWED.items() if len(found.trials) >= part * trials]
    if widths and found.best is not None:
        best = found.best.values
        ranges = {name: _around(each, best[name], widths[-1]) for name, each in ranges.items()}
    return [study.ask(ranges).params for _ in range(count)]


def _around(gain: Any, value: GainValue, width: float) -> Any:
    """Return the part of a range around a value, of this fraction of its width; choices as is."""
    if hasattr(gain, 'choices'):
        return gain
    start = min(max(_part(gain, value) - 0.5 * width, 0.0), 1.0 - width)
    return type(gain)(at(gain, start), at(gain, start + width), log=gain.log)


def _moved(gain: Any, value: GainValue) -> GainValue:
    """Return another value of the range, at a distance of `EFFECT_STEP`."""
    part = _part(gain, value)
    return at(gain, part + EFFECT_STEP if part + EFFECT_STEP <= 1.0 else part - EFFECT_STEP)


def at(gain: Any, part: float) -> GainValue:
    """Return the value at this part of a range, from 0 (its low end) to 1."""
    if hasattr(gain, 'choices'):
        return str(gain.choices[int(min(part, 0.999) * len(gain.choices))])
    if gain.log:
        return min(max(gain.low * (gain.high / gain.low) ** part, gain.low), gain.high)
    return gain.low + part * (gain.high - gain.low)


def _part(gain: Any, value: GainValue) -> float:
    """Return the inverse of `at`; the middle of a choice."""
    if hasattr(gain, 'choices'):
        return (gain.choices.index(value) + 0.5) / len(gain.choices)
    if gain.log:
        return math.log(float(value) / gain.low) / math.log(gain.high / gain.low)
    return (float(value) - gain.low) / (gain.high - gain.low)
