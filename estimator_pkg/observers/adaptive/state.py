# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records of the observer `adaptive`.

n is the order of the plant, p the number of parameters theta, m that of the free ones. Arrays are
as large as these numbers of the user make them, so the observer runs as plain Python.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.record import record
from estimator_pkg.sensor.convention import Convention
from estimator_pkg.sensor.scatter import Scatter

Array = NDArray[np.float64]


@record
class Design:
    """Everything that follows from the gains alone."""

    order: int  # n
    is_paper: bool  # forward Euler
    is_gradient: bool  # the law
    full: bool  # velocity with b1 u
    load: bool  # there is a constant load
    gravity: bool  # there is a sine of the angle
    gated: bool  # adapt only with excitation
    observer: list[float]  # first column of A_c - K C, shape (n,)
    model: list[float]  # first column of A_c, shape (n,)
    free: list[int]  # indices of the free parameters in theta
    fixed: Array  # theta with zeros for the free parameters, shape (p,)
    injection: Array  # K, then zeros, shape (p,)
    start: Array  # initial values of the free parameters, shape (m,)
    low: Array  # bounds of all parameters, shape (p,)
    high: Array
    gamma: Array  # Gamma of the free parameters, shape (m, m)
    variance: Array  # diagonal of the initial P of least squares, shape (m,)
    slowest: float  # slowest pole of A_c - K C [1/s]
    fastest: float  # fastest pole
    pace: float  # their geometric mean
    a_k: Array  # A_c - K C, shape (n, n)
    units: Array  # Phi's rows, one after another, for y, u, 1 and sin y of 1, shape (4, n p)
    w: Array  # `gramian` of A_c - K C, for the noise of filter outputs, shape (n, n)
    noise_floor: Array  # information by noise of unit variance, per sample time, shape (m, m)
    settle: float  # settling time of the filters [s]
    average: float  # time over which the innovation's power is averaged [s]
    memory: float  # of least squares [s]
    knock: float  # square of e at a knock, relative to the usual square; 0: none is watched for
    moving_above: float  # speed below which the joint may stick by dry friction [rad/s]
    adapt: bool  # theta may change
    has_theta: bool  # theta is a parameter that the user has set
    period: float  # wrap period [rad]; 0: none
    unwrap: bool
    noise: float  # variance of the measurement noise [rad^2]; 0: estimated
    finest: float  # its smallest value, from the encoder's quantum [rad^2]


@record
class Coefficients:
    """Everything that follows from the sample time h."""

    F: Array  # exp((A_c - K C) h), shape (n, n)
    G0: Array  # its integral, for a constant input ...
    G1: Array  # ... and for a ramp
    h: float  # sample time [s]
    weight: float  # of the newest sample in averages
    slow_weight: float  # of the newest check in averages
    keep: float  # part of the information matrix that is kept over a sample
    forget: float  # part of the information that least squares keeps over a sample
    low_pass: float  # weight of the newest sample in the low-passed innovation


@record
class LearningSums:
    """What `evidence` needs, summed over the samples that the observer learnt from."""

    matrix: Array  # psi psi', shape (m, m)
    vector: Array  # psi target, shape (m,)
    count: float  # samples
    of_e: float  # slow_e^2
    of_bend: float  # slow_bend^2


@record
class State:
    """Filters, parameters, and what the innovation shows of them."""

    upsilon: Array  # the filtered regressor, shape (n, p)
    z: Array  # sampled: the decaying effect of the initial state on x; paper: x, shape (n,)
    theta: Array  # the free parameters, shape (m,)
    plant: Array  # all of theta as the estimate uses it: L, B, load, gravity, shape (p,)
    information: Array  # the information matrix, shape (m, m)
    p: Array  # P of least squares, shape (m, m)
    convention: Convention
    scatter: Scatter
    y: float  # [rad]
    age: float  # time since the start [s]
    power: float  # mean square of the innovation [rad^2]
    speed_power: float  # mean square of the velocity [rad^2/s^2]
    adapted: float  # time spent adapting [s]
    paused: float  # remaining pause of the adaptation [s]
    usual: float  # usual square of the innovation while adapting [rad^2]
    slow_e: float  # innovation after the low-pass [rad]
    slow_bend: float  # acceleration after it
    slow_power: float  # mean square of slow_e [rad^2]
    phase: int  # see `law`
    trusted: bool  # the innovation is no larger than noise explains, or small
    tick: int  # samples since the last check
    sums: LearningSums
