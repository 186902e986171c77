# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of observers of mechanisms over simulated motions, for the rows of the table.

Every run steps the package's own observers, without their status and guard, for all random seeds at
once: arrays have shape (N, ..., n). Positions do not wrap.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.models.mechanics import Array, Mechanics
from estimator_pkg.models.motion import course
from estimator_pkg.observers.mechanism.observer import Core, MechanismObserver
from estimator_pkg.parameters import build

Case = tuple[str, dict[str, Any]]  # an observer and its gains


def quantise(values: Array, quantum: Any) -> Array:
    """Return Q(x) = d floor(x/d + 1/2), in the shape and units of `values`.

    Parameters
    ----------
    values : shape (..., n). quantum : d, one number or one for each column.
    """
    d = np.asarray(quantum, float)
    return d * np.floor(values / d + 0.5)


def assigned(numbers: dict[str, float]) -> tuple[str, ...]:
    """Return the numbers of a model as assignments."""
    return tuple(f'{name}={value!r}' for name, value in numbers.items())


def make(case: Case, model: str, numbers: dict[str, float]) -> MechanismObserver:
    """Return an observer of a built-in model (forward Euler)."""
    observer, gains = case
    record = observers.find(observer)
    values = {'form': 'paper', 'model': model, **gains, 'model_parameters': assigned(numbers)}
    checked: Any = build(record.gains, values, owner=observer)
    made: MechanismObserver = record.plan(checked, Circle())
    return made


def rest(measured: Array, start: Any = None) -> Core:
    """Return the start at rest at the positions `start`, or at the measurement, shape (..., n)."""
    e = np.zeros_like(measured) if start is None else np.asarray(start) - measured
    return Core(e, *[np.zeros_like(e)] * 4)


def follow(
    observer: MechanismObserver, core: Core, before: Array, now: Array, u: Array, dt: float
) -> Core:
    """Return the state after one more sample; where the model is not valid, that before it."""
    after = observer.advance(core, before, now - before, u, dt)
    if after is None and before.ndim > 1:  # with one of the seeds
        rows = zip(map(Core._make, zip(*core)), before, now)
        return Core._make(map(np.stack, zip(*(follow(observer, *row, u, dt) for row in rows))))
    return after or core


def in_single(core: Core) -> Core:
    """Return the state stored in single precision."""
    e, x, d = (each.astype(np.float32).astype(float) for each in core[:3])
    return core._replace(e=e, x=x, d=d)


def observe(
    observer: MechanismObserver,
    measured: Array,
    inputs: Array,
    dt: float,
    *,
    start: Any = None,
    single: bool = False,
) -> Array:
    """Return estimated velocities, shape (N, ..., n), each before its y_k is injected.

    Parameters
    ----------
    inputs : shape (N, m); row k acts from sample k to k + 1.
    start : qh(0); None: y(0). Velocity and momenta start at 0.
    single : the state is stored in single precision.
    """
    core = rest(measured[0], start)
    found = [core.v]
    with np.errstate(all='ignore'):  # with some seeds they diverge
        for before, now, u in zip(measured, measured[1:], inputs):
            core = follow(observer, core, before, now, u, dt)
            if single:
                core = in_single(core)
            found.append(core.v)
    return np.array(found)


def move(
    mechanics: Mechanics, q: Any, v: Any, inputs: Array, dt: float, parts: int
) -> tuple[Array, Array]:
    """Return (positions, velocities), shape (N, n): row k at sample k; input k acts from it on."""
    count = len(inputs) - 1
    at = np.array(q, float), np.array(v, float)
    return course(mechanics, *at, inputs[:count], np.full(count, dt), [parts] * count)


def metrics(errors: Array) -> Array:
    """Return ME x 1e2 and MSE x 1e4 of each column in turn, shape (..., 2 n): (23).

    `errors` has shape (N, ..., n); the units are that of a column, and its square.
    """
    both = 1e2 * np.mean(np.abs(errors), axis=0), 1e4 * np.mean(errors**2, axis=0)
    return np.stack(both, axis=-1).reshape(*errors.shape[1:-1], -1)


METRICS = tuple(
    f'{name}{joint}{unit}' for joint in (1, 2, 3) for name, unit in (('ME', 'e2'), ('MSE', 'e4'))
)
