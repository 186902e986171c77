# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A filter of (x, v, a) fuses one of them that another sensor measures.

    nu = z - y,   y of x, v, a   K = P_.y/(P_yy + R)   P -= K P_y.   before: P_yy += max(0, m)
    m += b (nu nu_before - m)

White innovations are uncorrelated. Where the prediction is surer than it may be, they keep their
sign, and their covariance m is what P_yy lacks (Mehra, "On the identification of variances and
adaptive Kalman filtering", IEEE TAC 15(2), 1970).
"""

from __future__ import annotations

from estimator_pkg.observers.maths.covariance import Covariance
from estimator_pkg.record import record

FUSE_ANGLE, FUSE_RATE, FUSE_ACCELERATION = 0, 1, 2  # x [rad], v [rad/s], a [rad/s^2]
WEIGHT = 0.2  # b: m is a mean over the last ten innovations


@record
class Fusion:
    """Innovations of the other sensor."""

    last: float  # the newest [of the kind]
    mean: float  # m, of products of two in a row
    now: bool  # since the newest reading


def scalar_update(
    p: Covariance, state: Fusion, kind: int, nu: float, r: float
) -> tuple[float, float, float]:
    """Update the covariance; return what angle, speed and acceleration gain.

    Parameters
    ----------
    kind : ANGLE, RATE or ACCELERATION. nu : innovation. r : variance of the value.
    """
    state.mean += WEIGHT * (nu * state.last - state.mean)
    state.last, state.now = nu, True
    lacks = state.mean if state.mean > 0.0 else 0.0
    if kind == FUSE_RATE:
        p.p11 += lacks
        c0, c1, c2, own = p.p01, p.p11, p.p12, p.p11
    elif kind == FUSE_ANGLE:
        p.p00 += lacks
        c0, c1, c2, own = p.p00, p.p01, p.p02, p.p00
    else:
        p.p22 += lacks
        c0, c1, c2, own = p.p02, p.p12, p.p22, p.p22
    k0, k1, k2 = c0 / (own + r), c1 / (own + r), c2 / (own + r)
    p.p00 -= k0 * c0
    p.p01 -= k0 * c1
    p.p02 -= k0 * c2
    p.p11 -= k1 * c1
    p.p12 -= k1 * c2
    p.p22 -= k2 * c2
    return k0 * nu, k1 * nu, k2 * nu
