# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers, angles and stamps for tests of `hybrid_angle`."""

import math

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.observers.angle.hybrid.design import Coefficients, Core
from estimator_pkg.observers.angle.hybrid.observer import HybridAngle
from estimator_pkg.parameters import build

TURN = 2.0 * math.pi
PHI = {
    'sin': math.sin,
    'tan': lambda e: 2.0 * math.tan(0.5 * e),
    'saw': lambda e: (e + math.pi) % TURN - math.pi,
    'sat': lambda e: max(-1.0, min(1.0, (e + math.pi) % TURN - math.pi)),
}
MARGIN = math.radians(5.0)


def make(period=TURN, **gains):
    return Joint(HybridAngle, build(HybridAngle.gains, gains), JointSettings(wrap_period=period))


def wrapped(angle, period=TURN):
    return (np.asarray(angle) + 0.5 * period) % period - 0.5 * period


def stamps(times):
    return 10**18 + np.rint(np.asarray(times) * 1e9).astype(np.int64)


class Inner:
    """The observer itself, without what angle observers share around it."""

    def __init__(self, dt, period=TURN, **gains):
        self.design = HybridAngle.design(build(HybridAngle.gains, gains), Circle(period))
        self.coefficients, self.core = Coefficients(), Core()
        HybridAngle.prepare(self.coefficients, self.design, dt)
        HybridAngle.begin(self.core, self.design, 0.0)

    def put(self, **fields):
        """Set fields of the core; the position follows."""
        for name, value in fields.items():
            setattr(self.core, name, value)
        self.core.position = self.core.last - self.core.error

    def correct(self, reading):
        """Take a reading; return the innovation."""
        return HybridAngle.correct(self.core, self.coefficients, self.design, reading)
