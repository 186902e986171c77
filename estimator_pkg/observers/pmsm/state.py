# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records of the sensorless observer.

A two-vector is a pair of numbers: 1 and 2 in the estimated frame, alpha and beta in that of the
stator. All are amplitude-invariant.
"""

from __future__ import annotations

from typing import Annotated

from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.record import record

PERIODS = 16  # clock periods that the identifier fits, at most
TICKS = PERIODS + 1
VOLTAGES_KEPT = 9  # voltages that are kept, at most


@record
class Design:
    """What the gains imply whatever the sample time is."""

    robust: bool  # else the paper's form
    resets: bool  # (16), else (5)
    identifies: bool  # (25), (26)
    periods: int  # N in (23)
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
    speed_max: float  # [rad/s]; 0: not known
    natural: float  # natural frequency of the low-pass on the speed [rad/s]; 0: none
    noise_power: float  # of each current [A^2]; 0: to be estimated
    noise_guess: float
    period: float  # of the published position [rad]; 0: none
    dead: float  # minus the settling time of the back-EMF after a start [s]
    scale: float  # of a sample
    corrects: bool  # the voltage is not taken as reported:
    late: int  # its delay, in whole samples
    part: float  # and the rest
    kept: int  # samples that this needs
    dead_time: float  # phase voltage lost by dead time [V]


@record
class Scheme:
    """One sample of scheme X, see `scheme`: E, and weights for the current and the back-EMF."""

    dt: float  # [s]
    e11: float
    e12: float
    e21: float
    e22: float
    iu: float  # of the voltage
    ia: float  # of the current at the start
    iw: float  # of -j w times it
    idd: float  # of the current's change
    idw: float  # of -j w times that
    hu: float
    ha: float
    hw: float
    hdd: float
    hdw: float


@record
class Coefficients:
    """What follows from the sample time."""

    dt: float  # [s]
    scheme: Scheme
    pace: float  # clock periods per sample
    fast: float  # weight of the newest sample in averages of the back-EMF
    slow: float  # in averages of speeds
    memory: float  # in the innovation's power
    window: float  # how long the rotation is observed before locking on [s]
    known_power: float  # innovation variance [A^2] if the noise is a parameter; 0: it is estimated
    emf_of_noise: float  # back-EMF required per standard deviation of the innovation [V/A]
    fastest: float  # speed that is too near to half a turn per sample [rad/s]
    # transition of (speed output - speed, its slope) over one sample; f21 = 0: no low-pass
    f11: float
    f12: float
    f21: float
    f22: float


@record
class Core:
    """The observer (16), with the newest current and back-EMF."""

    i1: float  # current [A]
    i2: float
    h1: float  # back-EMF [V]
    h2: float
    z1: float  # the frame, a unit number
    z2: float
    x: float  # xi_hat [1/Wb]
    i_alpha: float  # measured current [A]
    i_beta: float
    y_alpha: float  # back-EMF in the stator frame [V]
    y_beta: float


@record
class Ticks:
    """The clock (7)."""

    rho: float  # the clock
    span: float  # where this period ends
    count: int  # of ticks
    area_alpha: float  # integral of y since the tick [V s]
    area_beta: float


@record
class Registers:
    """Those of the identifier (25), the newest last: Y, Z and Phi."""

    y_alpha: Annotated[list[float], TICKS]
    y_beta: Annotated[list[float], TICKS]
    size: Annotated[list[float], TICKS]
    phi_alpha: Annotated[list[float], PERIODS]
    phi_beta: Annotated[list[float], PERIODS]


@record
class Watch:
    """The residuals."""

    level: float  # of |h| [V]
    mean_h1: float  # h averaged [V]
    mean_h2: float
    rate: float  # mean speed at which y turns [rad/s]
    slip: float  # mean disagreement of the two speeds [rad/s]
    power: float  # innovation variance [A^2]
    idle: float  # time of zero voltage or equal currents [s]
    calm: float  # time in order [s]
    reasons: int  # bits of `watch.REASON_TEXTS`


@record
class Out:
    """The outputs, electrical."""

    speed: float  # [rad/s]
    slope: float  # of the speed [rad/s^2]
    travel: float  # travelled angle [rad]


@record
class Rotation:
    """How long and how far y turned since it became large enough."""

    time: float  # [s]
    angle: float  # [rad]


@record
class State:
    """All of it."""

    core: Core
    ticks: Ticks
    registers: Registers
    watch: Watch
    out: Out
    rotation: Rotation
    acting: DriveSample  # the newest sample, with the voltage that acted
    u_alpha: Annotated[
        list[float], VOLTAGES_KEPT
    ]  # the last reported voltages, the newest last [V]
    u_beta: Annotated[list[float], VOLTAGES_KEPT]
