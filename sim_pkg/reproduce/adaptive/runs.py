# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `adaptive` on sampled signals, without the driver, for the rows."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.estimate import Estimate
from estimator_pkg.observers.adaptive import observer as adaptive
from estimator_pkg.observers.adaptive.motion import set_plant
from estimator_pkg.observers.adaptive.observer import Gains
from estimator_pkg.observers.adaptive.state import Coefficients, State
from sim_pkg.reproduce.adaptive.plant import Array, Example


class Run(NamedTuple):
    """A run, every n-th sample; the first row is the first kept sample.

    time : s. position : estimated [rad]. paper, full : velocity by (38) and by the full formula
    [rad/s]. theta : shape (n, m). phase : see `estimator_pkg.observers.adaptive.observer`.
    """

    time: Array
    position: Array
    paper: Array
    full: Array
    theta: Array
    phase: Array


def gains(example: Example, **changes: Any) -> Gains:
    """Return the paper's observer: gradient, sampled form, no gate, no settling time."""
    plain = Gains(
        law='gradient',
        observer_poles=example.observer_poles,
        model_poles=example.model_poles,
        gamma=example.gamma,
        settle=0.0,
        gate='none',
        velocity='paper',
        start_variance=(1e6,),
        knock=0.0,
    )
    return replace(plain, **changes)


def run(
    settings: Gains,
    angles: Array,
    inputs: Array,
    dt: float,
    every: int = 1,
    *,
    from_zero: bool = False,
    leak: float = 0.0,
    dead_zone: float = 0.0,
) -> Run:
    """Run the observer on these samples.

    Parameters
    ----------
    angles : shape (n + 1,) [rad]; inputs : shape (n,), constant between the samples.
    every : keep every n-th sample.
    from_zero : start regressor and x at zero instead of at the first angle.
    leak : rate at which the parameters return to their start values [1/s]. dead_zone : innovations
        below it are ignored [rad]. Both are remedies of others that the observer does not have;
        they need the sampled form, where x follows theta by itself.
    """
    design, coefficients = adaptive.design(settings, Circle(0.0)), Coefficients()
    adaptive.prepare(coefficients, design, dt)
    state, out = State(), Estimate()
    adaptive.start(adaptive, state, design, float(angles[0]))
    if from_zero:
        state.of_y, state.of_u, state.of_one, state.of_sine, state.z = (
            [0.0] * design.order for _ in range(5)
        )
    count = len(inputs) // every
    kept = np.full((count, 3 + len(state.theta)), math.nan)
    leak *= dt
    with suppress(OverflowError):  # diverged
        for k, (angle, given) in enumerate(zip(angles[1:].tolist(), inputs.tolist()), start=1):
            before = state.theta[:]
            adaptive.step(adaptive, state, coefficients, design, angle, given)
            if dead_zone > 0.0:
                after, state.theta = state.theta, before
                set_plant(state, design)
                adaptive.estimate(adaptive, out, state, coefficients, design, angle, given)
                if not -dead_zone <= angle - out.position <= dead_zone:
                    state.theta = after
                    set_plant(state, design)
            elif leak > 0.0:
                state.theta = [
                    (1.0 - leak) * own + leak * first
                    for own, first in zip(state.theta, design.start)
                ]
                set_plant(state, design)
            if k % every == 0:
                adaptive.estimate(adaptive, out, state, coefficients, design, angle, given)
                kept[k // every - 1] = out.position, out.velocity, state.phase, *state.theta
    rows = np.arange(1, count + 1) * every
    free = kept[:, 3:]
    b1 = free[:, 2] if free.shape[1] >= 4 else 0.0
    return Run(
        rows * dt, kept[:, 0], kept[:, 1], kept[:, 1] + b1 * inputs[rows - 1], free, kept[:, 2]
    )
