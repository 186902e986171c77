# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What messages and banks say, as tests look at it."""

import math

from estimator_pkg.estimate import VALID


def estimated(message):
    """The names of the joints of a JointState that have an estimate."""
    return tuple(
        name for name, speed in zip(message.names, message.velocities) if math.isfinite(speed)
    )


def valid(taken):
    """[(name, estimate)] of what a bank made of a message, where there is one to publish."""
    if taken is None:
        return []
    return [
        (name, estimate)
        for name, estimate in zip(taken.names, taken.estimates)
        if estimate is not None and estimate[3] in VALID
    ]
