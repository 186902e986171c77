# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers of mechanisms driven by hand, for tests."""

import numpy as np

from estimator_pkg import observers
from estimator_pkg.circle import Circle
from estimator_pkg.models.load import load
from estimator_pkg.observers.mechanism.core import MechanismEstimate
from estimator_pkg.observers.mechanism.motion import MechanismSimulation
from estimator_pkg.observers.mechanism.state import Coefficients, enlarge
from estimator_pkg.parameters import build

NAMES = ('geso', 'hgo', 'ehgo', 'smo')
MODELS = ('single_joint', 'cart_pendulum', 'robotic_leg')
FAST = ('pendulum_inertia=1', 'pendulum_moment=0.9', 'moving_mass=1', 'gravity=1')


def made(name, circle=None, **values):
    """The plan of an observer of mechanisms."""
    record = observers.find(name)
    return record.module.plan(build(record.gains, values), circle or Circle())


def begun(plan, dt, reading):
    """(state after this reading, coefficients)."""
    state, coefficients = plan.state(), Coefficients()
    plan.module.prepare(coefficients, plan.design, dt)
    plan.module.start(plan.module, state, plan.design, list(reading))
    return state, coefficients


def shown(plan, state, coefficients, reading):
    """(positions, velocities, status) of a state."""
    out, n = enlarge(MechanismEstimate(), plan.mechanics.degrees), plan.mechanics.degrees
    plan.module.estimate(plan.module, out, state, coefficients, plan.design, list(reading), [])
    return tuple(out.position[:n]), tuple(out.velocity[:n]), out.status


def stepped(plan, state, coefficients, reading, u):
    """Take one sample."""
    plan.module.step(plan.module, state, coefficients, plan.design, list(reading), list(u))


def driven(plan, dt, stamps, readings, inputs=None):
    """(velocities, statuses, last state) of a run, without the driver's guard."""
    state, coefficients = begun(plan, dt, readings[0])
    velocities, statuses = [], []
    for k in range(1, stamps):
        u = inputs[k - 1] if inputs is not None else (0.0,) * max(1, plan.mechanics.inputs)
        stepped(plan, state, coefficients, readings[k], u)
        _, velocity, status = shown(plan, state, coefficients, readings[k])
        velocities.append(velocity)
        statuses.append(status)
    return np.array(velocities), statuses, state


def motion(model, assignments, q, v, dt, count, inputs=None, parts=4):
    """(positions, velocities) as lists of tuples."""
    mechanics = load(model, assignments)
    plant = MechanismSimulation(mechanics, q, v)
    positions, speeds = [], []
    for k in range(count):
        positions.append(q)
        speeds.append(v)
        u = inputs[k] if inputs is not None else (0.0,) * max(1, mechanics.inputs)
        q, v = plant.step(u, dt, parts)
    return positions, np.array(speeds)
