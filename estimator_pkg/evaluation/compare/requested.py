# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The requested observers, each with those of the parameters that it has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from estimator_pkg import observers, params_file, streams
from estimator_pkg.driver.configuration import SELECT_OBSERVER
from estimator_pkg.errors import UsageError, suggestion
from estimator_pkg.evaluation.entries import Entry, angle_observers
from estimator_pkg.parameters import parse_assignments

ALL_OBSERVERS = 'all'
OBSERVER_KEY = 'observer'


def entries(names: Sequence[str], params: str | None, assignments: Sequence[str]) -> list[Entry]:
    """Return one entry per observer, in order.

    A parameter file that names its observer applies to that one only; other files and --set apply
    to every observer that has the parameter. Without names, parameters are those of the observer
    that they name, else of the default observer.

    Parameters
    ----------
    names : names of observers, or 'all' for those of single angles.
    params : parameter file. assignments : those of --set; they override the file.

    Raises
    ------
    UserError, UsageError : no such observer or file, or a parameter that no observer has.
    """
    every = {name: angle_observers() if name == ALL_OBSERVERS else [name] for name in names}
    wanted = list(dict.fromkeys(name for of in every.values() for name in of))
    given = parse_assignments(list(assignments))
    if not wanted:
        if not given and not params:
            return []
        wanted = [str(given.pop(OBSERVER_KEY, None) or _named(params))]
    from_file = {name: _from_file(params, name) for name in wanted}
    if params is not None and all(values is None for values in from_file.values()):
        params_file.warn_unused(params, wanted)
    values_of = {name: {**(values or {}), **given} for name, values in from_file.items()}
    known = {name: streams.parameters(name, values) for name, values in values_of.items()}
    anywhere = {parameter for of in known.values() for parameter in of}
    for values in values_of.values():
        for key in values:
            gain = params_file.parameter_of(key)
            if gain not in anywhere:
                first = observers.find(wanted[0])
                instead = observers.instead(gain, anywhere, first, SELECT_OBSERVER)
                raise UsageError(
                    f"unknown parameter '{key}' of {', '.join(wanted)}: "
                    f'{instead or suggestion(gain, anywhere)}'
                )
    return [
        Entry(
            name,
            name,
            tuple(
                (key, known[name][params_file.parameter_of(key)].check(value))
                for key, value in values.items()
                if params_file.parameter_of(key) in known[name]
            ),
        )
        for name, values in values_of.items()
    ]


def _named(params: str | None) -> str:
    """Return the observer of a parameter file; raise UserError or UsageError."""
    if params is None:
        return observers.DEFAULT
    sections = params_file.section_names(params)
    for stream in streams.every():
        if sections & {stream.NODE, '*', '**'}:
            named = params_file.load(params, stream.NODE).get(OBSERVER_KEY)
            if isinstance(named, str) and streams.of_observer(named) is stream:
                return named
    if sections & {streams.named(streams.USUAL).NODE, '*', '**'}:
        return observers.DEFAULT
    raise UsageError(f'{params} names no observer: name one with --observer')


def _from_file(params: str | None, observer: str) -> dict[str, Any] | None:
    """Return the parameters in the file for this observer; None: it names another one."""
    if params is None:
        return {}
    node = streams.of_observer(observer).NODE
    if not params_file.section_names(params) & {node, '*', '**'}:
        return {}
    values = params_file.for_observer(params, node, observer)
    if values is not None:
        values.pop(OBSERVER_KEY, None)
    return values
