# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``dc_motor``: J q'' + b q' + k q = Kv u + load, optionally with Coulomb friction.

The plant (34) of Gonzalez-Olvera and Tang.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH
from sim_pkg.contract import Simulator
from sim_pkg.joints.driven import SUBSTEP, DrivenParameters, Plant, stream

RANDOM, SINES = 'random', 'sines'


@dataclass(frozen=True)
class MotorParameters(DrivenParameters):
    """The parameters of the simulator."""

    inertia: float = structural(0.02, unit='kg m^2', range=(1e-9, 1e6), description='J')
    damping: float = structural(0.04, unit='N m s/rad', range=(0.0, 1e6), description='b')
    stiffness: float = structural(0.1, unit='N m/rad', range=(0.0, 1e6), description='k')
    torque_constant: float = structural(
        0.6, unit='N m/V', range=(1e-9, 1e6), description='Kv: torque of one volt'
    )
    coulomb: float = structural(
        0.0, unit='N m', range=(0.0, 1e6), description='Coulomb friction; 0: none'
    )
    load: float = structural(
        0.0, unit='N m', range=(-1e6, 1e6), description='constant load torque, added to that of u'
    )
    voltage: str = structural(
        RANDOM,
        choices=(RANDOM, SINES),
        description='random: uniform, piecewise constant (both examples of the paper while they '
        'learn); sines: three of them',
    )
    amplitude: float = structural(
        5.0, unit='V', range=(0.0, 1e6), description='rms of the random voltage, else its amplitude'
    )
    hold: float = structural(
        0.2, unit='s', range=(1e-6, 1e6), description='how long a random voltage stays constant'
    )

    @property
    def fastest(self) -> float:
        """An upper bound of the joint's rates [1/s]."""
        return self.damping / self.inertia + math.sqrt(self.stiffness / self.inertia)


class Motor(Plant):
    """The plant."""

    def __init__(self, parameters: MotorParameters, seed: int) -> None:
        self._p = parameters
        self._seed = seed
        self._held, self._value = -1, 0.0

    def input(self, t: float) -> float:
        """Return the voltage applied from t [s] on [V]."""
        p = self._p
        if p.voltage == RANDOM:
            return p.amplitude * self._random(math.floor(t / p.hold + 1e-9))
        return p.amplitude / 3.0 * (math.sin(3.0 * t) + math.sin(7.3 * t) + math.sin(17.0 * t))

    def _random(self, index: int) -> float:
        """Return a uniform number with unit variance: the index-th of this seed."""
        if index != self._held:
            x = ((index + 1) * 0x9E3779B97F4A7C15 + self._seed * 0xBF58476D1CE4E5B9) % 2**64
            x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
            x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) % 2**64
            self._held = index
            self._value = math.sqrt(3.0) * (2.0 * ((x ^ (x >> 31)) >> 11) * 2.0**-53 - 1.0)
        return self._value

    def _torque(self, q: float, w: float, u: float) -> float:
        p = self._p
        return p.torque_constant * u + p.load - p.damping * w - p.stiffness * q

    def acceleration(self, q: float, v: float, u: float) -> float:
        """Return q'' [rad/s^2]."""
        torque, friction = self._torque(q, v, u), self._p.coulomb
        if v != 0.0:
            torque -= math.copysign(friction, v)
        elif abs(torque) <= friction:
            torque = 0.0
        else:
            torque -= math.copysign(friction, torque)
        return torque / self._p.inertia

    def stick(self, q: float, before: float, w: float, u: float) -> float:
        """Return w, or 0 where Coulomb friction stops a slow or reversing joint [rad/s]."""
        friction = self._p.coulomb
        slow = abs(w) <= SUBSTEP * friction / self._p.inertia
        held = friction > 0.0 and abs(self._torque(q, 0.0, u)) <= friction
        return 0.0 if held and (slow or before * w < 0.0) else w


SIMULATOR = Simulator(
    name='dc_motor',
    summary='a servo motor with spring, load and friction, driven by a voltage',
    parameters=MotorParameters,
    topics=lambda p: (MEASURED, TRUTH),
    generate=lambda p, duration, seed: stream(Motor(p, seed), p, duration, seed),
)
