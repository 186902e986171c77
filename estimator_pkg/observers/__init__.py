"""Observers: the mathematics, written once. No ROS, no files, no plotting."""

from __future__ import annotations

from contextlib import suppress

from estimator_pkg import registry
from estimator_pkg.errors import UserError
from estimator_pkg.observers.contract import Functions, Observer

__all__ = ['Functions', 'Observer', 'find', 'names', 'of_kind']


def names() -> list[str]:
    """The observers known here, sorted."""
    return registry.names(registry.OBSERVERS)


def find(name: str) -> Observer:
    """The observer called `name`.

    Raises
    ------
    UsageError : there is none; the nearest name is suggested.
    UserError : it cannot be imported, or is no `Observer`.
    """
    observer = registry.find(registry.OBSERVERS, name)
    if not isinstance(observer, Observer):
        raise UserError(
            f"observer '{name}': its entry point names {observer!r}, which is no "
            'Observer of estimator_pkg.observers'
        )
    return observer


def of_kind(kind: str) -> list[str]:
    """The names of the observers of this kind; one that cannot be imported is none."""
    found = []
    for name in names():
        with suppress(UserError):
            if find(name).kind == kind:
                found.append(name)
    return found
