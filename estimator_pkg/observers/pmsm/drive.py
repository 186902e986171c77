# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The records of drive observers: a sample, and what only a drive has as estimates.

Besides what the contract asks for, the module of an observer of kind 'drive' has

- `electrical(out, state, design)`: set an `Electrical`;
- `electrical_deviation(out, state, coefficients, design)`: set an `ElectricalDeviation`;
- `speed_bound(state, coefficients, design)`: upper bound of the mechanical speed while the rotor is
  not observable [rad/s]; inf if no bound is known;
- `coast(state, gap)`: go on with the speed as it was over a gap [s], after `resume`.
"""

from __future__ import annotations

from estimator_pkg.record import record

LARGEST_VECTOR = 1e6  # A and V: a sample whose vector is longer is garbage


@record
class DriveSample:
    """What one row of a drive holds, in the stator frame."""

    i_alpha: float  # current at the stamp [A]
    i_beta: float
    u_alpha: float  # mean voltage over the interval that ends at the stamp [V]
    u_beta: float


@record
class Electrical:
    """The newest estimate in electrical quantities."""

    angle: float  # [rad]; nan while the rotor is not observable
    speed: float  # [rad/s]; nan while the rotor is not observable
    flux: float  # flux linkage [Wb]
    valid: float  # 1: angle and speed are valid; else 0
    status: int
    reasons: int  # bits of `watch.REASON_TEXTS`


@record
class ElectricalDeviation:
    """One standard deviation of each."""

    angle: float  # [rad]
    speed: float  # [rad/s]
    flux: float  # [Wb]


def is_reading(measurement: DriveSample) -> bool:
    """Return False if a component is not finite, or the vector is longer than `LARGEST_VECTOR`."""
    i_alpha, i_beta = measurement.i_alpha, measurement.i_beta
    u_alpha, u_beta = measurement.u_alpha, measurement.u_beta
    # false for nan too; one comparison costs half as much as four
    return (
        i_alpha * i_alpha + i_beta * i_beta + u_alpha * u_alpha + u_beta * u_beta
        < LARGEST_VECTOR * LARGEST_VECTOR
    )
