# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""T3 to T5 and T7: ways to sample, starts by scheme X, bias from wrong data, controlled drive."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import product

import numpy as np

from estimator_pkg.observers.pmsm.state import Design
from sim_pkg.pmsm.drive import Drive
from sim_pkg.pmsm.parameters import PmsmParameters
from sim_pkg.pmsm.profiles import P1, Profile
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.pmsm.continuous_rows import shown
from sim_pkg.reproduce.pmsm.observer import PAPER, design_of, observer_run, run_log, start_state
from sim_pkg.reproduce.pmsm.reference import (
    CONTINUOUS,
    FLUX,
    HYBRID,
    ID_POST,
    INDUCTANCE,
    POLE_PAIRS,
    RESISTANCE,
    STARTS,
    Run,
    Signals,
    errors,
    settle_times,
    signals,
)
from sim_pkg.reproduce.pmsm.schemes import (
    NAMES,
    X_HELD,
    X_TURNED,
    Samples,
    drive_samples,
    sampled_run,
)

RATES = (2000, 5000, 10000, 20000, 50000, 100000)  # Hz, of T3; T4 has the first four
RPM = math.pi / 30.0
KINDS = {'cont': CONTINUOUS, 'hyb': HYBRID, 'id_post': ID_POST}
VARIANTS = {'cont': 'continuous', 'hyb': 'hybrid', 'id_post': 'identifier'}
# an unbounded frame speed diverges here; ours is bounded and settles
BOUNDED = (2000, 'G', 'hyb')
SPEEDS = ((6000.0, 5.0), (2000.0, 10.0), (500.0, 10.0))  # rpm, i_q [A]
# relative errors of R and of L
WRONG = ((0.1, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.1), (0.0, 0.3), (0.0, -0.3))


@lru_cache
def exact_samples(rate: int, direction: int = 1) -> Samples:
    """Return the exact signals of P1 as a drive publishes them."""
    return drive_samples(float(rate), direction)


def late_errors(run: Run) -> tuple[float, float]:
    """Return the largest errors of angle [deg] and speed [%] in the last 0.3 s; nan: diverged."""
    wrong = errors(run)
    late = run.truth.time >= run.truth.time[-1] - 0.3 - 1e-9
    return (math.degrees(np.abs(wrong.angle[late]).max()), 100.0 * np.abs(wrong.speed[late]).max())


def scheme_values() -> Values:
    """Rows T3: ways to sample; those that diverge have no late errors.

    At 1 kHz (fewer than two samples per turn at top speed) no scheme works. At 2 kHz and one pass a
    late crossing of a bound may move by one swing of 8 ms.
    """
    for rate, (way, scheme), observer in product(RATES, enumerate(NAMES), ('hyb', 'id_post')):
        run = sampled_run(exact_samples(rate), float(rate), way, KINDS[observer], 0.0, 0.0)
        times = settle_times(run)
        name = f'T3 {rate} {scheme.replace(" ", "_")} {observer}'
        yield f'{name} t_w', shown(times['t_w'])
        yield f'{name} t_th5', shown(times['t_th5'])
        angle, speed = late_errors(run)
        if not math.isnan(angle):
            yield f'{name} max angle', angle
            yield f'{name} max speed', speed
    for way, scheme in enumerate(NAMES):
        for observer in ('hyb', 'id_post'):
            run = sampled_run(exact_samples(1000), 1000.0, way, KINDS[observer], 0.0, 0.0)
            angle, speed = late_errors(run)
            settled = not math.isnan(settle_times(run)['t_th5'])
            yield (
                f'T3 1000 {scheme.replace(" ", "_")} {observer} holds',
                float(settled and angle < 2.0 and speed < 2.0),
            )


def paper_observer(name: str) -> Design:
    """The design of `pmsm` in the paper's form."""
    return design_of(variant=VARIANTS[name], **PAPER)


def start_values() -> Values:
    """Rows T4: starts by scheme X.

    The accuracy of the averaged voltage shifts slow starts: the tolerance follows the rate.
    """
    for start, observer in product(STARTS, VARIANTS):
        direction, eta0, xi0 = STARTS[start]
        for rate in RATES[:4]:
            if (rate, start, observer) == BOUNDED:
                continue
            run, wrong = observer_run(
                paper_observer(observer), exact_samples(rate, direction), float(rate), eta0, xi0
            )
            times = settle_times(run)
            for what in ('t_w', 't_th5'):
                yield f'T4 {rate} {start} {observer} {what}', shown(times[what])


def bias_values() -> Values:
    """Rows T5: constant speed and current, hybrid observer at 20 kHz with wrong R or L."""
    rate, duration = 20000.0, 0.5
    for (rpm, i_q), (of_r, of_l) in product(SPEEDS, WRONG):
        profile = Profile([(1.0, rpm, rpm)])
        times = np.arange(round(duration * rate) + 1, dtype=np.float64) / rate
        truth = signals(times, profile=profile, extra_iq=i_q)
        omega = rpm * RPM * POLE_PAIRS
        half = 0.5 * omega / rate  # the mean of a turning voltage
        mean = truth.voltage * np.exp(-1j * half) * math.sin(half) / half
        gains = {
            **PAPER,
            'variant': 'hybrid',
            'resistance': RESISTANCE * (1.0 + of_r),
            'inductance': INDUCTANCE * (1.0 + of_l),
        }
        design = design_of(**gains)
        table = np.column_stack((truth.current.real, truth.current.imag, mean.real, mean.imag))
        start = start_state(design, table[0], 1.0 + 0.0j, 1.0 / FLUX)
        log = run_log(design, table, 1.0 / rate, start)
        late = slice(-2000, None)
        turned = np.angle(log.z * np.exp(-1j * truth.theta[1:]))
        name = f'T5 {rpm:.0f} rpm {i_q:g} A R{of_r:+g} L{of_l:+g}'
        angle = math.degrees(float(np.mean(turned[late])))
        yield f'{name} angle', angle
        yield f'{name} theory', angle
        yield f'{name} xi', 100.0 * (float(np.mean(log.x[late])) * FLUX - 1.0)
        speed = float(np.mean(np.abs(log.h[late]) * log.x[late]))
        yield f'{name} speed', 100.0 * (speed / omega - 1.0)


def controlled_samples() -> Samples:
    """Return P1 driven by the simulated drive with a sensor, without noise or quantisation."""
    record = Drive(PmsmParameters(adc_bits=0), profile=Profile(P1)).run(14001)
    truth = record.truth
    current = record.samples[:, 0] + 1j * record.samples[:, 1]
    voltage = record.samples[:, 2] + 1j * record.samples[:, 3]
    times = np.arange(len(truth), dtype=np.float64) / 20000.0
    return Samples(Signals(times, truth[:, 1], POLE_PAIRS * truth[:, 0], current, voltage), voltage)


def loop_values() -> Values:
    """Rows T7: scheme X in a controlled drive.

    The controller is another than that of the references: a late crossing of a bound may move by
    one swing of 8 ms.
    """
    samples = controlled_samples()
    for voltage, observer in product(('zoh', 'rot'), KINDS):
        run = sampled_run(
            samples, 20000.0, X_HELD if voltage == 'zoh' else X_TURNED, KINDS[observer], 0.0, 0.0
        )
        times, name = settle_times(run), f'T7 {voltage} {observer}'
        for what in ('t_w', 't_th5', 't_xi'):
            yield f'{name} {what}', shown(times[what])
        angle, speed = late_errors(run)
        yield f'{name} max angle', angle
        yield f'{name} max speed', speed
