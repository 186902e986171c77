# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The functions that the engine has: those of the observers that setup.py names, and loops."""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from .sources import Class, RefusedError, Sources
from .translate import Entry

OBSERVERS = 'velocity_estimator.observers'
CHANNELS = {  # of a kind of observers: the module of the channel, and its functions
    'angle': (
        'estimator_pkg.driver.channel',
        ('take', 'write_estimate', 'write_deviation', 'message', 'deviations', 'batch'),
    ),
    'drive': (
        'estimator_pkg.driver.drive_channel',
        ('take', 'write_estimate', 'write_deviation', 'batch', 'trace'),
    ),
}
SMOOTHER = 'estimator_pkg.evaluation.reference.smoother'
LOOPS = {  # functions of a module whose arguments are numbers, arrays and records
    f'{SMOOTHER}.cells': ('along', 'used'),
    f'{SMOOTHER}.steps': ('backward', 'forward'),
    'estimator_pkg.sensor.faults': ('find_faults',),
    'sim_pkg.pmsm.drive': ('simulate',),
}


def c_name(module: str, function: str) -> str:
    """Return the name in C of a function of a loop's module, or for an observer's class."""
    return re.sub(r'\W+', '_', f'{module}_{function}')


def path_of(observer: Any) -> str:
    """Return the path by which `Sources.scope` finds the class of an observer."""
    return f'{observer.__module__}:{observer.__name__}'


def installed() -> dict[str, list[str]]:
    """Return the entry points of the installed package by group, as `entries` takes them."""
    found: dict[str, list[str]] = {OBSERVERS: []}
    for point in distribution('velocity_estimator').entry_points:
        found.setdefault(point.group, []).append(f'{point.name} = {point.value}')
    return found


def entries(points: Mapping[str, Iterable[str]], root: Path) -> list[Entry]:
    """Return the functions of the engine.

    Parameters
    ----------
    points : entry points by group, each ``name = module:object``, as setup.py has them.
    root : folder of the sources.

    Raises
    ------
    RefusedError : an entry point names no class of the sources.
    """
    loops = [(module, function) for module, functions in LOOPS.items() for function in functions]
    return [
        *_of_observers(Sources(root), points[OBSERVERS]),
        *(Entry(module, function, {}, c_name(module, function)) for module, function in loops),
    ]


def _of_observers(sources: Sources, points: Iterable[str]) -> Iterator[Entry]:
    """Yield the functions of each observer whose kind has a channel."""
    for observer in _classes(sources, points):
        kind = ast.literal_eval(sources.member(observer, 'kind').node)
        if kind not in CHANNELS:  # plain Python runs them
            continue
        channel, functions = CHANNELS[kind]
        for function in functions:
            name = c_name(observer.path, function)
            yield Entry(channel, function, {'observer': observer.path}, name)


def _classes(sources: Sources, points: Iterable[str]) -> Iterator[Class]:
    """Yield the class that each entry point names."""
    for point in points:
        observer = sources.scope(point.partition('=')[2].strip())
        if not isinstance(observer, Class):
            raise RefusedError(f'setup.py:1: entry point {point!r} names no class of the sources')
        yield observer
