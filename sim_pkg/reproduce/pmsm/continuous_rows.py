"""T0 to T2 and the order of the observers: exact signals, jump, least squares, reference runs."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache

import numpy as np

from estimator_pkg.observers.pmsm.equations import emf, reflect
from estimator_pkg.observers.pmsm.identifier import empty_registers, shift, solve
from estimator_pkg.observers.pmsm.scheme import advance, prepare_scheme
from sim_pkg.reproduce.contract import AT_MOST, EXACT, PERCENT, Part, Reference, Values
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
    RESISTANCE,
    STARTS,
    Signals,
    errors,
    exact_grid,
    reference_run,
    settle_times,
    signals,
)
from sim_pkg.reproduce.pmsm.references import REFERENCE_RUNS, rows
from sim_pkg.reproduce.pmsm.schemes import exponential_step

NEVER = -1.0  # settling time of a run that never settles
STARTS_DRAWN = 120
SLACK = 1.0  # ms

# time [s]: angle [rad], electrical speed [rad/s], current [A], voltage [V]
CHECKPOINTS = {
    0.0: (0.0, 2199.114858, 0.0, 1.236793, -0.091795, 4.252526),
    0.05: (109.955743, 2199.114858, 0.0, -1.236793, 0.091795, -4.252526),
    0.123: (278.418941, 3160.861198, -13.723556, -5.608936, -5.790805, -4.075322),
    0.3: (979.702191, 2521.167772, 5.739808, 11.168803, 1.598047, 5.447188),
    0.62: (1808.358039, 1676.073354, 4.056365, 1.580165, 3.126826, 1.482340),
    0.7: (2034.181243, 3665.191429, 3.435535, 0.0, 7.163439, 0.424976),
}
QUANTITIES = ('theta', 'omega', 'i_alpha', 'i_beta', 'u_alpha', 'u_beta')

UNITS = (
    Reference('T1 jump z+ re', 'zhat 30 deg, zchi 160 deg, chi 5 V', -0.342020, 1e-6),
    Reference('T1 jump z+ im', 'frame after the reset', 0.939693, 1e-6),
    Reference('T1 jump h+ re', 'back-EMF estimate after it [V]', 3.830222, 1e-6),
    Reference('T1 jump h+ im', 'back-EMF estimate after it [V]', -3.213938, 1e-6),
    Reference('T1 jump i+ re', 'current estimate after it, from 1 - 2j [A]', -1.795967, 1e-6),
    Reference('T1 jump i+ im', 'current estimate after it [A]', -1.332104, 1e-6),
    Reference(
        'T1 least squares',
        'xi* from exact data at 1000 rad/s [1/Wb]',
        526.3157894736844,
        1e-6,
        PERCENT,
    ),
    Reference('T1 X held xi', 'one step of scheme X, voltage held [1/Wb]', 399.944838697, 1e-8),
    Reference('T1 X held h re', 'back-EMF [V]', -0.481547823, 1e-8),
    Reference('T1 X held h im', 'back-EMF [V]', 0.416041635, 1e-8),
    Reference('T1 X xi', 'one step of scheme X, voltage turned [1/Wb]', 399.944873338, 1e-8),
    Reference('T1 X h re', 'back-EMF [V]', -0.481245411, 1e-8),
    Reference('T1 X h im', 'back-EMF [V]', 0.416423196, 1e-8),
    Reference('T1 X angle', 'of the frame [rad]', 0.354274917, 1e-8),
    Reference('T1 X innovation', 'of the current [A]', 2.141499360, 1e-8),
)


def checkpoint_references() -> tuple[Reference, ...]:
    """T0."""
    # the references have a resolution of 1e-6; a zero replaces a rounding residue
    return tuple(
        Reference(f'T0 {time:g} s {name}', 'exact signal of P1', value, 2e-6)
        for time, values in CHECKPOINTS.items()
        for name, value in zip(QUANTITIES, values)
    )


def checkpoint_values() -> Values:
    """The values of T0."""
    for time in CHECKPOINTS:
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
    """The values of UNITS."""
    z, rotor = cmath.exp(1j * math.radians(30.0)), cmath.exp(1j * math.radians(160.0))
    i, h, z = reflect(1.0 - 2.0j, -5j * z.conjugate() * rotor, z)
    for name, number in (('z+', z), ('h+', h), ('i+', i)):
        yield f'T1 jump {name} re', number.real
        yield f'T1 jump {name} im', number.imag
    yield 'T1 least squares', exact_least_squares(1000.0)
    scheme = prepare_scheme(RESISTANCE, INDUCTANCE, K_P, K_I, 1.0 / 20000.0)
    z = cmath.exp(1j * math.radians(20.0))
    before, now, voltage = 1.0 + 2.0j, 1.5 + 1.8j, 3.0 - 1.0j
    i, h, spare, x = exponential_step(
        z.conjugate() * before, 0j, z, 400.0, before, now, voltage, scheme, K_ETA, GAMMA, True, 2
    )
    yield 'T1 X held xi', x
    yield 'T1 X held h re', h.real
    yield 'T1 X held h im', h.imag
    i, h, z, x, spare = advance(
        z.conjugate() * before, 0j, z, 400.0, before, now, voltage, scheme, K_ETA, GAMMA, 0.0
    )
    yield 'T1 X xi', x
    yield 'T1 X h re', h.real
    yield 'T1 X h im', h.imag
    yield 'T1 X angle', cmath.phase(z)
    yield 'T1 X innovation', abs(z.conjugate() * now - i)


def exact_least_squares(omega: float) -> float:
    """Return xi* from exact data at constant speed: N+1 ticks of 5 ms."""
    registers, period, chi = empty_registers(2), 5e-3, omega * FLUX
    for k in range(4):
        y = chi * cmath.exp(1j * omega * period * k)
        integral = (y - y * cmath.exp(-1j * omega * period)) / (1j * omega)
        z = y / chi
        registers = shift(registers, emf(-1j * chi, z), chi, integral)
    return solve(registers)[0]


@lru_cache
def grid(direction: int) -> Signals:
    """The exact signals of P1, shared by all reference runs."""
    return exact_grid(direction)


def run_references() -> tuple[Reference, ...]:
    """T2."""
    found = []
    for start, observer, *numbers in rows(REFERENCE_RUNS):
        name = f'T2 {start} {observer}'
        for what, text in zip(('t_w', 't_th5', 't_th1', 't_xi', 't_h'), numbers):
            found.append(time_reference(f'{name} {what}', 'settling [ms]', text, 0.1))
        late = start == 'G' and observer in ('cont', 'hyb')  # these never settle: counts vary
        if not late:
            found.append(Reference(f'{name} resets', 'of the frame', float(numbers[5]), kind=EXACT))
            found.append(
                Reference(f'{name} fires', 'replacements of xi_hat', float(numbers[6]), kind=EXACT)
            )
        for at, text in zip((5, 10, 20, 50), numbers[7:]):
            found.append(Reference(f'{name} xi {at} ms', 'xi_hat [1/Wb]', float(text), 0.01))
    found += [
        Reference('T2 rest rms angle', 'last 0.3 s, A id_post [deg]', 0.0535, 1e-4),
        Reference('T2 rest max angle', 'last 0.3 s, A id_post [deg]', 0.172, 1e-3),
        Reference('T2 rest max speed', 'last 0.3 s, A id_post [%]', 0.061, 1e-3),
        Reference('T2 rest rms h', 'last 0.3 s, A id_post [mV]', 3.96, 0.01),
    ]
    return tuple(found)


def time_reference(name: str, what: str, text: str, tolerance: float) -> Reference:
    """Return the reference of a settling time; NEVER for a run that never settles."""
    if text == 'never':
        return Reference(name, f'{what}; -1: never', NEVER, kind=EXACT)
    return Reference(name, what, float(text), tolerance)


def shown(time: float) -> float:
    """Return a settling time as a row's value; NEVER for nan."""
    return NEVER if math.isnan(time) else time


def run_values() -> Values:
    """The values of T2."""
    for start, observer, *_ in rows(REFERENCE_RUNS):
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


ORDER = (
    Reference(
        'order id > hyb',
        f'of {STARTS_DRAWN} random starts, those where the identifier '
        'settles later than the hybrid observer',
        0.0,
        kind=AT_MOST,
        paper='significantly faster',
    ),
    Reference(
        'order hyb > cont',
        'and the hybrid one later than the continuous one',
        0.0,
        kind=AT_MOST,
        paper='consistently faster',
    ),
    Reference(
        'order median cont', 'of t_th5 [ms]; other draws differ by up to 25 %', 153.0, 15.0, PERCENT
    ),
    Reference('order median hyb', 'of t_th5 [ms]', 98.5, 15.0, PERCENT),
    Reference('order median id_post', 'of t_th5 [ms]', 30.1, 15.0, PERCENT),
    Reference('order median id_early', 'of t_th5 [ms]', 26.2, 15.0, PERCENT),
    Reference('order never id_post', 'starts that do not settle', 0.0, kind=AT_MOST),
    Reference('order never id_early', 'starts that do not settle', 0.0, kind=AT_MOST),
)


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
    """The values of ORDER."""
    times = drawn_times(STARTS_DRAWN)
    cont, hyb, post, early = times.T
    yield 'order id > hyb', later(post, hyb)
    yield 'order hyb > cont', later(hyb, cont)
    for name, column in (('cont', cont), ('hyb', hyb), ('id_post', post), ('id_early', early)):
        yield f'order median {name}', float(np.median(column))
    yield 'order never id_post', float(np.isinf(post).sum())
    yield 'order never id_early', float(np.isinf(early).sum())


def later(first: np.ndarray, second: np.ndarray) -> float:
    """Return how often the first settles later than the second; 'never' is later than any time."""
    return float(((first > second + SLACK) & ~(np.isinf(first) & np.isinf(second))).sum())


PARTS = (
    Part('T0', checkpoint_references(), checkpoint_values),
    Part('T1', UNITS, unit_values),
    Part('T2', run_references(), run_values),
    Part('order', ORDER, order_values),
)
