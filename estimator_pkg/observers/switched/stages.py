# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The continuous part: step-by-step super-twisting (22), one stage after the other."""

from __future__ import annotations

import math

import numpy as np

from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.observers.maths.twisting import implicit_step
from estimator_pkg.observers.switched.state import Design, Stage, State

LAMBDA, ALPHA = 1.5, 1.1  # lambda = 1.5 sqrt(L), alpha = 1.1 L


def stage(bound: float) -> Stage:
    """Return a stage for a derivative within `bound`."""
    made = Stage()
    made.gain, made.alpha = LAMBDA * math.sqrt(bound), ALPHA * bound
    return made


def climb(state: State, design: Design, i: int, jump: float, h: float) -> None:
    """Take a sample of output i, which changed by `jump` in h [s].

    A stage runs while the errors of all stages before it are within the gate, (23).
    """
    zh, zt, signal = state.zh[i], state.zt[i], state.y[i] + jump
    for j, stage in enumerate(design.stages[i]):
        ahead = zh[j] + h * zt[j]
        left, push = implicit_step(signal - ahead, h, stage.gain, stage.alpha)
        zt[j] += h * push
        zh[j] = signal - left
        state.errors[i][j] = left
        if abs(left) >= design.gate:
            break
        signal = zt[j]


def chains(state: State) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return (zeta, last derivative of each chain) of the stages."""
    zeta: list[float] = []
    for y, zt in zip(state.y, state.zt):
        zeta += [y, *zt[:-1]]
    return tuple(zeta), tuple(zt[-1] for zt in state.zt)


def gates_open(state: State, design: Design) -> bool:
    """Return True if every stage runs."""
    return all(abs(e) < design.gate for errors in state.errors for e in errors[:-1])


def ending(model: SwitchedModel, zeta: tuple, u: tuple, z: tuple) -> list[float]:
    """Return Gamma + Lambda Z, the last derivative of each chain (9)."""
    found: list[float] = (
        np.array(model.gamma(zeta, u)) + np.array(model.lam(zeta, u)) @ z
    ).tolist()
    return found


def moved_chain(
    model: SwitchedModel, zeta: tuple[float, ...], old: tuple[float, ...], new: tuple[float, ...]
) -> tuple[float, ...]:
    """Return zeta after Z has jumped from `old` to `new`, by (13): x is continuous."""
    return tuple(map(float, model.zeta(model.state(zeta, old), new)))
