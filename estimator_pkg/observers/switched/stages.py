# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The continuous part: step-by-step super-twisting (22), one stage after the other."""

from __future__ import annotations

from estimator_pkg.observers.maths.twisting import implicit_step, injections
from estimator_pkg.observers.switched.state import State
from estimator_pkg.observers.switched.system import System


def climb(system: System, i: int, state: State, jump: float, h: float) -> tuple:
    """Return (zh, zt, errors) of output i after a sample; the output changed by `jump` in h [s].

    A stage runs while the errors of all stages before it are within the gate, (23).
    """
    zh, zt, errors = list(state.zh[i]), list(state.zt[i]), list(state.errors[i])
    signal = state.y[i] + jump
    for j, (gain, alpha) in enumerate(system.stages[i]):
        if system.is_implicit:
            ahead = zh[j] + h * zt[j]
            left, push = implicit_step(signal - ahead, h, gain, alpha)
            zt[j] += h * push
            zh[j] = signal - left
        else:
            before = state.y[i] if j == 0 else state.zt[i][j - 1]
            left = before - zh[j]
            first, second = injections(left, gain, alpha)
            zh[j] += h * (zt[j] + first)
            zt[j] += h * second
        errors[j] = left
        if abs(left) >= system.gains.gate:
            break
        signal = zt[j]
    return tuple(zh), tuple(zt), tuple(errors)


def gates_open(system: System, state: State) -> bool:
    """Return True if every stage runs."""
    return all(abs(e) < system.gains.gate for errors in state.errors for e in errors[:-1])
