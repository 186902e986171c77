# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Residuals of the sensorless observer, and the reasons why an estimate is not valid.

All residuals are computed from internal signals. They cannot detect an error of the inductance, a
delay of the voltage or a constant bias of the angle; docs/papers/pmsm.md has the size of these.
"""

from __future__ import annotations

import math

from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.observers.pmsm.state import Coefficients, Core, Design, Watch

# Reasons, as bits. An estimate is valid once no reason has been present for the hold time.
LOW_EMF = 1  # back-EMF too small compared with noise, resistance drop or emf_min
MISALIGNED = 2  # the back-EMF does not have the direction that the frame requires
INCONSISTENT = 4  # the estimated speed is not the speed at which the back-EMF turns
FLUX_RANGE = 8  # the flux linkage is outside its credible range
FRAME_RESET = 16  # the frame or the flux was reset at this sample
SEARCHING = 32  # after a start or a gap, or the rotor has just become observable
NO_VOLTAGE = 64  # all voltages are exactly zero: not connected
ALIASING = 128  # the rotor turns about half a turn per sample, or more
CURRENTS_STUCK = 256  # the current repeats exactly while the back-EMF turns
BLIND = LOW_EMF | NO_VOLTAGE | ALIASING | CURRENTS_STUCK

REASON_TEXTS = {
    NO_VOLTAGE: 'all voltages are zero: is the voltage connected?',
    CURRENTS_STUCK: 'the currents do not change while the rotor turns: '
    'is the current still measured?',
    ALIASING: 'the rotor turns about half an electrical turn per sample or more: '
    'use a higher sample rate, or check the units of current, voltage and motor data '
    '(the estimate is valid again after standstill or ~/reset)',
    LOW_EMF: 'back-EMF too small (slow or at rest; if it turns, check motor data and units): '
    'only a bound of the speed is known',
    FLUX_RANGE: 'flux linkage outside its range (wrong flux, resistance, inductance or voltage?)',
    MISALIGNED: 'the direction of the back-EMF contradicts the estimated angle (wrong flux, '
    'inductance or voltage?)',
    INCONSISTENT: 'the estimated speed is not the speed at which the back-EMF turns (wrong flux?)',
    SEARCHING: 'finding the rotor',
    FRAME_RESET: 'frame or flux was reset',
}

ALIGNED = math.tan(math.radians(8.0))  # largest angle between frame and back-EMF
CONSISTENT = 0.05  # largest relative disagreement of the two speeds
LEAST_DISAGREEMENT = 0.05  # added to it, of the speed at the smallest back-EMF
NOISE_SIGMAS = 0.9  # noise allowed in the disagreement, over that in the required back-EMF
LEAST_DIVISOR = 1e-300  # keeps a quotient finite
LEAST_EMF = 5.0  # standard deviations of h that the back-EMF must exceed
LEAVES = 2.0  # hysteresis: factor on the required back-EMF to leave LOW_EMF
HALF_TURN = 0.85  # of half a turn per sample: faster is too near to aliasing
RUN_AWAY = 4.0  # xi_hat has diverged beyond this multiple of its upper limit
UNCONNECTED = 0.010  # s of exactly zero voltage, or of exactly equal currents
STUCK_TURN = 2.0 * math.pi  # the rotor has turned this far during equal currents [rad]
CLIP = 16.0  # a squared innovation is clamped to this multiple of the variance


def begin_watch(watch: Watch, power: float) -> None:
    """Set the watch before the first step; `power`: initial innovation variance [A^2]."""
    watch.level = watch.mean_h1 = watch.mean_h2 = watch.rate = watch.slip = 0.0
    watch.power = power
    watch.idle = watch.calm = 0.0
    watch.reasons = SEARCHING | LOW_EMF


def least_emf(
    power: float, i_alpha: float, i_beta: float, coefficients: Coefficients, design: Design
) -> float:
    """Return the back-EMF [V] above which the rotor is observable.

    Parameters
    ----------
    power : innovation variance [A^2].
    i_alpha, i_beta : measured current [A].
    """
    least = coefficients.emf_of_noise * math.sqrt(power)
    if least < design.emf_min:
        least = design.emf_min
    drop = design.drop * abs(complex(i_alpha, i_beta))
    return drop if drop > least else least


def follow_averages(
    watch: Watch,
    coefficients: Coefficients,
    core: Core,
    size: float,
    speed: float,
    turning: float,
    square: float,
) -> None:
    """Take one more sample into the averages; parameters as in `look`."""
    fast, slow = coefficients.fast, coefficients.slow
    watch.level += fast * (size - watch.level)
    watch.mean_h1 += fast * (core.h1 - watch.mean_h1)
    watch.mean_h2 += fast * (core.h2 - watch.mean_h2)
    watch.rate += (fast if watch.reasons & SEARCHING != 0 else slow) * (turning - watch.rate)
    watch.slip += slow * (speed - turning - watch.slip)
    if coefficients.known_power > 0.0:
        watch.power = coefficients.known_power
    else:
        if square > CLIP * watch.power:
            square = CLIP * watch.power
        watch.power += coefficients.memory * (square - watch.power)


def look(
    watch: Watch,
    coefficients: Coefficients,
    design: Design,
    core: Core,
    acting: DriveSample,
    event: int,
    size: float,
    speed: float,
    turning: float,
    square: float,
) -> None:
    """Take one more sample.

    Parameters
    ----------
    core : with the current of the sample before. acting : the sample.
    event : reasons from the step itself (FRAME_RESET, SEARCHING).
    size, speed : |h| [V] and omega_hat = |h| x [rad/s].
    turning : speed at which y turned during the sample [rad/s].
    square : power of the innovation, of each component [A^2].
    """
    follow_averages(watch, coefficients, core, size, speed, turning, square)
    before, blind = watch.reasons, SEARCHING if design.robust else 0
    i_alpha, i_beta, x = acting.i_alpha, acting.i_beta, abs(core.x)
    silent = acting.u_alpha == 0.0 and acting.u_beta == 0.0
    # currents of exactly zero may be right: a converter without load
    loaded = i_alpha != 0.0 or i_beta != 0.0
    repeated = loaded and i_alpha == core.i_alpha and i_beta == core.i_beta
    watch.idle = watch.idle + coefficients.dt if silent or repeated else 0.0
    least = least_emf(watch.power, i_alpha, i_beta, coefficients, design)
    reasons = event
    if watch.level < (least * LEAVES if before & LOW_EMF != 0 else least):
        reasons |= LOW_EMF | blind
    if watch.idle > UNCONNECTED:
        if silent:
            reasons |= NO_VOLTAGE | blind
        elif abs(watch.rate) * watch.idle > STUCK_TURN:
            reasons |= CURRENTS_STUCK | blind
    fastest = coefficients.fastest
    if before & ALIASING != 0 and watch.level > design.emf_min:
        # beyond half a turn per sample the samples are also those of a slower rotor that turns
        # backwards: only at rest is it certain that the speed is low again
        reasons |= ALIASING
    elif not -fastest < watch.rate < fastest:
        reasons |= ALIASING
    elif not -fastest < speed < fastest:
        reasons |= INCONSISTENT
    if not abs(watch.mean_h1) <= -ALIGNED * watch.mean_h2:
        reasons |= MISALIGNED
    if not design.xi_low <= x <= design.xi_high:
        reasons |= FLUX_RANGE
        if x > RUN_AWAY * design.xi_high:
            reasons |= blind
    allowed = CONSISTENT * abs(speed) + LEAST_DISAGREEMENT * design.emf_min * x
    allowed += NOISE_SIGMAS / coefficients.window * least / (watch.level + LEAST_DIVISOR)
    if not -allowed < watch.slip < allowed:
        reasons |= INCONSISTENT
    watch.calm = watch.calm + coefficients.dt if reasons == 0 else 0.0
    watch.reasons = reasons


def describe(reasons: int) -> str:
    """Return the most telling reason in words; '' if there is none."""
    return next((text for bit, text in REASON_TEXTS.items() if reasons & bit), '')
