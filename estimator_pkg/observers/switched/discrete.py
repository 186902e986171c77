# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Discrete state: Z from least squares or inversion, its prediction and the reset at an event.

Inversion, (25), (28), (29): at each event, from the last N + 1 intervals; for exact outputs.

Regression, within an interval: all signals pass the same filter, so that Y = Gamma + Lambda Z needs
no derivative of the outputs. Its matrix A is the companion of k equal poles, k the length of the
chain. A filter's state commutes with A, so that its first row is all of it. At an event the filters
of Lambda are reset, and their old content, multiplied by the old Z, decays in a filter of its own.
So learning can go on without waiting for the filters to forget.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.observers.maths.least_squares import update
from estimator_pkg.observers.maths.linear import companion, response
from estimator_pkg.observers.switched.stages import chains, ending, gates_open, moved_chain
from estimator_pkg.observers.switched.state import (
    Array,
    Coefficients,
    Design,
    Interval,
    RegressionFilter,
    Signals,
    State,
)
from estimator_pkg.observers.switched.velocity import move_observers

FILTER_RATE = 25.0  # poles of the filters [1/s]
FORGOTTEN = 8.0 / FILTER_RATE  # time until a filter has forgotten its start [s]
UNKNOWN_VARIANCE = 1e8  # variance of an unknown Z, in variances of the measurement noise
CERTAIN = 0.1  # a standard deviation below this part of Z counts as converged
POWER_WEIGHT = 0.02  # weight of the newest residual in their mean square


# Events


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


# Regression


@lru_cache
def column(k: int) -> tuple[float, ...]:
    """Return the first column of the filter's matrix A, shape (k,)."""
    return tuple(-math.comb(k, i + 1) * FILTER_RATE ** (i + 1) for i in range(k))


def regression_filter(k: int, dt: float) -> RegressionFilter:
    """Return the filter for a chain of this length at dt [s]."""
    made = RegressionFilter()
    made.F, of_constant, of_ramp = response(column(k), FILTER_RATE, dt)
    made.responses, made.column = np.stack([of_constant[0], of_ramp[0]]), np.array(column(k))
    return made


def resting(k: int, value: float) -> Array:
    """Return the state of a filter in steady state at a `value` [rad or m], shape (k,)."""
    return np.array([*(0.0,) * (k - 1), -value / column(k)[-1]])


def begin_signals(k: int, m: int, value: float) -> Signals:
    """Return the filters of an output at rest at `value` [rad or m]."""
    made = Signals()
    made.rows, made.carried = np.zeros((m + 2, k)), np.zeros(k)
    made.rows[0] = resting(k, value)
    return made


def signals(model: SwitchedModel, y: tuple, u: tuple, zeta: tuple) -> Array:
    """Return Gamma and Lambda (or antiderivatives of their columns), shape (outputs, m + 1)."""
    if model.basis is not None:
        return np.array(model.basis(y, u), float)
    return np.column_stack([model.gamma(zeta, u), model.lam(zeta, u)]).astype(float)


def learn(
    model: SwitchedModel,
    state: State,
    coefficients: Coefficients,
    design: Design,
    y: tuple[float, ...],
    jumps: list[float],
    u: tuple[float, ...],
) -> None:
    """Filter all signals, and take one least-squares update.

    Parameters
    ----------
    y : the new outputs. u : the input since the last sample.
    jumps : change of each output since the last sample.
    """
    # the input u was constant over the interval: columns go from (y before, u) to (y now, u)
    before = state.last_columns
    if model.basis is not None:
        before = signals(model, tuple(state.y), u, ())
    state.y[:] = y
    state.last_columns = signals(model, y, u, chains(state)[0])
    for i, filter_of in enumerate(coefficients.filters):
        row, target = filtered(state, design, i, jumps[i], before[i], filter_of)
        if state.forgetting <= 0.0:
            residual = target - float(row @ state.z)
            state.z, state.p, s = update(
                state.z, state.p, row, residual, coefficients.keep, design.vague
            )
            state.power += POWER_WEIGHT * (residual * residual / s - state.power)


def filtered(
    state: State, design: Design, i: int, jump: float, before: Array, filter_of: RegressionFilter
) -> tuple[Array, float]:
    """Return (row of Lambda, shape (m,), target that the row times Z must equal) of output i.

    `before`, shape (m + 1,), are Gamma and Lambda at the last sample.
    """
    own, orders, size = state.signals[i], design.orders[i], len(before) + 1
    signal = np.empty((2, size))  # at the start of the sample, and its rise
    signal[:, 0] = state.y[i] - jump, jump
    signal[0, 1:], signal[1, 1:] = before, state.last_columns[i] - before
    signal[0, 2:] -= orders[1:] * state.origin[i, 1:]
    own.rows = own.rows @ filter_of.F + signal.T @ filter_of.responses
    own.carried = own.carried @ filter_of.F
    shown = own.rows[np.arange(1, size), -1 - orders]
    target = state.y[i] + own.rows[0] @ filter_of.column - shown[0] - own.carried[-1]
    return shown[1:], float(target)


def carry(state: State, design: Design) -> None:
    """Reset the filters of Lambda; their content decays times the old Z.

    If the old Z is not known, learning waits until the filters have forgotten it.
    """
    change = state.last_columns - state.origin
    for own, orders, at in zip(state.signals, design.orders, change):
        of_derivative = companion(column(len(own.carried)))
        for content, order, z, since in zip(own.rows[2:], orders[1:], state.z, at[1:]):
            if order:  # convert to the filter of the derivative
                content = content @ of_derivative
                content[0] += since
            own.carried = own.carried + z * content
        own.rows = own.rows.copy()
        own.rows[2:] = 0.0
    if not certain(state, sigmas(state)):
        state.forgetting = FORGOTTEN
    state.origin = state.last_columns


def sigmas(state: State) -> tuple[float, ...]:
    """Return the standard deviations of the Z from least squares."""
    return tuple(np.sqrt(np.maximum(0.0, state.power * state.p.diagonal())).tolist())


def certain(state: State, deviations: tuple[float, ...]) -> bool:
    """Return True if least squares has determined Z to within `CERTAIN`; `deviations` : of Z."""
    most = CERTAIN * float(np.abs(state.z).max())
    return state.forgetting <= 0.0 and max(deviations) <= most
