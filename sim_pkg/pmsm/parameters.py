# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the motor simulator: motor, load, inverter, sensors, controller, profile."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import structural
from sim_pkg.pmsm.control import Control
from sim_pkg.pmsm.plant import Plant
from sim_pkg.pmsm.profiles import NAMES, Profile, named


@dataclass(frozen=True)
class PmsmParameters:
    """The parameters of the drive; the motor is that of Table 1 of Bosso et al. (2020)."""

    resistance: float = structural(
        0.06, unit='ohm', range=(1e-6, 1e4), description='nominal stator resistance per phase'
    )
    inductance: float = structural(
        33.75e-6, unit='H', range=(1e-9, 10.0), description='nominal stator inductance per phase'
    )
    flux: float = structural(
        1.9e-3, unit='Wb', range=(1e-7, 100.0), description='nominal flux linkage of the magnets'
    )
    pole_pairs: int = structural(7, range=(1, 200), description='pole pairs')
    inertia: float = structural(
        2.5e-5, unit='kg m^2', range=(1e-9, 1e3), description='inertia of rotor and load'
    )
    current_max: float = structural(
        30.0, unit='A', range=(1e-3, 1e4), description='current limit of the controller (amplitude)'
    )
    resistance_error: float = structural(
        0.0,
        range=(-0.9, 10.0),
        description='relative error of the nominal resistance: plant over nominal, minus 1',
    )
    inductance_error: float = structural(
        0.0,
        range=(-0.9, 10.0),
        description='relative error of the nominal inductance: plant over nominal, minus 1',
    )
    flux_error: float = structural(
        0.0,
        range=(-0.9, 10.0),
        description='relative error of the nominal flux linkage: plant over nominal, minus 1',
    )
    load_quadratic: float = structural(
        2.5e-7, unit='N m s^2', range=(0.0, 1e3), description='load torque over speed squared'
    )
    load_constant: float = structural(
        0.0, unit='N m', range=(0.0, 1e4), description='constant load torque against the motion'
    )
    viscous: float = structural(0.0, unit='N m s', range=(0.0, 1e3), description='viscous friction')
    coulomb: float = structural(0.0, unit='N m', range=(0.0, 1e3), description='Coulomb friction')
    load_step: float = structural(
        0.0, unit='N m', range=(0.0, 1e4), description='load torque added at load_step_time'
    )
    load_step_time: float = structural(
        0.5, unit='s', range=(0.0, 1e6), description='time of the load step'
    )
    dc_voltage: float = structural(24.0, unit='V', range=(0.1, 1e4), description='DC link voltage')
    sample_rate: float = structural(
        20000.0, unit='Hz', range=(1000.0, 200000.0), description='rate of controller and sampling'
    )
    dead_time: float = structural(
        0.0,
        unit='s',
        range=(0.0, 1e-5),
        description='dead time of the bridge; the reported voltage does not contain its effect',
    )
    current_noise: float = structural(
        0.0, unit='A', range=(0.0, 1e3), description='standard deviation on each measured current'
    )
    adc_bits: int = structural(
        12, range=(0, 24), description='bits of the current ADC; 0: continuous'
    )
    adc_range: float = structural(
        60.0, unit='A', range=(1e-3, 1e5), description='range of the current ADC, each way'
    )
    voltage_delay: int = structural(
        0,
        unit='sample',
        range=(-1, 2),
        description='delay of the reported voltage; 0: it acted over the interval that ends at its '
        'stamp; 1: it starts to act at the stamp; 2: as computed there by the controller; -1: it '
        'is one sample old',
    )
    current_hz: float = structural(
        1000.0, unit='Hz', range=(1.0, 1e5), description='bandwidth of the current control'
    )
    speed_hz: float = structural(
        30.0, unit='Hz', range=(0.01, 1e4), description='bandwidth of the speed control'
    )
    profile: str = structural(
        'p1',
        choices=NAMES,
        description='reference of the speed: constant, ramps (0.3 to 1 and back), p1 (of the '
        'paper, 0.7 s long), reversal, standstill (start and stop)',
    )
    speed_rpm: float = structural(
        6000.0, unit='rpm', range=(-1e6, 1e6), description='top speed of the profile'
    )
    profile_time: float = structural(
        1.0, unit='s', range=(0.01, 1e5), description='length of one run through the profile'
    )

    def __post_init__(self) -> None:
        """Check what a range cannot express; raise UsageError."""
        room = self.dc_voltage / math.sqrt(3.0)
        top = self.flux * self.pole_pairs * abs(self.speed_rpm) * math.pi / 30.0
        if top > room:
            raise UsageError(
                f'speed_rpm = {self.speed_rpm:g}: its back-EMF of {top:.3g} V is more '
                f'than dc_voltage/sqrt(3) = {room:.3g} V: lower it, or raise dc_voltage'
            )
        if self.dead_time * self.sample_rate > 0.2:
            raise UsageError(
                f'dead_time = {self.dead_time:g} s is more than a fifth of the period, '
                f'{self.period:.3g} s: shorten it'
            )
        if self.fastest > self.sample_rate:
            raise UsageError(
                f'inertia = {self.inertia:g} kg m^2: with its torque and friction the rotor has '
                f'a time constant of {1.0 / self.fastest:.2g} s, less than a sample: increase it'
            )

    @property
    def period(self) -> float:
        """Sample time [s]."""
        return 1.0 / self.sample_rate

    @property
    def fastest(self) -> float:
        """An upper bound of the mechanical rates [1/s]: friction at top speed, and stiffness.

        The stiffness is that of the largest current. Dry friction is left out: its rate is bounded,
        and at worst the rotor chatters about standstill.
        """
        top = abs(self.speed_rpm) * math.pi / 30.0
        brake = (self.viscous + 2.0 * self.load_quadratic * top) / self.inertia
        pull = 1.5 * self.pole_pairs**2 * self.flux * self.current_max / self.inertia
        return brake + math.sqrt(pull)

    def plant(self) -> Plant:
        """Return the true motor."""
        made = Plant()
        made.resistance = self.resistance * (1.0 + self.resistance_error)
        made.inductance = self.inductance * (1.0 + self.inductance_error)
        made.flux = self.flux * (1.0 + self.flux_error)
        made.poles, made.inertia = float(self.pole_pairs), self.inertia
        made.quadratic, made.constant = self.load_quadratic, self.load_constant
        made.viscous, made.coulomb = self.viscous, self.coulomb
        return made

    def control(self) -> Control:
        """Return the controller, tuned for the nominal motor."""
        fast, slow = 2.0 * math.pi * self.current_hz, 2.0 * math.pi * self.speed_hz
        made = Control()
        made.kp_current = fast * self.inductance
        made.ki_current = fast * self.resistance * self.period
        made.kp_speed = slow * self.inertia
        made.ki_speed = 0.25 * slow * slow * self.inertia * self.period
        made.torque_constant = 1.5 * self.pole_pairs * self.flux
        made.current_max, made.dc_voltage = self.current_max, self.dc_voltage
        made.inductance, made.flux, made.poles = self.inductance, self.flux, float(self.pole_pairs)
        made.period, made.inertia = self.period, self.inertia
        return made

    def motion(self) -> Profile:
        """Return the profile of the reference speed."""
        return named(self.profile, self.speed_rpm, self.profile_time)
