# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records of the hybrid observer."""

from __future__ import annotations

from estimator_pkg.observers.angle.shared import SharedDesign
from estimator_pkg.record import record


@record
class Design:
    """What the gains imply whatever the sample time is."""

    shared: SharedDesign
    order: int
    paper: bool  # Algorithm 1; else the robust form
    injection: int  # which, see `injections`
    saturation: float  # M [rad]
    margin: float  # delta_pi [rad]
    # the poles of the robust form: single, decay +- sqrt(discriminant), see `tracking.matched`
    triple: bool  # all three poles are one
    single: float  # the pole next to the pair [1/s]; order 2: 0
    decay: float  # of the pair [1/s]
    discriminant: float  # of the pair [1/s^2]
    reset_from: float  # errors from here on are reset (J2) instead of injected [rad]
    doubtful: float  # innovations beyond it are [rad], see `robust`
    fastest: float  # speed limit [rad/s]
    # Algorithm 1: L = (k1/eps, k2/eps^2), section III
    l1: float  # [1/s]
    l2: float  # [1/s^2]
    epsilon: float  # [s]
    bandwidth_hz: float
    ratio: float  # largest stable T/epsilon


@record
class Coefficients:
    """What follows from the sample time."""

    dt: float  # [s]
    alpha: float
    beta: float  # over dt [1/s]
    gamma: float  # over dt^2 [1/s^2]
    z: float  # of the single or triple pole
    pace: float  # of the slowest pole of Algorithm 1 [1/s]


@record
class Core:
    """The observer itself."""

    position: float  # [rad]
    velocity: float  # [rad/s]
    acceleration: float  # [rad/s^2]; order 2: nan
    last: float  # last measurement [rad]
    error: float  # that the last correction left [rad]
    # 0 in steady state, the number of samples so far in a start, and less the number of samples
    # held while astray
    phase: float
