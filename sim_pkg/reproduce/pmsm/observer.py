# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `pmsm` itself, run over samples from a chosen start."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.compiled import available, compiled
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.contract import TRACKING
from estimator_pkg.observers.pmsm.drive import DriveFunctions
from estimator_pkg.observers.pmsm.gains import Gains
from estimator_pkg.observers.pmsm.observer import build
from sim_pkg.reproduce.pmsm.reference import (
    FLUX,
    GAMMA,
    INDUCTANCE,
    K_ETA,
    K_I,
    K_P,
    POLE_PAIRS,
    RESISTANCE,
    Errors,
    Run,
    Signals,
    errors,
    start_frame,
)
from sim_pkg.reproduce.pmsm.schemes import Samples

COMPILE_FROM = 100_000  # samples from which compiling pays off

PAPER: dict[str, Any] = {
    'form': 'paper',
    'resistance': RESISTANCE,
    'inductance': INDUCTANCE,
    'flux': FLUX,
    'pole_pairs': POLE_PAIRS,
    'k_p': K_P,
    'k_i': K_I,
    'k_eta': K_ETA,
    'gamma': GAMMA,
}
ROBUST: dict[str, Any] = {
    'resistance': RESISTANCE,
    'inductance': INDUCTANCE,
    'flux': FLUX,
    'pole_pairs': POLE_PAIRS,
}


def functions_of(**gains: Any) -> DriveFunctions:
    """The observer's functions at these gains."""
    return build(Gains(**gains), Circle())


def make_log(functions: DriveFunctions) -> Callable[..., tuple]:
    """A loop that logs h, z, xi_hat, the speed output, status and reasons after each sample."""
    step, output, reasons_of = functions.step, functions.output, functions.reasons

    def log(
        state: Any,
        coefficients: tuple,
        design: tuple,
        samples: NDArray[np.float64],
        out_h: NDArray[np.complex128],
        out_z: NDArray[np.complex128],
        out_x: NDArray[np.float64],
        speed: NDArray[np.float64],
        status: NDArray[np.int8],
        reasons: NDArray[np.int16],
    ) -> tuple:
        for k in range(len(samples)):
            row = samples[k]
            sample = (row[0], row[1], row[2], row[3])
            state = step(state, coefficients, design, sample, 0.0)
            core, _, _, _, (speed[k], _, _), _, _, _ = state
            _, out_h[k], out_z[k], out_x[k], _, _ = core
            position, velocity, spare, status[k] = output(state, coefficients, design, sample, 0.0)
            reasons[k] = reasons_of(state)
        return state

    return log


class Log(NamedTuple):
    """Arrays of shape (n,), one entry after each sample but the first; speed electrical."""

    h: NDArray[np.complex128]
    z: NDArray[np.complex128]
    x: NDArray[np.float64]
    speed: NDArray[np.float64]
    status: NDArray[np.int8]
    reasons: NDArray[np.int16]

    @property
    def angle(self) -> NDArray[np.float64]:
        """Rotor angle of the observer, whether it is published or not [rad]."""
        return np.angle(self.z * np.where(self.x < 0.0, -1.0, 1.0))


def start_state(
    functions: DriveFunctions,
    first: NDArray[np.float64],
    z: complex,
    x: float,
    h: complex = 0j,
    seen: float = 0.0,
) -> Any:
    """Return the observer's state at a chosen start.

    Parameters
    ----------
    first : shape (4,), the first sample: two currents [A], two voltages [V].
    z, x, h : frame, xi_hat [1/Wb] and back-EMF [V].
    seen : electrical speed [rad/s] that the watch has observed for long; 0: no observation, and
        the robust form searches for the rotor first.
    """
    state: Any = functions.init(tuple(float(value) for value in first), functions.design())
    current = complex(first[0], first[1])
    y = z * complex(-h.imag, h.real)
    _, clock, registers, watch, *others = state
    if seen:
        chi = abs(seen) * FLUX
        _, _, _, _, power, _, _, _ = watch
        watch = (chi, complex(0.0, -chi), seen, 0.0, power, 0.0, 1.0, 0)
    core = (z.conjugate() * current, h, z, float(x), current, y)
    return (core, clock, registers, watch, *others)


def run_log(
    functions: DriveFunctions,
    samples: NDArray[np.float64],
    dt: float,
    state: Any,
    *,
    fast: bool | None = None,
) -> Log:
    """Run the observer over `samples`, shape (n + 1, 4), from the state at the first of them."""
    count = len(samples) - 1
    design = functions.design()
    log = Log(
        np.empty(count, complex),
        np.empty(count, complex),
        np.empty(count),
        np.empty(count),
        np.empty(count, np.int8),
        np.empty(count, np.int16),
    )
    loop = make_log(functions)
    if (available() and count >= COMPILE_FROM) if fast is None else fast:
        compiled(loop)(
            state, functions.prepare(design, dt), design, np.ascontiguousarray(samples[1:]), *log
        )
    else:
        loop(state, functions.prepare(design, dt), design, samples[1:].tolist(), *log)
    return log


def table_of(samples: Samples) -> NDArray[np.float64]:
    """Return exact currents and mean voltages as rows, shape (n + 1, 4)."""
    return np.column_stack(
        (
            samples.truth.current.real,
            samples.truth.current.imag,
            samples.mean.real,
            samples.mean.imag,
        )
    )


def observer_run(
    functions: DriveFunctions, samples: Samples, rate: float, eta0_deg: float, xi0: float
) -> tuple[Run, Errors]:
    """Run the observer on exact samples; return it in the form of a reference run."""
    truth = samples.truth
    rows = table_of(samples)
    z = start_frame(truth.theta[0], truth.omega[0], eta0_deg)
    log = run_log(functions, rows, 1.0 / rate, start_state(functions, rows[0], z, xi0))
    later = Signals(
        truth.time[1:], truth.theta[1:], truth.omega[1:], truth.current[1:], truth.voltage[1:]
    )
    run = Run(later, log.h, log.z, log.x, 0, 0)
    return run, errors(run)


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
