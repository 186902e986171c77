# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Friction that stops a joint within a sample, for the steps of observers of mechanisms.

In a step all forces except viscous ones are constant. Constant dry friction would move a joint that
comes to rest past zero speed, and back at the next sample: the velocity chatters with amplitude
c dt/M. So if friction F(v) stops the joint within the sample against all driving forces, it is
replaced by viscous friction of the same size, F(v)/v, which the steps treat exactly or implicitly.
"""

from __future__ import annotations

import numpy as np

from estimator_pkg.models.mechanics import Array, Mechanics

MOST_DECAY = 30.0  # largest viscous decay per sample: with more, the joint is at rest all the same


def resist(mechanics: Mechanics, q: Array, v: Array, u: Array, dt: float) -> tuple[Array, Array]:
    """Return the forces that are constant over a sample of dt [s], and D with such friction.

    They have shape (n,) and (n, n), at one configuration q with velocities v and inputs u.
    """
    force, damping = mechanics.force(q, v, u), mechanics.damping(q)
    if not mechanics.dry:
        return force, damping
    free, inertia = mechanics.force(q, np.zeros_like(v), u), np.diagonal(mechanics.inertia(q))
    lost, speed = free - force, np.abs(v)
    stops = (lost * v > 0.0) & (np.abs(lost) * dt > inertia * speed)
    if stops.any():
        late = mechanics.force(q, v + dt * free / inertia, u)
        # not if the driving forces are larger than the friction
        stops &= np.abs(inertia * v + dt * free) <= dt * np.abs(free - late)
        most = MOST_DECAY * inertia / dt
        viscous = np.minimum(np.abs(lost) / np.where(stops, speed, 1.0), most)
        force = np.where(stops, free, force)
        damping = damping + np.diag(np.where(stops, viscous, 0.0))
    return force, damping
