# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Friction that stops a joint within a sample, for the steps of observers of mechanisms.

In a step all forces except viscous ones are constant. Constant dry friction would move a joint that
comes to rest past zero speed, and back at the next sample: the velocity chatters with amplitude
c dt/M. So if friction F(v) stops the joint within the sample against all driving forces, it is
replaced by viscous friction of the same size, F(v)/v, which the steps treat exactly or implicitly.
"""

from __future__ import annotations

from collections.abc import Callable

from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.maths.unroll import written_out
from estimator_pkg.observers.mechanism.algebra import column

MOST = 30.0  # largest viscous decay per sample: with more, the joint is at rest all the same


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
    lost, most = abs(free - force), MOST * inertia / dt
    return free, lost / abs(v) if lost < most * abs(v) else most


def make_resistance(mechanics: Mechanics) -> Callable[..., tuple]:
    """Return resistance(values, q, v, u, mass, dt) -> (constant forces, D with such friction).

    `mass` is M at q. If the model has neither damping nor friction, D is meaningless (but has its
    shape); see `is_resisted`.
    """
    n, force = mechanics.degrees, mechanics.force
    damped = mechanics.damping is not None
    damping = mechanics.damping if mechanics.damping is not None else mechanics.inertia

    def viscous(values: tuple, q: tuple, v: tuple, u: tuple, mass: tuple, dt: float) -> tuple:
        return force(values, q, v, u), damping(values, q)

    if not mechanics.speed_matters:
        return viscous
    matrix = ''.join(
        '('
        + ''.join(
            (f'd[{i}][{j}]' if damped else '0.0') + (f' + s{i}, ' if i == j else ', ')
            for j in range(n)
        )
        + '), '
        for i in range(n)
    )
    stops = ' or '.join(
        f'may_stop(full[{i}], free[{i}], v[{i}], mass[{i}][{i}], dt)' for i in range(n)
    )
    lines = [
        'def resistance(values, q, v, u, mass, dt):',
        '    full = force(values, q, v, u)',
        f'    free = force(values, q, {column("0.0", n)}, u)',
        f'    {column("f{i}", n)} = full',
        *(f'    s{i} = 0.0' for i in range(n)),
        f'    if {stops}:',
        f'        ahead = {column("v[{i}] + dt * free[{i}] / mass[{i}][{i}]", n)}',
        '        late = force(values, q, ahead, u)',
        *(
            f'        f{i}, s{i} = stopping(full[{i}], free[{i}], late[{i}], v[{i}], '
            f'mass[{i}][{i}], dt)'
            for i in range(n)
        ),
        *(['    d = damping(values, q)'] if damped else []),
        f'    return {column("f{i}", n)}, ({matrix})',
    ]
    return written_out(
        lines,
        f'resistance of {mechanics.name}',
        force=force,
        damping=damping,
        stopping=stopping,
        may_stop=may_stop,
    )['resistance']


def is_resisted(mechanics: Mechanics) -> bool:
    """Return True if the D of `resistance` is meaningful: there is damping or dry friction."""
    return mechanics.damping is not None or mechanics.speed_matters
