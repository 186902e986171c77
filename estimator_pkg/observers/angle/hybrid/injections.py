# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The output injections of Brentari et al. (2018), section IV, and a user's own.

Each is periodic in the error with slope 1 at zero (Assumption 1). For a circle of another period
the angle is scaled to 2 pi and back. A user's own function runs as plain Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from estimator_pkg import registry
from estimator_pkg.circle import wrap
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.hybrid.state import Design
from estimator_pkg.record import plain

INJECTIONS = ('sin', 'tan', 'saw', 'sat')
SIN = 0
TAN = 1
SAW = 2
SAT = 3  # further numbers are those of users' own functions
CHECKED_POINTS = 2000  # points on each side of zero where a user's injection is looked at
BEYOND = 50  # and within the margin before +-pi

_own: list[Callable[[float], float]] = []


def inject(error: float, design: Design) -> float:
    """Return the injection of an error, both [rad]: case studies 1 to 4."""
    period, limit = design.shared.period, design.saturation
    if design.injection == SAW:
        return wrap(error, period)
    if design.injection == SAT:
        wrapped = wrap(error, period)
        if wrapped > limit:
            return limit
        return wrapped if wrapped >= -limit else -limit
    scale = 2.0 * math.pi / period
    if design.injection == SIN:
        return math.sin(error * scale) / scale
    if design.injection == TAN:
        return 2.0 * math.tan(0.5 * error * scale) / scale
    return inject_own(design.injection, error * scale) / scale


@plain
def inject_own(number: int, error: float) -> float:
    """Return the injection of a user's function; see `find`."""
    return float(_own[number - SAT - 1](error))


def find(name: str, *, margin: float) -> int:
    """Return the number of a built-in injection, or of ``package.module:function`` of one angle.

    Parameters
    ----------
    margin : delta_pi [rad]; within this distance from +-pi the injection may jump.

    Raises
    ------
    UsageError : it cannot be loaded, or it violates Assumption 1 (which item, and where).
    """
    if name in INJECTIONS:
        return INJECTIONS.index(name)
    own = registry.load(name)
    check_assumption_1(own, margin, name)
    if own not in _own:
        _own.append(own)
    return SAT + 1 + _own.index(own)


def check_assumption_1(function: Callable[[float], float], margin: float, name: str) -> None:
    """Holds `function` to the four items of Assumption 1, numerically.

    Parameters
    ----------
    function : of the error [rad].
    margin : delta_pi [rad].

    Raises
    ------
    UsageError : with the item that fails and the error at which it does.
    """

    def fail(item: int, what: str) -> None:
        raise UsageError(f"injection '{name}' violates Assumption 1, item {item}: {what}")

    def value_at(error: float) -> float:
        try:
            return float(function(error))
        except Exception as problem:  # a user's function may fail in any way
            raise UsageError(f"injection '{name}' fails at {error:.3f} rad: {problem}") from problem

    if not callable(function):
        raise UsageError(f"injection '{name}' is no function of one angle")
    inner = math.pi - margin
    previous = None
    for i in range(-CHECKED_POINTS, CHECKED_POINTS + 1):
        error = inner * i / CHECKED_POINTS
        value = value_at(error)
        if not math.isfinite(value):
            fail(1, f'not finite at {error:.3f} rad')
        if i != 0 and not error * value > 0.0:
            fail(2, f'error times injection is not positive at {error:.3f} rad')
        for turn in (-1, 1):
            if abs(value_at(error + turn * 2.0 * math.pi) - value) > 1e-6 * (1.0 + abs(value)):
                fail(3, f'not 2 pi periodic at {error:.3f} rad')
        if previous is not None and _jumps(value_at, previous, error):
            fail(1, f'jumps near {error:.3f} rad')
        previous = error
    for i in range(1, BEYOND):  # the rest of (-pi, pi), where it need not be continuous
        for error in (inner + margin * i / BEYOND, -inner - margin * i / BEYOND):
            if not error * value_at(error) > 0.0:
                fail(2, f'error times injection is not positive at {error:.3f} rad')
    step = 1e-5
    slope = (value_at(step) - value_at(-step)) / (2.0 * step)
    if not abs(slope - 1.0) <= 1e-3:
        fail(4, f'slope at zero is {slope:.4g}, not 1')


def _jumps(function: Callable[[float], float], low: float, high: float) -> bool:
    """True if the function keeps a finite step while the interval is halved away."""
    at_low, at_high = function(low), function(high)
    whole = abs(at_high - at_low)
    if whole < 1e-3:
        return False
    for _ in range(40):
        middle = 0.5 * (low + high)
        at_middle = function(middle)
        if abs(at_middle - at_low) > abs(at_high - at_middle):
            high, at_high = middle, at_middle
        else:
            low, at_low = middle, at_middle
    return abs(at_high - at_low) > 0.5 * whole
