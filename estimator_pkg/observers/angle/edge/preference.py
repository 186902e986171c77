# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The user's preference: a second filter beside the first, of a larger or a smaller density.

The laws find the density at which innovations are white: there lag and noise are balanced. In a
filter with more process noise they no longer are, and the laws would undo the preference. So the
first filter always follows the laws, and judges the readings; a second one of `RATIO` times the
density gets the same news, and is published. Noise makes RATIO^(1/2) times the variance in its
velocity, and its delay is RATIO^(-1/2) times that of the first.
"""

from __future__ import annotations

from typing import Any

from estimator_pkg.observers.angle.edge.covariance import (
    Coefficients,
    add_velocity_noise,
    correct_covariance,
    predict_covariance,
    widen,
)
from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.record import record


@record
class SecondFilter:
    """The second filter."""

    apart: bool  # False: it is as the first one
    x: float  # angle less that of the first filter [rad]
    v: float  # the same of the speed [rad/s]
    a: float  # and of the acceleration [rad/s^2]
    p: Covariance


def reset_second_filter(second: SecondFilter) -> None:
    """Reset the second filter to the first."""
    second.apart = False
    second.x = second.v = second.a = 0.0


def predict_second_filter(
    state: Any, design: Any, coefficients: Coefficients, half_variance: float, lasted: float
) -> None:
    """Predict the second filter one sample on, after the first one's covariance.

    Parameters
    ----------
    half_variance, lasted : see `covariance.add_velocity_noise`; the time of the random walk [s].
    """
    second, dt = state.second, coefficients.dt
    if design.ratio == 1.0:
        reset_second_filter(second)
    elif not second.apart:
        second.apart = True
        second.p.take(state.p)
    else:
        predict_covariance(second.p, design.ratio * state.process_noise.density, coefficients)
        add_velocity_noise(second.p, half_variance, lasted)
        second.x = second.x + second.v * dt + second.a * coefficients.half
        second.v += second.a * dt
        second.a *= coefficients.kept


def correct_second_filter(
    state: Any,
    design: Any,
    s: float,
    d: float,
    left: float,
    measured: bool,
    growth: float,
    manoeuvre: bool,
) -> None:
    """Take news as the first filter takes it, before its own covariance is corrected.

    For the first filter it is a Gaussian measurement of variance S/f - P_00 at a distance of d/f.

    Parameters
    ----------
    s, d : S [rad^2] and d [rad] of the news. left : 1 - f.
    measured : it is a measurement; else it only moves the estimate.
    growth, manoeuvre : of the log density, and whether a manoeuvre was found.
    """
    second, p = state.second, state.p
    f = 1.0 - left
    own = second.p
    if manoeuvre:
        own.take(p)
        widen(own, design.log_ratio)
    elif growth > 0.0:
        widen(own, growth)
    own_00, own_01, own_02 = own.p00, own.p01, own.p02
    whole = s + f * (own_00 - p.p00)
    rate = (d - f * second.x) / whole
    if measured:
        correct_covariance(own, whole - own_00, left)
    ratio = d / s
    second.x = second.x + own_00 * rate - p.p00 * ratio
    second.v = second.v + own_01 * rate - p.p01 * ratio
    second.a = second.a + own_02 * rate - p.p02 * ratio


def ratios(ratio: float) -> tuple[float, float, float]:
    """Return ratio, and variances of angle and speed over those of the first filter.

    Where the first one is right noise and jerk have equal shares of the speed's variance, or
    another bandwidth would be better. They go with ratio^(1/2) and ratio^(-1/2). In that of the
    angle 5/6 are of the noise, which goes with ratio^(1/6); that of the jerk goes with
    ratio^(-5/6).
    """
    root = ratio ** (1.0 / 6.0)
    cube = root**3
    return ratio, (5.0 * root + root / ratio) / 6.0, 0.5 * (cube + 1.0 / cube)
