# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator ``gripper``: a joint whose load changes when its gripper closes or opens."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.models import gripper
from estimator_pkg.parameters import structural
from sim_pkg.chunks import MEASURED, TRUTH
from sim_pkg.contract import Simulator
from sim_pkg.joints.driven import EVENTS, DrivenParameters, Plant, stream


@dataclass(frozen=True)
class GripperParameters(DrivenParameters):
    """The parameters of the simulator."""

    counts_per_revolution: int = structural(
        65536, unit='counts', range=(0, 2**31 - 1), description='resolution; 0: no quantisation'
    )
    start: float = structural(0.3, unit='rad', range=(-1e3, 1e3), description='angle at the start')
    inertia: float = structural(0.5, unit='kg m^2', range=(1e-6, 1e6), description='J without load')
    damping: float = structural(0.4, unit='N m s/rad', range=(0.0, 1e6), description='b')
    gravity: float = structural(
        4.905, unit='N m', range=(0.0, 1e6), description='m g l without load: torque at 90 degrees'
    )
    load_inertia: float = structural(
        0.3, unit='kg m^2', range=(0.0, 1e6), description='J added by a gripped load'
    )
    load_gravity: float = structural(
        4.905, unit='N m', range=(0.0, 1e6), description='m g l added by a gripped load'
    )
    first_event: float = structural(
        2.0, unit='s', range=(1e-3, 1e9), description='when the gripper first closes'
    )
    event_every: float = structural(
        2.0,
        unit='s',
        range=(1e-3, 1e9),
        description='time from one event to the next: the gripper opens, closes, opens',
    )

    @property
    def fastest(self) -> float:
        """An upper bound of the joint's rates [1/s], with and without load."""
        return self.damping / self.inertia + math.sqrt(
            (self.gravity + self.load_gravity) / self.inertia
        )


class Gripper(Plant):
    """The plant."""

    def __init__(self, parameters: GripperParameters) -> None:
        self._p = parameters
        self._now = self.discrete(0.0)

    def _events(self, t: float) -> int:
        """Return the number of events up to and including t [s]."""
        p = self._p
        return max(0, math.floor((t - p.first_event) / p.event_every + 1e-9) + 1)

    def discrete(self, t: float) -> tuple[float, float, float]:
        """Return the discrete state Z = (1/J, b/J, m g l/J) from t [s] on."""
        p, gripped = self._p, self._events(t) % 2
        inertia = p.inertia + gripped * p.load_inertia
        return 1.0 / inertia, p.damping / inertia, (p.gravity + gripped * p.load_gravity) / inertia

    def input(self, t: float) -> float:
        """Return the torque applied from t [s] on [N m]."""
        return gripper.torque(t)[0]

    def acceleration(self, q: float, v: float, u: float) -> float:
        """Return q'' [rad/s^2]."""
        return gripper.dynamics((q, v), self._now, (u,))[1]

    def begin(self, t: float) -> None:
        """Switch to the discrete state Z from t [s] on."""
        self._now = self.discrete(t)

    def event(self, first: float, last: float) -> tuple[float, str] | None:
        """Return (time [s], 'close' or 'open') of the first event after `first`, else None."""
        before, after = self._events(first), self._events(last)
        if after == before:
            return None
        at = self._p.first_event + before * self._p.event_every
        return at, 'open' if before % 2 else 'close'


SIMULATOR = Simulator(
    name='gripper',
    summary='a joint whose load changes when its gripper closes or opens',
    parameters=GripperParameters,
    topics=lambda p: (MEASURED, EVENTS, TRUTH),
    generate=lambda p, duration, seed: stream(Gripper(p), p, duration, seed),
)
