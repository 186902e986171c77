# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Motors and their recorded currents and voltages, for tests of the observer `pmsm`."""

import math
from functools import lru_cache

import numpy as np

from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.pmsm.gains import Gains
from estimator_pkg.observers.pmsm.observer import build
from estimator_pkg.parameters import build as build_parameters
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.profiles import Profile

MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
RATE, DT = 20000.0, 5e-5
RPM = math.pi / 30.0
TURN = 2.0 * math.pi


def made(**gains):
    return build(build_parameters(Gains, {**MOTOR, **gains}), Circle(0.0))


@lru_cache
def record(segments, seed=1, **plant):
    profile = Profile(segments)
    return Drive(PmsmParameters(**plant), seed, profile=profile, fast=False).run(
        round(profile.duration * RATE)
    )


def noisy(segments, **plant):
    return record(segments, current_noise=0.1, **plant)


STEADY = ((0.06, 3000.0, 3000.0),)
RESTING = ((0.05, 0.0, 0.0),)


def estimates(functions, samples, dt=DT, rows=None):
    """(status, reasons, electrical rows) after each sample."""
    design = functions.design()
    coefficients = functions.prepare(design, dt)
    state = functions.init(tuple(samples[0]), design)
    status, reasons, electrical = [], [], []
    for row in samples[1:].tolist():
        state = functions.step(state, coefficients, design, tuple(row), 0.0)
        status.append(functions.output(state, coefficients, design, tuple(row), 0.0)[3])
        reasons.append(functions.reasons(state))
        electrical.append(functions.electrical(state, coefficients, design))
    return np.array(status), np.array(reasons), np.array(electrical), state, coefficients


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
