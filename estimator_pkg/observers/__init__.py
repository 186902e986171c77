# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers: the mathematics, written once. No ROS, no files, no plotting."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from difflib import get_close_matches
from typing import Any

from estimator_pkg import registry
from estimator_pkg.errors import UserError
from estimator_pkg.observers.contract import Observer
from estimator_pkg.parameters import declared

__all__ = ['DEFAULT', 'Observer', 'find', 'instead', 'names', 'of_kind']

DEFAULT = 'edge_adaptive'  # observer of a single angle where none is named
LINEAR = 'hybrid_angle'  # the one to choose where gains are to be set


def names() -> list[str]:
    """Return the names of all registered observers, sorted."""
    return registry.names(registry.OBSERVERS)


def find(name: str) -> type[Observer]:
    """Return the observer called `name`.

    Raises
    ------
    UsageError : no observer has this name; the message suggests the nearest name.
    UserError : it cannot be imported, or is no `Observer`.
    """
    observer = registry.find(registry.OBSERVERS, name)
    if not is_observer(observer):
        raise UserError(
            f"observer '{name}': its entry point names {observer!r}, which is not an Observer: "
            'let it name a class that inherits estimator_pkg.observers.Observer'
        )
    return observer


def is_observer(found: Any) -> bool:
    """Return True if what an entry point names is an observer."""
    return isinstance(found, type) and issubclass(found, Observer)


def of_kind(kind: str) -> list[str]:
    """Return the names of the importable observers of this kind."""
    found = []
    for name in names():
        with suppress(UserError):
            if find(name).kind == kind:
                found.append(name)
    return found


def instead(name: str, known: Iterable[str], observer: type[Observer], remedy: str) -> str:
    """Return a clause on the observers of the same kind that have a gain which this one lacks.

    Parameters
    ----------
    name : of the gain, as the user wrote it. known : all parameters next to this observer.
    remedy : how to select another observer, with {} for its name.

    Returns
    -------
    '' if no other observer has the gain, or if a parameter in `known` is nearer.
    """
    others = {each: declared(find(each).gains) for each in of_kind(observer.kind)}
    gains = {gain for each in others.values() for gain in each}
    group, _, name = name.rpartition('.')
    near = get_close_matches(name, {*known, *gains}, n=1, cutoff=1.0 if group else 0.5)
    if not near or near[0] in known:
        return ''
    having = sorted((each for each in others if near[0] in others[each]), key=LINEAR.__ne__)
    default = ' (the default)' if observer.name == DEFAULT else ''
    meant = '' if near[0] == name else f"did you mean '{near[0]}'? "
    return (
        f'{meant}{", ".join(having)} {"have" if len(having) > 1 else "has"} it, '
        f'{observer.name}{default} does not: {remedy.format(having[0])}'
    )
