# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers, angles and stamps for tests of `hybrid_angle`."""

import math

import numpy as np

from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.observers.angle.hybrid.observer import OBSERVER
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
    return Joint(OBSERVER, build(OBSERVER.gains, gains), JointSettings(wrap_period=period))


def wrapped(angle, period=TURN):
    return (np.asarray(angle) + 0.5 * period) % period - 0.5 * period


def stamps(times):
    return 10**18 + np.rint(np.asarray(times) * 1e9).astype(np.int64)


def coefficients_of(dt, **gains):
    functions = make(**gains).functions
    return functions.prepare(functions.design(), dt)[0]


def core_of(**gains):
    """The core that `build` hands to `around`."""
    import estimator_pkg.observers.angle.hybrid.observer as module

    seen = []
    original = module.around
    module.around = lambda core, *rest: seen.append(core) or original(core, *rest)
    try:
        make(**gains)
    finally:
        module.around = original
    return seen[0]
