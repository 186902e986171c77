# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The discrete part at an event: prediction of Z, inversion from the last intervals, reset."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.observers.switched.regression import carry, certain, sigmas
from estimator_pkg.observers.switched.stages import chains, ending, gates_open, moved_chain
from estimator_pkg.observers.switched.state import Array, Design, Interval, State
from estimator_pkg.observers.switched.velocity import move_observers


def discrete(state: State, design: Design) -> tuple[tuple[float, ...], tuple[float, ...], bool]:
    """Return (Z, its standard deviations, converged); Z is the prediction until it converges."""
    if not design.regression:
        return tuple(state.predicted.tolist()), (math.nan,) * len(state.z), state.fitted
    if not settled(state, design) or state.forgetting > 0.0:
        return tuple(state.predicted.tolist()), (math.inf,) * len(state.z), False
    found = sigmas(state)
    return tuple(state.z.tolist()), found, certain(state, found)


def settled(state: State, design: Design) -> bool:
    """Return True if more than the settling time has passed since the event, (26)."""
    return state.age > design.settle


def jump(observer: Any, state: State, design: Design, mode: str, v: tuple[float, ...]) -> None:
    """Take a switching instant; `mode` and `v` are as the model defines them.

    Z(k) is reconstructed if possible and predicted across the event: N + 1 steps from Z(k - N),
    which the stacked rows determine.
    """
    model = observer.model
    known = model.transition(mode)
    old = np.array(discrete(state, design)[0])
    state.fitted = False
    if known is None:
        carry(state, design)
        state.history, state.predicted, state.p = [], old, np.diag(design.vague)
    else:
        newest = interval(model, state, design, known, mode, v)
        state.history = [*state.history, newest][-(design.steps + 1) :]
        a, beta = newest.a, newest.beta
        if not design.regression:
            old, state.fitted = inverted(state, design, old)
        carry(state, design)
        state.predicted, state.z, state.p = a @ old + beta, a @ state.z + beta, a @ state.p @ a.T
        move(model, state, design, tuple(old.tolist()), tuple(state.predicted.tolist()))
    state.age = 0.0
    state.y_at[:] = state.y


def interval(
    model: SwitchedModel, state: State, design: Design, known: Any, mode: str, v: tuple[float, ...]
) -> Interval:
    """Return what the interval that ends has shown; `known` is A_d."""
    made, u = Interval(), tuple(state.u)
    zeta, theta = chains(state)
    made.a = np.array(known, float)
    made.beta = np.array(model.offset(mode, v, tuple(state.y_at)), float)
    made.lam = np.array(model.lam(zeta, u), float)
    made.y = np.array(theta) - np.array(model.gamma(zeta, u), float)
    made.settled = settled(state, design) and gates_open(state, design)
    return made


def inverted(state: State, design: Design, fallback: Array) -> tuple[Array, bool]:
    """Return (Z(k), shape (m,), success) by (28) from the last N + 1 intervals; k is the last."""
    m, history = len(state.z), state.history
    if len(history) <= design.steps or not all(each.settled for each in history):
        return fallback, False
    matrix, rest = np.eye(m), np.zeros(m)
    blocks, right, at = [], [], (matrix, rest)
    for each in history:
        blocks.append(each.lam @ matrix)
        right.append(each.y - each.lam @ rest)
        at = (matrix, rest)
        matrix, rest = each.a @ matrix, each.a @ rest + each.beta
    u, values, vt = np.linalg.svd(np.vstack(blocks), full_matrices=False)
    if len(values) < m or values[-1] <= design.singular_value:
        return fallback, False
    first = vt.T @ ((u.T @ np.concatenate(right)) / values)
    return at[0] @ first + at[1], True


def move(
    model: SwitchedModel, state: State, design: Design, old: tuple[float, ...], new: tuple
) -> None:
    """Take the reset (13): x is continuous, so zeta and both chains jump as Z jumps."""
    zeta, theta = chains(state)
    after = moved_chain(model, zeta, old, new)
    ends = ending(model, after, tuple(state.u), new) if design.resets_ends else theta
    for i, (first, k) in enumerate(zip(model.firsts, model.indices)):
        for j in range(1, k):
            state.zh[i][j] += after[first + j] - zeta[first + j]
        state.zt[i][:] = *after[first + 1 : first + k], ends[i]
    move_observers(model, state, old, new)
