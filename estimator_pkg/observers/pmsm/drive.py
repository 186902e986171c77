# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The contract of drive observers: `Functions`, and the outputs that only a drive has.

Observers of kind 'drive' take a sample (i_alpha, i_beta, u_alpha, u_beta): the current at the stamp
[A] and the mean voltage [V] over the interval that ends at the stamp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from estimator_pkg.observers.contract import Functions

LARGEST = 1e6  # A and V: a sample whose vector is longer is garbage

Sample = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class DriveFunctions(Functions):
    """The functions of an observer of kind 'drive'.

    Attributes
    ----------
    row : (state, coefficients, design) -> the values of `electrical`, then status and reasons: all
        per-sample outputs in one call.
    electrical : (state, coefficients, design) -> (electrical angle [rad], electrical speed [rad/s],
        flux linkage [Wb], 1.0 if they are valid, else 0.0). Angle and speed are nan while the rotor
        is not observable.
    electrical_stddev : (state, coefficients, design) -> one standard deviation of angle, speed and
        flux.
    speed_bound : (state, coefficients, design) -> upper bound of the mechanical speed while the
        rotor is not observable [rad/s]; inf if no bound is known.
    reasons : (state) -> bits of `watch.REASONS`.
    coast : (state, coefficients, design, measurement, gap) -> state. Continues after a gap [s].
    """

    row: Callable[..., tuple]
    electrical: Callable[..., tuple]
    electrical_stddev: Callable[..., tuple]
    speed_bound: Callable[..., float]
    reasons: Callable[[tuple], int]
    coast: Callable[..., tuple]


def finite(measurement: Sample) -> bool:
    """Return False if a component is NaN or infinite, or the vector is longer than `LARGEST`."""
    i_alpha, i_beta, u_alpha, u_beta = measurement
    # false for nan too; one comparison costs half as much as four
    return (
        i_alpha * i_alpha + i_beta * i_beta + u_alpha * u_alpha + u_beta * u_beta
        < LARGEST * LARGEST
    )
