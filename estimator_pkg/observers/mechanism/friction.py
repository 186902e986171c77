"""Friction that stops a joint within a sample, for the steps of observers of mechanisms.

A step holds all forces but viscous ones over the sample. Dry friction held like that throws a joint
that comes to rest past it, and back at the next sample: it chatters by c dt/M, for ever. So where
friction F(v) takes all of a joint's velocity within the sample, whatever drives it, it counts as a
viscous one of the same size, F(v)/v, which the steps take exactly or implicitly.
"""

from __future__ import annotations

from collections.abc import Callable

from estimator_pkg.models.mechanics import Mechanics
from estimator_pkg.observers.maths.unroll import written_out
from estimator_pkg.observers.mechanism.algebra import column

MOST = 30.0  # rates of decay per sample: beyond it a joint rests whatever they are


def may_stop(force: float, free: float, v: float, inertia: float, dt: float) -> bool:
    """True if the friction at this velocity would take all of it within the sample.

    Parameters
    ----------
    force, free : all forces at this velocity, and at rest [N m or N].
    v : velocity [rad/s or m/s].
    inertia : of this joint alone [kg m^2 or kg].
    dt : sample time [s].
    """
    lost = free - force
    return lost * v > 0.0 and abs(lost) * dt > inertia * abs(v)


def stopping(
    force: float, free: float, late: float, v: float, inertia: float, dt: float
) -> tuple[float, float]:
    """(force that is held, viscous coefficient) of one joint.

    Parameters
    ----------
    late : all forces at the velocity to which those at rest would bring it; the others are those of
        `may_stop`.
    """
    if not may_stop(force, free, v, inertia, dt):
        return force, 0.0
    if abs(inertia * v + dt * free) > dt * abs(free - late):
        return force, 0.0  # what drives it is stronger
    lost, most = abs(free - force), MOST * inertia / dt
    return free, lost / abs(v) if lost < most * abs(v) else most


def make_resistance(mechanics: Mechanics) -> Callable[..., tuple]:
    """resistance(values, q, v, u, mass, dt) -> (forces that are held, D with such friction in it).

    `mass` is M there. Where there is neither damping nor friction D is anything of its shape; see
    `is_resisted`.
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
    """True where `resistance` has a D to tell."""
    return mechanics.damping is not None or mechanics.speed_matters
