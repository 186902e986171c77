# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""An estimate of one angle: its status, position and velocity, and their standard deviations."""

from __future__ import annotations

from estimator_pkg.record import record

# The status of an estimate. Plain ints: compiled code returns them.
INITIALISING = 0  # not settled since the start or the last loss of lock; not published
TRACKING = 1  # the estimate can be trusted
COASTING = 2  # published, but predicted only (gap, outlier, loss of lock)
LOST = 3  # no input (set by the node, never by an observer)
NOT_OBSERVABLE = 4  # the signals do not determine the state
MISCONFIGURED = 5  # the gains are unstable at the measured sample rate
VALID = (TRACKING, COASTING)  # only estimates with one of these statuses are published
STATUS_NAMES = ('initialising', 'tracking', 'coasting', 'lost', 'not observable', 'misconfigured')


@record
class Estimate:
    """The newest estimate of a single angle."""

    position: float  # [rad or m], in the convention of the measurement
    velocity: float  # [rad/s or m/s]
    acceleration: float  # [rad/s^2 or m/s^2]; nan: the observer gives none
    status: int


@record
class Deviation:
    """One standard deviation of each."""

    position: float  # [rad or m]
    velocity: float  # [rad/s or m/s]
