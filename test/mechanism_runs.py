# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers of mechanisms driven by hand, for tests."""

import numpy as np

from estimator_pkg import observers
from estimator_pkg.models.load import load
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.mechanism.motion import make_plant
from estimator_pkg.parameters import build

NAMES = ('geso', 'hgo', 'ehgo', 'smo')
MODELS = ('single_joint', 'cart_pendulum', 'robotic_leg')
FAST = ('pendulum_inertia=1', 'pendulum_moment=0.9', 'moving_mass=1', 'gravity=1')


def made(name, circle=None, **values):
    """The functions of an observer of mechanisms."""
    record = observers.find(name)
    gains = build(record.gains, values)
    return record.build(gains, circle or Circle())


def driven(functions, dt, stamps, readings, inputs=None):
    """(velocities, statuses, last state) of a run, without the driver's guard."""
    design = functions.design()
    coefficients = functions.prepare(design, dt)
    state = functions.init(readings[0], design)
    velocities, statuses = [], []
    for k in range(1, stamps):
        u = inputs[k - 1] if inputs is not None else (0.0,) * max(1, functions.mechanics.inputs)
        state = functions.step(state, coefficients, design, readings[k], u)
        _, velocity, _, status = functions.output(state, coefficients, design, readings[k], u)
        velocities.append(velocity)
        statuses.append(status)
    return np.array(velocities), statuses, state


def motion(model, assignments, q, v, dt, count, inputs=None):
    """(positions, velocities) as lists of tuples."""
    mechanics = load(model, assignments)
    plant = make_plant(mechanics)
    positions, speeds = [], []
    for k in range(count):
        positions.append(q)
        speeds.append(v)
        u = inputs[k] if inputs is not None else (0.0,) * max(1, mechanics.inputs)
        q, v = plant(mechanics.values, q, v, u, dt, 4)
    return positions, np.array(speeds)
