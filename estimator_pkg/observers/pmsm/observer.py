# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sensorless speed, angle and flux of a permanent-magnet motor (Bosso, Azzollini, Tilli, 2020).

A sample is (i_alpha, i_beta, u_alpha, u_beta): the current at the stamp and the mean voltage over
the interval that ends at the stamp. `step` is in step.py; here are the parameters, the gains that
follow from motor and bandwidth, and the estimates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.errors import UsageError
from estimator_pkg.estimate import INITIALISING, NOT_OBSERVABLE, TRACKING, Deviation, Estimate
from estimator_pkg.models.motor import POWER_INVARIANT, MotorData, check_motor
from estimator_pkg.observers.contract import Observer
from estimator_pkg.observers.maths.tracking import natural_frequency
from estimator_pkg.observers.pmsm import drive
from estimator_pkg.observers.pmsm import state as records
from estimator_pkg.observers.pmsm import step as stepping
from estimator_pkg.observers.pmsm.drive import DriveSample, Electrical, ElectricalDeviation
from estimator_pkg.observers.pmsm.equations import flux_linkage, rotor_angle
from estimator_pkg.observers.pmsm.noise import DAMPING, deviations, low_pass_weight, noise_gains
from estimator_pkg.observers.pmsm.scheme import exponential, prepare_scheme
from estimator_pkg.observers.pmsm.state import Coefficients, Design, State
from estimator_pkg.observers.pmsm.watch import (
    BLIND,
    HALF_TURN,
    LEAST_EMF,
    LEAVES,
    LOW_EMF,
    least_emf,
)
from estimator_pkg.parameters import parameter, structural

EPSILON = 85e-6  # s; Table 1's gains are those of (17) at this epsilon
EPSILON_SPEED = 0.374  # epsilon times the top electrical speed in Table 1's motor
EMF_SPEED = 75.0  # electrical rad/s: the smallest usable back-EMF is the one at this speed
FLUX_FACTOR = 2.5  # the flux linkage is estimated within this factor of the nominal one
RESISTANCE_ERROR = 0.2  # relative; the back-EMF must exceed twice the drop that corresponds to it
HOLD = 0.010  # s in which all residuals are within their limits before the estimate is valid
NOISE_GUESS = 0.002  # current noise per flux/inductance until it is measured
EMF_SETTLING = 5.0  # settling time of the fast part in units of epsilon
EMF_AVERAGE = 1e-3  # s, averages of the back-EMF
SPEED_AVERAGE = 5e-3  # s, averages of speeds; so long the rotation is observed before locking on
NOISE_MEMORY = 0.03  # s, average of the innovation's power
TURN = 2.0 * math.pi


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
        equation='gamma = (relative_bandwidth/phi)^2 in (5)',
    )
    epsilon: float | None = parameter(
        None,
        unit='s',
        range=(1e-6, 0.1),
        advanced=True,
        description='time constant of current and back-EMF estimation; automatic: 0.374 over the '
        'top electrical speed, 85 us where speed_max is automatic',
        equation='(17): kp = 2/epsilon - R/L, ki = 2 L/epsilon^2',
    )
    speed_max: float | None = parameter(
        None,
        unit='rad/s',
        range=(0.1, 1e5),
        description='top mechanical speed; a sample rate at which the rotor turns more than half '
        'an electrical turn per sample at this speed is refused; automatic: not known',
    )
    k_eta: float | None = parameter(
        None,
        unit='1/Wb',
        range=(0.0, 1e9),
        advanced=True,
        description='alignment of the frame; automatic: damping 0.707',
        equation='k_eta in (5)',
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
    initial_flux: float | None = parameter(
        None,
        unit='Wb',
        range=(0.0, 1e3),
        advanced=True,
        description='initial estimate of the flux linkage; automatic: the nominal one; 0: unknown',
    )
    emf_min: float | None = parameter(
        None,
        unit='V',
        range=(0.0, 1e4),
        description='back-EMF below which the rotor is not observable; noise and current can raise '
        'this limit; automatic: nominal flux times 75 rad/s (electrical)',
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


def _tune(made: Design, gains: Gains, flux: float) -> None:
    """Set epsilon, kp, ki by (17), k_eta and gamma; raise UsageError if they cannot work."""
    rate = made.resistance / made.inductance
    epsilon = gains.epsilon
    if epsilon is None:
        epsilon = EPSILON
        if gains.speed_max is not None:
            epsilon = EPSILON_SPEED / (gains.speed_max * made.pole_pairs)
            epsilon = min(epsilon, made.inductance / made.resistance)
    made.k_p, made.k_i = 2.0 / epsilon - rate, 2.0 * made.inductance / epsilon**2
    made.gamma = (gains.relative_bandwidth / flux) ** 2
    made.k_eta = gains.k_eta if gains.k_eta is not None else math.sqrt(2.0 * made.gamma)
    if made.k_p <= 0.0:
        raise UsageError(
            f'epsilon = {epsilon:g} s is too slow for L/R = {1.0 / rate:g} s: '
            'set it below twice that'
        )
    made.epsilon = 2.0 / (rate + made.k_p)
    settling = EMF_SETTLING * made.epsilon
    if gains.clock_rate * settling > 1.0:
        raise UsageError(
            f'clock_rate = {gains.clock_rate:g} /s is too fast: the back-EMF needs {settling:g} s '
            f'to settle between ticks; set at most {1.0 / settling:g} /s'
        )


def _set_voltage(made: Design, gains: Gains) -> None:
    made.late = math.floor(gains.voltage_delay)
    made.part = gains.voltage_delay - made.late
    made.kept = made.late + 1 if made.part > 0.0 else made.late
    made.dead_time = gains.dead_time_voltage
    made.corrects = made.kept > 0 or made.dead_time > 0.0


def status_of(state: State, design: Design) -> int:
    """Return the status."""
    if state.watch.reasons & BLIND != 0:
        return NOT_OBSERVABLE
    if state.watch.reasons != 0 or state.watch.calm < HOLD:
        return INITIALISING
    return TRACKING


class Pmsm(Observer):
    """The observer of a motor."""

    name = 'pmsm'
    summary = 'sensorless speed, angle and flux of a permanent-magnet motor'
    reference = 'Bosso, Azzollini, Tilli (2020), (5), (16), (25), (26)'
    kind = 'drive'
    gains = Gains
    Design: TypeAlias = records.Design
    Coefficients: TypeAlias = records.Coefficients
    State: TypeAlias = records.State
    start = staticmethod(stepping.start)
    step = staticmethod(stepping.step)
    resume = staticmethod(stepping.resume)
    restart = staticmethod(stepping.restart)
    coast = staticmethod(stepping.coast)
    is_reading = staticmethod(drive.is_reading)

    @staticmethod
    def design(gains: Gains, circle: Circle) -> Design:
        """Return what the gains imply whatever the sample time is.

        Raises
        ------
        UsageError : motor data are missing, or the gains cannot work.
        """
        made = Design()
        resistance, inductance, nominal, made.pole_pairs = check_motor(gains, 'pmsm')
        made.resistance, made.inductance = resistance, inductance
        _tune(made, gains, nominal)
        made.robust, made.periods = gains.form == 'robust', gains.periods
        made.resets, made.identifies = gains.variant != 'continuous', gains.variant == 'identifier'
        made.clock_rate, made.threshold = gains.clock_rate, 4.0 * math.sqrt(made.gamma)
        made.flux_low, made.flux_high = nominal / FLUX_FACTOR, nominal * FLUX_FACTOR
        made.xi_low, made.xi_high = 1.0 / made.flux_high, 1.0 / made.flux_low
        flux = nominal if gains.initial_flux is None else gains.initial_flux
        made.xi_start = 1.0 / flux if flux > 0.0 else 0.0
        made.emf_min = nominal * EMF_SPEED if gains.emf_min is None else gains.emf_min
        made.drop = 2.0 * RESISTANCE_ERROR * resistance
        made.speed_max = gains.speed_max or 0.0
        made.natural = natural_frequency(gains.speed_filter_hz, DAMPING)
        made.noise_power = (gains.current_noise or 0.0) ** 2
        made.noise_guess = (NOISE_GUESS * nominal / inductance) ** 2
        made.period = 0.0 if circle.unwrap else float(circle.period)
        made.dead = -10.0 * made.epsilon
        made.scale = 1.0 / POWER_INVARIANT if gains.scaling == 'power' else 1.0
        _set_voltage(made, gains)
        return made

    @staticmethod
    def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]."""
        scheme, natural = coefficients.scheme, design.natural
        prepare_scheme(scheme, design.resistance, design.inductance, design.k_p, design.k_i, dt)
        of_h, of_innovation, of_integral = noise_gains(design, scheme, 0.0)
        fast = max(EMF_AVERAGE, 5.0 * design.epsilon)
        coefficients.window = max(SPEED_AVERAGE, 5.0 * fast)
        coefficients.dt, coefficients.pace = dt, design.clock_rate * dt
        coefficients.fast = low_pass_weight(1.0 / fast, dt)
        coefficients.slow = low_pass_weight(1.0 / coefficients.window, dt)
        coefficients.memory = low_pass_weight(1.0 / NOISE_MEMORY, dt)
        coefficients.known_power = design.noise_power * of_innovation
        coefficients.emf_of_noise = LEAST_EMF * math.sqrt(of_h / of_innovation)
        coefficients.fastest = HALF_TURN * math.pi / dt
        coefficients.f11, coefficients.f12, coefficients.f21, coefficients.f22 = exponential(
            0.0, 1.0, -natural * natural, -2.0 * DAMPING * natural, dt
        )

    @staticmethod
    def estimate(
        observer: Any,
        out: Estimate,
        state: State,
        coefficients: Coefficients,
        design: Design,
        measurement: DriveSample,
        known_input: float,
    ) -> None:
        """Set the mechanical estimate."""
        out.status = status_of(state, design)
        out.position = out.velocity = out.acceleration = math.nan
        if out.status != NOT_OBSERVABLE:
            travel = state.out.travel
            travel += wrap(rotor_angle(state.core) - travel, TURN)
            out.position = wrap(travel / design.pole_pairs, design.period)
            out.velocity = state.out.speed / design.pole_pairs

    @staticmethod
    def deviation(
        observer: Any,
        out: Deviation,
        state: State,
        coefficients: Coefficients,
        design: Design,
        scale: float,
    ) -> None:
        """Set one standard deviation of mechanical position and speed, the latter times `scale`."""
        of_electrical = ElectricalDeviation()
        observer.electrical_deviation(of_electrical, state, coefficients, design)
        out.position = of_electrical.angle / design.pole_pairs
        out.velocity = scale * (of_electrical.speed / design.pole_pairs)

    @staticmethod
    def electrical(out: Electrical, state: State, design: Design) -> None:
        """Set the electrical estimate."""
        out.status, out.reasons = status_of(state, design), state.watch.reasons
        out.flux = flux_linkage(state.core.x, design.flux_low, design.flux_high)
        out.valid = 1.0 if out.status == TRACKING else 0.0
        out.angle = out.speed = math.nan
        if out.status != NOT_OBSERVABLE:
            out.angle, out.speed = rotor_angle(state.core), state.out.speed

    @staticmethod
    def electrical_deviation(
        out: ElectricalDeviation, state: State, coefficients: Coefficients, design: Design
    ) -> None:
        """Set one standard deviation of angle, speed and flux."""
        level, x = state.watch.level, state.core.x
        out.angle, out.speed, of_xi = deviations(
            design, coefficients.scheme, state.watch.power, level, x
        )
        if state.watch.reasons & BLIND != 0:
            # angle unknown: uniform over a turn; speed uniform within its bound
            bound = Pmsm.speed_bound(state, coefficients, design)
            out.angle = math.pi / math.sqrt(3.0)
            out.speed = bound * design.pole_pairs / math.sqrt(3.0)
        flux = flux_linkage(x, design.flux_low, design.flux_high)
        out.flux = of_xi * flux * flux

    @staticmethod
    def speed_bound(state: State, coefficients: Coefficients, design: Design) -> float:
        """Return the largest mechanical speed [rad/s] while not observable; inf: not known."""
        core, watch = state.core, state.watch
        if watch.reasons & BLIND != LOW_EMF:
            return math.inf
        least = least_emf(watch.power, core.i_alpha, core.i_beta, coefficients, design)
        flux = flux_linkage(core.x, design.flux_low, design.flux_high)
        return max(LEAVES * least, watch.level) / (flux * design.pole_pairs)

    @staticmethod
    def limits(design: Design, dt: float) -> str | None:
        """Return why the sample time is too long for the top speed; None: it is not."""
        top = design.speed_max * design.pole_pairs
        if top * dt <= math.pi:
            return None
        return (
            f'at {1.0 / dt:.0f} Hz the rotor turns more than half an electrical turn per '
            f'sample at speed_max = {design.speed_max:g} rad/s: sample at {top / math.pi:.0f} Hz '
            'at least'
        )

    @staticmethod
    def group_delay(design: Design, dt: float) -> float:
        """Return the delay of the speed at low frequency [s]."""
        if design.natural <= 0.0:
            return 0.0  # the flux estimate compensates the lag of the back-EMF (epsilon)
        return 2.0 * DAMPING / design.natural
