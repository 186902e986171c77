# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Servos for the tests of the adaptive observer, and streams through its driver."""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from estimator_pkg.driver.adaptive import AdaptiveJoint
from estimator_pkg.driver.efforts import DrivenSettings
from estimator_pkg.observers.adaptive.observer import Adaptive
from estimator_pkg.observers.adaptive.structure import Gains
from estimator_pkg.parameters import build


def servo(damping, stiffness, gain, u, dt, load=0.0, start=(0.0, 0.0)):
    """(angle, velocity), each one longer than u, which is held; dt a number or an array [s]."""
    steps = np.broadcast_to(dt, len(u))
    a = np.zeros((3, 3))
    a[:2] = [[0.0, 1.0, 0.0], [-stiffness, -damping, 1.0]]
    if np.ptp(steps) == 0.0:
        moves = np.broadcast_to(expm(a * steps[0]), (len(u), 3, 3))
    else:  # a series is exact for steps this short
        moves, term = np.zeros((len(u), 3, 3)), np.broadcast_to(np.eye(3), (len(u), 3, 3))
        for j in range(1, 12):
            moves = moves + term
            term = term @ a * (steps[:, None, None] / j)
    x = np.array([*start, 0.0])
    found = [x[:2].copy()]
    for value, move in zip(u, moves):
        x[2] = gain * value + load
        x = move @ x
        found.append(x[:2].copy())
    angle, velocity = np.array(found).T
    return angle, velocity


class Fed(NamedTuple):
    """The estimates after each sample, shape (n,)."""

    position: Any
    velocity: Any
    acceleration: Any
    status: Any
    position_stddev: Any
    velocity_stddev: Any


def joint(period=2.0 * math.pi, **gains):
    return AdaptiveJoint(Adaptive, build(Gains, gains), DrivenSettings(wrap_period=period))


def feed(made, angles, inputs, dt=1e-3, start_ns=10**18):
    """A stream through the driver; stamps from `start_ns` on."""
    stamps = start_ns + np.rint(
        np.concatenate([[0.0], np.cumsum(np.broadcast_to(dt, len(inputs)))]) * 1e9
    ).astype(np.int64)
    rows = []
    for sample in zip(stamps.tolist(), angles.tolist(), [0.0, *inputs.tolist()]):
        made.update(*sample)
        rows.append((*made.estimate(), *made.stddev()))
    return Fed(*np.array(rows).T), stamps


def excited(count, hold=200, seed=1, size=5.0):
    return (
        size * np.repeat(np.random.default_rng(seed).normal(size=count // hold + 1), hold)[:count]
    )


def named(made):
    return {item.name: item for item in made.report().parameters}
