# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The output injections of Brentari et al. (2018), section IV, and a user's own.

Each is periodic in the error with slope 1 at zero (Assumption 1). For a circle of another period
the angle is scaled to 2 pi and back. A user's own function runs as plain Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from estimator_pkg import registry
from estimator_pkg.circle import wrap
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.hybrid.design import Design
from estimator_pkg.record import plain

INJECTIONS = ('sin', 'tan', 'saw', 'sat')
SIN = 0
TAN = 1
SAW = 2
SAT = 3  # further numbers are those of users' own functions
CHECKED_POINTS = 2000  # points on each side of zero where a user's injection is looked at
BEYOND = 50  # and within the margin before +-pi
STEP = 1e-5  # of the slope at zero [rad]

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
    """Check `function` for the four items of Assumption 1, numerically.

    Parameters
    ----------
    function : of the error [rad].
    margin : delta_pi [rad].

    Raises
    ------
    UsageError : with the item that fails and the error at which it does.
    """

    def value_at(error: float) -> float:
        try:
            return float(function(error))
        except Exception as problem:  # a user's function may fail in any way
            raise UsageError(f"injection '{name}' fails at {error:.3f} rad: {problem}") from problem

    if not callable(function):
        raise UsageError(f"injection '{name}' is no function of one angle")
    inner = math.pi - margin
    inside = inner * np.arange(-CHECKED_POINTS, CHECKED_POINTS + 1) / CHECKED_POINTS
    beyond = inner + margin * np.arange(1, BEYOND) / BEYOND  # it need not be continuous there
    points = np.concatenate([inside, beyond, -beyond])
    values = np.array([value_at(error) for error in points.tolist()])
    turned = np.array([value_at(error + 2.0 * math.pi) for error in inside.tolist()])
    within = values[: len(inside)]
    with np.errstate(invalid='ignore'):  # of values that are not finite
        turns = ~(abs(turned - within) <= 1e-6 * (1.0 + abs(within)))
    jumps = [_jumps(value_at, *pair) for pair in pairwise(inside.tolist())]
    slope = (value_at(STEP) - value_at(-STEP)) / (2.0 * STEP)
    rules = (  # item, what is wrong, and at which of the points
        (1, 'not finite at {:.3f} rad', ~np.isfinite(within)),
        (2, 'error times injection is not positive at {:.3f} rad', ~(points * values > 0.0)),
        (3, 'not 2 pi periodic at {:.3f} rad', turns),
        (1, 'jumps near {:.3f} rad', np.array([False, *jumps])),
        (4, f'slope at zero is {slope:.4g}, not 1', np.array([not abs(slope - 1.0) <= 1e-3])),
    )
    for item, wrong, where in rules:
        where[CHECKED_POINTS : CHECKED_POINTS + 1] &= item != 2  # the sign at zero
        if np.any(where):
            found = wrong.format(points[np.argmax(where)])
            raise UsageError(f"injection '{name}' violates Assumption 1, item {item}: {found}")


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
