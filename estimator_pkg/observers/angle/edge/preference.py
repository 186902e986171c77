# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The user's preference: a second filter beside the first, of a larger or a smaller density.

The laws find the density at which innovations are white: there lag and noise are balanced. In a
filter that listens faster they no longer are, and the laws would undo the preference. So the first
filter always listens as the laws say, and judges the readings; a second one of `RATIO` times the
density gets the same news, and is published. Noise makes RATIO^(1/2) times the variance in its
velocity, and its delay is RATIO^(-1/2) times that of the first.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.angle.edge.covariance import (
    Covariance,
    corrected,
    predicted,
    swayed,
    widened,
)

# (angle [rad], speed, acceleration less those of the first filter; covariance)
Other = tuple[float, float, float, Covariance]
# news, as the first filter took it: (covariance before it, S [rad^2], d [rad], 1 - f, whether it is
# a measurement, growth of the log density, whether a manoeuvre was found); see `update`
Taken = tuple[Covariance, float, float, float, bool, float, bool]

NOWHERE: Covariance = (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ALIKE: Other = (0.0, 0.0, 0.0, NOWHERE)  # it begins as the first filter is


def beside(
    other: Other, p: Covariance, density: float, coefficients: tuple, sway: float, lasted: float
) -> Other:
    """Return the second filter one sample later.

    Parameters
    ----------
    p : covariance of the first filter, one sample later.
    density : of the second one's jerk [(rad/s^3)^2 s].
    coefficients : see `covariance.predicted`.
    sway, lasted : see `covariance.swayed`; the time in which the speed sways [s].
    """
    x, v, a, own = other
    p00, _, _, _, _, _ = own
    if p00 < 0.0:
        return (0.0, 0.0, 0.0, p)
    dt, half_square, kept, _, _, _ = coefficients
    own = swayed(predicted(own, density, coefficients), sway, lasted)
    return (x + v * dt + a * half_square, v + a * dt, kept * a, own)


def informed(other: Other, taken: Taken, shift: tuple[float, float, float], ratio: float) -> Other:
    """Return the second filter after news that moved the first one by `shift`.

    The first filter took the news as a Gaussian measurement of variance S/f - P_00 at a distance of
    d/f. The second one takes the same.

    Parameters
    ----------
    ratio : of its density to the first one's.
    """
    x, v, a, own = other
    p, s, d, left, measured, growth, manoeuvre = taken
    f = 1.0 - left
    if manoeuvre:
        own = widened(p, math.log(ratio))
    elif growth > 0.0:
        own = widened(own, growth)
    p00, _, _, _, _, _ = p
    own_00, own_01, own_02, _, _, _ = own
    whole = s + f * (own_00 - p00)
    rate = (d - f * x) / whole
    if measured:
        own = corrected(own, whole - own_00, left)
    dx, dv, da = shift
    return (x + own_00 * rate - dx, v + own_01 * rate - dv, a + own_02 * rate - da, own)


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
