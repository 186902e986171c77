# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of observers of mechanisms over simulated motions, for the rows of the table.

Every run steps the package's own observers, without their status and guard. Positions do not wrap.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.models import cart_pendulum, robotic_leg
from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.mechanism.core import Plan
from estimator_pkg.observers.mechanism.motion import MechanismSimulation
from estimator_pkg.observers.mechanism.state import Coefficients, State
from estimator_pkg.parameters import build

Array = NDArray[np.float64]

ONE_SIZE = Circle(0.0, False)  # no wrapping: the runs stay on one turn, or count turns


def quantise(values: Array, quantum: Any) -> Array:
    """Return Q(x) = d floor(x/d + 1/2), in the shape and units of `values`.

    Parameters
    ----------
    values : shape (N, n). quantum : d, one number or one for each column.
    """
    d = np.asarray(quantum, float)
    return d * np.floor(values / d + 0.5)


def make(observer: str, model: str, parameters: dict[str, Any], **gains: Any) -> Plan:
    """Return the plan of an observer of a built-in model, without wrapping (forward Euler)."""
    record = observers.find(observer)
    values = {
        'form': 'paper',
        'model': model,
        **gains,
        'model_parameters': [f'{name}={value!r}' for name, value in parameters.items()],
    }
    checked: Any = build(record.gains, values, owner=observer)
    count = {'single_joint': 1, 'cart_pendulum': 2, 'robotic_leg': 3}[model]
    plan: Plan = record.module.plan(checked, (ONE_SIZE,) * count)
    return plan


def observe(
    plan: Plan,
    measured: Array,
    inputs: Array,
    dt: float,
    *,
    start: Any = None,
    single: bool = False,
) -> Array:
    """Return estimated velocities, shape (N, n).

    Parameters
    ----------
    start : qh(0); None: y(0). Velocity and momenta start at 0.
    """
    state = plan.state()
    if start is not None:
        state.core.e[: measured.shape[1]] = (np.asarray(start, float) - measured[0]).tolist()
    return walk(plan, state, measured, inputs, dt, single)


def walk(
    plan: Plan, state: State, measured: Array, inputs: Array, dt: float, single: bool = False
) -> Array:
    """Return estimated velocities, shape (N, n); the state goes on.

    Parameters
    ----------
    measured : shape (N, n). Row k of the result is the estimate before y_k is injected.
    inputs : shape (N, m); row k acts from sample k to k + 1.
    single : the state is stored in single precision.
    """
    module, core, work, n = plan.module, state.core, state.work, plan.mechanics.degrees
    coefficients = Coefficients()
    module.prepare(coefficients, plan.design, dt)
    rows, found = measured.tolist(), [core.v[:n]]
    for (before, now), given in zip(pairwise(rows), inputs.tolist()):
        state.before[:n] = before
        work.moved[:n] = [new - old for new, old in zip(now, before)]
        if module.advance(module.model, state, coefficients, plan.design, now, given):
            core.take(work.after)
        if single:
            for each in (core.e, core.x, core.d):
                each[:n] = map(in_single, each[:n])
        found.append(core.v[:n])
    return np.array(found)


def in_single(x: float) -> float:
    """Return x rounded to the 24 digits of single precision (Veltkamp's splitting)."""
    wide = 536870913.0 * x
    return wide - (wide - x)


def move(
    mechanics: Mechanics, q: Any, v: Any, inputs: Array, dt: float, parts: int
) -> tuple[Array, Array]:
    """Return (positions, velocities), shape (N, n): row k at sample k; input k acts from it on."""
    count = len(inputs) - 1
    return MechanismSimulation(mechanics, q, v).run(
        inputs[:count], np.full(count, dt), np.full(count, parts)
    )


def metrics(errors: Array) -> list[float]:
    """Return ME x 1e2 and MSE x 1e4 of each column, in turn: (23).

    `errors` has shape (N, n); the units are that of a column, and its square.
    """
    values = []
    for column in errors.T:
        values += [float(np.mean(np.abs(column))) * 1e2, float(np.mean(column**2)) * 1e4]
    return values


METRICS = tuple(
    f'{name}{joint}{unit}' for joint in (1, 2, 3) for name, unit in (('ME', 'e2'), ('MSE', 'e4'))
)
OF_FIRST = ('ME1e2', 'MSE1e4', 'ME2e2', 'MSE2e4')


@lru_cache
def normalised() -> Mechanics:
    """The cart-pendulum of section 5.1: a = m = 1."""
    return cart_pendulum.build(cart_pendulum.Parameters(**cart_of()))


def cart_of() -> dict[str, float]:
    """Its numbers."""
    return {'pendulum_inertia': 1.0, 'pendulum_moment': 0.1, 'moving_mass': 1.0, 'gravity': 1.0}


@lru_cache
def leg() -> Mechanics:
    """Return the leg of section 5.2, without the guard of its domain."""
    return robotic_leg.build(robotic_leg.Parameters(margin=1e-9))
