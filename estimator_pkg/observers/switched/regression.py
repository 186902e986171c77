# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The discrete state from filtered signals and least squares, within an interval.

All signals pass the same filter, so that Y = Gamma + Lambda Z needs no derivative of the outputs.
At an event the filters of Lambda are reset, and their old content, multiplied by the old Z, decays
in a filter of its own. So learning can go on without waiting for the filters to forget.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.adaptive.filter import after, feed
from estimator_pkg.observers.maths.least_squares import kept, update
from estimator_pkg.observers.maths.vectors import dot
from estimator_pkg.observers.switched.state import State
from estimator_pkg.observers.switched.system import System

VAGUE = 1e8  # variance of an unknown Z, in variances of the measurement noise
CERTAIN = 0.1  # a standard deviation below this part of Z counts as converged
FORGOTTEN = 8.0  # time constants of the filter until it has forgotten its start


def resting(system: System, i: int, value: float) -> tuple[float, ...]:
    """Return the state of output i's filter in steady state at a constant `value` [rad or m]."""
    return (*(0.0,) * (system.model.indices[i] - 1), -value / system.columns[i][-1])


def empty_columns(system: System, i: int) -> tuple[tuple[float, ...], ...]:
    """Return zero states for the filters of Lambda's columns of output i."""
    return tuple((0.0,) * system.model.indices[i] for _ in range(system.model.size))


def vague(system: System) -> tuple:
    """Return the initial P of least squares, shape (m, m), for an unknown Z."""
    m = range(system.model.size)
    return tuple(tuple(VAGUE if i == j else 0.0 for j in m) for i in m)


def learn(
    system: System, state: State, y: tuple, jumps: tuple, filters_of: tuple, h: float
) -> State:
    """Return the state after filtering all signals and one least-squares update.

    Parameters
    ----------
    y : the new outputs.
    jumps : change of each output since the last sample.
    filters_of : columns and input rows of each output's filter for this sample time.
    h : sample time [s].
    """
    # the input u was constant over the interval: columns go from (y before, u) to (y now, u)
    before = (
        system.signals(state.y, state.u, system.chains(state)[0])
        if system.model.basis is not None
        else state.last_columns
    )
    state = state._replace(y=y)
    now = system.signals(y, state.u, system.chains(state)[0])
    z, p, power, filters = list(state.z), [list(row) for row in state.p], state.power, []
    most, keep = [VAGUE] * system.model.size, kept(h, system.gains.memory)
    for i in system.outputs:
        own, rows, target = _filtered(system, state, i, jumps[i], before[i], now[i], filters_of[i])
        filters.append(own)
        if state.forgetting <= 0.0:
            residual = target - dot(rows, z)
            s = update(z, p, rows, residual, keep, most)
            power += 0.02 * (residual * residual / s - power)
    return state._replace(
        z=tuple(z), p=tuple(map(tuple, p)), power=power, filters=tuple(filters), last_columns=now
    )


def _filtered(
    system: System, state: State, i: int, jump: float, before: tuple, now: tuple, filter_of: tuple
) -> tuple[tuple, list[float], float]:
    """Return (filters of output i, row of Lambda, target that the row times Z must equal)."""
    columns, g0, g1 = filter_of
    k, orders, m = system.model.indices[i], system.orders[i], system.model.size
    of_y, of_gamma, of_columns, carried = state.filters[i]

    def fed(row: tuple, start: float, end: float) -> tuple:
        found = list(row)
        feed(found, columns, g0, g1, start, end - start)
        return tuple(found)

    of_y = fed(of_y, state.y[i] - jump, state.y[i])
    of_gamma = fed(of_gamma, before[0], now[0])
    shift = [state.origin[i][j + 1] if orders[j + 1] else 0.0 for j in range(m)]
    of_columns = tuple(
        fed(of_columns[j], before[j + 1] - shift[j], now[j + 1] - shift[j]) for j in range(m)
    )
    carried = tuple(dot(carried, column) for column in columns)
    rows = [of_columns[j][k - 1 - orders[j + 1]] for j in range(m)]
    target = (
        state.y[i] + dot(system.columns[i], of_y) - of_gamma[k - 1 - orders[0]] - carried[k - 1]
    )
    return (of_y, of_gamma, of_columns, carried), rows, target


def carry(system: System, state: State) -> State:
    """Return the state with the filters of Lambda reset; their content decays times the old Z.

    If the old Z is not known, learning waits until the filters have forgotten it.
    """
    filters, z = [], state.z
    for i in system.outputs:
        of_y, of_gamma, of_columns, carried = state.filters[i]
        for j in range(system.model.size):
            column = of_columns[j]
            if system.orders[i][j + 1]:  # convert to the filter of the derivative
                fed = state.last_columns[i][j + 1] - state.origin[i][j + 1]
                first, *others = after(column, system.columns[i])
                column = (first + fed, *others)
            carried = tuple(old + z[j] * x for old, x in zip(carried, column))
        filters.append((of_y, of_gamma, empty_columns(system, i), carried))
    forgetting = state.forgetting if certain(state) else FORGOTTEN / system.gains.filter_rate
    return state._replace(filters=tuple(filters), origin=state.last_columns, forgetting=forgetting)


def sigmas(state: State) -> tuple[float, ...]:
    """Return the standard deviations of the Z from least squares."""
    return tuple(math.sqrt(max(0.0, state.power * row[j])) for j, row in enumerate(state.p))


def certain(state: State) -> bool:
    """Return True if least squares has determined Z to within `CERTAIN`."""
    most = CERTAIN * max(abs(x) for x in state.z)
    return state.forgetting <= 0.0 and max(sigmas(state)) <= most
