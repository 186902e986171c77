# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Find observers, their streams, models, commands and simulators through entry points.

Other packages can add their own; ours are found in the same way.
"""

from __future__ import annotations

import importlib
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.optional import missing

OBSERVERS = 'velocity_estimator.observers'
MODELS = 'velocity_estimator.models'
COMMANDS = 'velocity_estimator.commands'
SIMULATORS = 'velocity_estimator.simulators'
STREAMS = 'velocity_estimator.streams'


@lru_cache
def _points(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def names(group: str) -> list[str]:
    """Return the names in an entry-point group, sorted."""
    return sorted(_points(group))


def find(group: str, name: str) -> Any:
    """Return the object of the entry point `name`.

    Raises
    ------
    UsageError : no such name; the nearest one is suggested.
    UserError : it exists but cannot be imported.
    """
    what = group.rpartition('.')[2].rstrip('s')
    point = _points(group).get(name)
    if point is None:
        raise UsageError(f"unknown {what} '{name}': {suggestion(name, _points(group))}")
    try:
        return point.load()
    except Exception as error:  # another package's code may fail in any way
        why = missing(error) or f'{type(error).__name__}: {error}'
        raise UserError(f"{what} '{name}' ({point.value}) cannot be imported: {why}") from error


def load(path: str) -> Any:
    """Return the object ``package.module:name``.

    Raises
    ------
    UsageError : another form, not importable, or no such name in the module.
    """
    module_name, colon, attribute = path.partition(':')
    if not colon or not module_name or not attribute:
        raise UsageError(f"'{path}' is incomplete: write it as package.module:name")
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # a user's module may fail in any way while it is imported
        raise UsageError(f"cannot import '{module_name}': {error}") from error
    if not hasattr(module, attribute):
        public = [name for name in vars(module) if not name.startswith('_')]
        raise UsageError(
            f"module '{module_name}' has no '{attribute}': {suggestion(attribute, public)}"
        )
    return getattr(module, attribute)
