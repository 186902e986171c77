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
from estimator_pkg.driver.configuration import NAME_IT
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.evaluation.compare import requested
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import check_joints
from estimator_pkg.evaluation.tuning.objective import PREFERENCES, Weights
from estimator_pkg.evaluation.tuning.study import Dimension, Value
from estimator_pkg.parameters import Parameter, declared

WRAP_PERIOD = 2.0 * math.pi
LARGEST_SEED = 2**32 - 1  # of NumPy


@dataclass(frozen=True)
class TuneSettings:
    """Observer, search ranges, and weights of a tuning run.

    entry : the observer with its fixed parameters. weights : of error, delay, noise. preference :
    the name of the weights. dimensions : the searched gains.
    """

    entry: Entry
    weights: Weights
    preference: str
    dimensions: tuple[Dimension, ...]

    @property
    def held(self) -> dict[str, Any]:
        """The fixed parameters."""
        return dict(self.entry.values)

    @property
    def gains(self) -> dict[str, Parameter]:
        """The observer's parameters by name."""
        return declared(observers.find(self.entry.observer).gains)

    def start(self) -> dict[str, Value]:
        """Return the start values: the defaults if inside the range, else its middle."""
        found: dict[str, Value] = {}
        for each in self.dimensions:
            default = single(self.gains[each.name].default)
            if default is None:
                found[each.name] = each.value(0.5)
            elif isinstance(default, str):
                found[each.name] = default
            else:
                found[each.name] = min(max(default, each.low), each.high)
        return found

    def defaults(self) -> dict[str, Value | None]:
        """Return the defaults of the searched gains; None: computed from other parameters."""
        return {each.name: single(self.gains[each.name].default) for each in self.dimensions}


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
    if parsed.observer == requested.ALL:
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
        _dimensions(entry.observer, known, parsed.search, dict(entry.values)),
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


def _dimensions(
    observer: str, known: Mapping[str, Parameter], wanted: Sequence[str], held: Mapping[str, Any]
) -> tuple[Dimension, ...]:
    if wanted:
        found = {}
        for text in wanted:
            name, _, ends = text.partition('=')
            if name not in known:
                hint = observers.instead(name, known, observers.find(observer), NAME_IT)
                raise UsageError(
                    f"unknown parameter '{name}' of {observer}: {hint or suggestion(name, known)}"
                )
            found[name] = _searched(known[name], ends, text)
    else:
        found = {
            name: Dimension(name, *(each.search or (0.0, 1.0)), each.among)
            for name, each in known.items()
            if each.search is not None or each.among
        }
    found = {name: each for name, each in found.items() if name not in held}
    if not found:
        raise UsageError(
            f"nothing to search: '{observer}' has no search ranges, or --set and "
            '--params fix all its gains; add one with --search'
        )
    return tuple(found.values())


def _searched(parameter: Parameter, ends: str, text: str) -> Dimension:
    """Return the dimension that the user requests."""
    if parameter.kind is str:
        choices = tuple(parameter.check(choice) for choice in ends.split('|'))
        if len(choices) < 2:
            raise UsageError(f"--search '{text}' is invalid: write it as NAME=ONE|OTHER")
        return Dimension(parameter.name, choices=choices)
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
    return Dimension(parameter.name, *bounds)
