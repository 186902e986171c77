# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records of the observer `adaptive`.

n is the order of the plant, m the number of free parameters. Lists are as long as these numbers of
the user make them, so the observer runs as plain Python.
"""

from __future__ import annotations

from estimator_pkg.record import record
from estimator_pkg.sensor.convention import Convention
from estimator_pkg.sensor.scatter import Scatter


@record
class Design:
    """Everything that follows from the gains alone; companion matrices by their first column."""

    order: int  # n
    is_paper: bool  # forward Euler
    is_gradient: bool  # the law
    full: bool  # velocity with b1 u
    load: bool  # there is a constant load
    gravity: bool  # there is a sine of the angle
    gated: bool  # adapt only with excitation
    noise_gate: bool  # compare it with the noise
    watched: bool  # knocks are watched for
    bounded: bool  # a free parameter has a bound
    names: int  # number of all parameters
    free: list[int]  # indices of the free parameters in theta
    known: list[int]  # and of the others
    a_k: list[float]  # of A_c - K C
    fastest: float  # upper bound of its poles' magnitudes [1/s]
    a_c: list[float]  # of A_c
    k: list[float]  # K, the injection
    fixed: list[float]  # the known parameters in theta
    start: list[float]  # initial values of the free parameters
    low: list[float]  # bounds of the free parameters
    high: list[float]
    gamma: list[list[float]]  # Gamma of the free parameters
    floor: list[list[float]]  # the matrix that the information must exceed to open the gate
    w: list[list[float]]  # `gramian` of A_c - K C
    settle: float  # settling time of the filters [s]
    average: float  # time over which the innovation's power is averaged [s]
    young: float  # age until which theta still converges [s]
    memory: float  # of least squares [s]
    keep: float  # memory of the information matrix [s]
    pace: float  # geometric mean of the poles [1/s]
    slowest: float  # slowest pole [1/s]
    knock: float  # square of e at a knock, relative to the usual square
    moving_above: float  # speed below which the joint may stick by dry friction [rad/s]
    adapt: bool  # theta may change
    has_theta: bool  # theta is a parameter that the user has set
    period: float  # wrap period [rad]; 0: none
    unwrap: bool
    noise: float  # variance of the measurement noise [rad^2]; 0: estimated
    finest: float  # its smallest value, from the encoder's quantum [rad^2]
    variance: list[float]  # diagonal of the initial P of least squares


@record
class Coefficients:
    """Everything that follows from the sample time h."""

    f: list[list[float]]  # exp((A_c - K C) h)
    columns: list[list[float]]  # its columns
    g0: list[float]  # first row of its integral, for a constant input ...
    g1: list[float]  # ... and for a ramp
    h: float  # sample time [s]
    weight: float  # of the newest sample in averages
    slow_weight: float  # of the newest check in averages
    keep: float  # part of the information matrix that is kept over a sample
    forget: float  # part of the information that least squares keeps over a sample
    low_pass: float  # weight of the newest sample in the low-passed innovation


@record
class LearningSums:
    """What `evidence` needs, summed over the samples that the observer learnt from."""

    matrix: list[list[float]]  # psi psi', its lower triangle
    vector: list[float]  # psi target
    count: float  # samples
    of_e: float  # slow_e^2
    of_bend: float  # slow_bend^2


@record
class State:
    """Filters, parameters, and what the innovation shows of them."""

    of_y: list[float]  # first row of the filtered regressor for y, ...
    of_u: list[float]  # ... the input, ...
    of_one: list[float]  # ... a constant ...
    of_sine: list[float]  # ... and sin y
    z: list[float]  # sampled: the decaying effect of the initial state on x; paper: x
    theta: list[float]  # the free parameters
    plant: list[float]  # all of theta as the estimate uses it: L, B, load, gravity
    information: list[list[float]]  # the information matrix
    p: list[list[float]]  # P of least squares
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
