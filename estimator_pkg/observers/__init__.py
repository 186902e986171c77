"""Observers: the mathematics, written once. No ROS, no files, no plotting."""

from __future__ import annotations

from estimator_pkg import registry
from estimator_pkg.observers.contract import Functions, Observer

__all__ = ['Functions', 'Observer', 'find', 'names']


def names() -> list[str]:
    """The observers known here, sorted."""
    return registry.names(registry.OBSERVERS)


def find(name: str) -> Observer:
    """The observer called `name`; raises UsageError, with the nearest name, if there is none."""
    return registry.find(registry.OBSERVERS, name)
