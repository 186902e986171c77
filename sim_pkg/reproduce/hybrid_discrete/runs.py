# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid observer on the paper's example and on the gripper joint, without the driver."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.models import gripper
from estimator_pkg.models.switched import SwitchedModel, load, trajectory
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.switched.gains import Gains
from estimator_pkg.observers.switched.observer import build
from sim_pkg.reproduce.adaptive.plant import Array, lcg

EVENTS = 40  # periods of 0.5 s
GRIPS_AT = 2.0  # [s]


class Run(NamedTuple):
    """A run on the example; row i at times[i] [s], before an event if one is there.

    Arrays have shape (n, 4), but times (n,), and z and z_hat (events + 1, 3).

    zeta_error : absolute errors of zeta2, end of the first chain, zeta4, end of the second chain.
    state, state_error : x, and estimated minus true x.
    z, z_hat : true and estimated Z at the start and after each event.
    """

    times: Array
    zeta_error: Array
    state: Array
    state_error: Array
    zeta: Array
    zeta_hat: Array
    z: Array
    z_hat: Array

    def settling(self, first: int, last: int, dt: float) -> list[float]:
        """Worst time of intervals first..last until the errors stay below (.05, 1, .05, 1) [s]."""
        per_period = len(self.times) // (len(self.z) - 1)
        worst = [0.0] * 4
        for k in range(first, last + 1):
            part = self.zeta_error[k * per_period : (k + 1) * per_period]
            for j, limit in enumerate((0.05, 1.0, 0.05, 1.0)):
                astray = np.flatnonzero(part[:, j] > limit)
                if len(astray):
                    worst[j] = max(worst[j], (astray[-1] + 1) * dt)
        return worst

    @property
    def discrete_error(self) -> Array:
        """Largest entry of |Zhat - Z| at the start and after each event, shape (events + 1,)."""
        return np.abs(self.z_hat - self.z).max(axis=1)


@lru_cache(maxsize=4)
def plant(
    dt: float, start: tuple[float, ...] = (), events: int = EVENTS
) -> tuple[SwitchedModel, Array, Array, Array]:
    """Return (model, times, states, Z) of the example, sampled every dt [s]; `start` sets Z(0).

    The arrays have shape (n,) [s], (n, 4) and (n, 3).
    """
    model = load('example')
    if start:
        model = replace(model, start=(model.start[0], start))
    return (model, *trajectory(model, events, step=dt))


@lru_cache(maxsize=8)
def example(
    dt: float,
    noise: float = 0.0,
    start: tuple[float, ...] = (),
    events: int = EVENTS,
    **changes: Any,
) -> Run:
    """Run the observer on the example.

    Parameters
    ----------
    noise : amplitude of uniform noise on both outputs.
    start, events : as in `plant`.
    """
    model, times, states, z = plant(dt, start, events)
    functions = build(
        Gains(model='example', settle=0.0, **{'discrete': 'inversion', **changes}), Circle(0.0)
    )
    measured = states[:, [0, 2]]
    if noise:
        measured = measured + noise / math.sqrt(3.0) * lcg(777, measured.size).reshape(-1, 2)
    rows = [tuple(row) for row in measured.tolist()]
    coefficients = functions.prepare((), dt)
    state = functions.init(rows[0], ())
    per_period = round(model.period / dt)
    errors, state_errors, zeta_hats, z_hat = [], [], [], [state.predicted]
    zetas = []
    for i in range(1, len(rows)):
        state = functions.step(state, coefficients, (), rows[i], ())
        zeta, ending = functions.chains(state)
        true = model.zeta(states[i], z[i - 1])
        end = np.array(model.gamma(true, ())) + np.array(model.lam(true, ())) @ z[i - 1]
        errors.append(
            (zeta[1] - true[1], ending[0] - end[0], zeta[3] - true[3], ending[1] - end[1])
        )
        zetas.append(true)
        zeta_hats.append(zeta)
        state_errors.append(np.array(functions.states(state)) - states[i])
        if i % per_period == 0:
            state = functions.jump(state, ('', ()))
            z_hat.append(state.predicted)
    return Run(
        times[1:],
        np.abs(errors),
        states[1:],
        np.array(state_errors),
        np.array(zetas),
        np.array(zeta_hats),
        z[::per_period],
        np.array(z_hat),
    )


class Grip(NamedTuple):
    """A run on the gripper joint, 1 kHz, load gripped at GRIPS_AT.

    z : (n, 3), converged : (n,), velocity_error : (n,) [rad/s]; row i at i ms.
    """

    z: Array
    converged: Array
    velocity_error: Array


@lru_cache
def _gripper_plant() -> tuple[Array, list[tuple[float, ...]]]:
    dt, count = 1e-3, 4000
    x, states, torques = np.array(gripper.MODEL.start[0]), [], []
    for i in range(count + 1):
        states.append(x)
        z = gripper.OPEN if i * dt < GRIPS_AT - 1e-9 else gripper.CLOSED
        u = gripper.torque((i + 0.5) * dt)
        torques.append(u)

        def slope(at: Array, z: tuple = z, u: tuple = u) -> Array:
            return np.array(gripper.dynamics(at.tolist(), z, u))

        k1 = slope(x)
        k2 = slope(x + 0.5 * dt * k1)
        k3 = slope(x + 0.5 * dt * k2)
        x = x + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + slope(x + dt * k3))
    return np.array(states), torques


@lru_cache
def grip(counts: int, mode: str = 'close', virtual: float = 0.0, **changes: Any) -> Grip:
    """Run the observer on the gripper joint.

    Parameters
    ----------
    counts : counts per revolution of the encoder; 0: exact.
    mode : name of the event at GRIPS_AT.
    virtual : time between events without effect, for the inversion [s]; 0: none.
    """
    states, torques = _gripper_plant()
    angles = states[:, 0]
    if counts:
        quantum = 2.0 * math.pi / counts
        angles = np.round(angles / quantum) * quantum
        changes['quantum'] = quantum
    functions = build(Gains(**changes), Circle())
    coefficients = functions.prepare((), 1e-3)
    state = functions.init((float(angles[0]),), ())
    found: list[tuple[float, ...]] = [(0.0,) * 3]
    converged, errors = [False], [0.0]
    for i, angle in enumerate(angles[1:].tolist(), start=1):
        state = functions.step(state, coefficients, (), (angle,), torques[i - 1])
        z, _, is_converged = functions.discrete(state)
        found.append(z)
        converged.append(is_converged)
        errors.append(functions.outputs(state, (angle,))[0][1] - states[i, 1])
        if i == round(GRIPS_AT * 1e3):
            state = functions.jump(state, (mode, ()))
        elif virtual and i % round(virtual * 1e3) == 0:
            state = functions.jump(state, ('same', ()))
    return Grip(np.array(found), np.array(converged), np.array(errors))
