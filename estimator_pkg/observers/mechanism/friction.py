# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Friction that stops a joint within a sample, for the steps of observers of mechanisms.

In a step all forces except viscous ones are constant. Constant dry friction would move a joint that
comes to rest past zero speed, and back at the next sample: the velocity chatters with amplitude
c dt/M. So if friction F(v) stops the joint within the sample against all driving forces, it is
replaced by viscous friction of the same size, F(v)/v, which the steps treat exactly or implicitly.
"""

from __future__ import annotations

from typing import Any

from estimator_pkg.models.mechanics import Vector
from estimator_pkg.observers.mechanism.state import Design, Work

MOST_DECAY = 30.0  # largest viscous decay per sample: with more, the joint is at rest all the same


def may_stop(force: float, free: float, v: float, inertia: float, dt: float) -> bool:
    """Return True if the friction at this velocity would stop the joint within the sample.

    Parameters
    ----------
    force, free : sum of the forces at this velocity, and at rest [N m or N].
    v : velocity [rad/s or m/s].
    inertia : diagonal entry of M for this joint [kg m^2 or kg].
    dt : sample time [s].
    """
    lost = free - force
    return lost * v > 0.0 and abs(lost) * dt > inertia * abs(v)


def stopping(
    force: float, free: float, late: float, v: float, inertia: float, dt: float
) -> tuple[float, float]:
    """Return (force that is constant over the sample, viscous coefficient) of one joint.

    Parameters
    ----------
    late : sum of the forces at the velocity v + dt free/inertia; the others as in `may_stop`.
    """
    if not may_stop(force, free, v, inertia, dt):
        return force, 0.0
    if abs(inertia * v + dt * free) > dt * abs(free - late):
        return force, 0.0  # the driving forces are larger than the friction
    lost, most = abs(free - force), MOST_DECAY * inertia / dt
    return free, lost / abs(v) if lost < most * abs(v) else most


def resist(
    model: Any, design: Design, work: Work, q: Vector, v: Vector, u: Vector, dt: float
) -> None:
    """Set `work.force`, constant over the sample, and `work.damping`, D with such friction.

    With dry friction `work.mass` must be M at q. D is zero if the model has neither damping nor
    dry friction.
    """
    n, values = model.JOINTS, design.values
    model.force(work.force, values, q, v, u)
    if design.damped:
        model.damping(work.damping, values, q)
    if not design.dry:
        return
    force, free, mass = work.force, work.free, work.mass
    model.force(free, values, q, work.nothing, u)
    stops = False
    for i in range(n):
        if may_stop(force[i], free[i], v[i], mass[i][i], dt):
            stops = True
    if stops:
        for i in range(n):
            work.ahead[i] = v[i] + dt * free[i] / mass[i][i]
        model.force(work.late, values, q, work.ahead, u)
    for i in range(n):
        viscous = 0.0
        if stops:
            constant, viscous = stopping(force[i], free[i], work.late[i], v[i], mass[i][i], dt)
            force[i] = constant
        if design.damped:
            work.damping[i][i] += viscous
        else:
            work.damping[i][i] = viscous
