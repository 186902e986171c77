# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Random streams through each function of an engine: `python engine_streams.py LIBRARY RUNS`.

Prints the names of the functions that were called. Sanitizers end the process at a fault.
"""

import contextlib
import math
import sys
from pathlib import Path

import numpy as np
from observer_cases import drawn_gains

from estimator_pkg import observers
from estimator_pkg.driver.bank import Line
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.driver.joint import Joint
from estimator_pkg.engine import calls
from estimator_pkg.engine.load import PACKAGE, load
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.checks.angles import faults_of
from estimator_pkg.evaluation.reference.smoother.smoother import smooth
from estimator_pkg.parameters import build
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.reproduce.pmsm.observer import run_states

COUNT = 300
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
BAD = [math.nan, math.inf, -math.inf, 1e300, -1e10, 5e-324, -0.0]
STEPS_NS = [10**6] * 40 + [10**5, 10**7, 0, 1, -(10**6), 4 * 10**8, 10**10, -(10**10)]


class Recorded:
    """A library, and the names of its functions that were called."""

    def __init__(self, library):
        self.functions, self.called = library, set()

    def __getattr__(self, name):
        function = getattr(self.functions, name)

        def call(*arguments):
            self.called.add(name)
            return function(*arguments)

        return call


def drawn_stream(random, columns=1, dt_ns=10**6):
    """(stamps [ns], readings of shape (COUNT, columns)): motion, counts, rests, and any fault."""
    steps = random.choice(STEPS_NS, COUNT) * dt_ns // 10**6
    stamps = 10**15 + np.cumsum(steps)
    stamps[random.integers(0, COUNT, 3)] = random.choice([0, -1, 2**62, -(2**62)], 3)
    speed = random.choice([0.0, 1e-4, 0.1, 3.0, 1e4]) * random.normal(size=(COUNT, columns))
    readings = np.cumsum(1e-2 * speed * (random.random((COUNT, 1)) < 0.8), axis=0)
    quantum = random.choice([1e-9, 1e-3, 0.1])
    readings = quantum * np.round(readings / quantum)
    rows = random.integers(0, COUNT, 8)
    readings[rows, random.integers(0, columns, 8)] = random.choice(BAD, 8)
    return stamps, readings


def made(kind, name, random, **fixed):
    """A joint or drive with random gains; None: all are refused."""
    observer = observers.find(name)
    settings = {
        'unwrap': bool(random.integers(2)),
        'gap_max': random.choice([0.01, 0.3]),
        'wrap_period': random.choice([0.0, 2.0 * math.pi, 360.0]),
    }
    for _ in range(100):
        with contextlib.suppress(UserError):
            gains = build(observer.gains, {**drawn_gains(observer.gains, random), **fixed})
            return kind(observer, gains, build(JointSettings, settings))
    return None


def run(joint, stamps, *columns):
    """Take a stream sample by sample, then begin anew."""
    for stamp, *values in zip(stamps.tolist(), *(column.tolist() for column in columns)):
        joint.update(stamp, *values)
        joint.estimate()
        if hasattr(joint.compiled, 'write_deviation'):
            joint.stddev()
    joint.reset()


def angle(name, random):
    stamps, readings = drawn_stream(random, 3)
    joints = [made(Joint, name, random) for _ in range(3)]
    joint = joints[0]
    run(joint, stamps, readings[:, 0])
    joint.run(stamps, readings[:, 0])
    line = Line('abc', joints)
    for stamp, row in zip(stamps.tolist(), readings.tolist()):
        line.take(stamp, row)
    line.stddevs(range(3))


def drive(name, random):
    stamps, readings = drawn_stream(random, 4, 10**5)
    joint = made(DriveJoint, name, random, **MOTOR)
    run(joint, stamps, readings)
    joint.take(stamps, readings)
    run_states(joint.design, readings, 1e-4, joint.state)


def loops(random):
    stamps, readings = drawn_stream(random)
    readings = readings[:, 0]
    faults_of(stamps, readings, 2.0 * math.pi, 1e-3)
    even, good = stamps[0] + 10**6 * np.arange(4 * COUNT), np.nan_to_num(readings).clip(-9.0, 9.0)
    smooth(even, np.round(np.interp(np.arange(4 * COUNT) / 4.0, np.arange(COUNT), good), 1), 0.0)
    Drive(PmsmParameters(), int(random.integers(99))).run(COUNT)


def main(path, runs):
    library, reason = load(Path(path), PACKAGE.parent)
    assert library is not None, reason
    recorded = Recorded(library)
    calls.load = lambda: (recorded, '')
    random = np.random.default_rng(int(runs))
    kinds = {'angle': angle, 'drive': drive}
    for _ in range(int(runs)):
        for kind, function in kinds.items():
            for name in observers.of_kind(kind):
                function(name, random)
        loops(random)
    print(*sorted(recorded.called), sep='\n')


if __name__ == '__main__':
    main(*sys.argv[1:])
