# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The discrete part at an event: prediction of Z, inversion from the last intervals, reset."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from estimator_pkg.observers.switched.regression import carry, certain, sigmas, vague
from estimator_pkg.observers.switched.stages import gates_open
from estimator_pkg.observers.switched.state import State
from estimator_pkg.observers.switched.system import System
from estimator_pkg.observers.switched.velocity import moved_chain, moved_observers


def discrete(system: System, state: State) -> tuple[tuple[float, ...], tuple[float, ...], bool]:
    """Return (Z, its standard deviations, converged); Z is the prediction until it converges."""
    if not system.is_regression:
        known = state.fitted or system.gains.discrete == 'copy'
        return state.predicted, (math.nan,) * system.model.size, known
    if not settled(system, state) or state.forgetting > 0.0:
        return state.predicted, (math.inf,) * system.model.size, False
    return state.z, sigmas(state), certain(state)


def settled(system: System, state: State) -> bool:
    """Return True if more than the settling time has passed since the event, (26)."""
    return state.age > system.gains.settle


def jump(system: System, state: State, event: tuple) -> State:
    """Return the state after a switching instant; `event` is (mode, v).

    Z(k) is reconstructed if possible and predicted across the event: N + 1 steps from Z(k - N),
    which the stacked rows determine.
    """
    mode, v = event
    model = system.model
    zeta, theta = system.chains(state)
    known = model.transition(mode)
    shown = discrete(system, state)[0]
    if known is None:
        return carry(system, state)._replace(
            history=(), predicted=shown, p=vague(system), age=0.0, y_at=state.y, fitted=False
        )
    a, beta = np.array(known), np.array(model.offset(mode, v, state.y_at))
    row = (
        np.array(model.lam(zeta, state.u)),
        np.array(theta) - np.array(model.gamma(zeta, state.u)),
        a,
        beta,
        settled(system, state) and gates_open(system, state),
    )
    history = (*state.history, row)[-(system.gains.steps + 1) :]
    old, fitted = np.array(shown), False
    if system.gains.discrete == 'inversion':
        old, fitted = inverted(system, history, old)
    new = tuple((a @ old + beta).tolist())
    after = carry(system, state)._replace(
        history=history,
        predicted=new,
        z=tuple((a @ np.array(state.z) + beta).tolist()),
        age=0.0,
        y_at=state.y,
        fitted=fitted,
        p=tuple(map(tuple, (a @ np.array(state.p) @ a.T).tolist())),
    )
    if system.gains.reset == 'none':
        return after
    return moved(system, after, tuple(old.tolist()), new)


def inverted(system: System, history: tuple, fallback: Any) -> tuple[Any, bool]:
    """Return (Z(k), success) by (28), where k is the interval that ends, from the last N + 1."""
    m, gains = system.model.size, system.gains
    if len(history) <= gains.steps or not all(row[4] for row in history):
        return fallback, False
    matrix, rest = np.eye(m), np.zeros(m)
    blocks, right, at = [], [], (matrix, rest)
    for lam, y, a, beta, _ in history:
        blocks.append(lam @ matrix)
        right.append(y - lam @ rest)
        at = (matrix, rest)
        matrix, rest = a @ matrix, a @ rest + beta
    stacked = np.vstack(blocks)
    u, values, vt = np.linalg.svd(stacked, full_matrices=False)
    if len(values) < m or values[-1] <= gains.singular_value:
        return fallback, False
    first = vt.T @ ((u.T @ np.concatenate(right)) / values)
    return at[0] @ first + at[1], True


def moved(system: System, state: State, old: tuple, new: tuple) -> State:
    """Return the state after the reset (13): x is continuous, so zeta and both chains jump."""
    model = system.model
    zeta, theta = system.chains(state)
    after = moved_chain(system, zeta, old, new)
    ending = tuple(theta)
    if system.gains.reset == 'all':
        ending = system.ending(after, state.u, new)
    zh, zt = [], []
    for i in system.outputs:
        first, k = model.firsts[i], model.indices[i]
        change = [after[first + j] - zeta[first + j] for j in range(k)]
        zh.append((state.zh[i][0], *(state.zh[i][j] + change[j] for j in range(1, k))))
        zt.append((*(after[first + j] for j in range(1, k)), ending[i]))
    return state._replace(
        zh=tuple(zh), zt=tuple(zt), used=new, observed=moved_observers(system, state, old, new)
    )
