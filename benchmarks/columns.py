"""The columns of the field: readings of one joint with their true velocity.

A column is a signal of the shared set, or a joint of a recording. Where the torque is known it
carries that too, with the numbers of the joint on which it acts: for the observers that are told.
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
EDGE = 0.1  # [s] left out at the end: what looks ahead does not see it whole
FLOOR = 0.01  # [rad/s] errors below this are as good as none when one setting is chosen
INERTIA = 0.1  # [kg m^2] of the joint that makes the signals' motion


class Cleaned(NamedTuple):
    """What a peer takes: no repeated or late stamp, no nan, turns counted.

    rows : shape (m,), which samples these are. time [s], angle [rad] : shape (m,).
    """

    rows: NDArray[np.int64]
    time: Array
    angle: Array


@dataclass(frozen=True)
class Column:
    """Readings of one joint and what is true of them.

    samples : as received; the velocity is nan where it is not known.
    quantum : smallest step of the reading [rad].
    skip : seconds at the beginning that do not count.
    noise : what the reference may itself be wrong by [rad/s rms]; 0: it is the truth.
    torque : shape (n,), mean over the interval that ends at the sample [N m]; None: not known.
    joint : the numbers of `single_joint` on which it acts; empty: not known.
    reference : what the velocity comes from.
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

    @property
    def time(self) -> Array:
        """Of each sample since the first stamp that is one [s]."""
        stamps = self.samples.stamps
        return (stamps - stamps[np.argmax(stamps > 0)]) * 1e-9

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which samples are judged."""
        time = self.time
        return (
            (time >= self.skip) & (time <= np.max(time) - EDGE) & np.isfinite(self.samples.velocity)
        )

    @property
    def floor(self) -> float:
        """Errors below this do not rank estimators [rad/s]."""
        return max(FLOOR, self.noise)

    def cleaned(self) -> Cleaned:
        """The readings for estimators that know no guard."""
        stamps, angle = self.samples.stamps, self.samples.angle
        newest = np.concatenate([[0], np.maximum.accumulate(stamps)[:-1]])
        rows = np.flatnonzero((stamps > newest) & np.isfinite(angle))
        return Cleaned(rows, self.time[rows], np.unwrap(angle[rows]).astype(np.float64))

    def spread(self, rows: NDArray[np.int64], velocity: Array) -> Array:
        """Velocities of some samples as those of all; nan elsewhere."""
        every = np.full(len(self.samples.stamps), np.nan)
        every[rows] = velocity
        return every


def of_signal(signal: Signal, duration: float = DURATION) -> Column:
    """A signal as the motion of a joint without friction, with the torque that makes it."""
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
    """The shared set."""
    return [of_signal(signal, duration) for signal in signals]


def driven_by(column: Column) -> Array | None:
    """The acceleration that torque and gravity give at the measured angle [rad/s^2], or None."""
    if column.torque is None or 'inertia' not in column.joint:
        return None
    joint = column.joint
    gravity = joint.get('gravity', 0.0) * np.sin(column.samples.angle - joint.get('hanging', 0.0))
    made: Array = (column.torque - gravity - joint.get('bias', 0.0)) / joint['inertia']
    return made if math.isfinite(joint['inertia']) else None
