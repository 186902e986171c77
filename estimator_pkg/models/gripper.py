# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A joint whose load changes when its gripper closes or opens, at known instants.

J q'' = tau - b q' - m g l sin q, Z = (1/J, b/J, m g l / J). After the modes 'close' and 'open' Z is
unknown (the gripped load is not known); any other mode leaves it unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from estimator_pkg.models.switched import SwitchedModel, Vector

UNLOADED = (2.0, 0.8, 9.81)  # Z without load
CLOSED = (1.25, 0.5, 12.2625)  # Z with load: J rises from 0.5 to 0.8 kg m^2
IDENTITY_JUMP = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
UNKNOWN_LOAD = ('close', 'open')


def dynamics(x: Vector, z: Vector, u: Vector) -> Sequence[float]:
    """Return x' for x = (angle [rad], velocity [rad/s]), u = (torque [N m],)."""
    return (x[1], z[0] * u[0] - z[1] * x[1] - z[2] * math.sin(x[0]))


def lam(zeta: Vector, u: Vector) -> Sequence[Vector]:
    """Return Lambda, the factor of Z."""
    return ((u[0], -zeta[1], -math.sin(zeta[0])),)


def basis(y: Vector, u: Vector) -> Sequence[Vector]:
    """Return Gamma and Lambda without the velocity: -q' is the derivative of -q."""
    return ((0.0, u[0], -y[0], -math.sin(y[0])),)


def torque(t: float) -> tuple[float, ...]:
    """Return a torque that makes all three parameters identifiable [N m]."""
    return (3.0 * math.sin(3.0 * t) + 2.0 * math.sin(7.3 * t) + 1.0 * math.sin(17.0 * t),)


MODEL = SwitchedModel(
    indices=(2,),
    size=3,
    gamma=lambda zeta, u: (0.0,),
    lam=lam,
    transition=lambda mode: None if mode in UNKNOWN_LOAD else IDENTITY_JUMP,
    offset=lambda mode, v, y: (0.0, 0.0, 0.0),
    dynamics=dynamics,
    start=((0.3, 0.0), UNLOADED),
    probe=torque,
    period=2.0,
    bounds=((60.0, 1000.0),),
    names=('1/J', 'b/J', 'mgl/J'),
    units=('1/(kg m^2)', '1/s', '1/s^2'),
    joints=('joint',),
    basis=basis,
    orders=((0, 0, 1, 0),),
)
