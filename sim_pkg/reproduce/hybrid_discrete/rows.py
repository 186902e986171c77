# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of the hybrid paper: its example (B1 to B3) and the gripper joint (C)."""

from __future__ import annotations

import numpy as np

from estimator_pkg.models import gripper
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.hybrid_discrete.runs import GRIPS_AT, example, grip, plant


def b1_values() -> Values:
    """The values of B1."""
    model, times, states, z = plant(1e-3)
    for t in (0.5, 1.0, 2.0, 5.0, 20.0):
        i = round(t / 1e-3)
        for name, row in (('x', states[i]), ('z', z[i])):
            for j, value in enumerate(row):
                yield f'B1 {t:g} s {name}{j + 1}', value


# B2: times until the errors stay below (.05, 1, .05, 1), in the first interval and from the fourth

WHAT = ('zeta2', 'theta1', 'zeta4', 'theta2')
FINE, COARSE = 1e-4, 1e-3  # [s]
STARTS = ((0.5, -0.5, 0.5), (2.0, -2.0, 2.0))  # other Z(0)


def b2_values() -> Values:
    """The values of B2."""
    for reset in ('none', 'states', 'all'):
        run = example(FINE, reset=reset)
        for name, value in zip(WHAT, run.settling(3, 39, FINE)):
            yield f'B2 reset {reset} {name}', value
        late = np.abs(run.state_error[round(1.0 / FINE) :]).max(axis=0)
        if reset == 'none':
            for name, value in zip(WHAT, run.settling(0, 0, FINE)):
                yield f'B2 first interval {name}', value
            yield 'B2 x error, no reset x2', late[1]
            yield 'B2 x error, no reset x4', late[3]
        if reset == 'all':
            yield 'B2 x error x2', late[1]
            yield 'B2 x error x4', late[3]
            yield 'B2 Z k=2', run.discrete_error[2]
            yield 'B2 Z k=2..40', run.discrete_error[2:].max()
            for j in range(3):
                yield f'B2 Zhat(2) z{j + 1}', run.z_hat[2, j]
    for start in STARTS:
        yield f'B2 Z from {start}', example(FINE, start=start, events=2).discrete_error[2]
    chattering = example(FINE, form='explicit', reset='none')
    for name, first, last in (('first interval', 0, 0), ('reset none', 3, 39)):
        for what, value in zip(WHAT, chattering.settling(first, last, FINE)):
            yield f'B2 {name}, explicit {what}', value
    yield 'B2 Z, explicit k=2', chattering.discrete_error[2]
    yield 'B2 Z, explicit k=2..40', chattering.discrete_error[2:].max()
    states = example(COARSE, reset='states')
    for name, first, last in (('first interval', 0, 0), ('reset states', 3, 39)):
        for what, value in zip(WHAT, states.settling(first, last, COARSE)):
            yield f'B2 {name} at 1 ms {what}', value
    late = np.abs(states.state_error[round(1.0 / COARSE) :]).max(axis=0)
    yield 'B2 x error at 1 ms x2', late[1]
    yield 'B2 x error at 1 ms x4', late[3]
    coarse = example(COARSE)
    yield 'B2 Z at 1 ms k=2', coarse.discrete_error[2]
    yield 'B2 Z at 1 ms k=2..40', coarse.discrete_error[2:].max()
    copied = example(COARSE, discrete='copy').discrete_error
    for k in (0, 1, 2, 3, 10, 20):
        yield f'B2 copy k={k}', copied[k]
    explicit = example(COARSE, form='explicit')
    yield 'B2 explicit 1 ms Z', explicit.discrete_error[2:].max()


def b3_values() -> Values:
    """The values of B3."""
    for noise in (0.0, 1e-6, 1e-5, 1e-4, 1e-3):
        error = example(COARSE, noise=noise).discrete_error[4:]
        yield f'B3 noise {noise:g}', np.sqrt(np.mean(np.square(error)))
        if noise in (1e-6, 1e-3):
            yield (
                f'B3 noise, copy {noise:g}',
                example(COARSE, noise=noise, discrete='copy').discrete_error[40],
            )


# C: relative error of Z, in % of the entry, on the gripper joint

GRIP_TIMES = (1.99, 2.5, 3.0, 3.99)  # [s]
CASCADE = {'discrete': 'inversion', 'steps': 3, 'settle': 0.0, 'virtual': 0.1}


def _error(z: np.ndarray, t: float) -> float:
    """Largest relative error of an entry of Z at t [%]."""
    true = np.array(gripper.OPEN if t < GRIPS_AT else gripper.CLOSED)
    return float(100.0 * np.abs(z[round(t * 1e3)] / true - 1.0).max())


def c_values() -> Values:
    """The values of C."""
    exact = grip(0, **CASCADE)
    for t in GRIP_TIMES:
        yield f'C cascade, flush, exact {t:g} s', _error(exact.z, t)
    blind = grip(0, mode='same', **CASCADE)
    for t in (2.4, 3.0):
        yield f'C cascade, no flush, exact {t:g} s', _error(blind.z, t)
    yield 'C cascade, flush, 16 bit 3 s', _error(grip(65536, **CASCADE).z, 3.0)
    for name, counts in (('exact', 0), ('16 bit', 65536), ('12 bit', 4096)):
        run = grip(counts)
        for t in GRIP_TIMES:
            yield f'C regression, {name} {t:g} s', _error(run.z, t)
        if name == '16 bit':
            at = round(GRIPS_AT * 1e3)
            before, after = (
                np.sqrt(np.mean(np.square(part)))
                for part in (run.velocity_error[at - 500 : at], run.velocity_error[at : at + 500])
            )
            yield 'C velocity', after / before
            yield 'C not converged', 1e-3 * int(np.argmax(run.converged[at + 1 :]))
