# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Motors and their recorded currents and voltages, for tests of the observer `pmsm`."""

import math
from functools import lru_cache

import numpy as np

from estimator_pkg.circle import Circle
from estimator_pkg.estimate import Deviation, Estimate
from estimator_pkg.observers.pmsm.observer import (
    DriveSample,
    Electrical,
    ElectricalDeviation,
    Gains,
    Pmsm,
)
from estimator_pkg.observers.pmsm.state import Coefficients, State
from estimator_pkg.parameters import build as build_parameters
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.profiles import Profile

MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
RATE, DT = 20000.0, 5e-5
RPM = math.pi / 30.0
TURN = 2.0 * math.pi


class Motor:
    """The observer at some gains, sample by sample."""

    def __init__(self, gains, dt=DT):
        self.design = Pmsm.design(gains, Circle(0.0))
        self.state, self.coefficients, self.sample = State(), Coefficients(), DriveSample()
        Pmsm.prepare(self.coefficients, self.design, dt)

    def take(self, function, row, *more):
        for name, value in zip(DriveSample.fields, row):
            setattr(self.sample, name, float(value))
        function(Pmsm, self.state, *more, self.design, self.sample)

    def start(self, row):
        self.take(Pmsm.start, row)

    def resume(self, row):
        self.take(Pmsm.resume, row, self.coefficients)

    def step(self, row):
        self.take(lambda *given: Pmsm.step(*given, 0.0), row, self.coefficients)

    @property
    def reasons(self):
        return self.state.watch.reasons

    def estimate(self):
        """(position, velocity, nan, status)."""
        out = Estimate()
        Pmsm.estimate(Pmsm, out, self.state, self.coefficients, self.design, self.sample, 0.0)
        return values(out)

    def electrical(self):
        """(angle, speed, flux, valid, status, reasons)."""
        out = Electrical()
        Pmsm.electrical(out, self.state, self.design)
        return values(out)

    def electrical_stddev(self):
        out = ElectricalDeviation()
        Pmsm.electrical_deviation(out, self.state, self.coefficients, self.design)
        return values(out)

    def stddev(self):
        out = Deviation()
        Pmsm.deviation(Pmsm, out, self.state, self.coefficients, self.design, 1.0)
        return values(out)

    def speed_bound(self):
        return Pmsm.speed_bound(self.state, self.coefficients, self.design)


def values(record):
    return tuple(getattr(record, name) for name in type(record).fields)


def made(dt=DT, **gains):
    return Motor(build_parameters(Gains, {**MOTOR, **gains}), dt)


@lru_cache
def record(segments, seed=1, **plant):
    profile = Profile(segments)
    return Drive(PmsmParameters(**plant), seed, profile=profile).run(round(profile.duration * RATE))


def noisy(segments, **plant):
    return record(segments, current_noise=0.1, **plant)


STEADY = ((0.06, 3000.0, 3000.0),)
RESTING = ((0.05, 0.0, 0.0),)


def estimates(motor, samples):
    """(status, reasons, electrical rows) after each sample."""
    motor.start(samples[0])
    rows = []
    for row in samples[1:].tolist():
        motor.step(row)
        rows.append(motor.electrical())
    *_, status, reasons = np.array(rows).T
    return status.astype(int), reasons.astype(int), np.array(rows)[:, :4]


def steady(count, begin=0, turns=100.0, rate=2500.0, rows=50):
    """Batches of a motor that turns steadily, or stands: (stamps [ns], samples) of each."""
    speed = TURN * turns
    for k in range(begin, begin + count):
        at = rows * k + np.arange(rows)
        turned = np.exp(1j * speed * at / rate)
        current = 5j * turned
        voltage = (MOTOR['resistance'] + 1j * speed * MOTOR['inductance']) * current
        voltage += 1j * speed * MOTOR['flux'] * turned
        values = np.transpose([current.real, current.imag, voltage.real, voltage.imag])
        values += np.random.default_rng(k).normal(0.0, 1e-3, values.shape)
        yield 10**18 + np.rint(1e9 * at / rate).astype(np.int64), values


def angle_error(found, truth):
    return np.degrees(np.angle(np.exp(1j * (found - truth))))
