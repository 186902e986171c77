# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Super-twisting: its two injections, and its implicit Euler step in closed form.

Forward Euler chatters with amplitude h a; the implicit step does not:

    e+ + h g sqrt|e+| sgn e+ + h^2 a sgn e+ = e,   sgn 0 anything in [-1, 1]

where e is the error of the prediction, g and a the gains of the two injections. While |e| <= h^2 a
it slides: the error becomes zero within the step. `switched` and `smo` use it.
"""

from __future__ import annotations

import math


def injections(error: float, gain: float, alpha: float) -> tuple[float, float]:
    """Return gain sqrt|e| sgn e and alpha sgn e, with sgn 0 = 0; units as in `implicit_step`."""
    if error == 0.0:
        return 0.0, 0.0
    root = math.sqrt(abs(error))
    if error > 0.0:
        return gain * root, alpha
    return -gain * root, -alpha


def implicit_step(error: float, h: float, gain: float, alpha: float) -> tuple[float, float]:
    """Return (error after the step e+, second injection).

    Parameters
    ----------
    error : error of the prediction e [unit].
    h : sample time [s].
    gain, alpha : gains of sqrt|e| [unit^(1/2)/s] and of the sign [unit/s^2].
    """
    size = abs(error)
    sliding = h * h * alpha
    if size <= sliding:
        return 0.0, error / (h * h)
    half = 0.5 * h * gain
    over = size - sliding
    root = over / (half + math.sqrt(half * half + over))  # no difference of nearly equal numbers
    if error > 0.0:
        return root * root, alpha
    return -root * root, -alpha
