"""What is sought, and the Optuna study that keeps and suggests the trials."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from estimator_pkg.errors import UserError, first_line
from estimator_pkg.optional import needs

BATCH = 8
ELSEWHERE = 0.3  # of the range, how far a gain is changed to see what it does

ABOUT = 'about'
ATTEMPTS, PAUSE = 4, 0.4  # to open a storage, [s] in between

T = TypeVar('T')
Value = float | str


@dataclass(frozen=True)
class Dimension:
    """A gain that is sought between two values, on a logarithmic scale where both are positive.

    choices : what is sought among instead, in an order in which neighbours are alike.
    """

    name: str
    low: float = 0.0
    high: float = 1.0
    choices: tuple[str, ...] = ()

    @property
    def logarithmic(self) -> bool:
        """True if ratios count, not differences."""
        return self.low > 0.0

    def value(self, part: float) -> Value:
        """The gain at a place in [0, 1]."""
        part = min(max(part, 0.0), 1.0)
        if self.choices:
            return self.choices[min(int(part * len(self.choices)), len(self.choices) - 1)]
        if self.logarithmic:
            return self.low * (self.high / self.low) ** part
        return self.low + part * (self.high - self.low)

    def place(self, value: Value) -> float:
        """Where in [0, 1] a gain lies."""
        if isinstance(value, str):
            return (self.choices.index(value) + 0.5) / len(self.choices)
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def elsewhere(self, value: Value) -> Value:
        """A gain well apart from this one."""
        place = self.place(value)
        return self.value(place + ELSEWHERE if place + ELSEWHERE <= 1.0 else place - ELSEWHERE)


@dataclass
class Trial:
    """Gains that were tried; cost inf where they cannot work."""

    values: dict[str, Value]
    cost: float
    details: Any = None


class Study:
    """A study of Optuna.

    Parameters
    ----------
    storage : a URL; None: in memory. A study of this name that is there goes on.
    about : what the costs depend on beside the gains.

    Raises
    ------
    UserError : Optuna is missing, the storage cannot be used, now or later, or its study of this
        name is about something else.
    """

    def __init__(
        self,
        storage: str | None,
        name: str,
        seed: int,
        dimensions: Sequence[Dimension],
        about: str = '',
    ) -> None:
        try:
            import optuna
        except ImportError as error:
            raise UserError(needs('optuna')) from error
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._storage, self._dimensions = storage, list(dimensions)
        self._distributions = {each.name: _distribution(each) for each in dimensions}
        self._failed = optuna.trial.TrialState.FAIL
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # that options are called experimental
            self._sampler = optuna.samplers.TPESampler(
                seed=seed,
                multivariate=len(dimensions) > 1,
                n_startup_trials=BATCH,
                constant_liar=True,
            )
            self._fixed = optuna.samplers.PartialFixedSampler
            self._study = self._opened(
                lambda: optuna.create_study(
                    study_name=name, storage=storage, sampler=self._sampler, load_if_exists=True
                )
            )
        before = self._guarded(lambda: self._study.user_attrs.get(ABOUT))
        if before is None:
            self._guarded(lambda: self._study.set_user_attr(ABOUT, about))
        elif before != about:
            raise UserError(
                f"the study '{name}' in '{storage}' is of other data, another observer "
                'or other wishes: name another one with --study'
            )

    def _opened(self, call: Callable[[], T]) -> T:
        """Processes that begin together may all be about to make the tables of the storage."""
        for _ in range(ATTEMPTS - 1):
            try:
                return call()
            except Exception:  # as below; the last attempt says what is wrong
                time.sleep(PAUSE)
        return self._guarded(call)

    def _guarded(self, call: Callable[[], T]) -> T:
        try:
            return call()
        except Exception as error:  # a database may fail in any way
            if self._storage is None:
                raise
            raise UserError(
                f"the storage '{self._storage}' cannot be used: {first_line(error)}"
            ) from error

    def earlier(self) -> list[Trial]:
        """Trials of the same gains that the storage has."""
        known = self._guarded(lambda: self._study.get_trials(deepcopy=False))
        return [
            Trial(self._values(trial.params), float(trial.value))
            for trial in known
            if trial.value is not None
            and trial.params
            and set(trial.params) <= set(self._distributions)
        ]

    def leave_out(self, names: Sequence[str]) -> list[Dimension]:
        """Seek these no longer; what is left."""
        self._dimensions = [each for each in self._dimensions if each.name not in names]
        self._distributions = {
            each.name: self._distributions[each.name] for each in self._dimensions
        }
        return self._dimensions

    def ask(
        self, points: Sequence[Mapping[str, Value]], more: int
    ) -> list[tuple[Any, dict[str, Value]]]:
        """(trial, gains) of these points, and of so many more that the sampler suggests.

        The points are not queued in the study: another process that shares it would take them.
        """
        trials = []
        for point in points:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')  # that it is called experimental
                self._study.sampler = self._fixed(dict(point), self._sampler)
            trials.append(self._guarded(lambda: self._study.ask(self._distributions)))
        self._study.sampler = self._sampler
        trials += self._guarded(lambda: [self._study.ask(self._distributions) for _ in range(more)])
        return [(trial, self._values(trial.params)) for trial in trials]

    def tell(self, trial: Any, cost: float) -> None:
        """What a trial came to; infinite: it failed."""
        if math.isfinite(cost):
            self._guarded(lambda: self._study.tell(trial, cost))
        else:
            self._guarded(lambda: self._study.tell(trial, state=self._failed))

    def _values(self, params: Mapping[str, Any]) -> dict[str, Value]:
        return {
            each.name: params[each.name] if each.choices else float(params[each.name])
            for each in self._dimensions
            if each.name in params
        }


def _distribution(dimension: Dimension) -> Any:
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    if dimension.choices:
        return CategoricalDistribution(dimension.choices)
    return FloatDistribution(dimension.low, dimension.high, log=dimension.logarithmic)
