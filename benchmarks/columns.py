# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The columns of the field: readings of one joint with their true velocity.

A column is a signal of the shared set, or a joint of a recording. If the torque is known, the
column also has it, with the parameters of the joint, for the observers that use an input.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.signals import SIGNALS, SKIPPED, Samples, Signal

Array = NDArray[np.float64]

DURATION = 6.0  # [s] of each signal
EDGE = 0.1  # [s] ignored at the end: non-causal estimators lack samples there
FLOOR = 0.01  # errors below this count as zero when one setting is chosen [rad/s]
INERTIA = 0.1  # of the joint that makes the signals' motion [kg m^2]


class Cleaned(NamedTuple):
    """Readings for a peer: increasing stamps, no nan, multi-turn angles.

    rows : shape (m,), indices of these samples. time [s], angle [rad] : shape (m,).
    """

    rows: NDArray[np.int64]
    time: Array
    angle: Array


@dataclass(frozen=True)
class Column:
    """Readings of one joint and the truth about them.

    samples : as received; the velocity is nan where it is not known.
    quantum : quantum of the reading [rad].
    skip : time at the beginning that is not evaluated [s].
    noise : error of the reference itself [rad/s rms]; 0: it is the ground truth.
    torque : shape (n,), mean over the interval that ends at the sample [N m]; None: not known.
    joint : the parameters of `single_joint` for this joint; empty: not known.
    reference : origin of the true velocity.
    period : wrap period of the readings [rad]; 0: none.
    """

    name: str
    summary: str
    samples: Samples
    quantum: float
    skip: float = SKIPPED
    noise: float = 0.0
    torque: Array | None = None
    joint: dict[str, float] = field(default_factory=dict)
    reference: str = 'truth'
    period: float = 2.0 * math.pi

    @property
    def time(self) -> Array:
        """Time of each sample since the first positive stamp [s]."""
        stamps = self.samples.stamps
        return (stamps - stamps[np.argmax(stamps > 0)]) * 1e-9

    @property
    def counted(self) -> NDArray[np.bool_]:
        """True for the samples that are evaluated."""
        time = self.time
        return (
            (time >= self.skip) & (time <= np.max(time) - EDGE) & np.isfinite(self.samples.velocity)
        )

    @property
    def floor(self) -> float:
        """Errors below this do not rank estimators [rad/s]."""
        return max(FLOOR, self.noise)

    def cleaned(self) -> Cleaned:
        """Return the readings for estimators without a guard."""
        stamps, angle = self.samples.stamps, self.samples.angle
        newest = np.concatenate([[0], np.maximum.accumulate(stamps)[:-1]])
        rows = np.flatnonzero((stamps > newest) & np.isfinite(angle))
        return Cleaned(rows, self.time[rows], np.unwrap(angle[rows]).astype(np.float64))

    def at_rows(self, rows: NDArray[np.int64], velocity: Array) -> Array:
        """Return the velocities of `rows` as an array over all samples; nan elsewhere."""
        every = np.full(len(self.samples.stamps), np.nan)
        every[rows] = velocity
        return every


def of_signal(signal: Signal, duration: float = DURATION) -> Column:
    """Return a signal as the motion of a frictionless joint, with the torque that causes it."""
    samples = signal.samples(duration=duration)
    steps = np.diff(samples.stamps) * 1e-9
    torque = np.concatenate([[0.0], INERTIA * np.diff(samples.velocity) / steps])
    return Column(
        signal.name,
        signal.summary,
        samples,
        signal.quantum,
        torque=torque,
        joint={'inertia': INERTIA},
    )


def shared(signals: Sequence[Signal] = SIGNALS, duration: float = DURATION) -> list[Column]:
    """Return the columns of the shared set."""
    return [of_signal(signal, duration) for signal in signals]


def driven_by(column: Column) -> Array | None:
    """Return the acceleration by torque and gravity at the measured angle [rad/s^2], or None."""
    if column.torque is None or 'inertia' not in column.joint:
        return None
    joint = column.joint
    gravity = joint.get('gravity', 0.0) * np.sin(column.samples.angle - joint.get('hanging', 0.0))
    made: Array = (column.torque - gravity - joint.get('bias', 0.0)) / joint['inertia']
    return made if math.isfinite(joint['inertia']) else None
