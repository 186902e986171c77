# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""T6: speeds at which the rotor comes back to the same angle at every clock tick."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_pkg.joints.sensor import random_stream
from sim_pkg.pmsm.profiles import Profile
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.pmsm.observer import (
    PAPER,
    ROBUST,
    design_of,
    first_state,
    run_log,
    start_state,
)
from sim_pkg.reproduce.pmsm.reference import FLUX, GAMMA, POLE_PAIRS, Signals, settling, signals

RATE = 20000.0
DURATION = 0.6  # s
SEEDS = 10
NOISE = 0.1  # A
STEP, FULL_SCALE = 120.0 / 4096.0, 60.0  # A, of the 12-bit ADC
RPM = math.pi / 30.0

FORMS: dict[str, dict[str, Any]] = {
    'paper': {**PAPER, 'initial_flux': 0.0},
    'gated': {
        **ROBUST,
        'second_period': 1.0,
        'initial_flux': 0.0,
        'flux_min': 0.5e-3,
        'flux_max': 8e-3,
    },
    'dithered': {**ROBUST, 'initial_flux': 0.0, 'flux_min': 0.5e-3, 'flux_max': 8e-3},
}
BAD_SPEEDS = (1714.2857, 3428.5714, 5142.8571, 6857.1429)  # rpm: 1, 2, 3, 4 turns per tick


def noisy(rpm: float, seed: int) -> tuple[Signals, NDArray[np.float64]]:
    """Return truth and samples at constant speed, with noisy and quantised currents.

    Samples have shape (n + 1, 4): two currents [A], two mean voltages [V].
    """
    times = np.arange(round(DURATION * RATE) + 1, dtype=np.float64) / RATE
    truth = signals(times, profile=Profile([(1.0, rpm, rpm)]))
    half = 0.5 * rpm * RPM * POLE_PAIRS / RATE
    mean = truth.voltage * np.exp(-1j * half) * math.sin(half) / half
    noise = NOISE * random_stream(seed, 'aliasing').standard_normal((len(times), 2))
    read = np.column_stack((truth.current.real, truth.current.imag)) + noise
    read = STEP * np.round(np.clip(read, -FULL_SCALE, FULL_SCALE) / STEP)
    return truth, np.column_stack((read, mean.real, mean.imag))


def count_fires(x: NDArray[np.float64]) -> int:
    """Return the number of replacements of xi_hat: steps too large for the flow within a sample.

    `x` is xi_hat after each sample, shape (n,) [1/Wb].
    """
    return int((np.abs(np.diff(x)) > 2.0 * math.sqrt(GAMMA)).sum())


def outcome(
    gains: dict[str, Any], rpm: float, seeds: int, *, cold: bool = True
) -> tuple[list[float], list[int]]:
    """Return, per seed, settling from the unknown start [ms, nan: never] and later replacements.

    Parameters
    ----------
    cold : start as an observer without samples; else at eta = 1 and xi_hat = 0, with a rotor that
        is known to turn.
    """
    design = design_of(**gains)
    times, fires = [], []
    omega = rpm * RPM * POLE_PAIRS
    for seed in range(seeds):
        truth, samples = noisy(rpm, seed)
        start = first_state(design, samples[0])
        if not cold:
            start = start_state(design, samples[0], 1.0 + 0.0j, 0.0, seen=omega)
        log = run_log(design, samples, 1.0 / RATE, start)
        error = np.angle(np.exp(1j * (log.angle - truth.theta[1:])))
        times.append(settling(truth.time[1:], error, math.radians(5.0)))
        settled = start_state(
            design, samples[0], 1.0 + 0.0j, 1.0 / FLUX, -1j * omega * FLUX, seen=omega
        )
        fires.append(count_fires(run_log(design, samples, 1.0 / RATE, settled).x))
    return times, fires


def values(seeds: int = SEEDS) -> Values:
    """Rows T6, and the four bad speeds with the default observer."""
    for rpm, form in product((BAD_SPEEDS[0], BAD_SPEEDS[2], 6000.0), FORMS):
        times, fires = outcome(FORMS[form], rpm, seeds, cold=False)
        name = f'T6 {rpm:.0f} rpm {form}'
        yield f'{name} lost', float(np.isnan(times).sum())
        if form != 'paper' or rpm not in BAD_SPEEDS:  # there it never settles
            yield f'{name} t_th5', float(np.median(times))
        yield f'{name} fires', float(np.mean(fires))
    for speed in BAD_SPEEDS:
        times, fires = outcome(ROBUST, speed, seeds)
        yield f'T6 default {speed:.0f} rpm lost', float(np.isnan(times).sum())
        yield f'T6 default {speed:.0f} rpm fires', float(np.sum(fires))
