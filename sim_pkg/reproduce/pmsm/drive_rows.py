# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Our own claims about the observer in a drive: correct status, closed loop, wrong nominal flux."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.profiles import Profile
from sim_pkg.pmsm.sensorless import RUNNING, Sensorless
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.pmsm.observer import ROBUST, Verdict, design_of, first_state, judge, run_log

RPM = math.pi / 30.0
RATE = 20000.0

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


def judged(profile: Profile, plant: dict[str, Any], seed: int = 1, **gains: Any) -> Verdict:
    """Judge the status of the default observer, with `gains` changed, over a profile."""
    record = Drive(PmsmParameters(**plant), seed, profile=profile).run(
        round(profile.duration * RATE)
    )
    design = design_of(**{**ROBUST, **gains})
    log = run_log(design, record.samples, 1.0 / RATE, first_state(design, record.samples[0]))
    return judge(log, record.truth[1:, 1], record.truth[1:, 0], 1.0 / RATE)


def verdict(scenario: str, plant: str, seed: int = 1) -> Verdict:
    """The status in one of the 25 runs."""
    return judged(SCENARIOS[scenario], PLANTS[plant], seed)


def status_values() -> Values:
    """The values of the 25 runs."""
    for scenario in SCENARIOS:
        for plant in PLANTS:
            found = verdict(scenario, plant)
            yield f'status {scenario}, {plant}: wrong', found.wrong
            yield f'status {scenario}, {plant}: withheld', found.withheld


class Loop(NamedTuple):
    """A drive on the observer's own angle and speed, one row per ms, shape (n,).

    angle_error [deg], speed_error [%], speed and its reference [rpm], i_q [A]; running: True when
    the observer controls the drive.
    """

    angle_error: NDArray[np.float64]
    speed_error: NDArray[np.float64]
    speed: NDArray[np.float64]
    reference: NDArray[np.float64]
    i_q: NDArray[np.float64]
    running: NDArray[np.bool_]


# name: forced start, speed at the start [rpm], profile, time of the load step [s]
LOOPS: dict[str, tuple[bool, float, Profile, float]] = {
    'spinning 1000 rpm': (False, 1000.0, Profile([(1.0, 1000, 1000)]), 0.5),
    'spinning 4000 rpm': (False, 4000.0, Profile([(1.0, 4000, 4000)]), 0.5),
    'forced to 1500 rpm': (
        True,
        0.0,
        Profile([(0.3, 700, 700), (0.2, 700, 1500), (0.5, 1500, 1500)]),
        0.7,
    ),
}


@lru_cache
def closed_loop(name: str) -> Loop:
    """Run one of LOOPS, with 0.1 A of noise and a load step of half the rated torque."""
    forced, start, profile, step_time = LOOPS[name]
    rated = PmsmParameters().rated_torque
    parameters = PmsmParameters(current_noise=0.1, load_step=0.5 * rated, load_step_time=step_time)
    feedback = Sensorless(design_of(**ROBUST), parameters, forced=forced)
    drive = Drive(parameters, 3, feedback=feedback, profile=profile, start_speed=start * RPM)
    per_row = round(1e-3 * RATE)
    rows = []
    for _ in range(round(profile.duration * 1e3)):
        truth = drive.run(per_row).truth[-1]
        wrong = math.degrees(math.remainder(feedback.angle - truth[1], 2.0 * math.pi))
        speed = feedback.omega / parameters.pole_pairs
        rows.append(
            (
                wrong,
                100.0 * (speed / truth[0] - 1.0) if truth[0] else 0.0,
                truth[0] / RPM,
                truth[4] / RPM,
                truth[3],
                float(feedback.mode == RUNNING),
            )
        )
    table = np.array(rows).T
    return Loop(table[0], table[1], table[2], table[3], table[4], table[5] > 0.5)


def loop_values() -> Values:
    """The values of the closed loop."""
    for name in LOOPS:
        loop = closed_loop(name)
        led = loop.running
        yield f'loop {name}: angle', float(np.abs(loop.angle_error[led]).max())
        yield f'loop {name}: speed', float(np.abs(loop.speed_error[led]).max())
        yield f'loop {name}: least', float(loop.speed[led].min())
        yield f'loop {name}: lead', float(np.argmax(led)) if led.any() else math.inf
        yield f'loop {name}: end', float(100.0 * abs(loop.speed[-1] / loop.reference[-1] - 1.0))
