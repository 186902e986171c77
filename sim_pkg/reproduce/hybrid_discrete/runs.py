# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid observer on the paper's example and on the gripper joint, without the driver."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.models import gripper
from estimator_pkg.models.switched import SwitchedModel, load, trajectory
from estimator_pkg.observers.switched.observer import OBSERVER, Gains
from estimator_pkg.observers.switched.stages import chains
from estimator_pkg.observers.switched.state import Coefficients, Estimate, State
from sim_pkg.reproduce.adaptive.plant import Array, lcg

EVENTS = 40  # periods of 0.5 s
GRIPS_AT = 2.0  # [s]


class Observed:
    """The observer with these gains at one sample time, without the driver.

    Parameters
    ----------
    dt : sample time [s]. measurement : the first sample.
    """

    def __init__(
        self, gains: Gains, circle: Circle, dt: float, measurement: tuple[float, ...]
    ) -> None:
        self.module: Any = OBSERVER.module_of(gains)
        self.design = self.module.design(gains, circle)
        self.state, self.coefficients = State(), Coefficients()
        self.module.prepare(self.coefficients, self.design, dt)
        self.module.start(self.module, self.state, self.design, measurement)

    def step(self, measurement: tuple[float, ...], known_input: tuple[float, ...] = ()) -> None:
        """Take one sample."""
        self.module.step(
            self.module, self.state, self.coefficients, self.design, measurement, known_input
        )

    def jump(self, mode: str = '') -> None:
        """Take an event."""
        self.module.jump(self.module, self.state, self.design, mode, ())

    def discrete(self) -> tuple[tuple[float, ...], tuple[float, ...], bool]:
        """Return (Z, its standard deviations, converged)."""
        found: tuple[tuple[float, ...], tuple[float, ...], bool]
        found = self.module.discrete(self.state, self.design)
        return found

    def states(self) -> tuple[float, ...]:
        """Return x, in the coordinates of the model."""
        found: tuple[float, ...]
        found = self.module.model.state(chains(self.state)[0], self.discrete()[0])
        return found

    def estimate(self) -> Estimate:
        """Return the estimate of all outputs."""
        out = Estimate()
        self.module.estimate(self.module, out, self.state, self.coefficients, self.design, (), ())
        return out


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
    measured = states[:, [0, 2]]
    if noise:
        measured = measured + noise / math.sqrt(3.0) * lcg(777, measured.size).reshape(-1, 2)
    rows = [tuple(row) for row in measured.tolist()]
    gains = Gains(model='example', settle=0.0, **{'discrete': 'inversion', **changes})
    observed = Observed(gains, Circle(0.0), dt, rows[0])
    per_period = round(model.period / dt)
    errors, state_errors, zeta_hats, zetas = [], [], [], []
    z_hat = [tuple(observed.state.predicted)]
    for i in range(1, len(rows)):
        observed.step(rows[i])
        zeta, ending = chains(observed.state)
        true = model.zeta(states[i], z[i - 1])
        end = np.array(model.gamma(true, ())) + np.array(model.lam(true, ())) @ z[i - 1]
        errors.append(
            (zeta[1] - true[1], ending[0] - end[0], zeta[3] - true[3], ending[1] - end[1])
        )
        zetas.append(true)
        zeta_hats.append(zeta)
        state_errors.append(np.array(observed.states()) - states[i])
        if i % per_period == 0:
            observed.jump()
            z_hat.append(tuple(observed.state.predicted))
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
    observed = Observed(Gains(**changes), Circle(), 1e-3, (float(angles[0]),))
    found: list[tuple[float, ...]] = [(0.0,) * 3]
    converged, errors = [False], [0.0]
    for i, angle in enumerate(angles[1:].tolist(), start=1):
        observed.step((angle,), torques[i - 1])
        z, _, is_converged = observed.discrete()
        found.append(z)
        converged.append(is_converged)
        errors.append(observed.estimate().velocity[0] - states[i, 1])
        if i == round(GRIPS_AT * 1e3):
            observed.jump(mode)
        elif virtual and i % round(virtual * 1e3) == 0:
            observed.jump('same')
    return Grip(np.array(found), np.array(converged), np.array(errors))
