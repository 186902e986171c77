# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How correct the status of the observer `pmsm` is over a run of the simulated drive."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from motors import DT, MOTOR, RATE, Motor, made
from numpy.typing import NDArray

from estimator_pkg.estimate import INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm.observer import HOLD
from estimator_pkg.observers.pmsm.watch import BLIND
from sim_pkg.pmsm.drive import Drive, Record
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.profiles import Profile
from sim_pkg.reproduce.pmsm.observer import run_states

SCENARIOS = {
    'start-up': Profile([(0.3, 3000, 3000), (0.1, 3000, 6000), (0.2, 6000, 6000)]),
    'backward': Profile([(0.3, -3000, -3000), (0.1, -3000, -6000), (0.2, -6000, -6000)]),
    'reversal': Profile(
        [
            (0.2, 3000, 3000),
            (0.1, 3000, -3000),
            (0.2, -3000, -3000),
            (0.1, -3000, 3000),
            (0.1, 3000, 3000),
        ]
    ),
    'from rest': Profile([(0.1, 0, 0), (0.3, 0, 3000), (0.2, 3000, 3000)]),
    'to rest': Profile(
        [(0.1, 3000, 3000), (0.3, 3000, 0), (0.1, 0, 0), (0.2, 0, 3000), (0.1, 3000, 3000)]
    ),
}
PLANTS: dict[str, dict[str, Any]] = {
    'noise 0.1 A': {'current_noise': 0.1},
    'noise 0.3 A': {'current_noise': 0.3},
    'R +30 %': {'current_noise': 0.1, 'resistance_error': 0.3},
    'R -20 % L +20 %': {'current_noise': 0.1, 'resistance_error': -0.2, 'inductance_error': 0.2},
    'L -30 % flux +15 %': {'current_noise': 0.1, 'inductance_error': -0.3, 'flux_error': 0.15},
}


class Log(NamedTuple):
    """Arrays of shape (n,), one entry after each sample but the first.

    angle, speed : electrical, whether they are published or not [rad, rad/s].
    """

    angle: NDArray[np.float64]
    speed: NDArray[np.float64]
    status: NDArray[np.int64]


def track(motor: Motor, first: NDArray[np.float64], omega: float) -> None:
    """Make it the state of an observer that has tracked a rotor [rad/s] for long, at 0 rad."""
    motor.start(first)
    core, watch, level = motor.state.core, motor.state.watch, omega * MOTOR['flux']
    core.i1, core.i2, core.h1, core.h2 = float(first[0]), float(first[1]), 0.0, -level
    core.z1, core.z2, core.x = 1.0, 0.0, 1.0 / MOTOR['flux']
    core.y_alpha, core.y_beta = level, 0.0
    watch.level = abs(level)
    watch.mean_h2, watch.rate, watch.calm, watch.reasons = -watch.level, omega, 1.0, 0


def run_log(motor: Motor, samples: NDArray[np.float64]) -> Log:
    """Run the observer over `samples`, shape (n + 1, 4), from its state at the first of them."""
    states = run_states(motor.design, samples, DT, motor.state)[1:]
    core, watch = states['core'], states['watch']
    reasons = watch['reasons']
    settled = (reasons == 0) & (watch['calm'] >= HOLD)
    status = np.where(settled, TRACKING, INITIALISING)
    return Log(
        np.angle((core['z1'] + 1j * core['z2']) * np.where(core['x'] < 0.0, -1.0, 1.0)),
        states['out']['speed'],
        np.where(reasons & BLIND, NOT_OBSERVABLE, status),
    )


def judged(profile: Profile, plant: dict[str, Any], seed: int = 1, **gains: Any) -> Verdict:
    """Judge the status of the default observer, with `gains` changed, over a profile."""
    drive = Drive(PmsmParameters(**plant), seed, profile=profile)
    return judge(made(**gains), drive.run(round(profile.duration * RATE)))


def verdict(scenario: str, plant: str, seed: int = 1) -> Verdict:
    """The status in one of the 25 runs."""
    return judged(SCENARIOS[scenario], PLANTS[plant], seed)


class Verdict(NamedTuple):
    """How correct a run's status was [ms].

    wrong : time in TRACKING with an angle error of more than 10 degrees.
    withheld : time in another status with a correct angle and a speed above 200 rpm.
    tracking : total time; worst : largest angle error in TRACKING [deg].
    """

    wrong: float
    withheld: float
    tracking: float
    worst: float


def judge(motor: Motor, record: Record) -> Verdict:
    """Run the observer over a record of a drive, and compare it with the truth."""
    motor.start(record.samples[0])
    log, theta, speed = run_log(motor, record.samples), record.truth[1:, 1], record.truth[1:, 0]
    error = np.abs(np.angle(np.exp(1j * (log.angle - theta))))
    tracking = log.status == TRACKING
    good = error <= math.radians(10.0)
    fast = np.abs(speed) > 200.0 * math.pi / 30.0
    worst = math.degrees(float(error[tracking].max())) if tracking.any() else 0.0
    return Verdict(
        1e3 * DT * float((tracking & ~good).sum()),
        1e3 * DT * float((~tracking & good & fast).sum()),
        1e3 * DT * float(tracking.sum()),
        worst,
    )
