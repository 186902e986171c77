# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `adaptive` on sampled signals, without the driver, for the rows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.driver.compiled import available, compiled
from estimator_pkg.observers.adaptive.gains import Gains
from estimator_pkg.observers.adaptive.observer import OBSERVER, Design
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.maths.unroll import algebra
from sim_pkg.reproduce.adaptive.plant import Array, Example

COMPILE_FROM = 50_000  # samples from which compiling pays


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


def with_theta(state: tuple, theta: tuple) -> tuple:
    """Return the observer's state with other parameters."""
    inner, z, _, information, p, convention, scatter, signals, flags, evidence = state
    return inner, z, theta, information, p, convention, scatter, signals, flags, evidence


@lru_cache
def _loop(step: Callable, output: Callable, size: int) -> Callable:
    add, scale = algebra(size).add, algebra(size).scale

    def loop(
        state: tuple,
        coefficients: tuple,
        design: Design,
        angles: Array,
        inputs: Array,
        every: int,
        kept: Array,
        leak: float,
        dead: float,
    ) -> tuple:
        for k in range(1, len(angles)):
            _, _, before, _, _, _, _, _, _, _ = state
            state = step(state, coefficients, design, angles[k], inputs[k - 1])
            if dead > 0.0:
                unmoved = with_theta(state, before)
                e = angles[k] - output(unmoved, coefficients, design, angles[k], inputs[k - 1])[0]
                if -dead <= e <= dead:
                    state = unmoved
            elif leak > 0.0:
                _, _, theta, _, _, _, _, _, _, _ = state
                theta = add(scale(1.0 - leak, theta), leak, design.start)
                state = with_theta(state, theta)
            if k % every == 0:
                position, speed, acceleration, status = output(
                    state, coefficients, design, angles[k], inputs[k - 1]
                )
                row = kept[k // every - 1]
                _, _, theta, _, _, _, _, _, (phase, _, _), _ = state
                row[0], row[1], row[2] = position, speed, phase
                i = 3
                for value in theta:
                    row[i] = value
                    i += 1
        return state

    return loop


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
    functions = OBSERVER.build(settings, Circle(0.0))
    design = functions.design()
    state = functions.init(float(angles[0]), design)
    if from_zero:
        _, _, *others = state
        state = (((0.0, 0.0),) * 4, (0.0, 0.0), *others)
    coefficients = functions.prepare(design, dt)
    count = len(inputs) // every
    _, _, theta, *_ = state
    kept = np.full((count, 3 + len(theta)), math.nan)
    loop = _loop(functions.step, functions.output, len(theta))
    remedies = (leak * dt, dead_zone)
    with np.errstate(over='ignore', invalid='ignore'):
        if len(inputs) >= COMPILE_FROM and available():
            compiled(loop)(state, coefficients, design, angles, inputs, every, kept, *remedies)
        else:
            try:
                loop(
                    state,
                    coefficients,
                    design,
                    angles.tolist(),
                    inputs.tolist(),
                    every,
                    kept,
                    *remedies,
                )
            except OverflowError:
                kept[:, :] = math.nan  # diverged
    rows = np.arange(1, count + 1) * every
    free = kept[:, 3:]
    b1 = free[:, 2] if free.shape[1] >= 4 else 0.0
    return Run(
        rows * dt, kept[:, 0], kept[:, 1], kept[:, 1] + b1 * inputs[rows - 1], free, kept[:, 2]
    )
