# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The checked settings of a tuning run: observer, search ranges, and weights."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from estimator_pkg import observers
from estimator_pkg.driver.configuration import SELECT_OBSERVER
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.evaluation.compare import requested
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import check_joints, check_window
from estimator_pkg.evaluation.tuning.objective import PREFERENCES, Weights
from estimator_pkg.evaluation.tuning.search import GainValue, Ranges, at
from estimator_pkg.parameters import Parameter, declared

LARGEST_SEED = 2**32 - 1  # of NumPy


@dataclass(frozen=True)
class TuneSettings:
    """Observer, search ranges, and weights of a tuning run.

    entry : the observer with its fixed parameters. weights : of error, delay, noise. preference :
    the name of the weights. ranges : of the searched gains, by name. trials : their number. seed :
    of the search.
    """

    entry: Entry
    weights: Weights
    preference: str
    ranges: Ranges
    trials: int
    seed: int

    @property
    def held(self) -> dict[str, Any]:
        """The fixed parameters."""
        return dict(self.entry.values)

    @property
    def gains(self) -> dict[str, Parameter]:
        """The observer's parameters by name."""
        return declared(observers.find(self.entry.observer).gains)

    def start(self) -> dict[str, GainValue]:
        """Return the start values: the defaults if inside the range, else its middle."""
        found: dict[str, GainValue] = {}
        for name, default in self.defaults().items():
            gain = self.ranges[name]
            if isinstance(default, float):
                found[name] = min(max(default, gain.low), gain.high)
            else:
                found[name] = at(gain, 0.5) if default is None else default
        return found

    def defaults(self) -> dict[str, GainValue | None]:
        """Return the defaults of the searched gains; None: computed from other parameters."""
        return {name: single(self.gains[name].default) for name in self.ranges}


def single(default: Any) -> Any:
    """Return a default as a search value: for a list of equal numbers, that number."""
    if isinstance(default, (list, tuple)):
        return float(default[0]) if len(set(default)) == 1 else None
    return default if default is None or isinstance(default, str) else float(default)


def tune_settings(parsed: argparse.Namespace) -> TuneSettings:
    """Return the checked arguments of the command; raise UsageError."""
    if bool(parsed.bags) == (parsed.live is not None):
        raise UsageError('give either bags or --live SECONDS')
    if parsed.live is not None and not 1.0 <= parsed.live < math.inf:
        raise UsageError(f'--live is {parsed.live:g} s: it must be 1 or more')
    if not 0.0 <= parsed.held_out < 0.9:
        raise UsageError(f'--held-out is {parsed.held_out:g}: it must be from 0 to below 0.9')
    if parsed.trials < 1:
        raise UsageError(f'--trials is {parsed.trials}: it must be 1 or more')
    if not 0 <= parsed.seed <= LARGEST_SEED:
        raise UsageError(f'--seed is {parsed.seed}: it must be from 0 to {LARGEST_SEED}')
    check_joints(parsed)
    check_window(parsed)
    if parsed.observer == requested.ALL_OBSERVERS:
        raise UsageError("--observer is 'all', but tuning needs one: name it")
    (entry,) = requested.entries([parsed.observer], parsed.params, parsed.set)
    known = declared(observers.find(entry.observer).gains)
    for name, value in entry.values:
        if name in known:
            known[name].check(value)
    return TuneSettings(
        entry,
        _weights(parsed),
        f'weights {parsed.weights}' if parsed.weights else parsed.prefer,
        _ranges(entry.observer, known, parsed.search, dict(entry.values)),
        parsed.trials,
        parsed.seed,
    )


def _weights(parsed: argparse.Namespace) -> Weights:
    if not parsed.weights:
        return PREFERENCES[parsed.prefer]
    try:
        values = [float(text) for text in parsed.weights.split(',')]
    except ValueError:
        values = []
    if len(values) != 3 or min(values) < 0.0 or not 0.0 < sum(values) < math.inf:
        raise UsageError(
            f"--weights '{parsed.weights}' must be three numbers of 0 or more, as in 1,0.5,0"
        )
    return Weights(*values)


def _ranges(
    observer: str,
    known: Mapping[str, Parameter],
    assignments: Sequence[str],
    held: Mapping[str, Any],
) -> Ranges:
    found: Ranges = {}
    for text in assignments:
        name, _, ends = text.partition('=')
        if name not in known:
            hint = observers.instead(name, known, observers.find(observer), SELECT_OBSERVER)
            raise UsageError(
                f"unknown parameter '{name}' of {observer}: {hint or suggestion(name, known)}"
            )
        found[name] = _searched(known[name], ends, text)
    if not assignments:
        found = {
            name: _range(*(each.search or (0.0, 1.0)), each.among)
            for name, each in known.items()
            if each.search is not None or each.among
        }
    found = {name: each for name, each in found.items() if name not in held}
    if not found:
        raise UsageError(
            f"nothing to search: '{observer}' has no search ranges, or --set and "
            '--params fix all its gains; add one with --search'
        )
    return found


def _range(low: float = 0.0, high: float = 1.0, choices: Sequence[str] = ()) -> Any:
    """Return the distribution, on a logarithmic scale if both ends are positive."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    if choices:
        return CategoricalDistribution(choices)
    return FloatDistribution(low, high, log=low > 0.0)


def _searched(parameter: Parameter, ends: str, text: str) -> Any:
    """Return the range that the user requests."""
    if parameter.kind is str:
        choices = tuple(parameter.check(choice) for choice in ends.split('|'))
        if len(choices) < 2:
            raise UsageError(f"--search '{text}' is invalid: write it as NAME=ONE|OTHER")
        return _range(choices=choices)
    if parameter.kind not in (float, list):
        raise UsageError(f"--search '{text}': choose a gain that is a number or a choice")
    low, colon, high = ends.partition(':')
    try:
        bounds = float(low), float(high)
    except ValueError:
        bounds = (math.nan, math.nan)
    if not colon or not -math.inf < bounds[0] < bounds[1] < math.inf:
        raise UsageError(f"--search '{text}' is invalid: write it as GAIN=LOW:HIGH")
    for value in bounds:
        parameter.check(value)
    return _range(*bounds)
