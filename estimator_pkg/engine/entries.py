# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The functions that the engine has: those of the observers that setup.py names, and loops."""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import distribution
from pathlib import Path

from .sources import Found, Module, RefusedError, Sources
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
    """Return the name in C of a function of a loop's module, or for an observer's."""
    return re.sub(r'\W+', '_', f'{module}_{function}')


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
    RefusedError : an entry point names no object of the sources.
    """
    sources, made = Sources(root), {}
    for entry in _of_observers(sources, points[OBSERVERS]):
        made[entry.name] = entry  # observers of one module have the same functions
    for module, functions in LOOPS.items():
        for function in functions:
            made[c_name(module, function)] = Entry(module, function, {}, c_name(module, function))
    return list(made.values())


def _of_observers(sources: Sources, points: Iterable[str]) -> Iterator[Entry]:
    """Yield the functions of each observer whose kind has a channel."""
    for found, module in _objects(sources, points):
        kind = _kind(found)
        if kind not in CHANNELS:  # plain Python runs them
            continue
        channel, functions = CHANNELS[kind]
        for function in functions:
            name = c_name(module.name, function)
            yield Entry(channel, function, {'observer': module.name}, name)


def _objects(sources: Sources, points: Iterable[str]) -> Iterator[tuple[Found, Module]]:
    """Yield what each entry point names, and the module that it names."""
    for point in points:
        path, _, attribute = point.partition('=')[2].strip().partition(':')
        module = sources.module(path)
        found = module and sources.find(module, attribute)
        if module is None or not isinstance(found, Found):
            raise RefusedError(f'setup.py:1: entry point {point!r} names no object of the sources')
        yield found, module


def _kind(found: Found) -> str:
    """Return the kind of an observer that ``Observer(...)`` or ``replace(...)`` makes."""
    words = found.node.keywords if isinstance(found.node, ast.Call) else []
    kinds = [ast.literal_eval(each.value) for each in words if each.arg == 'kind']
    return str(kinds[0]) if kinds else 'angle'
