# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A row of a comparison: an observer and its parameter values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from estimator_pkg import observers
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.joint import Joint


@dataclass(frozen=True)
class Entry:
    """One row: an observer with parameter values.

    label : name of the row.
    values : (name, value) of the parameters that are not at their default.
    """

    label: str
    observer: str
    values: tuple[tuple[str, Any], ...] = ()

    def joint(self, **settings: Any) -> Joint:
        """Return a joint with this observer; `settings` are further parameters."""
        observer = observers.find(self.observer)
        configuration = Configuration(observer, {**dict(self.values), **settings})
        return Joint(observer, *configuration.for_joint(''))


def angle_observers() -> list[str]:
    """Return the names of all observers that take only an angle."""
    return observers.of_kind('angle')


def at_defaults() -> list[Entry]:
    """Return every angle observer at its defaults, and the Kalman filter with either model."""
    found = []
    for name in angle_observers():
        if name == 'kalman':
            found += [
                Entry(f'kalman {model}', name, (('model', f'constant_{model}'),))
                for model in ('acceleration', 'velocity')
            ]
        else:
            found.append(Entry(name, name))
    return found
