# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""T0 to T2 and the order of the observers: exact signals, jump, least squares, reference runs."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from itertools import product

import numpy as np

from estimator_pkg.observers.pmsm.drive import Sample
from estimator_pkg.observers.pmsm.equations import reflect
from estimator_pkg.observers.pmsm.identifier import shift, solve
from estimator_pkg.observers.pmsm.scheme import advance, prepare_scheme
from estimator_pkg.observers.pmsm.state import Registers, Scheme
from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.pmsm.reference import (
    DURATION,
    FLUX,
    GAMMA,
    HYBRID,
    ID_EARLY,
    ID_POST,
    INDUCTANCE,
    K_ETA,
    K_I,
    K_P,
    OBSERVERS,
    PERIODS,
    RESISTANCE,
    STARTS,
    Signals,
    core_of,
    errors,
    exact_grid,
    reference_run,
    settle_times,
    signals,
    vectors_of,
)
from sim_pkg.reproduce.pmsm.schemes import exponential_step

NEVER = -1.0  # settling time of a run that never settles
STARTS_DRAWN = 120
SLACK = 1.0  # ms
QUANTITIES = ('theta', 'omega', 'i_alpha', 'i_beta', 'u_alpha', 'u_beta')


def checkpoint_values() -> Values:
    """Rows T0: the exact signals, with references of six decimals."""
    for time in (0.0, 0.05, 0.123, 0.3, 0.62, 0.7):
        at = signals(np.array([time]))
        found = (
            at.theta[0],
            at.omega[0],
            at.current[0].real,
            at.current[0].imag,
            at.voltage[0].real,
            at.voltage[0].imag,
        )
        for name, value in zip(QUANTITIES, found):
            yield f'T0 {time:g} s {name}', value


def unit_values() -> Values:
    """Rows T1."""
    z, rotor = cmath.exp(1j * math.radians(30.0)), cmath.exp(1j * math.radians(160.0))
    core = core_of(1.0 - 2.0j, -5j * z.conjugate() * rotor, z)
    reflect(core)
    i, h, z = vectors_of(core)
    for name, number in (('z+', z), ('h+', h), ('i+', i)):
        yield f'T1 jump {name} re', number.real
        yield f'T1 jump {name} im', number.imag
    yield 'T1 least squares', exact_least_squares(1000.0)
    scheme = Scheme()
    prepare_scheme(scheme, RESISTANCE, INDUCTANCE, K_P, K_I, 1.0 / 20000.0)
    z = cmath.exp(1j * math.radians(20.0))
    before, now, voltage = 1.0 + 2.0j, 1.5 + 1.8j, 3.0 - 1.0j
    i, h, spare, x = exponential_step(
        z.conjugate() * before, 0j, z, 400.0, before, now, voltage, scheme, True, 2
    )
    yield 'T1 X held xi', x
    yield 'T1 X held h re', h.real
    yield 'T1 X held h im', h.imag
    core, acting = core_of(z.conjugate() * before, 0j, z, before), Sample()
    acting.i_alpha, acting.i_beta = now.real, now.imag
    acting.u_alpha, acting.u_beta = voltage.real, voltage.imag
    x, _ = advance(core, scheme, acting, 400.0, K_ETA, GAMMA, 0.0)
    i, h, z = vectors_of(core)
    yield 'T1 X xi', x
    yield 'T1 X h re', h.real
    yield 'T1 X h im', h.imag
    yield 'T1 X angle', cmath.phase(z)
    yield 'T1 X innovation', abs(z.conjugate() * now - i)


def exact_least_squares(omega: float) -> float:
    """Return xi* from exact data at constant speed: N+1 ticks of 5 ms."""
    registers, period, chi = Registers(), 5e-3, omega * FLUX
    for k in range(4):
        y = chi * cmath.exp(1j * omega * period * k)
        integral = (y - y * cmath.exp(-1j * omega * period)) / (1j * omega)
        shift(registers, PERIODS, y.real, y.imag, chi, integral.real, integral.imag)
    return solve(registers, PERIODS)[0]


@lru_cache
def grid(direction: int) -> Signals:
    """The exact signals of P1, shared by all reference runs."""
    return exact_grid(direction)


def shown(time: float) -> float:
    """Return a settling time as a row's value; NEVER for nan."""
    return NEVER if math.isnan(time) else time


def run_values() -> Values:
    """Rows T2; start G never settles without an identifier, and has no counts then."""
    for start, observer in product(STARTS, OBSERVERS):
        direction, eta0, xi0 = STARTS[start]
        run = reference_run(grid(direction), OBSERVERS.index(observer), eta0, xi0)
        name = f'T2 {start} {observer}'
        for what, time in settle_times(run).items():
            yield f'{name} {what}', shown(time)
        if not (start == 'G' and observer in ('cont', 'hyb')):
            yield f'{name} resets', run.jumps
            yield f'{name} fires', run.fires
        for at in (5, 10, 20, 50):
            yield f'{name} xi {at} ms', run.x[20 * at]
        if name == 'T2 A id_post':
            rest = errors(run)
            late = run.truth.time >= DURATION - 0.3
            yield 'T2 rest rms angle', math.degrees(np.sqrt(np.mean(rest.angle[late] ** 2)))
            yield 'T2 rest max angle', math.degrees(np.abs(rest.angle[late]).max())
            yield 'T2 rest max speed', 100.0 * np.abs(rest.speed[late]).max()
            yield 'T2 rest rms h', 1e3 * np.sqrt(np.mean(np.abs(rest.emf[late]) ** 2))


def drawn_times(count: int, seed: int = 12345) -> np.ndarray:
    """Return t_th5 [ms, inf: never] of four observers, `count` random starts, shape (count, 4)."""
    random = np.random.default_rng(seed)
    found = np.empty((count, 4))
    for row in found:
        eta0, xi0 = random.uniform(-180.0, 180.0), random.uniform(-1000.0, 1000.0)
        direction = int(random.choice([-1, 1]))
        for place, kind in enumerate((0, HYBRID, ID_POST, ID_EARLY)):
            time = settle_times(reference_run(grid(direction), kind, eta0, xi0))['t_th5']
            row[place] = math.inf if math.isnan(time) else time
    return found


def order_values() -> Values:
    """Rows on the order of the observers over random starts; other draws differ by up to 25 %."""
    times = drawn_times(STARTS_DRAWN)
    cont, hyb, post, early = times.T
    yield 'order id > hyb', later(post, hyb)
    yield 'order hyb > cont', later(hyb, cont)
    for name, column in (('cont', cont), ('hyb', hyb), ('id_post', post), ('id_early', early)):
        yield f'order median {name}', float(np.median(column))
    yield 'order never id_post', float(np.isinf(post).sum())
    yield 'order never id_early', float(np.isinf(early).sum())


def later(first: np.ndarray, second: np.ndarray) -> float:
    """Return how often the first settles later than the second, by more than SLACK.

    Parameters
    ----------
    first, second : shape (n,), settling times [ms]; inf: never.
    """
    return float(((first > second + SLACK) & ~(np.isinf(first) & np.isinf(second))).sum())
