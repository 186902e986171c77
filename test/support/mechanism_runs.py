# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers of mechanisms driven by hand, for tests."""

import numpy as np

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.models.load import load
from estimator_pkg.models.motion import course
from estimator_pkg.observers.mechanism.observer import State
from estimator_pkg.parameters import build

NAMES = ('geso', 'hgo', 'ehgo', 'smo')
MODELS = ('single_joint', 'cart_pendulum', 'robotic_leg')
FAST = ('pendulum_inertia=1', 'pendulum_moment=0.9', 'moving_mass=1', 'gravity=1')


def made(name, circle=None, **values):
    """An observer of mechanisms with its gains."""
    record = observers.find(name)
    return record.plan(build(record.gains, values), circle or Circle())


def begun(observer, reading):
    """The state after this reading."""
    state = State(observer.mechanics.degrees)
    observer.start(state, reading)
    return state


def driven(observer, dt, count, readings, inputs=None):
    """(velocities, statuses, last state) of a run, without the driver's guard."""
    state = begun(observer, readings[0])
    velocities, statuses = [], []
    for k in range(1, count):
        u = inputs[k - 1] if inputs is not None else (0.0,) * observer.mechanics.inputs
        observer.step(state, dt, readings[k], u)
        velocities.append(state.core.v)
        statuses.append(state.status)
    return np.array(velocities), statuses, state


def motion(model, assignments, q, v, dt, count, inputs=None, parts=4):
    """Positions and velocities, shape (count, n)."""
    mechanics = load(model, assignments)
    u = np.zeros((count, mechanics.inputs)) if inputs is None else np.array(inputs, float)
    at = np.array(q, float), np.array(v, float)
    return course(mechanics, *at, u[: count - 1], np.full(count - 1, dt), [parts] * (count - 1))
