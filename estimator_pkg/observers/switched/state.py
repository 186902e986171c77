# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records of the observer `switched`.

Lists and arrays are as long as the user's model makes them, so the observer runs as plain Python.
Lists with an entry per output come first: `zh[i][j]` is stage j of output i.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.record import record
from estimator_pkg.sensor.convention import Convention
from estimator_pkg.sensor.scatter import Scatter

Array = NDArray[np.float64]

LARGEST_DERIVATIVE = 1e15  # largest derivative or parameter, in its own unit


@record
class Stage:
    """The gains of a stage of super-twisting."""

    gain: float  # lambda
    alpha: float


@record
class Design:
    """Everything that follows from gains and model."""

    filtered: bool  # the extended observers give the published velocity
    regression: bool  # least squares estimates Z; else the last intervals give it
    resets_ends: bool  # (13) resets the last derivatives of the chains too at an event
    stages: list[list[Stage]]
    orders: list[Array]  # those of the model, whole numbers; zeros if it has none
    poles: list[float]  # of the extended observers, magnitude [1/s]
    bounds: list[float]  # of the second derivative of each output
    gate: float  # epsilon in (23)
    steps: int  # N in (28)
    singular_value: float  # smallest one with which the inversion is used
    settle: float  # tau_c in (26) [s]
    locked: float  # settling time of the stages after a start [s]
    faded: float  # time until a start has no influence on the extended observers [s]
    memory: float  # of least squares [s]; 0: it forgets nothing
    vague: Array  # diagonal of P for an unknown Z, shape (m,)
    period: float  # wrap period of every output [rad]; 0: none
    unwrap: bool
    noise: float  # variance of the measurement noise; 0: estimated
    floor: float  # its smallest value, from the encoder's quantum


@record
class RegressionFilter:
    """A regression filter of order k at a sample time."""

    F: Array  # transition, shape (k, k)
    responses: Array  # first rows of those to a constant and to a ramp, shape (2, k)
    column: Array  # the first one of its matrix, shape (k,)


@record
class Correction:
    """An extended observer at a sample time, shape (k + 1,)."""

    gains: Array
    step: Array  # transition of the chain, shape (k + 1, k + 1)
    noise: list[float]  # variances of position, velocity and innovation at unit noise


@record
class Coefficients:
    """Everything that follows from the sample time."""

    dt: float  # [s]
    filters: list[RegressionFilter]
    corrections: list[Correction]
    keep: float  # part of the information that least squares keeps over a sample


@record
class Interval:
    """What an interval has shown: Y = Lambda Z, and Z+ = A_d Z + beta_d at its end."""

    lam: Array
    y: Array
    a: Array
    beta: Array
    settled: bool  # the stages had settled


@record
class Signals:
    """The filtered signals of an output whose chain has length k."""

    rows: Array  # the output, Gamma, and the columns of Lambda, shape (m + 2, k)
    carried: Array  # the old content of Lambda's rows times the old Z, shape (k,)


@record
class State:
    """Chains, Z, and what least squares has learnt.

    zt are the derivatives, from the first to the one that ends the chain.
    """

    zh: list[list[float]]  # the estimates of the stages
    zt: list[list[float]]  # their auxiliary states
    errors: list[list[float]]  # their last errors
    y: list[float]  # newest outputs, unwrapped
    u: list[float]  # newest input
    z: Array  # Z from least squares
    predicted: Array  # Z predicted at the last event
    y_at: list[float]  # outputs at the last event
    history: list[Interval]  # the last intervals
    dt: float  # the last interval between samples [s]
    observed: list[Array]  # extended observers: the chain, then the disturbance w
    used: Array  # the Z that they used last
    powers: list[float]  # noise variance that their innovations correspond to
    noises: list[list[float]]  # variances as in `Correction`
    age: float  # since the last event, or gap [s]
    total: float  # since the start [s]
    forgetting: float  # time until the filters have forgotten an unknown Z or start [s]
    fitted: bool  # the last inversion could be used
    signals: list[Signals]
    last_columns: Array  # Gamma and Lambda's columns at the newest sample, shape (outputs, m + 1)
    origin: Array  # columns at the last event: derivatives are relative to them
    p: Array  # of least squares, shape (m, m)
    power: float  # mean square of its residual
    conventions: list[Convention]
    scatters: list[Scatter]


@record
class OutputEstimates:
    """The newest estimate of all outputs."""

    position: list[float]  # [rad or m], in the convention of the measurement
    velocity: list[float]  # [rad/s or m/s]
    acceleration: list[float]  # [rad/s^2 or m/s^2]; nan: the chain ends before
    status: int


@record
class OutputDeviations:
    """One standard deviation of each output."""

    position: list[float]
    velocity: list[float]


def is_sound(state: State) -> bool:
    """Return False if an estimate is NaN or beyond `LARGEST_DERIVATIVE`: the state has diverged."""
    every: list[Array] = [state.z, *map(np.array, state.zh + state.zt), *state.observed]
    return bool((np.abs(np.concatenate(every)) < LARGEST_DERIVATIVE).all())
