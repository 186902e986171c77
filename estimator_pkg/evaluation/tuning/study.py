# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The searched gains, and the Optuna study that stores and suggests the trials."""

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
ELSEWHERE = 0.3  # change of a gain that shows its effect, as a fraction of its range

ABOUT = 'about'
ATTEMPTS, PAUSE = 4, 0.4  # attempts to open a storage, pause between them [s]

T = TypeVar('T')
Value = float | str


@dataclass(frozen=True)
class Dimension:
    """A gain with its search range, on a logarithmic scale if both ends are positive.

    choices : values to choose from instead, in an order in which neighbours are similar.
    """

    name: str
    low: float = 0.0
    high: float = 1.0
    choices: tuple[str, ...] = ()

    @property
    def logarithmic(self) -> bool:
        """True for a logarithmic scale."""
        return self.low > 0.0

    def value(self, part: float) -> Value:
        """Return the gain at a place in [0, 1]."""
        part = min(max(part, 0.0), 1.0)
        if self.choices:
            return self.choices[min(int(part * len(self.choices)), len(self.choices) - 1)]
        if self.logarithmic:
            return self.low * (self.high / self.low) ** part
        return self.low + part * (self.high - self.low)

    def place(self, value: Value) -> float:
        """Return the place of a gain in [0, 1]."""
        if isinstance(value, str):
            return (self.choices.index(value) + 0.5) / len(self.choices)
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def elsewhere(self, value: Value) -> Value:
        """Return a gain at a distance of `ELSEWHERE` from this one."""
        place = self.place(value)
        return self.value(place + ELSEWHERE if place + ELSEWHERE <= 1.0 else place - ELSEWHERE)


@dataclass
class Trial:
    """The gains of a trial and its cost, inf if they do not work."""

    values: dict[str, Value]
    cost: float
    details: Any = None


class Study:
    """A study of Optuna.

    Parameters
    ----------
    storage : a URL; None: in memory. An existing study of this name continues.
    about : everything but the gains that the costs depend on.

    Raises
    ------
    UserError : Optuna is missing, the storage cannot be used, now or later, or its study of this
        name has other data.
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
            warnings.simplefilter('ignore')  # about experimental options
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
                f"the study '{name}' in '{storage}' has other data, another observer "
                'or other settings: choose another name with --study'
            )

    def _opened(self, call: Callable[[], T]) -> T:
        """Retry `call`: processes that start together may all create the storage's tables."""
        for _ in range(ATTEMPTS - 1):
            try:
                return call()
            except Exception:  # as below; the last attempt reports the reason
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
        """Return the stored trials of the same gains."""
        known = self._guarded(lambda: self._study.get_trials(deepcopy=False))
        return [
            Trial(self._values(trial.params), float(trial.value))
            for trial in known
            if trial.value is not None
            and trial.params
            and set(trial.params) <= set(self._distributions)
        ]

    def leave_out(self, names: Sequence[str]) -> list[Dimension]:
        """Stop searching these gains; return the others."""
        self._dimensions = [each for each in self._dimensions if each.name not in names]
        self._distributions = {
            each.name: self._distributions[each.name] for each in self._dimensions
        }
        return self._dimensions

    def ask(
        self, points: Sequence[Mapping[str, Value]], more: int
    ) -> list[tuple[Any, dict[str, Value]]]:
        """Return (trial, gains) of these points, and of `more` points from the sampler.

        The points are not queued in the study: another process that shares it would take them.
        """
        trials = []
        for point in points:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')  # about an experimental sampler
                self._study.sampler = self._fixed(dict(point), self._sampler)
            trials.append(self._guarded(lambda: self._study.ask(self._distributions)))
        self._study.sampler = self._sampler
        trials += self._guarded(lambda: [self._study.ask(self._distributions) for _ in range(more)])
        return [(trial, self._values(trial.params)) for trial in trials]

    def tell(self, trial: Any, cost: float) -> None:
        """Record the cost of a trial; infinite: it failed."""
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
