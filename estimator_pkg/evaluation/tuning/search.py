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
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from estimator_pkg import interrupts
from estimator_pkg.errors import UserError, first_line

BATCH = 8
ELSEWHERE = 0.3  # change of a gain that shows its effect, as a fraction of its range
NEAR = {
    0.6: 0.25,
    0.8: 0.05,
}  # after this part of the trials: width around the best, as such a fraction
ABOUT = 'about'
ATTEMPTS, PAUSE = 4, 0.4  # attempts to open a storage, pause between them [s]

Value = float | str
Ranges = dict[str, Any]  # distributions of Optuna by gain


@dataclass
class Trial:
    """The gains of a trial and its cost, inf if they do not work."""

    values: dict[str, Value]
    cost: float
    details: Any = None


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
    ranges: Ranges,
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
    ranges : of the gains. start : start values of the gains.
    judge : a batch of gains -> (cost, details) of each, in the same order.
    trials : largest number of trials.
    storage : of Optuna, a URL; None: in memory. An existing study of this name continues.
    report : called after each batch with the number of new trials.
    about : everything else that the costs depend on; a study of something else does not continue.
    same : whether two trials gave the same. A gain without effect at the start is dropped.

    Raises
    ------
    UserError : the storage cannot be used, or its study of this name has other data.
    """
    study = _opened(storage, name, seed, about)
    with _stored(storage):
        earlier = study.get_trials(deepcopy=False)
    found = Search(
        [
            Trial(dict(trial.params), float(trial.value))
            for trial in earlier
            if trial.value is not None and trial.params and set(trial.params) <= set(ranges)
        ]
    )
    found.idle = [name for name in ranges if any(name not in each.values for each in found.trials)]
    ranges = {name: each for name, each in ranges.items() if name not in found.idle}
    try:
        while found.asked < trials:
            size = min(BATCH, trials - found.asked)
            first = not found.trials
            # not queued in the study: another process that shares it would take them
            if first:
                points = _first(ranges, start)[:size]
            else:
                points = _near(study.sampler, ranges, found, found.asked / trials, size)
            with _stored(storage):
                asked = [study.ask(ranges) for _ in range(size - len(points))]
            points += [trial.params for trial in asked]
            for values, trial, (cost, details) in zip(
                points, [*[None] * (size - len(asked)), *asked], judge(points)
            ):
                with _stored(storage):
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
            found.asked += size
            report(size, found)
            if interrupts.came():  # an exception may be lost during clean-up
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        interrupts.finish()
        found.interrupted = True
    return found


@contextmanager
def _stored(storage: str | None) -> Iterator[None]:
    """Raise UserError if the storage fails, which a database may do in any way."""
    try:
        yield
    except Exception as error:
        if storage is None:
            raise
        raise UserError(
            f"the storage '{storage}' cannot be used: {first_line(error)}; it must be a URL, "
            'as in sqlite:///study.db'
        ) from error


def _opened(storage: str | None, name: str, seed: int, about: str) -> Any:
    """Return the study."""
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
    for attempt in range(ATTEMPTS):
        try:
            with _stored(storage):
                study = optuna.create_study(
                    study_name=name, storage=storage, sampler=sampler, load_if_exists=True
                )
            break
        except UserError:  # processes that start together may all create the storage's tables
            if attempt == ATTEMPTS - 1:
                raise
            time.sleep(PAUSE)
    with _stored(storage):
        before = study.user_attrs.get(ABOUT)
        if before is None:
            study.set_user_attr(ABOUT, about)
    if before not in (None, about):
        raise UserError(
            f"the study '{name}' in '{storage}' has other data, another observer "
            'or other settings: choose another name with --study'
        )
    return study


def _first(ranges: Ranges, start: Mapping[str, Value]) -> list[dict[str, Value]]:
    """Return the start, and, for several gains, the start with one gain changed at a time."""
    begin = {name: start[name] for name in ranges}
    if len(ranges) == 1:
        return [begin]
    return [begin, *({**begin, name: moved(each, begin[name])} for name, each in ranges.items())]


def _near(
    sampler: Any, ranges: Ranges, found: Search, done: float, count: int
) -> list[dict[str, Value]]:
    """Return gains near the best, from a study of their own; none before the part `NEAR` is done.

    The study of all trials keeps the whole ranges, so that it can continue.
    """
    import optuna

    widths = [width for part, width in NEAR.items() if done >= part]
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


def _around(gain: Any, value: Value, width: float) -> Any:
    """Return the part of a range around a value, of this fraction of its width; choices as is."""
    if hasattr(gain, 'choices'):
        return gain
    into, back = (math.log, math.exp) if gain.log else (float, float)
    low, high, at = into(gain.low), into(gain.high), into(float(value))
    width *= high - low
    start = min(max(at - 0.5 * width, low), high - width)
    ends = max(back(start), gain.low), min(back(start + width), gain.high)
    return type(gain)(*ends, log=gain.log)


def moved(gain: Any, value: Value | None = None) -> Value:
    """Return a value at a distance of `ELSEWHERE` from this one; without one, the middle."""
    choices = getattr(gain, 'choices', None)
    if choices:
        at = (len(choices) - 1) // 2 if value is None else choices.index(value) + 1
        return str(choices[at % len(choices)])
    into, back = (math.log, math.exp) if gain.log else (float, float)
    low, high = into(gain.low), into(gain.high)
    if value is None:
        return back(0.5 * (low + high))
    at, step = into(float(value)), ELSEWHERE * (high - low)
    return back(at + step if at + step <= high else at - step)
