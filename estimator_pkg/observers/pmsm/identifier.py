# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The mini-batch identifier (21) to (26): the flux from the last N clock periods by least squares.

Between clock ticks at t-T and t the rotor's motion satisfies (22),

    chi(t-T) y(t) - chi(t) y(t-T) = xi chi(t-T) chi(t) J (integral of y from t-T to t),

one equation X = Phi xi per tick, with the estimates |h| for chi and y = C[z] J h. Reflections of
the frame do not change |h| and y, so the registers may shift before or after them.
"""

from __future__ import annotations

from estimator_pkg.observers.pmsm.state import Design, Registers

CHORD = 0.3  # smallest rotation between ticks, as a chord of the unit circle (rms)
FIT_RESIDUAL = 0.25  # largest residual of the fit, relative to |X|^2


def shift(
    registers: Registers,
    periods: int,
    y_alpha: float,
    y_beta: float,
    size: float,
    area_alpha: float,
    area_beta: float,
) -> None:
    """Take one more tick into the registers, (25).

    Parameters
    ----------
    periods : N.
    y_alpha, y_beta, size : y and |h| at the tick [V].
    area_alpha, area_beta : integral of y since the last tick [V s].
    """
    scale = size * registers.size[periods]  # |h| at the last tick
    for k in range(periods):
        registers.y_alpha[k] = registers.y_alpha[k + 1]
        registers.y_beta[k] = registers.y_beta[k + 1]
        registers.size[k] = registers.size[k + 1]
    for k in range(periods - 1):
        registers.phi_alpha[k] = registers.phi_alpha[k + 1]
        registers.phi_beta[k] = registers.phi_beta[k + 1]
    registers.y_alpha[periods] = y_alpha
    registers.y_beta[periods] = y_beta
    registers.size[periods] = size
    registers.phi_alpha[periods - 1] = -area_beta * scale
    registers.phi_beta[periods - 1] = area_alpha * scale


def solve(registers: Registers, periods: int) -> tuple[float, float, float, float]:
    """Return (xi*, |X|^2, |X - Phi xi*|^2, sum of (Z Z)^2): the fit (24) and its quality.

    xi* [1/Wb] is the least-squares solution; the last three are arguments of `credible`.
    """
    along = power = travelled = scale = 0.0
    for k in range(periods):
        before, now = registers.size[k], registers.size[k + 1]
        x_alpha = before * registers.y_alpha[k + 1] - now * registers.y_alpha[k]
        x_beta = before * registers.y_beta[k + 1] - now * registers.y_beta[k]
        phi_alpha, phi_beta = registers.phi_alpha[k], registers.phi_beta[k]
        along += phi_alpha * x_alpha + phi_beta * x_beta
        power += phi_alpha * phi_alpha + phi_beta * phi_beta
        travelled += x_alpha * x_alpha + x_beta * x_beta
        scale += before * now * (before * now)
    if power == 0.0:
        return 0.0, travelled, travelled, scale
    found = along / power
    rest = travelled - found * along
    return found, travelled, rest, scale


def credible(
    registers: Registers,
    design: Design,
    found: float,
    travelled: float,
    rest: float,
    scale: float,
    least_emf: float,
) -> bool:
    """Return True if xi* is credible: the gates of the robust form.

    The printed identifier divides noise by almost zero at standstill and where the rotor is at the
    same angle at every tick.

    Parameters
    ----------
    found, travelled, rest, scale : from `solve`.
    least_emf : smallest |h| at a tick [V].
    """
    for k in range(design.periods + 1):
        if registers.size[k] < least_emf:
            return False
    return (
        travelled >= CHORD * CHORD * scale
        and rest <= FIT_RESIDUAL * travelled
        and design.xi_low <= abs(found) <= design.xi_high
    )
