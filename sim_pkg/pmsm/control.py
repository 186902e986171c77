# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The drive's controller: speed and current loops in the rotor frame (field-oriented control).

A command computed from sample k is applied over the period that starts at sample k+1. All functions
are in the subset that the engine has.
"""

from __future__ import annotations

import math

from estimator_pkg.record import record
from sim_pkg.pmsm.inverter import limited


@record
class Control:
    """Gains and data of the controller."""

    kp_current: float  # [ohm]
    ki_current: float  # times the period [ohm]
    kp_speed: float  # [N m s]
    ki_speed: float  # times the period [N m s]
    torque_constant: float  # [N m/A]
    current_max: float  # [A]
    inductance: float  # [H]
    flux: float  # [Wb]
    poles: float  # pole pairs
    period: float  # [s]
    dc_voltage: float  # [V]
    inertia: float  # [kg m^2]


def speed_control(
    reference: float, acceleration: float, speed: float, integral: float, control: Control
) -> tuple[float, float]:
    """Return (i_q reference [A], integral [N m]) from mechanical speeds [rad/s].

    The acceleration of the profile is a feedforward through the inertia.
    """
    error = reference - speed
    torque = control.kp_speed * error + integral + control.inertia * acceleration
    most = control.torque_constant * control.current_max
    if torque > most:
        return control.current_max, integral
    if torque < -most:
        return -control.current_max, integral
    return torque / control.torque_constant, integral + control.ki_speed * error


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
    linked = control.inductance * (current * back) + control.flux
    frame = control.kp_current * error + integral + complex(0.0, omega) * linked
    ahead = theta + 1.5 * omega * control.period  # angle in the middle of the period of action
    voltage = limited(frame, control.dc_voltage)
    if voltage == frame:  # anti-windup: no integration while the voltage is saturated
        integral += control.ki_current * error
    return voltage * complex(math.cos(ahead), math.sin(ahead)), integral
