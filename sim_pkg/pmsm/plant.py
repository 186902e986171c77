# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The motor: the electromagnetic model (1) and its mechanics, in closed form where there is one.

Vectors are complex numbers alpha + j beta, amplitude-invariant. All functions are in the subset
that the engine has.
"""

from __future__ import annotations

import math

from estimator_pkg.record import record

STICKS = 1.0  # speed below which Coulomb friction fades to zero [rad/s]


@record
class Plant:
    """The motor and its load."""

    resistance: float  # [ohm]
    inductance: float  # [H]
    flux: float  # [Wb]
    poles: float  # pole pairs
    inertia: float  # [kg m^2]
    quadratic: float  # load per squared speed [N m s^2/rad^2]
    constant: float  # load [N m]
    viscous: float  # friction per speed [N m s/rad]
    coulomb: float  # friction [N m]


def electric(
    current: complex, voltage: complex, theta: float, omega: float, plant: Plant, time: float
) -> complex:
    """Return the current [A] after `time` [s] at constant voltage and speed (exact).

    Parameters
    ----------
    theta, omega : electrical angle at the start [rad] and electrical speed [rad/s].
    """
    rate = plant.resistance / plant.inductance
    decay = math.exp(-rate * time)
    turn = omega * time
    # integral of exp(-rate (t - s)) exp(j omega s) = (exp(j omega t) - exp(-rate t))/(rate + j w)
    rest = complex(math.cos(turn) - decay, math.sin(turn)) * complex(rate, -omega)
    scale = omega * plant.flux / (plant.inductance * (rate * rate + omega * omega))
    emf = complex(0.0, scale) * complex(math.cos(theta), math.sin(theta)) * rest
    return decay * current + (1.0 - decay) / plant.resistance * voltage - emf


def torque(current: complex, theta: float, plant: Plant) -> float:
    """Return the torque of the motor [N m]: 3/2 p phi i_q."""
    i_q = current.imag * math.cos(theta) - current.real * math.sin(theta)
    return 1.5 * plant.poles * plant.flux * i_q


def resisting(speed: float, load: float, plant: Plant) -> float:
    """Return the torque against the motion [N m] at a mechanical speed [rad/s], `load` included."""
    friction = speed / STICKS
    if friction > 1.0:
        friction = 1.0
    elif friction < -1.0:
        friction = -1.0
    # braking torques vanish with the speed, so a load does not drive a rotor at rest
    drag = plant.quadratic * speed * abs(speed) + plant.viscous * speed
    return drag + (plant.constant + plant.coulomb + load) * friction


def move(
    current: complex,
    voltage: complex,
    theta: float,
    speed: float,
    load: float,
    plant: Plant,
    time: float,
) -> tuple[complex, float, float]:
    """Return (current, electrical angle, mechanical speed) after `time` [s] at constant voltage.

    The speed is accurate to second order in `time`; the current is exact for the mean speed.
    """
    poles, inertia = plant.poles, plant.inertia
    before = torque(current, theta, plant)
    brake = resisting(speed, load, plant)
    middle = speed + 0.5 * time * (before - brake) / inertia
    current = electric(current, voltage, theta, poles * middle, plant, time)
    after = torque(current, theta + poles * middle * time, plant)
    new_speed = speed + time * (0.5 * (before + after) - resisting(middle, load, plant)) / inertia
    return current, theta + 0.5 * poles * time * (speed + new_speed), new_speed
