# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The parameters of the sensorless observer, and the gains that follow from motor and bandwidth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from estimator_pkg.errors import UsageError
from estimator_pkg.models.motor import MotorData, check_motor
from estimator_pkg.parameters import parameter, structural

EPSILON = 85e-6  # s; Table 1's gains are those of (17) at this epsilon
EPSILON_SPEED = 0.374  # epsilon times the top electrical speed in Table 1's motor
EMF_SPEED = 75.0  # electrical rad/s: the smallest usable back-EMF is the one at this speed
FLUX_RANGE = 2.5  # the flux linkage is estimated within this factor of the nominal one
NOISE_GUESS = 0.002  # current noise per flux/inductance until it is measured
SETTLES = 5.0  # settling time of the fast part in units of epsilon


@dataclass(frozen=True)
class Gains(MotorData):
    """Parameters of `pmsm`: motor data, one relative bandwidth, and the paper's symbols."""

    variant: str = structural(
        'identifier',
        choices=('identifier', 'hybrid', 'continuous'),
        description='identifier: (16) with the flux identifier (25), (26); hybrid: (16); '
        'continuous: (5)',
    )
    form: str = structural(
        'robust',
        choices=('robust', 'paper'),
        description='robust: gated identifier, alternating clock, frozen while not observable; '
        'paper: the equations as printed (misprints mended)',
    )
    relative_bandwidth: float = parameter(
        0.1286,
        range=(0.01, 1.0),
        search=(0.03, 0.5),
        description='natural frequency of angle and flux estimation per electrical speed',
        equation='sqrt(gamma) phi',
    )
    epsilon: float | None = parameter(
        None,
        unit='s',
        range=(1e-6, 0.1),
        advanced=True,
        description='time constant of current and back-EMF estimation; automatic: 0.374 over the '
        'top electrical speed, 85 us where speed_max is automatic',
        equation='(17)',
    )
    speed_max: float | None = parameter(
        None,
        unit='rad/s',
        range=(0.1, 1e5),
        description='top mechanical speed; a sample rate at which the rotor turns more than half '
        'an electrical turn per sample at this speed is refused; automatic: not known',
    )
    k_p: float | None = parameter(
        None,
        unit='1/s',
        range=(1e-3, 1e9),
        advanced=True,
        description='current correction; automatic: 2/epsilon - R/L',
        equation='kp in (5), (17)',
    )
    k_i: float | None = parameter(
        None,
        unit='V/(A s)',
        range=(1e-9, 1e12),
        advanced=True,
        description='back-EMF correction; automatic: 2 L/epsilon^2',
        equation='ki in (5), (17)',
    )
    k_eta: float | None = parameter(
        None,
        unit='1/Wb',
        range=(0.0, 1e9),
        advanced=True,
        description='alignment of the frame; automatic: sqrt(2 gamma) (damping 0.707)',
        equation='k_eta in (5)',
    )
    gamma: float | None = parameter(
        None,
        unit='1/Wb^2',
        range=(0.0, 1e15),
        advanced=True,
        description='adaptation of the flux; automatic: (relative_bandwidth/flux)^2',
        equation='gamma in (5)',
    )
    clock_rate: float = parameter(
        200.0,
        unit='1/s',
        range=(1.0, 5000.0),
        advanced=True,
        description='rate of the clock ticks at which the frame may be reset and the identifier '
        'takes a sample',
        equation='Lambda in (7)',
    )
    periods: int = structural(
        2,
        range=(1, 16),
        advanced=True,
        description='clock periods that the identifier fits',
        equation='N in (23)',
    )
    second_period: float = parameter(
        0.8,
        range=(0.2, 1.0),
        advanced=True,
        description='length of every second clock period relative to the others, so that at no '
        'speed the rotor is at the same angle at every tick; 1: all equal (form paper: always)',
    )
    scaling: str = structural(
        'amplitude',
        choices=('amplitude', 'power'),
        description='scaling of the measured alpha-beta vectors: their length is the amplitude of '
        'the phase quantity, or sqrt(1.5) times that (power-invariant)',
    )
    voltage_delay: float = structural(
        0.0,
        unit='sample',
        range=(0.0, 8.0),
        description='delay between the interval that ends at the stamp of a voltage and the '
        'interval over which it acts (2: a command computed at the stamp acts over the period '
        'after the next)',
    )
    dead_time_voltage: float = parameter(
        0.0,
        unit='V',
        range=(0.0, 1e4),
        description='mean phase voltage lost by the dead time of the bridge, if the reported '
        'voltage does not include it: dc voltage x dead time x carrier frequency; it is '
        'subtracted with the signs of the phase currents',
    )
    pwm_frequency: float | None = parameter(
        None,
        unit='Hz',
        range=(1.0, 1e7),
        advanced=True,
        description='carrier frequency of the drive: within a period the voltage is constant while '
        'the rotor turns, so the current deviates from the line between its samples; this is '
        'corrected if the frequency is known (angle: omega R/(12 L f^2)); automatic: not known',
    )
    initial_flux: float | None = parameter(
        None,
        unit='Wb',
        range=(0.0, 1e3),
        advanced=True,
        description='initial estimate of the flux linkage; automatic: the nominal one; 0: unknown',
    )
    flux_min: float | None = parameter(
        None,
        unit='Wb',
        range=(1e-9, 1e3),
        advanced=True,
        description='smallest credible flux linkage; automatic: nominal / 2.5',
        equation='sat, below (5)',
    )
    flux_max: float | None = parameter(
        None,
        unit='Wb',
        range=(1e-9, 1e3),
        advanced=True,
        description='largest credible flux linkage; automatic: nominal x 2.5',
        equation='sat, below (5)',
    )
    emf_min: float | None = parameter(
        None,
        unit='V',
        range=(0.0, 1e4),
        description='back-EMF below which the rotor is not observable; noise and resistance_error '
        'can raise this limit; automatic: nominal flux times 75 rad/s (electrical)',
    )
    resistance_error: float = parameter(
        0.2,
        range=(0.0, 2.0),
        advanced=True,
        description='relative uncertainty of the resistance; the back-EMF must exceed twice the '
        'voltage drop that corresponds to it',
    )
    current_noise: float | None = parameter(
        None,
        unit='A',
        range=(1e-9, 1e3),
        description='standard deviation of the noise of each measured current; automatic: '
        'estimated from the innovation',
    )
    speed_filter_hz: float = parameter(
        1000.0,
        unit='Hz',
        range=(0.0, 1e5),
        search=(20.0, 2000.0),
        description='-3 dB frequency of the low-pass on the speed output (two poles); 0: none. Its '
        'delay 0.193/f is reported as the group delay',
    )
    hold: float = parameter(
        0.010,
        unit='s',
        range=(0.0, 10.0),
        advanced=True,
        description='time for which all residuals must be within their limits before the estimate '
        'is valid',
    )


class Tuning(NamedTuple):
    """The gains in the paper's symbols, and epsilon [s]."""

    epsilon: float
    k_p: float
    k_i: float
    k_eta: float
    gamma: float


def tuning(gains: Gains) -> Tuning:
    """Return epsilon, kp, ki, k_eta and gamma; automatic ones from motor data and bandwidth.

    Raises
    ------
    UsageError : motor data are missing, or the gains cannot work.
    """
    resistance, inductance, flux, pole_pairs = check_motor(gains, 'pmsm')
    epsilon = gains.epsilon
    if epsilon is None:
        epsilon = EPSILON
        if gains.speed_max is not None:
            epsilon = EPSILON_SPEED / (gains.speed_max * pole_pairs)
            epsilon = min(epsilon, inductance / resistance)
    k_p = gains.k_p if gains.k_p is not None else 2.0 / epsilon - resistance / inductance
    k_i = gains.k_i if gains.k_i is not None else 2.0 * inductance / epsilon**2
    gamma = gains.gamma if gains.gamma is not None else (gains.relative_bandwidth / flux) ** 2
    k_eta = gains.k_eta if gains.k_eta is not None else math.sqrt(2.0 * gamma)
    if k_p <= 0.0:
        raise UsageError(
            f'epsilon = {epsilon:g} s is too slow for L/R = '
            f'{inductance / resistance:g} s: set it below twice that'
        )
    epsilon = 2.0 / (resistance / inductance + k_p)
    if gains.clock_rate * SETTLES * epsilon > 1.0:
        raise UsageError(
            f'clock_rate = {gains.clock_rate:g} /s is too fast: the back-EMF needs '
            f'{SETTLES * epsilon:g} s to settle between ticks; '
            f'set at most {1.0 / (SETTLES * epsilon):g} /s'
        )
    low, high = flux_range(gains)
    if not low < high:
        raise UsageError(f'flux_min = {low:g} Wb is not below flux_max = {high:g} Wb: set it below')
    return Tuning(epsilon, k_p, k_i, k_eta, gamma)


def flux_range(gains: Gains) -> tuple[float, float]:
    """Return the smallest and the largest credible flux linkage [Wb]."""
    nominal = float(gains.flux or 0.0)
    low = gains.flux_min if gains.flux_min is not None else nominal / FLUX_RANGE
    high = gains.flux_max if gains.flux_max is not None else nominal * FLUX_RANGE
    return low, high
