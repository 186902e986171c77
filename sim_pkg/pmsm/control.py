# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The drive's controller: speed and current loops in the rotor frame (field-oriented control).

A command computed from sample k is applied over the period that starts at sample k+1. All functions
are in the subset that Numba compiles.
"""

from __future__ import annotations

import math

from sim_pkg.pmsm.inverter import limited

# (kp current [ohm], ki current x period [ohm], kp speed [N m s], ki speed x period [N m s],
#  torque constant [N m/A], largest current [A], L [H], flux [Wb], pole pairs, period [s],
#  dc voltage [V], inertia [kg m^2])
Control = tuple[float, float, float, float, float, float, float, float, float, float, float, float]


def speed_control(
    reference: float, acceleration: float, speed: float, integral: float, control: Control
) -> tuple[float, float]:
    """Return (i_q reference [A], integral [N m]) from mechanical speeds [rad/s].

    The acceleration of the profile is a feedforward through the inertia.
    """
    error = reference - speed
    torque = control[2] * error + integral + control[11] * acceleration
    most = control[4] * control[5]
    if torque > most:
        return control[5], integral
    if torque < -most:
        return -control[5], integral
    return torque / control[4], integral + control[3] * error


def current_control(
    current: complex, i_q: float, theta: float, omega: float, integral: complex, control: Control
) -> tuple[complex, complex]:
    """Return (voltage for the next period in the static frame [V], integral [V]).

    Parameters
    ----------
    current : measured [A], static frame.
    theta, omega : electrical angle [rad] and speed [rad/s] as the controller estimates them.
    integral : of the current loop, in the rotor frame.
    """
    back = complex(math.cos(theta), -math.sin(theta))
    error = complex(0.0, i_q) - current * back
    frame = (
        control[0] * error
        + integral
        + complex(0.0, omega) * (control[6] * (current * back) + control[7])
    )
    ahead = theta + 1.5 * omega * control[9]  # angle in the middle of the period of action
    voltage = limited(frame, control[10])
    if voltage == frame:  # anti-windup: no integration while the voltage is saturated
        integral += control[1] * error
    return voltage * complex(math.cos(ahead), math.sin(ahead)), integral


def tuned(
    resistance: float,
    inductance: float,
    flux: float,
    pole_pairs: int,
    inertia: float,
    current_max: float,
    dc_voltage: float,
    period: float,
    current_hz: float,
    speed_hz: float,
) -> Control:
    """Return gains from the motor's data and the two bandwidths [Hz]."""
    fast, slow = 2.0 * math.pi * current_hz, 2.0 * math.pi * speed_hz
    return (
        fast * inductance,
        fast * resistance * period,
        slow * inertia,
        0.25 * slow * slow * inertia * period,
        1.5 * pole_pairs * flux,
        current_max,
        inductance,
        flux,
        float(pole_pairs),
        period,
        dc_voltage,
        inertia,
    )
