# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""``--part speed``: our sensorless observer and motulator's, on the same simulated drive.

Both know the true resistance and inductance. motulator also knows the true flux (ours gets one that
is wrong by a fifth) and starts at the true angle and speed. Both speed outputs have their -3 dB
frequency at `BANDWIDTH_HZ`. Ours is tuned for low noise (`QUIET`), with one tuning for all cases,
like motulator's. Users cannot know which voltage motulator expects, so it runs with each of
`TIMINGS` and counts with the best one, chosen for each number separately.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Side, interleave, not_run, ratio, row
from estimator_pkg import registry
from estimator_pkg.driver.configuration import Configuration, JointSettings
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.parameters import build
from estimator_pkg.progress import progress
from sim_pkg.pmsm.simulator import PmsmSimulatorParameters, Source

Array = NDArray[np.float64]

BANDWIDTH_HZ = 100.0
NOISE = 0.1  # of the currents [A]
SETTLED = 0.3  # ignored at the start [s]
RATE = 20000.0  # Hz
FASTER = 10.0  # required ratio of motulator's cost per sample to our compiled one
FLUX_ERROR = 1.2  # nominal flux that ours gets, over the true one
MOTOR = {'resistance': 0.06, 'inductance': 33.75e-6, 'flux': 1.9e-3, 'pole_pairs': 7}
FLUX = FLUX_ERROR * MOTOR['flux']
# The angle loop raises the gain at 100 Hz a little: with this low-pass the total is -3 dB there.
QUIET = {
    'relative_bandwidth': 0.3,
    'k_eta': 0.8 / FLUX,
    'epsilon': 150e-6,
    'speed_filter_hz': 0.99 * BANDWIDTH_HZ,
}
CASES: dict[str, dict[str, Any]] = {
    '500 rpm': {'profile': 'constant', 'speed_rpm': 500.0},
    '2000 rpm': {'profile': 'constant', 'speed_rpm': 2000.0},
    '6000 rpm': {'profile': 'constant', 'speed_rpm': 6000.0},
    'P1': {'profile': 'p1'},
}
DURATION = {'P1': 0.7}
# |a^2/(s + a)^2| = 1/sqrt(2) at s = j a sqrt(sqrt(2) - 1): motulator's speed from the true one
ALPHA = 2.0 * math.pi * BANDWIDTH_HZ / math.sqrt(math.sqrt(2.0) - 1.0)


class Signal(NamedTuple):
    """Samples of a drive and their ground truth.

    stamps : shape (n,), int64 ns.
    samples : shape (n, 4) [A, V].
    angle, speed : shape (n,), electrical [rad, rad/s].
    """

    stamps: NDArray[np.int64]
    samples: Array
    angle: Array
    speed: Array


class Estimate(NamedTuple):
    """Electrical angle [rad] and speed [rad/s], shape (n,)."""

    angle: Array
    speed: Array


def simulate(values: dict[str, Any], duration: float = 1.0, seed: int = 1) -> Signal:
    """Return a run of the simulator ``pmsm``."""
    parameters = build(
        PmsmSimulatorParameters, {'current_noise': NOISE, 'sample_rate': RATE, **MOTOR, **values}
    )
    rows = Source(parameters, seed).take(round(duration * RATE / parameters.every))
    return Signal(10**18 + rows.stamps_ns, rows.values, rows.true[:, 0], rows.true[:, 1])


def make_joint() -> DriveJoint:
    """Return our observer with a wrong flux."""
    observer = registry.find(registry.OBSERVERS, 'pmsm')
    values = {**MOTOR, 'flux': FLUX, **QUIET}
    configuration = Configuration(observer, values, settings=JointSettings)
    return DriveJoint(observer, *configuration.for_joint(''))


def ours(signal: Signal) -> Estimate:
    """Return our estimate."""
    out = make_joint().take(signal.stamps, signal.samples)
    return Estimate(out.electrical_angle, out.electrical_speed)


TIMINGS: dict[str, Callable[[Array], Array]] = {
    'reported': lambda u: u,  # that of the past interval
    'ahead': lambda u: np.append(u[1:], u[-1]),  # of the coming one, as a drive knows it
    'at the sample': lambda u: 0.5 * (u + np.append(u[1:], u[-1])),
}


def motulator(signal: Signal, timing: str = 'reported', count: int | None = None) -> Estimate:
    """Return motulator's estimate; raise ImportError if it is not installed."""
    from motulator.drive.control.sm._common import Observer, ObserverCfg
    from motulator.drive.utils import SynchronousMachinePars

    machine = SynchronousMachinePars(
        n_p=MOTOR['pole_pairs'],
        R_s=MOTOR['resistance'],
        L_d=MOTOR['inductance'],
        L_q=MOTOR['inductance'],
        psi_f=MOTOR['flux'],
    )
    observer = Observer(ObserverCfg(machine, sensorless=True, alpha_o=ALPHA))
    observer.est.theta_m, observer.est.w_m = float(signal.angle[0]), float(signal.speed[0])
    i = signal.samples[:, 0] + 1j * signal.samples[:, 1]
    u = TIMINGS[timing](signal.samples[:, 2] + 1j * signal.samples[:, 3])
    count = len(i) if count is None else count
    angle, speed = np.empty(count), np.empty(count)
    output, update, period = observer.output, observer.update, 1.0 / RATE
    for k, (current, voltage) in enumerate(zip(i[:count].tolist(), u[:count].tolist())):
        feedback = output(SimpleNamespace(i_ss=current, u_ss=voltage))
        angle[k], speed[k] = feedback.theta_m, feedback.w_m
        update(period, feedback)
    return Estimate(angle, speed)


def errors(signal: Signal, estimate: Estimate) -> tuple[float, float]:
    """Return rms errors of mechanical speed [rpm] and electrical angle [deg], after settling."""
    late = (signal.stamps - signal.stamps[0]) * 1e-9 >= SETTLED
    error = estimate.angle[late] - signal.angle[late]
    error = np.degrees((error + math.pi) % (2.0 * math.pi) - math.pi)
    speed = (estimate.speed[late] - signal.speed[late]) * 30.0 / math.pi / MOTOR['pole_pairs']
    return float(np.sqrt(np.mean(speed**2))), float(np.sqrt(np.mean(error**2)))


def drives(rounds: int = 7) -> list[dict[str, Any]]:
    """Return rows: errors in each case, ours limited by motulator's, and the cost per sample."""
    try:
        import motulator as _  # noqa: F401  (checks that it is installed)
    except ImportError:
        return [not_run('motulator', 'motulator is not installed')]
    rows = []
    with progress('drives', len(CASES) * (1 + len(TIMINGS))) as advance:
        for name, values in CASES.items():
            signal = simulate(values, DURATION.get(name, 1.0))
            mine = errors(signal, ours(signal))
            advance(1)
            theirs = []
            for timing in TIMINGS:
                theirs.append(errors(signal, motulator(signal, timing)))
                advance(1)
            for index, (what, unit) in enumerate((('speed', 'rpm'), ('angle', 'deg'))):
                peer = {timing: each[index] for timing, each in zip(TIMINGS, theirs)}
                best = min(peer, key=lambda timing: peer[timing])
                why = f'motulator at its best: voltage {best}'
                title = f'{what} rms, {name}'
                rows.append(row(title, mine[index], unit, limit=peer[best], peer=peer, why=why))
    return rows + _costs(rounds)


def _costs(rounds: int) -> list[dict[str, Any]]:
    signal = simulate({'profile': 'constant', 'speed_rpm': 2000.0}, 0.2)
    few = 1000
    joint = make_joint()
    with mock.patch('estimator_pkg.driver.joint.functions_of', lambda module: None):
        plain = make_joint()

    def own(which: DriveJoint, count: int) -> Side:
        def side(number: int) -> float:
            which.reset()
            start = time.thread_time()
            which.take(signal.stamps[:count], signal.samples[:count])
            return (time.thread_time() - start) / count

        return side

    def theirs(number: int) -> float:
        start = time.thread_time()
        motulator(signal, count=few)
        return (time.thread_time() - start) / few

    times = interleave(
        {'ours': own(joint, len(signal.stamps)), 'plain': own(plain, few), 'motulator': theirs},
        rounds,
    )
    rows = [
        row('motulator, one sample', 1e6 * min(times['motulator']), 'us'),
        row('ours in plain Python, one sample', 1e6 * min(times['plain']), 'us'),
        row('motulator / plain', ratio(times['motulator'], times['plain']), 'times'),
    ]
    if joint.compiled is None:
        return [*rows, not_run('compiled', 'the package was installed without a C compiler')]
    faster = ratio(times['motulator'], times['ours'])
    return [
        *rows,
        row('ours compiled, one sample', 1e6 * min(times['ours']), 'us'),
        row('motulator / compiled', faster, 'times', limit=FASTER, at_least=True),
    ]
