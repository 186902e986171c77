"""The discrete state from filtered signals and least squares, within an interval.

All signals pass the same filter, so that Y = Gamma + Lambda Z needs no derivative of the outputs.
At an event the filters of Lambda begin anew, and what they hold goes on with the old Z: they need
no time to forget.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg.observers.maths.least_squares import kept
from estimator_pkg.observers.switched.state import State
from estimator_pkg.observers.switched.system import System

VAGUE = 1e8  # variance of an unknown Z, in variances of the reading
CERTAIN = 0.1  # a standard deviation below this part of Z counts as converged
FORGOTTEN = 8.0  # time constants of the filter until a start is forgotten


def resting(system: System, i: int, value: float) -> tuple[float, ...]:
    """The filter of output i, settled on a constant."""
    return (*(0.0,) * (system.model.indices[i] - 1), -value / system.columns[i][-1])


def empty_columns(system: System, i: int) -> tuple[tuple[float, ...], ...]:
    """The filters of Lambda's columns of output i, as they begin."""
    return tuple((0.0,) * system.model.indices[i] for _ in range(system.model.size))


def vague(system: System) -> tuple:
    """P of least squares where nothing is known."""
    m = range(system.model.size)
    return tuple(tuple(VAGUE if i == j else 0.0 for j in m) for i in m)


def learn(
    system: System, state: State, y: tuple, jumps: tuple, filters_of: tuple, h: float
) -> State:
    """Filter everything and take the rows into least squares; y are the new outputs."""
    # the input was u all the time, so the columns run from (y before, u) to (y now, u)
    before = (
        system.signals(state.y, state.u, system.chains(state)[0])
        if system.model.basis is not None
        else state.last_columns
    )
    state = state._replace(y=y)
    now = system.signals(y, state.u, system.chains(state)[0])
    z, p, power, filters = state.z, state.p, state.power, []
    most, keep = vague(system), kept(h, system.gains.memory)
    for i in system.outputs:
        own, rows, target = _filtered(system, state, i, jumps[i], before[i], now[i], filters_of[i])
        filters.append(own)
        if state.deaf <= 0.0:
            residual = target - system.free.dot(rows, z)
            z, p, s = system.update(z, p, rows, residual, keep, most)
            power += 0.02 * (residual * residual / s - power)
    return state._replace(z=z, p=p, power=power, filters=tuple(filters), last_columns=now)


def _filtered(
    system: System, state: State, i: int, jump: float, before: tuple, now: tuple, filter_of: tuple
) -> tuple[tuple, tuple, float]:
    """(filters of output i, row of Lambda, what it has to explain)."""
    left, add, dot = system.filters[i].left, system.wide[i].add, system.wide[i].dot
    f, g0, g1 = filter_of
    k, orders, m = system.model.indices[i], system.orders[i], system.model.size
    of_y, of_gamma, of_columns, carried = state.filters[i]

    def fed(row: tuple, start: float, end: float) -> tuple:
        return add(add(left(row, f), start, g0), end - start, g1)

    of_y = fed(of_y, state.y[i] - jump, state.y[i])
    of_gamma = fed(of_gamma, before[0], now[0])
    shift = [state.origin[i][j + 1] if orders[j + 1] else 0.0 for j in range(m)]
    of_columns = tuple(
        fed(of_columns[j], before[j + 1] - shift[j], now[j + 1] - shift[j]) for j in range(m)
    )
    carried = left(carried, f)
    rows = tuple(of_columns[j][k - 1 - orders[j + 1]] for j in range(m))
    target = (
        state.y[i] + dot(system.columns[i], of_y) - of_gamma[k - 1 - orders[0]] - carried[k - 1]
    )
    return (of_y, of_gamma, of_columns, carried), rows, target


def carry(system: System, state: State) -> State:
    """From now on the filters of Lambda begin anew; what they hold goes on with the old Z.

    Where that is not known, learning waits until they have forgotten it.
    """
    filters, z = [], state.z
    for i in system.outputs:
        of_y, of_gamma, of_columns, carried = state.filters[i]
        add: Callable[..., tuple] = system.wide[i].add
        for j in range(system.model.size):
            column = of_columns[j]
            if system.orders[i][j + 1]:  # as if the derivative had been filtered
                fed = state.last_columns[i][j + 1] - state.origin[i][j + 1]
                column = add(
                    system.filters[i].after(column, system.columns[i]),
                    fed,
                    (1.0, *(0.0,) * (system.model.indices[i] - 1)),
                )
            carried = add(carried, z[j], column)
        filters.append((of_y, of_gamma, empty_columns(system, i), carried))
    deaf = state.deaf if certain(state) else FORGOTTEN / system.gains.filter_rate
    return state._replace(filters=tuple(filters), origin=state.last_columns, deaf=deaf)


def sigmas(state: State) -> tuple[float, ...]:
    """Standard deviations of Z as learnt."""
    return tuple(math.sqrt(max(0.0, state.power * row[j])) for j, row in enumerate(state.p))


def certain(state: State) -> bool:
    """True if least squares knows Z."""
    most = CERTAIN * max(abs(x) for x in state.z)
    return state.deaf <= 0.0 and max(sigmas(state)) <= most
