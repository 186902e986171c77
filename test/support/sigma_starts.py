# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The standard deviation where motion begins: errors over it, and how soon it is calm."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from observer_cases import make, stamps, wrapped

from estimator_pkg.estimate import TRACKING
from sim_pkg.joints.profiles import ProfileParameters, make_profile

REST = 0.5  # [s] the shaft stands before it moves
AROUND = 0.2  # [s] after the first changed reading: the start
LENGTH = 1.2  # [s] of motion
PHASES = 30  # of a start against the sampling

# Every profile of the simulator; what is at once has no ramp.
MOTIONS = {
    'steps 40 rad/s^2': {'profile': 'steps', 'acceleration': 40.0},
    'steps 600 rad/s^2': {'profile': 'steps', 'acceleration': 600.0},
    'steps 2 rad/s^2': {'profile': 'steps', 'acceleration': 2.0},
    'steps at once': {'profile': 'steps', 'acceleration': 0.0},
    'trapezoid': {'profile': 'trapezoid'},
    'trapezoid at once': {'profile': 'trapezoid', 'acceleration': 0.0, 'velocity': 30.0},
    'constant': {'profile': 'constant'},
    'constant, slow': {'profile': 'constant', 'velocity': 0.5},
    'sine': {'profile': 'sine'},
    'chirp': {'profile': 'chirp'},
    'figure_4': {'profile': 'figure_4'},
    'figure_6': {'profile': 'figure_6'},
    'random': {'profile': 'random'},
}


class Case(NamedTuple):
    """One stream; noise in quanta."""

    motion: str
    rate: float = 1000.0
    bits: int = 12
    noise: float = 0.0
    known: bool = False
    period: float = 2.0 * math.pi
    seed: int = 1

    @property
    def quantum(self) -> float:
        return 2.0 * math.pi / 2.0**self.bits


class Found(NamedTuple):
    """worst: largest |error|/sigma in the start; calm: changed readings until sigma is below twice
    its steady value; zeros: standard deviations of zero."""

    worst: float
    calm: int
    zeros: int


def stream(case: Case):
    """(stamps, readings, true velocity, index of the first sample in motion)."""
    own = MOTIONS[case.motion]
    held = own.get('hold_time', 1.0)
    late = held if own['profile'] in ('steps', 'trapezoid') else 0.0  # both begin with a rest
    random = np.random.default_rng(case.seed)
    profile = make_profile(ProfileParameters(**own), random)
    count = round((REST + LENGTH) * case.rate)
    dt = 1.0 / case.rate
    phase = random.random()
    time = (np.arange(count) + phase) * dt - REST
    moving = time > 0.0
    position, velocity, _ = profile(np.where(moving, time, 0.0) + late)
    position = position + case.quantum * random.random()
    velocity = np.where(moving, velocity, 0.0)
    noisy = position + case.noise * case.quantum * random.standard_normal(count)
    read = np.rint(noisy / case.quantum) * case.quantum
    if case.period > 0.0:
        read = wrapped(read)
    return stamps(count, dt), read, velocity, int(np.argmax(moving))


def measure(name, gains, case):
    """A `Found` of one observer on one stream."""
    at, read, velocity, begins = stream(case)
    own = {**gains, 'quantum': case.quantum} if case.known else gains
    joint = make(name, own, wrap_period=case.period)
    out = joint.run(at, read)
    sigma, error = out.velocity_stddev, np.abs(out.velocity - velocity)
    before = read[:begins]
    middle = before[-1]
    off = np.abs(read - middle)
    beyond = np.flatnonzero(off[begins:] > np.max(np.abs(before - middle)) + 1e-12)
    first = begins + (int(beyond[0]) if len(beyond) else 0)
    last = min(len(read), first + round(AROUND * case.rate) + 1)
    part = slice(first, last)
    told = out.status[part] >= TRACKING
    ratio = np.divide(
        error[part], sigma[part], out=np.full(last - first, np.inf), where=sigma[part] > 0.0
    )
    ratio = np.where(error[part] < 1e-12, 0.0, ratio)
    steady = np.median(sigma[first + round(0.5 * case.rate) : first + round(0.65 * case.rate)])
    changed = np.cumsum(np.diff(read[first - 1 : last]) != 0.0)
    wide = np.flatnonzero(sigma[part] > 2.0 * steady)
    zeros = np.count_nonzero(sigma == 0.0) + np.count_nonzero(out.position_stddev == 0.0)
    worst = float(np.max(ratio[told], initial=0.0))
    return Found(worst, int(changed[wide[-1]]) if len(wide) else 0, zeros)


def readings_of_error(name, gains, known):
    """Changed readings until the rms error, over phases of the start, stays within twice the steady
    sigma, at 40 rad/s^2 and 4096 counts, 1 kHz. Earlier sigma must not be there.
    """
    errors, steady = [], []
    for seed in range(1, PHASES + 1):
        case = Case('steps 40 rad/s^2', known=known, seed=seed)
        at, read, velocity, _ = stream(case)
        own = {**gains, 'quantum': case.quantum} if known else gains
        out = make(name, own, wrap_period=case.period).run(at, read)
        changed = np.flatnonzero(np.diff(read) != 0.0) + 1
        steady.append(np.median(out.velocity_stddev[changed[0] + 500 : changed[0] + 650]))
        errors.append((out.velocity - velocity)[changed[:150]])
    wide = np.flatnonzero(np.sqrt(np.mean(np.square(errors), 0)) > 2.0 * np.median(steady))
    return int(wide[-1]) + 1 if len(wide) else 0
