# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Residuals of the sensorless observer, and the reasons why an estimate is not valid.

All residuals are computed from internal signals. They cannot detect an error of the inductance, a
delay of the voltage or a constant bias of the angle; docs/papers/pmsm.md has the size of these.
"""

from __future__ import annotations

import math

# Reasons, as bits. An estimate is valid once no reason has been present for the hold time.
LOW_EMF = 1  # back-EMF too small compared with noise, resistance drop or emf_min
MISALIGNED = 2  # the back-EMF does not have the direction that the frame requires
INCONSISTENT = 4  # the estimated speed is not the speed at which the back-EMF turns
FLUX_RANGE = 8  # the flux linkage is outside its credible range
RESET = 16  # the frame or the flux was reset at this sample
SEARCHING = 32  # after a start or a gap, or the rotor has just become observable
NO_VOLTAGE = 64  # all voltages are exactly zero: not connected
TOO_FAST = 128  # the rotor turns about half a turn per sample, or more
STUCK = 256  # the current repeats exactly while the back-EMF turns
BLIND = LOW_EMF | NO_VOLTAGE | TOO_FAST | STUCK

REASONS = {
    NO_VOLTAGE: 'all voltages are zero: is the voltage connected?',
    STUCK: 'the currents do not change while the rotor turns: is the current still measured?',
    TOO_FAST: 'the rotor turns about half an electrical turn per sample or more: '
    'use a higher sample rate, or check the units of current, voltage and motor data '
    '(the estimate is valid again after standstill or ~/reset)',
    LOW_EMF: 'back-EMF too small (slow or at rest; if it turns, check motor data and units): '
    'only a bound of the speed is known',
    FLUX_RANGE: 'flux linkage outside its range (wrong flux, resistance, inductance or voltage?)',
    MISALIGNED: 'the direction of the back-EMF contradicts the estimated angle (wrong flux, '
    'inductance or voltage?)',
    INCONSISTENT: 'the estimated speed is not the speed at which the back-EMF turns (wrong flux?)',
    SEARCHING: 'finding the rotor',
    RESET: 'frame or flux was reset',
}

ALIGNED = math.tan(math.radians(8.0))  # largest angle between frame and back-EMF
CONSISTENT = 0.05  # largest relative disagreement of the two speeds
LEAST_DISAGREEMENT = 0.05  # added to it, of the speed at the smallest back-EMF
SIGMAS = 0.9  # noise allowed in the disagreement, relative to the noise in the required back-EMF
TINY = 1e-300  # keeps a quotient finite
LEAST_EMF = 5.0  # standard deviations of h that the back-EMF must exceed
LEAVES = 2.0  # hysteresis: factor on the required back-EMF to leave LOW_EMF
HALF_TURN = 0.85  # of half a turn per sample: faster is too near to aliasing
RUN_AWAY = 4.0  # xi_hat has diverged beyond this multiple of its upper limit
UNCONNECTED = 0.010  # s of exactly zero voltage, or of exactly equal currents
TURN = 2.0 * math.pi  # the rotor has turned this far during equal currents [rad]
CLIP = 16.0  # a squared innovation is clamped to this multiple of the variance

# (level of |h| [V], h averaged [V], mean speed at which y turns [rad/s], mean disagreement [rad/s],
#  variance of the innovation [A^2], time of zero voltage or equal currents [s], time in order [s],
#  reasons)
Watch = tuple[float, complex, float, float, float, float, float, int]


def begin_watch(power: float) -> Watch:
    """Return the watch before the first step; `power`: initial innovation variance [A^2]."""
    return (0.0, complex(0.0, 0.0), 0.0, 0.0, power, 0.0, 0.0, SEARCHING | LOW_EMF)


def least_emf(
    power: float, current: complex, of_noise: float, emf_min: float, drop: float
) -> float:
    """Return the back-EMF [V] above which the rotor is observable.

    Parameters
    ----------
    power : innovation variance [A^2].
    current : measured current [A].
    of_noise : back-EMF required per standard deviation of the innovation [V/A].
    emf_min : smallest usable back-EMF [V].
    drop : back-EMF required per current, for the resistance error [ohm].
    """
    least = of_noise * math.sqrt(power)
    if least < emf_min:
        least = emf_min
    drop *= abs(current)
    return drop if drop > least else least


def emf_of_noise(noise: tuple[float, float, float]) -> float:
    """Return the back-EMF required per standard deviation of the innovation [V/A].

    Parameters
    ----------
    noise : from `prepare_noise`.
    """
    of_h, of_innovation, of_integral = noise
    return LEAST_EMF * math.sqrt(of_h / of_innovation)


def prepare_watch(
    weights: tuple[float, float, float],
    noise: tuple,
    window: float,
    dt: float,
    known_power: float,
    emf_min: float,
    drop: float,
    xi_low: float,
    xi_high: float,
    when_blind: int,
) -> tuple:
    """Return the limits of `look`.

    Parameters
    ----------
    weights : of the newest sample in the averages of h, of speeds, of the innovation's power.
    noise : from `prepare_noise`.
    window : time constant of the average of speeds [s].
    dt : sample time [s].
    known_power : innovation variance [A^2] if the noise is a parameter; 0: it is estimated.
    emf_min, drop : as in `least_emf`.
    xi_low, xi_high : credible range of |xi| [1/Wb].
    when_blind : reason added while the rotor is not observable, or if xi_hat has diverged.
    """
    return (
        *weights,
        dt,
        known_power,
        emf_of_noise(noise),
        emf_min,
        drop,
        xi_low,
        xi_high,
        HALF_TURN * math.pi / dt,
        LEAST_DISAGREEMENT * emf_min,
        SIGMAS / window,
        when_blind,
    )


def look(
    watch: Watch,
    event: int,
    h: complex,
    speed: float,
    turning: float,
    innovation: complex,
    before_current: complex,
    current: complex,
    voltage: complex,
    x: float,
    limits: tuple,
) -> Watch:
    """Return the watch after one more sample.

    Parameters
    ----------
    event : reasons from the step itself (RESET, SEARCHING).
    h : estimated back-EMF [V].
    speed, turning : |h| x, and the speed at which y turned during the sample [rad/s].
    innovation : measured minus estimated current, in any frame [A].
    before_current : of the sample before [A].
    current, voltage : of the sample [A], [V].
    x : xi_hat [1/Wb].
    limits : from `prepare_watch`.
    """
    level, mean_h, rate, slip, power, idle, calm, before = watch
    (
        fast,
        slow,
        memory,
        dt,
        known_power,
        of_noise,
        emf_min,
        drop,
        xi_low,
        xi_high,
        fastest,
        floor,
        sigmas,
        when_blind,
    ) = limits
    level += fast * (abs(h) - level)
    mean_h += fast * (h - mean_h)
    rate += (fast if before & SEARCHING else slow) * (turning - rate)
    slip += slow * (speed - turning - slip)
    if known_power > 0.0:
        power = known_power
    else:
        real, imag = innovation.real, innovation.imag
        square = 0.5 * (real * real + imag * imag)
        if square > CLIP * power:
            square = CLIP * power
        power += memory * (square - power)
    # currents of exactly zero may be right: a converter without load
    repeated = current == before_current and current != 0.0
    idle = idle + dt if voltage == 0.0 or repeated else 0.0
    least = of_noise * math.sqrt(power)  # as `least_emf`, without the call
    if least < emf_min:
        least = emf_min
    drop *= abs(current)
    if drop > least:
        least = drop
    reasons = event
    if level < (least * LEAVES if before & LOW_EMF else least):
        reasons |= LOW_EMF | when_blind
    if idle > UNCONNECTED:
        if voltage == 0.0:
            reasons |= NO_VOLTAGE | when_blind
        elif abs(rate) * idle > TURN:
            reasons |= STUCK | when_blind
    if before & TOO_FAST and level > emf_min:
        # beyond half a turn per sample the samples are also those of a slower rotor that turns
        # backwards: only at rest is it certain that the speed is low again
        reasons |= TOO_FAST
    elif not -fastest < rate < fastest:
        reasons |= TOO_FAST
    elif not -fastest < speed < fastest:
        reasons |= INCONSISTENT
    if not abs(mean_h.real) <= -ALIGNED * mean_h.imag:
        reasons |= MISALIGNED
    size = abs(x)
    if not xi_low <= size <= xi_high:
        reasons |= FLUX_RANGE
        if size > RUN_AWAY * xi_high:
            reasons |= when_blind
    allowed = CONSISTENT * abs(speed) + floor * size + sigmas * least / (level + TINY)
    if not -allowed < slip < allowed:
        reasons |= INCONSISTENT
    return (level, mean_h, rate, slip, power, idle, calm + dt if reasons == 0 else 0.0, reasons)


def describe(reasons: int) -> str:
    """Return the most telling reason in words; '' if there is none."""
    return next((text for bit, text in REASONS.items() if reasons & bit), '')
