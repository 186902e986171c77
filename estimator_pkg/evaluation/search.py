"""The search for gains: Optuna keeps and suggests the trials, batch by batch.

Suggestions are asked for in batches of a fixed size and told in their order, so that the result
depends on the seed and not on how many workers there are. The first batch holds the defaults and
points spread evenly over the space; later ones are half suggested by Optuna's sampler and half from
the bottom of a parabola through the best trials, which is what makes few trials enough.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator_pkg.errors import UserError

HINT = "tuning needs Optuna: pip install 'velocity_estimator[tune]'"
BATCH = 8
SPREAD = 2          # batches that look everywhere, before the parabola
NEAREST = 10        # trials that the parabola goes through, at least
GOLDEN = 0.6180339887498949


@dataclass(frozen=True)
class Dimension:
    """A gain that is sought between two values, on a logarithmic scale where both are positive."""

    name: str
    low: float
    high: float

    @property
    def logarithmic(self) -> bool:
        """True if ratios count, not differences."""
        return self.low > 0.0

    def value(self, part: float) -> float:
        """The gain at a place in [0, 1]."""
        part = min(max(part, 0.0), 1.0)
        if self.logarithmic:
            return self.low * (self.high / self.low) ** part
        return self.low + part * (self.high - self.low)

    def place(self, value: float) -> float:
        """Where in [0, 1] a gain lies."""
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


@dataclass
class Trial:
    """Gains that were tried; cost inf where they cannot work."""

    values: dict[str, float]
    cost: float
    details: Any = None


@dataclass
class Search:
    """All trials in their order, and the best of them.

    asked : how many of them are of this run; a stored study brings earlier ones.
    """

    trials: list[Trial] = field(default_factory=list)
    asked: int = 0
    interrupted: bool = False

    @property
    def best(self) -> Trial | None:
        """The cheapest; None if none works."""
        working = [trial for trial in self.trials if math.isfinite(trial.cost)]
        return min(working, key=lambda trial: trial.cost) if working else None


def search(dimensions: Sequence[Dimension], start: Mapping[str, float],
           judge: Callable[[list[dict[str, float]]], list[tuple[float, Any]]], trials: int,
           seed: int = 0, storage: str | None = None, name: str = 'velocity_estimator',
           told: Callable[[int, Search], None] = lambda count, so_far: None) -> Search:
    """Seeks the gains of the lowest cost.

    Parameters
    ----------
    start : the gains to begin with.
    judge : a batch of gains -> (cost, details) of each, in the same order.
    trials : how many at most.
    storage : of Optuna, a URL; None: in memory. An existing study of this name goes on.
    told : called after each batch with how many were new.

    Raises
    ------
    UserError : Optuna is missing, or the storage cannot be used.
    """
    study = _study(storage, name, seed, dimensions)
    distributions = _distributions(dimensions)
    found = Search([Trial({each.name: float(trial.params[each.name]) for each in dimensions},
                          float(trial.value)) for trial in study.get_trials(deepcopy=False)
                    if trial.value is not None and set(trial.params) == set(distributions)])
    offsets = np.random.default_rng(seed).random(len(dimensions))
    number = 0
    try:
        while found.asked < trials:
            size = min(BATCH, trials - found.asked)
            points: list[dict[str, float]] = []
            if not found.asked:
                points.append({each.name: float(start[each.name]) for each in dimensions})
            if number < SPREAD:
                while len(points) < size:
                    points.append(_even(dimensions, offsets, number * BATCH + len(points)))
            else:
                points += _parabola(dimensions, found, size // 2, number, seed)
            for point in points:
                study.enqueue_trial(point)
            batch = [study.ask(distributions) for _ in range(size)]
            asked = [{each.name: float(trial.params[each.name]) for each in dimensions}
                     for trial in batch]
            for trial, values, (cost, details) in zip(batch, asked, judge(asked)):
                if math.isfinite(cost):
                    study.tell(trial, cost)
                else:
                    study.tell(trial, state=_failed())
                found.trials.append(Trial(values, cost, details))
            found.asked += size
            number += 1
            told(size, found)
    except KeyboardInterrupt:
        found.interrupted = True
    return found


def _study(storage: str | None, name: str, seed: int, dimensions: Sequence[Dimension]) -> Any:
    try:
        import optuna
    except ImportError as error:
        raise UserError(HINT) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # that options are called experimental
            sampler = optuna.samplers.TPESampler(seed=seed, multivariate=len(dimensions) > 1,
                                                 n_startup_trials=BATCH, constant_liar=True)
            return optuna.create_study(study_name=name, storage=storage, sampler=sampler,
                                       load_if_exists=True)
    except Exception as error:  # a database may fail in any way
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise UserError(f"the storage '{storage}' cannot be used: {reason}") from error


def _distributions(dimensions: Sequence[Dimension]) -> dict[str, Any]:
    from optuna.distributions import FloatDistribution
    return {each.name: FloatDistribution(each.low, each.high, log=each.logarithmic)
            for each in dimensions}


def _failed() -> Any:
    from optuna.trial import TrialState
    return TrialState.FAIL


def _even(dimensions: Sequence[Dimension], offsets: np.ndarray, number: int) -> dict[str, float]:
    """The n-th of points that fill the space evenly (an additive recurrence)."""
    ratio = 2.0
    for _ in range(30):  # the root of x^(d+1) = x + 1
        ratio = (1.0 + ratio) ** (1.0 / (len(dimensions) + 1))
    places = [(offset + (number + 1) * ratio ** -(i + 1)) % 1.0
              for i, offset in enumerate(offsets)]
    return {each.name: each.value(place) for each, place in zip(dimensions, places)}


def _parabola(dimensions: Sequence[Dimension], found: Search, count: int, number: int, seed: int
              ) -> list[dict[str, float]]:
    """Points at and around the lowest of a parabola through the best trials."""
    working = sorted((trial for trial in found.trials if math.isfinite(trial.cost)),
                     key=lambda trial: trial.cost)
    if not working or count < 1:
        return []
    size = len(dimensions)
    terms = 1 + size + size * (size + 1) // 2
    best = np.array([each.place(working[0].values[each.name]) for each in dimensions])
    centre = best
    kept = working[:max(terms + 2, NEAREST)]
    if len(kept) > terms:
        places = np.array([[each.place(trial.values[each.name]) for each in dimensions]
                           for trial in kept]) - best
        reach = float(np.max(np.abs(places))) or 1.0
        costs = np.log([max(trial.cost, 1e-300) for trial in kept])
        weights = np.exp(-0.5 * np.arange(len(kept)) / len(kept) * 3.0)
        pairs = [(i, j) for i in range(size) for j in range(i, size)]
        columns = np.stack([np.ones(len(kept)), *(places[:, i] for i in range(size)),
                            *(places[:, i] * places[:, j] for i, j in pairs)], axis=1)
        fitted = np.linalg.lstsq(columns * weights[:, None], costs * weights, rcond=None)[0]
        bend = np.zeros((size, size))
        for (i, j), value in zip(pairs, fitted[1 + size:]):
            bend[i, j] += value
            bend[j, i] += value
        values, vectors = np.linalg.eigh(bend)
        slope = vectors.T @ fitted[1:1 + size]
        step = np.where(values > 1e-6, -slope / np.maximum(values, 1e-6), -np.sign(slope) * reach)
        centre = np.clip(best + np.clip(vectors @ step, -reach, reach), 0.0, 1.0)
    random = np.random.default_rng((seed, number))
    radius = 0.1 * GOLDEN ** (2 * (number - SPREAD))
    points = [centre]
    while len(points) < count:
        around = best if len(points) % 2 else centre
        points.append(np.clip(around + radius * random.uniform(-1.0, 1.0, size), 0.0, 1.0))
    return [{each.name: each.value(float(place)) for each, place in zip(dimensions, point)}
            for point in points]
