# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The mini-batch identifier (21) to (26): the flux from the last N clock periods by least squares.

Between clock ticks at t-T and t the rotor's motion satisfies (22),

    chi(t-T) y(t) - chi(t) y(t-T) = xi chi(t-T) chi(t) J (integral of y from t-T to t),

one equation X = Phi xi per tick, with the estimates |h| for chi and y = C[z] J h. Reflections of
the frame do not change |h| and y, so the registers may shift before or after them.

Registers are (Y, Z, Phi): Y and Z at the last N+1 ticks, Phi at the last N.
"""

from __future__ import annotations


def empty_registers(count: int) -> tuple[tuple, tuple, tuple]:
    """Return empty registers (all zero) for `count` = N periods."""
    return (complex(0.0, 0.0),) * (count + 1), (0.0,) * (count + 1), (complex(0.0, 0.0),) * count


def shift(
    registers: tuple[tuple, tuple, tuple], emf: complex, size: float, integral: complex
) -> tuple[tuple, tuple, tuple]:
    """Return the registers after one more tick, (25).

    Parameters
    ----------
    emf, size : y and |h| at the tick [V].
    integral : integral of y since the last tick [V s].
    """
    ys, zs, phis = registers
    turned = complex(-integral.imag, integral.real)
    newest = turned * (size * zs[-1])  # zs[-1] is still the size at the last tick
    return ys[1:] + (emf,), zs[1:] + (size,), phis[1:] + (newest,)


def solve(registers: tuple[tuple, tuple, tuple]) -> tuple[float, float, float, float]:
    """Return (xi*, |X|^2, |X - Phi xi*|^2, sum of (Z Z)^2): the fit (24) and its quality.

    xi* [1/Wb] is the least-squares solution; the last three are arguments of `credible`.
    """
    ys, zs, phis = registers
    along, power, travelled, scale = 0.0, 0.0, 0.0, 0.0
    for k in range(len(phis)):
        size = zs[k] * zs[k + 1]
        x = zs[k] * ys[k + 1] - zs[k + 1] * ys[k]
        phi = phis[k]
        along += phi.real * x.real + phi.imag * x.imag
        power += phi.real * phi.real + phi.imag * phi.imag
        travelled += x.real * x.real + x.imag * x.imag
        scale += size * size
    if power == 0.0:
        return 0.0, travelled, travelled, scale
    found = along / power
    rest = travelled - found * along
    return found, travelled, rest, scale


def credible(
    registers: tuple[tuple, tuple, tuple],
    found: float,
    travelled: float,
    rest: float,
    scale: float,
    least_chord: float,
    largest_rest: float,
    lowest: float,
    highest: float,
    least_emf: float,
) -> bool:
    """Return True if xi* is credible: the gates of the robust form.

    The printed identifier divides noise by almost zero at standstill and where the rotor is at the
    same angle at every tick.

    Parameters
    ----------
    found, travelled, rest, scale : from `solve`.
    least_chord : smallest rotation between ticks, as a chord of the unit circle (rms).
    largest_rest : largest residual of the fit, relative to |X|^2.
    lowest, highest : range of |xi*| [1/Wb].
    least_emf : smallest |h| at a tick [V].
    """
    for size in registers[1]:
        if size < least_emf:
            return False
    return (
        travelled >= least_chord * least_chord * scale
        and rest <= largest_rest * travelled
        and lowest <= abs(found) <= highest
    )
