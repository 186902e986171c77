# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers: the mathematics, written once. No ROS, no files, no plotting."""

from __future__ import annotations

from contextlib import suppress

from estimator_pkg import registry
from estimator_pkg.errors import UserError
from estimator_pkg.observers.contract import Functions, Observer

__all__ = ['Functions', 'Observer', 'find', 'names', 'of_kind']


def names() -> list[str]:
    """Return the names of all registered observers, sorted."""
    return registry.names(registry.OBSERVERS)


def find(name: str) -> Observer:
    """Return the observer called `name`.

    Raises
    ------
    UsageError : no observer has this name; the message suggests the nearest name.
    UserError : it cannot be imported, or is not an `Observer`.
    """
    observer = registry.find(registry.OBSERVERS, name)
    if not isinstance(observer, Observer):
        raise UserError(
            f"observer '{name}': its entry point names {observer!r}, which is not an Observer: "
            'let it name an instance of estimator_pkg.observers.Observer'
        )
    return observer


def of_kind(kind: str) -> list[str]:
    """Return the names of the importable observers of this kind."""
    found = []
    for name in names():
        with suppress(UserError):
            if find(name).kind == kind:
                found.append(name)
    return found
