# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""`Design` from the gains, `Coefficients` from the sample time, and the layout of the state.

The state is a plain tuple, because a NamedTuple would cost a tenth of a step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from estimator_pkg.models.motor import check_motor
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.maths.tracking import natural_frequency
from estimator_pkg.observers.pmsm.gains import EMF_SPEED, NOISE_GUESS, Gains, flux_range, tuning
from estimator_pkg.observers.pmsm.noise import low_pass_weight, prepare_noise
from estimator_pkg.observers.pmsm.ripple import NARROW, RIPPLE_MEMORY
from estimator_pkg.observers.pmsm.scheme import exponential, prepare_scheme
from estimator_pkg.observers.pmsm.watch import emf_of_noise, prepare_watch

FAST = 1e-3  # s, averages of the back-EMF
SLOW = 5e-3  # s, averages of speeds; also how long the rotation is observed before locking on
NOISE_MEMORY = 0.03  # s, average of the innovation's power
DAMPING = 0.46  # of the low-pass on the speed: little delay for its noise and -3 dB frequency

# The state: (core, clock, registers, watch, out, clear, voltages, ripples), where
# core      : i, h, z, xi_hat, the last current, y
# clock     : integral of y since the tick, clock, length of this period, number of ticks
# registers : of the identifier
# watch     : see `watch`
# out       : speed output [rad/s], its slope [rad/s^2] and travelled angle [rad], electrical
# clear     : time [s] and rotation [rad] of y since it became large enough
# voltages  : the last reported voltages, newest last
# ripples   : see `ripple`
State = tuple[tuple, tuple, tuple, tuple, tuple, tuple, tuple, tuple]


class Design(NamedTuple):
    """Everything that follows from the gains alone; SI units, amplitude-invariant."""

    k_p: float
    k_i: float
    k_eta: float
    gamma: float
    resistance: float
    inductance: float
    epsilon: float
    clock_rate: float
    threshold: float  # of (26) [1/Wb]
    xi_low: float  # credible range of |xi| [1/Wb]
    xi_high: float
    flux_low: float
    flux_high: float
    emf_min: float
    drop: float  # back-EMF required per current, for the resistance error [ohm]
    xi_start: float  # 0: unknown
    pole_pairs: float
    hold: float
    natural: float  # natural frequency of the low-pass on the speed [rad/s]; 0: none
    noise_power: float  # of each current [A^2]; 0: to be estimated
    noise_guess: float
    period: float  # of the published position [rad]; 0: none
    second_period: float
    standing: float  # apparent lag of a voltage that is constant within a PWM period [s]
    dead_time: float  # phase voltage lost by dead time [V]
    dead: float  # minus the settling time of the back-EMF after a start [s]


class Coefficients(NamedTuple):
    """Everything that follows from the design and the sample time.

    dt : the sample time [s].
    scheme, noise : from `prepare_scheme`, and from `prepare_noise` at rest.
    watching : limits of `watch.look`.
    emf_of_noise : back-EMF required per standard deviation of the innovation [V/A].
    window : how long the rotation is observed before locking on [s].
    low_pass : transition of (speed output - speed, its slope) over one sample, row by row.
    pace : clock periods per sample.
    of_ripple : weight of the newest sample in the ripples.
    k_eta, gamma, standing, dead_time : copied from the design, so that a step unpacks one tuple.
    """

    dt: float
    scheme: tuple
    noise: tuple
    watching: tuple
    emf_of_noise: float
    window: float
    low_pass: tuple
    pace: float
    k_eta: float
    gamma: float
    standing: float
    dead_time: float
    of_ripple: float


def design_of(gains: Gains, circle: Circle) -> Design:
    """Return the design of these gains.

    Raises
    ------
    UsageError : motor data are missing, or the gains cannot work.
    """
    resistance, inductance, nominal, poles = check_motor(gains, 'pmsm')
    tuned = tuning(gains)
    low, high = flux_range(gains)
    start = nominal if gains.initial_flux is None else gains.initial_flux
    least = nominal * EMF_SPEED if gains.emf_min is None else gains.emf_min
    return Design(
        k_p=tuned.k_p,
        k_i=tuned.k_i,
        k_eta=tuned.k_eta,
        gamma=tuned.gamma,
        resistance=resistance,
        inductance=inductance,
        epsilon=tuned.epsilon,
        clock_rate=gains.clock_rate,
        threshold=4.0 * math.sqrt(tuned.gamma),
        xi_low=1.0 / high,
        xi_high=1.0 / low,
        flux_low=low,
        flux_high=high,
        emf_min=least,
        drop=2.0 * gains.resistance_error * resistance,
        xi_start=1.0 / start if start > 0.0 else 0.0,
        pole_pairs=poles,
        hold=gains.hold,
        natural=natural_frequency(gains.speed_filter_hz, DAMPING),
        noise_power=(gains.current_noise or 0.0) ** 2,
        noise_guess=(NOISE_GUESS * nominal / inductance) ** 2,
        period=0.0 if circle.unwrap else float(circle.period),
        second_period=gains.second_period,
        standing=resistance / (12.0 * inductance * gains.pwm_frequency**2)
        if gains.pwm_frequency
        else 0.0,
        dead_time=gains.dead_time_voltage,
        dead=-10.0 * tuned.epsilon,
    )


def prepare_coefficients(design: Design, dt: float, when_blind: int) -> Coefficients:
    """Return the coefficients for a sample time of `dt` [s]; `when_blind`: see `prepare_watch`."""
    scheme = prepare_scheme(design.resistance, design.inductance, design.k_p, design.k_i, dt)
    noise = prepare_noise(design.inductance, design.k_p, design.k_i, scheme, 0.0)
    fast = max(FAST, 5.0 * design.epsilon)
    slow = max(SLOW, 5.0 * fast)
    weights = (
        low_pass_weight(1.0 / fast, dt),
        low_pass_weight(1.0 / slow, dt),
        low_pass_weight(1.0 / NOISE_MEMORY, dt),
    )
    of_h, of_innovation, of_integral = noise
    watching = prepare_watch(
        weights,
        noise,
        slow,
        dt,
        design.noise_power * of_innovation,
        design.emf_min,
        design.drop,
        design.xi_low,
        design.xi_high,
        when_blind,
    )
    natural = design.natural
    low_pass = exponential(0.0, 1.0, -natural * natural, -2.0 * DAMPING * natural, dt)
    return Coefficients(
        dt,
        scheme,
        noise,
        watching,
        emf_of_noise(noise),
        slow,
        low_pass,
        design.clock_rate * dt,
        design.k_eta,
        design.gamma,
        design.standing,
        design.dead_time,
        low_pass_weight(min(1.0 / RIPPLE_MEMORY, natural / NARROW), dt),
    )
