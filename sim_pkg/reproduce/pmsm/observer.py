# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `pmsm` itself, run over samples from a chosen start."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import Circle
from estimator_pkg.driver.drive_channel import trace
from estimator_pkg.engine.calls import functions_of
from estimator_pkg.estimate import INITIALISING, NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.observers.pmsm.observer import OBSERVER, Gains
from estimator_pkg.observers.pmsm.state import Coefficients, Design, State
from estimator_pkg.observers.pmsm.watch import BLIND
from sim_pkg.reproduce.pmsm.motor import (
    FLUX,
    GAMMA,
    INDUCTANCE,
    K_ETA,
    K_I,
    K_P,
    LOG,
    POLE_PAIRS,
    RESISTANCE,
    Run,
    Signals,
    drive_samples,
    start_frame,
)

observer = OBSERVER.module

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


def design_of(**gains: Any) -> Design:
    """The observer's design at these gains."""
    return observer.design(Gains(**gains), Circle())


class Log(NamedTuple):
    """Arrays of shape (n,), one entry after each sample but the first; speed electrical."""

    h: NDArray[np.complex128]
    z: NDArray[np.complex128]
    x: NDArray[np.float64]
    speed: NDArray[np.float64]
    status: NDArray[np.int8]
    reasons: NDArray[np.int64]

    @property
    def angle(self) -> NDArray[np.float64]:
        """Rotor angle of the observer, whether it is published or not [rad]."""
        return np.angle(self.z * np.where(self.x < 0.0, -1.0, 1.0))


def sample_of(row: NDArray[np.float64]) -> DriveSample:
    """Return a row of samples, shape (4,), as the observer takes it."""
    sample = DriveSample()
    sample.i_alpha, sample.i_beta, sample.u_alpha, sample.u_beta = map(float, row)
    return sample


def first_state(design: Design, first: NDArray[np.float64]) -> State:
    """Return the observer's state after the first sample, shape (4,)."""
    state = State()
    observer.start(observer, state, design, sample_of(first))
    return state


def start_state(
    design: Design,
    first: NDArray[np.float64],
    z: complex,
    x: float,
    h: complex = 0j,
    seen: float = 0.0,
) -> State:
    """Return the observer's state at a chosen start.

    Parameters
    ----------
    first : shape (4,), the first sample: two currents [A], two voltages [V].
    z, x, h : frame, xi_hat [1/Wb] and back-EMF [V].
    seen : electrical speed [rad/s] that the watch has observed for long; 0: no observation, and
        the robust form searches for the rotor first.
    """
    state = first_state(design, first)
    core, watch = state.core, state.watch
    current = z.conjugate() * complex(first[0], first[1])
    y = z * complex(-h.imag, h.real)
    core.i1, core.i2, core.h1, core.h2 = current.real, current.imag, h.real, h.imag
    core.z1, core.z2, core.x = z.real, z.imag, float(x)
    core.y_alpha, core.y_beta = y.real, y.imag
    if seen:
        watch.level = abs(seen) * FLUX
        watch.mean_h2, watch.rate, watch.calm, watch.reasons = -watch.level, seen, 1.0, 0
    return state


def run_states(design: Any, samples: NDArray[np.float64], dt: float, state: Any) -> NDArray[Any]:
    """Return the state at each of `samples`, shape (n + 1, 4), from that at the first of them.

    Shape (n + 1,), of `State.dtype`.
    """
    coefficients: Any = Coefficients()
    observer.prepare(coefficients, design, dt)
    count, engine = len(samples) - 1, functions_of(observer)
    states = _array(state, count + 1)
    if engine is not None:
        pointers = states.ctypes.data + states.itemsize * np.arange(count + 1)
        arrays = pointers, _array(coefficients), _array(design)
        rows = np.ascontiguousarray(samples[1:], float)
        engine.trace(*(each.ctypes.data for each in arrays), count, rows.ctypes.data)
        return states
    made = [state, *(State() for _ in range(count))]
    trace(observer, made, coefficients, design, count, samples[1:].ravel().tolist())
    for row, each in zip(states, made):
        each.write(row)
    return states


def _array(record: Any, count: int = 1) -> NDArray[Any]:
    """Return an array of records, the first of which has these values."""
    array = np.zeros(count, type(record).dtype)
    record.write(array[0])
    return array


def run_log(design: Design, samples: NDArray[np.float64], dt: float, state: State) -> Log:
    """Run the observer over `samples`, shape (n + 1, 4), from the state at the first of them."""
    states = run_states(design, samples, dt, state)[1:]
    core, watch = states['core'], states['watch']
    reasons = watch['reasons']
    settled = (reasons == 0) & (watch['calm'] >= design.hold)
    status = np.where(settled, TRACKING, INITIALISING)
    status = np.where(reasons & BLIND, NOT_OBSERVABLE, status)
    return Log(
        core['h1'] + 1j * core['h2'],
        core['z1'] + 1j * core['z2'],
        core['x'],
        states['out']['speed'],
        status.astype(np.int8),
        reasons,
    )


def observer_run(variant: str, direction: int, eta0_deg: float, xi0: float) -> Run:
    """Run the observer `pmsm`, ``form: paper``, on exact samples of P1 at LOG Hz."""
    truth, rows = drive_samples(direction)
    design = design_of(variant=variant, **PAPER)
    z = start_frame(truth.theta[0], truth.omega[0], eta0_deg)
    log = run_log(design, rows, 1.0 / LOG, start_state(design, rows[0], z, xi0))
    # row 0 is the start, before the observer took a sample
    _, angle, speed, current, voltage = truth
    later = Signals(truth.time[1:], angle[1:], speed[1:], current[1:], voltage[1:])
    return Run(later, log.h, log.z, log.x, 0, 0)
