# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid observer on the paper's example, without the driver."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import Circle
from estimator_pkg.models.switched import load, trajectory
from estimator_pkg.observers.switched.observer import Gains, Switched
from estimator_pkg.observers.switched.stages import chains
from estimator_pkg.observers.switched.state import Coefficients, OutputEstimates, State

Array = NDArray[np.floating[Any]]

EVENTS = 20  # periods of 0.5 s


class Observed:
    """The observer with these gains at one sample time, without the driver.

    Parameters
    ----------
    dt : sample time [s]. measurement : the first sample.
    """

    def __init__(
        self, gains: Gains, circle: Circle, dt: float, measurement: tuple[float, ...]
    ) -> None:
        self.module: Any = Switched.bound(gains)
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

    def estimate(self) -> OutputEstimates:
        """Return the estimate of all outputs."""
        out = OutputEstimates()
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


@lru_cache
def example(dt: float, events: int = EVENTS) -> Run:
    """Run the observer on the example, sampled every dt [s]."""
    model = load('example')
    times, states, z = trajectory(model, events, step=dt)
    rows = [tuple(row) for row in states[:, [0, 2]].tolist()]
    gains = Gains(model='example', settle=0.0, discrete='inversion', reset='states')
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
