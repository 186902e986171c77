# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The checked settings of a tuning run: observer, search ranges, and weights."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from estimator_pkg import observers
from estimator_pkg.driver.configuration import SELECT_OBSERVER
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.evaluation.compare import requested
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import check_joints, check_window
from estimator_pkg.evaluation.tuning.objective import PREFERENCES, Weights
from estimator_pkg.evaluation.tuning.search import GainValue, Range
from estimator_pkg.parameters import Parameter, declared

LARGEST_SEED = 2**32 - 1  # of NumPy


@dataclass(frozen=True)
class Settings:
    """Observer, search ranges, and weights of a tuning run.

    entry : the observer with its fixed parameters. weights : of error, delay, noise. preference :
    the name of the weights. ranges : of the searched gains, by name. trials : their number. seed :
    of the search.
    """

    entry: Entry
    weights: Weights
    preference: str
    ranges: dict[str, Range]
    trials: int
    seed: int

    @property
    def gains(self) -> dict[str, Parameter]:
        """The observer's parameters by name."""
        return declared(observers.find(self.entry.observer).gains)

    def defaults(self) -> dict[str, GainValue | None]:
        """Return the defaults of the searched gains; None: computed from other parameters.

        For a list of equal numbers it is that number.
        """
        found: dict[str, GainValue | None] = {}
        for name in self.ranges:
            default = self.gains[name].default
            if isinstance(default, (list, tuple)):
                default = default[0] if len(set(default)) == 1 else None
            found[name] = float(default) if isinstance(default, (int, float)) else default
        return found

    def start(self) -> dict[str, GainValue]:
        """Return the start values: the defaults if inside the range, else its end or middle."""
        found: dict[str, GainValue] = {}
        for name, default in self.defaults().items():
            gain = self.ranges[name]
            if isinstance(default, float):
                found[name] = min(max(default, gain.low), gain.high)
            else:
                found[name] = gain.at(0.5) if default is None else default
        return found


def settings(parsed: argparse.Namespace, observer: str) -> Settings:
    """Return the checked arguments of the command; raise UsageError."""
    if bool(parsed.bags) == (parsed.live is not None):
        raise UsageError('give either bags or --live SECONDS')
    for wrong, text in (
        (
            parsed.live is not None and not 1.0 <= parsed.live < math.inf,
            f'--live is {parsed.live} s: it must be 1 or more',
        ),
        (
            not 0.0 <= parsed.held_out < 0.9,
            f'--held-out is {parsed.held_out:g}: it must be from 0 to below 0.9',
        ),
        (parsed.trials < 1, f'--trials is {parsed.trials}: it must be 1 or more'),
        (
            not 0 <= parsed.seed <= LARGEST_SEED,
            f'--seed is {parsed.seed}: it must be from 0 to {LARGEST_SEED}',
        ),
        (observer == requested.ALL_OBSERVERS, "--observer is 'all', but tuning needs one: name it"),
    ):
        if wrong:
            raise UsageError(text)
    check_joints(parsed)
    check_window(parsed)
    (entry,) = requested.entries([observer], parsed.params, parsed.set)
    held = dict(entry.values)
    known = declared(observers.find(observer).gains)
    for name in held.keys() & known.keys():
        known[name].check(held[name])
    if parsed.search:
        ranges = dict(_requested(observer, known, text) for text in parsed.search)
    else:
        ranges = {
            name: Range(*(each.search or (0.0, 1.0)), each.among)
            for name, each in known.items()
            if each.search is not None or each.among
        }
    ranges = {name: each for name, each in ranges.items() if name not in held}
    if not ranges:
        raise UsageError(
            f"nothing to search: '{observer}' has no search ranges, or --set and "
            '--params fix all its gains; add one with --search'
        )
    preference = f'weights {parsed.weights}' if parsed.weights else parsed.prefer
    return Settings(entry, _weights(parsed), preference, ranges, parsed.trials, parsed.seed)


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


def _requested(observer: str, known: Mapping[str, Parameter], text: str) -> tuple[str, Range]:
    """Return a gain and its range, as ``--search`` names them."""
    name, _, ends = text.partition('=')
    if name not in known:
        hint = observers.instead(name, known, observers.find(observer), SELECT_OBSERVER)
        hint = hint or suggestion(name, known)
        raise UsageError(f"unknown parameter '{name}' of {observer}: {hint}")
    parameter: Any = known[name]
    if parameter.kind is str:
        choices = tuple(parameter.check(choice) for choice in ends.split('|'))
        if len(choices) < 2:
            raise UsageError(f"--search '{text}' is invalid: write it as NAME=ONE|OTHER")
        return name, Range(choices=choices)
    if parameter.kind not in (float, list):
        raise UsageError(f"--search '{text}': choose a gain that is a number or a choice")
    try:
        low, high = map(float, ends.split(':'))
    except ValueError:
        low, high = math.nan, math.nan
    if not -math.inf < low < high < math.inf:
        raise UsageError(f"--search '{text}' is invalid: write it as GAIN=LOW:HIGH")
    parameter.check(low)
    parameter.check(high)
    return name, Range(low, high)
