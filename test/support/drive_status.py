# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How correct the status of the observer `pmsm` is over a run of the simulated drive."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import Circle
from estimator_pkg.estimate import INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm import observer
from estimator_pkg.observers.pmsm.observer import Gains, Sample
from estimator_pkg.observers.pmsm.state import Design, State
from estimator_pkg.observers.pmsm.watch import BLIND
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.profiles import Profile
from sim_pkg.reproduce.pmsm.motor import FLUX, INDUCTANCE, POLE_PAIRS, RESISTANCE
from sim_pkg.reproduce.pmsm.observer import run_states

RATE = 20000.0
ROBUST: dict[str, Any] = {
    'resistance': RESISTANCE,
    'inductance': INDUCTANCE,
    'flux': FLUX,
    'pole_pairs': POLE_PAIRS,
}

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


def first_state(design: Design, first: NDArray[np.float64]) -> State:
    """Return the observer's state after the first sample, shape (4,)."""
    state, sample = State(), Sample()
    sample.i_alpha, sample.i_beta, sample.u_alpha, sample.u_beta = first.tolist()
    observer.start(observer, state, design, sample)
    return state


def tracking_state(design: Design, first: NDArray[np.float64], omega: float) -> State:
    """Return the state of an observer that has tracked a rotor [rad/s] for long, at 0 rad."""
    state = first_state(design, first)
    core, watch, level = state.core, state.watch, omega * FLUX
    core.i1, core.i2, core.h1, core.h2 = float(first[0]), float(first[1]), 0.0, -level
    core.z1, core.z2, core.x = 1.0, 0.0, 1.0 / FLUX
    core.y_alpha, core.y_beta = level, 0.0
    watch.level = abs(level)
    watch.mean_h2, watch.rate, watch.calm, watch.reasons = -watch.level, omega, 1.0, 0
    return state


def run_log(design: Design, samples: NDArray[np.float64], dt: float, state: State) -> Log:
    """Run the observer over `samples`, shape (n + 1, 4), from the state at the first of them."""
    states = run_states(design, samples, dt, state)[1:]
    core, watch = states['core'], states['watch']
    reasons = watch['reasons']
    settled = (reasons == 0) & (watch['calm'] >= design.hold)
    status = np.where(settled, TRACKING, INITIALISING)
    return Log(
        np.angle((core['z1'] + 1j * core['z2']) * np.where(core['x'] < 0.0, -1.0, 1.0)),
        states['out']['speed'],
        np.where(reasons & BLIND, NOT_OBSERVABLE, status),
    )


def judged(profile: Profile, plant: dict[str, Any], seed: int = 1, **gains: Any) -> Verdict:
    """Judge the status of the default observer, with `gains` changed, over a profile."""
    record = Drive(PmsmParameters(**plant), seed, profile=profile).run(
        round(profile.duration * RATE)
    )
    design = observer.design(Gains(**{**ROBUST, **gains}), Circle())
    log = run_log(design, record.samples, 1.0 / RATE, first_state(design, record.samples[0]))
    return judge(log, record.truth[1:, 1], record.truth[1:, 0], 1.0 / RATE)


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


def judge(log: Log, theta: NDArray[np.float64], speed: NDArray[np.float64], dt: float) -> Verdict:
    """Compare a log with the true electrical angle [rad] and mechanical speed [rad/s].

    Parameters
    ----------
    theta, speed : shape (n,), after each sample of the log. dt : sample time [s].
    """
    error = np.abs(np.angle(np.exp(1j * (log.angle - theta))))
    tracking = log.status == TRACKING
    good = error <= math.radians(10.0)
    fast = np.abs(speed) > 200.0 * math.pi / 30.0
    worst = math.degrees(float(error[tracking].max())) if tracking.any() else 0.0
    return Verdict(
        1e3 * dt * float((tracking & ~good).sum()),
        1e3 * dt * float((~tracking & good & fast).sum()),
        1e3 * dt * float(tracking.sum()),
        worst,
    )
