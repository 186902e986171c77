"""What can be set of the motor simulator: motor, load, inverter, sensors, controller, profile."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from sim_pkg.joints.profiles import fixed
from sim_pkg.pmsm.control import Control, tuned
from sim_pkg.pmsm.plant import Plant
from sim_pkg.pmsm.profiles import NAMES, Profile, named

COPPER = 0.0039  # 1/K, of the resistance
MAGNET = -0.0011  # 1/K, of the flux (neodymium)


@dataclass(frozen=True)
class PmsmParameters:
    """All that can be set of the simulator; the motor is that of Table 1 of Bosso et al. (2020)."""

    resistance: float = fixed(
        0.06, unit='ohm', range=(1e-6, 1e4), description='nominal stator resistance per phase'
    )
    inductance: float = fixed(
        33.75e-6, unit='H', range=(1e-9, 10.0), description='nominal stator inductance per phase'
    )
    flux: float = fixed(
        1.9e-3, unit='Wb', range=(1e-7, 100.0), description='nominal flux linkage of the magnets'
    )
    pole_pairs: int = fixed(7, unit='', range=(1, 200), description='pole pairs')
    inertia: float = fixed(
        2.5e-5, unit='kg m^2', range=(1e-9, 1e3), description='of rotor and load'
    )
    rated_current: float = fixed(
        10.0,
        unit='A',
        range=(1e-3, 1e4),
        description='amplitude of the phase current at rated torque',
    )
    current_max: float = fixed(
        30.0, unit='A', range=(1e-3, 1e4), description='largest amplitude the controller asks for'
    )
    resistance_error: float = fixed(
        0.0,
        unit='',
        range=(-0.9, 10.0),
        description='resistance of the plant over the nominal one, less one',
    )
    inductance_error: float = fixed(
        0.0,
        unit='',
        range=(-0.9, 10.0),
        description='inductance of the plant over the nominal one, less one',
    )
    flux_error: float = fixed(
        0.0,
        unit='',
        range=(-0.9, 10.0),
        description='flux linkage of the plant over the nominal one, less one',
    )
    temperature_rise: float = fixed(
        0.0,
        unit='K',
        range=(-100.0, 200.0),
        description='warming in the end: the resistance rises by 0.39 % per K, the flux falls by '
        '0.11 % per K',
    )
    temperature_time: float = fixed(
        60.0, unit='s', range=(0.01, 1e5), description='time constant of the warming'
    )
    load_quadratic: float = fixed(
        2.5e-7, unit='N m s^2', range=(0.0, 1e3), description='load torque per speed squared'
    )
    load_constant: float = fixed(
        0.0, unit='N m', range=(0.0, 1e4), description='load torque against the motion'
    )
    viscous: float = fixed(0.0, unit='N m s', range=(0.0, 1e3), description='viscous friction')
    coulomb: float = fixed(0.0, unit='N m', range=(0.0, 1e3), description='Coulomb friction')
    load_step: float = fixed(
        0.0, unit='N m', range=(0.0, 1e4), description='load torque added at load_step_time'
    )
    load_step_time: float = fixed(
        0.5, unit='s', range=(0.0, 1e6), description='when the load step comes'
    )
    dc_voltage: float = fixed(
        24.0, unit='V', range=(0.1, 1e4), description='of the intermediate circuit'
    )
    sample_rate: float = fixed(
        20000.0,
        unit='Hz',
        range=(1000.0, 200000.0),
        description='of controller, carrier and sampling',
    )
    inverter: str = fixed(
        'averaged',
        unit='',
        choices=('averaged', 'switched'),
        description='averaged: the mean voltage of each period; switched: the bridge with its '
        'edges',
    )
    dead_time: float = fixed(
        0.0,
        unit='s',
        range=(0.0, 1e-5),
        description='of the bridge; what the drive reports does not know of it',
    )
    sampling_offset: float = fixed(
        0.0,
        unit='period',
        range=(0.0, 0.5),
        description='how far from the valley of the carrier the currents are sampled',
    )
    current_noise: float = fixed(
        0.0, unit='A', range=(0.0, 1e3), description='standard deviation on each measured current'
    )
    adc_bits: int = fixed(
        12, unit='', range=(0, 24), description='of the current measurement; 0: continuous'
    )
    adc_range: float = fixed(
        60.0, unit='A', range=(1e-3, 1e5), description='of the current measurement, each way'
    )
    voltage_delay: int = fixed(
        0,
        unit='sample',
        range=(-1, 2),
        description='the reported voltage acts so many samples later than over the interval that '
        'ends at its stamp; 1: it starts to act at the stamp, 2: as the controller '
        'computed it there, -1: it is a sample old',
    )
    current_hz: float = fixed(
        1000.0, unit='Hz', range=(1.0, 1e5), description='bandwidth of the current control'
    )
    speed_hz: float = fixed(
        30.0, unit='Hz', range=(0.01, 1e4), description='bandwidth of the speed control'
    )
    profile: str = fixed(
        'p1',
        unit='',
        choices=NAMES,
        description='wanted speed: constant, ramps (0.3 to 1 and back), p1 (of the paper, 0.7 s '
        'long), reversal, standstill (start and stop)',
    )
    speed_rpm: float = fixed(
        6000.0, unit='rpm', range=(-1e6, 1e6), description='top speed of the profile'
    )
    profile_time: float = fixed(
        1.0, unit='s', range=(0.01, 1e5), description='length of one run through the profile'
    )

    def __post_init__(self) -> None:
        """What a range cannot say; raises UsageError."""
        room = self.dc_voltage / math.sqrt(3.0)
        top = self.flux * self.pole_pairs * abs(self.speed_rpm) * math.pi / 30.0
        if top > room:
            raise UsageError(
                f'speed_rpm = {self.speed_rpm:g}: its back-EMF of {top:.3g} V is more '
                f'than dc_voltage/sqrt(3) = {room:.3g} V'
            )
        if self.dead_time * self.sample_rate > 0.2:
            raise UsageError(f'dead_time = {self.dead_time:g} s is more than a fifth of the period')
        if self.fastest > self.sample_rate:
            raise UsageError(
                f'inertia = {self.inertia:g} kg m^2: against its torque and friction the rotor has '
                f'a time constant of {1.0 / self.fastest:.2g} s, less than a sample'
            )

    @property
    def period(self) -> float:
        """Sample time [s]."""
        return 1.0 / self.sample_rate

    @property
    def fastest(self) -> float:
        """A bound of the mechanical rates [1/s]: friction at the top speed, and the currents' pull.

        Dry friction is left out: it is bounded, and at worst shivers about standstill.
        """
        top = abs(self.speed_rpm) * math.pi / 30.0
        brake = (self.viscous + 2.0 * self.load_quadratic * top) / self.inertia
        pull = 1.5 * self.pole_pairs**2 * self.flux * self.current_max / self.inertia
        return brake + math.sqrt(pull)

    @property
    def rated_torque(self) -> float:
        """At rated current [N m]."""
        return 1.5 * self.pole_pairs * self.flux * self.rated_current

    def plant(self, time: float = 0.0) -> Plant:
        """The true motor after `time` [s] of warming."""
        warmth = self.temperature_rise * (1.0 - math.exp(-time / self.temperature_time))
        return (
            self.resistance * (1.0 + self.resistance_error) * (1.0 + COPPER * warmth),
            self.inductance * (1.0 + self.inductance_error),
            self.flux * (1.0 + self.flux_error) * (1.0 + MAGNET * warmth),
            float(self.pole_pairs),
            self.inertia,
            self.load_quadratic,
            self.load_constant,
            self.viscous,
            self.coulomb,
        )

    def control(self) -> Control:
        """The controller, tuned for the nominal motor."""
        return tuned(
            self.resistance,
            self.inductance,
            self.flux,
            self.pole_pairs,
            self.inertia,
            self.current_max,
            self.dc_voltage,
            self.period,
            self.current_hz,
            self.speed_hz,
        )

    def motion(self) -> Profile:
        """The wanted speed."""
        return named(self.profile, self.speed_rpm, self.profile_time)
