"""The continuous part: step-by-step super-twisting (22), one stage after the other."""

from __future__ import annotations

import math

from estimator_pkg.observers.switched_state import State
from estimator_pkg.observers.switched_system import System


def implicit_stage(error: float, slope: float, h: float, gain: float, alpha: float
                   ) -> tuple[float, float]:
    """One super-twisting stage: (error left, slope), from the error of the prediction."""
    size, most = abs(error), h * h * alpha
    if size <= most:
        return 0.0, slope + error / h
    sign = 1.0 if error > 0.0 else -1.0
    root = 0.5 * (math.sqrt(h * h * gain * gain + 4.0 * (size - most)) - h * gain)
    return sign * root * root, slope + sign * h * alpha


def explicit_stage(error: float, slope: float, h: float, gain: float, alpha: float
                   ) -> tuple[float, float]:
    """The same by forward Euler: `error` is that before the step, and so is what it returns."""
    sign = 1.0 if error > 0.0 else -1.0 if error < 0.0 else 0.0
    return error, slope + sign * h * alpha


def climb(system: System, i: int, state: State, jump: float, h: float) -> tuple:
    """(zh, zt, errors) of output i after a sample; the output changed by `jump` in h [s].

    A stage runs while the errors of all before it are within the gate, (23).
    """
    zh, zt, errors = list(state.zh[i]), list(state.zt[i]), list(state.errors[i])
    signal = state.y[i] + jump
    for j, (gain, alpha) in enumerate(system.stages[i]):
        if system.is_implicit:
            ahead = zh[j] + h * zt[j]
            left, zt[j] = implicit_stage(signal - ahead, zt[j], h, gain, alpha)
            zh[j] = signal - left
        else:
            before = state.y[i] if j == 0 else state.zt[i][j - 1]
            left, slope = explicit_stage(before - zh[j], zt[j], h, gain, alpha)
            root = math.sqrt(abs(left))
            zh[j] += h * (zt[j] + gain * (root if left > 0.0 else -root))
            zt[j] = slope
        errors[j] = left
        if abs(left) >= system.gains.gate:
            break
        signal = zt[j]
    return tuple(zh), tuple(zt), tuple(errors)


def gates_open(system: System, state: State) -> bool:
    """True if every stage runs."""
    return all(abs(e) < system.gains.gate for errors in state.errors for e in errors[:-1])
