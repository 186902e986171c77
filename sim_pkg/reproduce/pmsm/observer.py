# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The observer `pmsm` itself, run over samples from a chosen start."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import Circle
from estimator_pkg.driver.drive_channel import trace
from estimator_pkg.engine.calls import functions_of
from estimator_pkg.observers.pmsm.drive import DriveSample
from estimator_pkg.observers.pmsm.observer import Gains, Pmsm
from estimator_pkg.observers.pmsm.state import Coefficients, State
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
    THRESHOLD,
    Run,
    Signals,
    drive_samples,
    start_frame,
)

observer = Pmsm

PAPER: dict[str, Any] = {
    'form': 'paper',
    'resistance': RESISTANCE,
    'inductance': INDUCTANCE,
    'flux': FLUX,
    'pole_pairs': POLE_PAIRS,
    'k_eta': K_ETA,
}


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


def observer_run(variant: str, direction: int, eta0_deg: float, xi0: float) -> Run:
    """Run the observer `pmsm`, ``form: paper``, on exact samples of P1 at LOG Hz."""
    truth, rows = drive_samples(direction)
    design = observer.design(Gains(variant=variant, **PAPER), Circle())
    design.k_p, design.k_i, design.gamma, design.threshold = (
        K_P,
        K_I,
        GAMMA,
        THRESHOLD,
    )  # as printed
    state, first = State(), DriveSample()
    first.i_alpha, first.i_beta, first.u_alpha, first.u_beta = rows[0].tolist()
    observer.start(observer, state, design, first)
    z = start_frame(truth.theta[0], truth.omega[0], eta0_deg)
    core, i = state.core, z.conjugate() * complex(truth.current[0])
    core.i1, core.i2, core.z1, core.z2 = i.real, i.imag, z.real, z.imag
    core.x = xi0
    # row 0 is the start, before the observer took a sample
    found = run_states(design, rows, 1.0 / LOG, state)['core'][1:]
    time, angle, speed, current, voltage = truth
    later = Signals(time[1:], angle[1:], speed[1:], current[1:], voltage[1:])
    return Run(later, found['h1'] + 1j * found['h2'], found['z1'] + 1j * found['z2'], found['x'])
