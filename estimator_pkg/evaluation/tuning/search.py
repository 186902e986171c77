# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The search for gains: Optuna suggests and stores the trials, batch by batch.

Trials run in batches of a fixed size and are recorded in a fixed order, so the result depends on
the seed and not on the number of workers. The first batch contains the defaults, the defaults with
one gain changed at a time (which shows the effect of each gain), and points spread evenly over the
space. Later batches come half from Optuna's sampler and half from the minimum of a parabola through
the best trials, which makes few trials sufficient.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator_pkg import interrupts
from estimator_pkg.evaluation.tuning.study import BATCH, Dimension, Study, Trial, Value

EVEN = 2  # batches of evenly distributed points, before the parabola
NEAREST = 10  # smallest number of trials for the parabola
GOLDEN = 0.6180339887498949


@dataclass
class Search:
    """All trials in order, and the best of them.

    asked : number of trials of this run; a stored study has earlier ones.
    idle : gains without effect; they are no longer searched.
    """

    trials: list[Trial] = field(default_factory=list)
    asked: int = 0
    interrupted: bool = False
    idle: list[str] = field(default_factory=list)

    @property
    def best(self) -> Trial | None:
        """The trial with the lowest cost; None if none works."""
        working = [trial for trial in self.trials if math.isfinite(trial.cost)]
        return min(working, key=lambda trial: trial.cost) if working else None


def search(
    dimensions: Sequence[Dimension],
    start: Mapping[str, Value],
    judge: Callable[[list[dict[str, Value]]], list[tuple[float, Any]]],
    trials: int,
    seed: int = 0,
    storage: str | None = None,
    name: str = 'velocity_estimator',
    report: Callable[[int, Search], None] = lambda count, so_far: None,
    about: str = '',
    same: Callable[[Trial, Trial], bool] = lambda one, other: False,
) -> Search:
    """Search the gains with the lowest cost.

    Parameters
    ----------
    start : start values of the gains.
    judge : a batch of gains -> (cost, details) of each, in the same order.
    trials : largest number of trials.
    storage : of Optuna, a URL; None: in memory. An existing study of this name continues.
    report : called after each batch with the number of new trials.
    about : everything else that the costs depend on; a study of something else does not continue.
    same : whether two trials gave the same. A gain without effect at the start is dropped.

    Raises
    ------
    UserError : Optuna is missing, or the storage cannot be used.
    """
    study = Study(storage, name, seed, dimensions, about)
    found = Search(study.earlier())
    found.idle = [
        each.name
        for each in dimensions
        if any(each.name not in trial.values for trial in found.trials)
    ]
    dimensions = study.leave_out(found.idle)
    offsets = np.random.default_rng(seed).random(len(dimensions))
    number = len(found.trials) // BATCH
    try:
        while found.asked < trials:
            size = min(BATCH, trials - found.asked)
            points: list[dict[str, Value]] = []
            if number == 0:
                points = _first(dimensions, start)[:size]
            if number < EVEN:  # a study that continues has these already
                while len(points) < size:
                    points.append(_even(dimensions, offsets, number * BATCH + len(points)))
            else:
                points += _parabola(dimensions, found, size // 2, number, seed)
            batch = study.ask(points, size - len(points))
            first = len(found.trials)
            for (trial, values), (cost, details) in zip(batch, judge([each for _, each in batch])):
                study.tell(trial, cost)
                found.trials.append(Trial(values, cost, details))
            if number == 0 and size > len(dimensions):
                found.idle = _idle(dimensions, found.trials[first:], same)
                dimensions = study.leave_out(found.idle)
                offsets = offsets[: len(dimensions)]
            found.asked += size
            number += 1
            report(size, found)
            if interrupts.came():  # an exception may be lost during clean-up
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        interrupts.finish()
        found.interrupted = True
    return found


def _first(dimensions: Sequence[Dimension], start: Mapping[str, Value]) -> list[dict[str, Value]]:
    """Return the start, and, for several gains, the start with one gain changed at a time."""
    begin = {each.name: start[each.name] for each in dimensions}
    if len(dimensions) == 1:
        return [begin]
    return [begin, *({**begin, each.name: each.elsewhere(begin[each.name])} for each in dimensions)]


def _idle(
    dimensions: Sequence[Dimension], batch: Sequence[Trial], same: Callable[[Trial, Trial], bool]
) -> list[str]:
    """Return the gains that had no effect when changed alone; none if that is true of all."""
    if len(dimensions) == 1:
        return []
    found = [each.name for each, trial in zip(dimensions, batch[1:]) if same(batch[0], trial)]
    return found if len(found) < len(dimensions) else []


def _even(dimensions: Sequence[Dimension], offsets: np.ndarray, number: int) -> dict[str, Value]:
    """Return the n-th of points that fill the space evenly (an additive recurrence)."""
    ratio = 2.0
    for _ in range(30):  # the root of x^(d+1) = x + 1
        ratio = (1.0 + ratio) ** (1.0 / (len(dimensions) + 1))
    places = [(offset + (number + 1) * ratio ** -(i + 1)) % 1.0 for i, offset in enumerate(offsets)]
    return {each.name: each.value(place) for each, place in zip(dimensions, places)}


def _parabola(
    dimensions: Sequence[Dimension], found: Search, count: int, number: int, seed: int
) -> list[dict[str, Value]]:
    """Return points at and around the minimum of a parabola through the best trials."""
    working = sorted(
        (trial for trial in found.trials if math.isfinite(trial.cost)), key=lambda trial: trial.cost
    )
    if not working or count < 1:
        return []
    size = len(dimensions)
    terms = 1 + size + size * (size + 1) // 2
    best = np.array([each.place(working[0].values[each.name]) for each in dimensions])
    centre = best
    kept = working[: max(terms + 2, NEAREST)]
    if len(kept) > terms:
        places = (
            np.array(
                [[each.place(trial.values[each.name]) for each in dimensions] for trial in kept]
            )
            - best
        )
        farthest = float(np.max(np.abs(places))) or 1.0
        costs = np.log([max(trial.cost, 1e-300) for trial in kept])
        weights = np.exp(-0.5 * np.arange(len(kept)) / len(kept) * 3.0)
        pairs = [(i, j) for i in range(size) for j in range(i, size)]
        columns = np.stack(
            [
                np.ones(len(kept)),
                *(places[:, i] for i in range(size)),
                *(places[:, i] * places[:, j] for i, j in pairs),
            ],
            axis=1,
        )
        fitted = np.linalg.lstsq(columns * weights[:, None], costs * weights, rcond=None)[0]
        bend = np.zeros((size, size))
        for (i, j), value in zip(pairs, fitted[1 + size :]):
            bend[i, j] += value
            bend[j, i] += value
        values, vectors = np.linalg.eigh(bend)
        slope = vectors.T @ fitted[1 : 1 + size]
        step = np.where(
            values > 1e-6, -slope / np.maximum(values, 1e-6), -np.sign(slope) * farthest
        )
        centre = np.clip(best + np.clip(vectors @ step, -farthest, farthest), 0.0, 1.0)
    random = np.random.default_rng((seed, number))
    radius = 0.1 * GOLDEN ** (2 * (number - EVEN))
    points = [centre]
    while len(points) < count:
        around = best if len(points) % 2 else centre
        points.append(np.clip(around + radius * random.uniform(-1.0, 1.0, size), 0.0, 1.0))
    return [
        {each.name: each.value(float(place)) for each, place in zip(dimensions, point)}
        for point in points
    ]
