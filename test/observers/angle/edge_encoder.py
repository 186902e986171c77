# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What a counting encoder shows of a motion, and the edge-aware observer on it."""

import math

import numpy as np
from observer_cases import make, stamps, wrapped

QUANTUM = 2.0 * math.pi / 4096
DT = 1e-3


def read(angle, quantum=QUANTUM):
    """What a counting encoder shows."""
    return wrapped(np.floor(np.asarray(angle) / quantum) * quantum)


def joint(**gains):
    return make('edge_adaptive', {'quantum': QUANTUM, **gains})


def run(angle, at=None, **gains):
    """Velocity, standard deviation and status for what an encoder reads of `angle` at 1 kHz."""
    return joint(**gains).run(stamps(len(angle)) if at is None else at, read(angle))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))
