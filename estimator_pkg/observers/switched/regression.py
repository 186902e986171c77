# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The discrete state from filtered signals and least squares, within an interval.

All signals pass the same filter, so that Y = Gamma + Lambda Z needs no derivative of the outputs.
At an event the filters of Lambda are reset, and their old content, multiplied by the old Z, decays
in a filter of its own. So learning can go on without waiting for the filters to forget.
"""

from __future__ import annotations

import math

from estimator_pkg.models.switched import SwitchedModel
from estimator_pkg.observers.adaptive.filter import after, feed
from estimator_pkg.observers.maths.least_squares import update
from estimator_pkg.observers.maths.vectors import dot
from estimator_pkg.observers.switched.stages import chains
from estimator_pkg.observers.switched.state import (
    Coefficients,
    Design,
    RegressionFilter,
    Signals,
    State,
)
from estimator_pkg.observers.switched.system import signals

UNKNOWN_VARIANCE = 1e8  # variance of an unknown Z, in variances of the measurement noise
CERTAIN = 0.1  # a standard deviation below this part of Z counts as converged
FILTER_MEMORY = 8.0  # time constants of the filter until it has forgotten its start


def resting(design: Design, i: int, value: float) -> list[float]:
    """Return the state of output i's filter in steady state at a constant `value` [rad or m]."""
    column = design.columns[i]
    return [*(0.0,) * (len(column) - 1), -value / column[-1]]


def begin_signals(design: Design, i: int, value: float) -> Signals:
    """Return the filters of output i, at rest at `value` [rad or m]."""
    made, k = Signals(), len(design.columns[i])
    made.y, made.gamma, made.carried = resting(design, i, value), [0.0] * k, [0.0] * k
    made.columns = [[0.0] * k for _ in design.vague]
    return made


def forget(state: State, design: Design) -> None:
    """Set P to that of an unknown Z, shape (m, m)."""
    m = range(len(design.vague))
    state.p = [[design.vague[i] if i == j else 0.0 for j in m] for i in m]


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
            residual = target - dot(row, state.z)
            s = update(state.z, state.p, row, residual, coefficients.keep, design.vague)
            state.power += 0.02 * (residual * residual / s - state.power)


def filtered(
    state: State,
    design: Design,
    i: int,
    jump: float,
    before: list[float],
    filter_of: RegressionFilter,
) -> tuple[list[float], float]:
    """Return (row of Lambda, target that the row times Z must equal) of output i."""
    columns, g0, g1 = filter_of.columns, filter_of.g0, filter_of.g1
    own, now, orders = state.signals[i], state.last_columns[i], design.orders[i]
    last = state.y[i] - jump
    feed(own.y, columns, g0, g1, last, state.y[i] - last)
    feed(own.gamma, columns, g0, g1, before[0], now[0] - before[0])
    for j, column in enumerate(own.columns, 1):
        shift = state.origin[i][j] if orders[j] else 0.0
        start = before[j] - shift
        feed(column, columns, g0, g1, start, now[j] - shift - start)
    own.carried = [dot(own.carried, column) for column in columns]
    end = len(columns) - 1
    row = [column[end - order] for column, order in zip(own.columns, orders[1:])]
    target = (
        state.y[i] + dot(design.columns[i], own.y) - own.gamma[end - orders[0]] - own.carried[end]
    )
    return row, target


def carry(state: State, design: Design) -> None:
    """Reset the filters of Lambda; their content decays times the old Z.

    If the old Z is not known, learning waits until the filters have forgotten it.
    """
    for i, own in enumerate(state.signals):
        for j, column in enumerate(own.columns):
            content = column
            if design.orders[i][j + 1]:  # convert to the filter of the derivative
                content = after(column, design.columns[i])
                content[0] += state.last_columns[i][j + 1] - state.origin[i][j + 1]
            own.carried = [old + state.z[j] * x for old, x in zip(own.carried, content)]
            column[:] = [0.0] * len(column)
    if not certain(state, sigmas(state)):
        state.forgetting = design.forget
    state.origin = state.last_columns


def sigmas(state: State) -> tuple[float, ...]:
    """Return the standard deviations of the Z from least squares."""
    return tuple(math.sqrt(max(0.0, state.power * row[j])) for j, row in enumerate(state.p))


def certain(state: State, deviations: tuple[float, ...]) -> bool:
    """Return True if least squares has determined Z to within `CERTAIN`; `deviations` : of Z."""
    most = CERTAIN * max(abs(x) for x in state.z)
    return state.forgetting <= 0.0 and max(deviations) <= most
