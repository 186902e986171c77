# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The sensorless-motor paper: Figure 2, its claims, and the observer `pmsm` on the same motor."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache

from estimator_pkg.observers.pmsm.equations import reflect
from estimator_pkg.observers.pmsm.identifier import shift, solve
from estimator_pkg.observers.pmsm.state import Registers
from sim_pkg.reproduce.contract import Reproduction, Table, Values, parts
from sim_pkg.reproduce.pmsm.motor import (
    FLUX,
    GAMMA,
    INDUCTANCE,
    K_ETA,
    K_I,
    K_P,
    OBSERVERS,
    PERIODS,
    RESISTANCE,
    STARTS,
    Run,
    continuous_run,
    core_of,
    final_errors,
    settle_times,
    vectors_of,
)
from sim_pkg.reproduce.pmsm.observer import observer_run

NEVER = -1.0  # settling time of a run that never settles
FROM = 'ACDG'  # starts of the observer `pmsm`
VARIANTS = {'cont': 'continuous', 'hyb': 'hybrid', 'id_post': 'identifier'}
NAMES = {
    'cont': '(5)',
    'hyb': '(16)',
    'id_post': '(16), (26)',
    'id_pre': '(26) before shift',
    'id_early': '(26) a tick earlier',
}
QUANTITIES = ('speed', 'angle', 'xi', 'emf')


@lru_cache
def figure_2(observer: str) -> Run:
    """Return a run of Figure 2, from start A."""
    return continuous_run(OBSERVERS.index(observer), *STARTS['A'])


def vector_values() -> Values:
    """The jump (14) to (16) and the least squares (24) on given numbers, and the gains (17)."""
    z, rotor = cmath.exp(1j * math.radians(30.0)), cmath.exp(1j * math.radians(160.0))
    core = core_of(1.0 - 2.0j, -5j * z.conjugate() * rotor, z)
    reflect(core)
    for name, number in zip(('i+', 'h+', 'z+'), vectors_of(core)):
        yield f'vector jump {name} re', number.real
        yield f'vector jump {name} im', number.imag
    registers, omega, period = Registers(), 1000.0, 5e-3
    chi = omega * FLUX
    for k in range(4):
        y = chi * cmath.exp(1j * omega * period * k)
        integral = (y - y * cmath.exp(-1j * omega * period)) / (1j * omega)
        shift(registers, PERIODS, y.real, y.imag, chi, integral.real, integral.imag)
    yield 'vector least squares', solve(registers, PERIODS)[0]


def gain_values() -> Values:
    """Whether the gains of Table 1 follow (17), and the damping of the slow loop."""
    fast = 2.0 / (RESISTANCE / INDUCTANCE + K_P)
    yield 'Table 1 epsilon of k_p [us]', 1e6 * fast
    yield 'Table 1 epsilon of k_i [us]', 1e6 * math.sqrt(2.0 * INDUCTANCE / K_I)
    yield 'Table 1 damping of the slow loop', K_ETA / (2.0 * math.sqrt(GAMMA))


def run_values() -> Values:
    """Figure 2: settling times [ms] and final errors of each observer, in continuous time."""
    for observer in NAMES:
        yield from _both('F2', observer, figure_2(observer))


def start_values() -> Values:
    """The observer `pmsm` (``form: paper``) at 20 kHz, from near and far."""
    for start in FROM:
        for observer, variant in VARIANTS.items():
            yield from _both(f'starts {start}', observer, observer_run(variant, *STARTS[start]))


def _both(name: str, observer: str, run: Run) -> Values:
    for what, time in settle_times(run).items():
        if name == 'F2' or what in ('speed', 'angle'):
            yield f'{name} {what} {observer}', NEVER if math.isnan(time) else time
    for what, error in final_errors(run).items():
        if name == 'F2' or what in ('speed', 'angle'):
            yield f'{name} final {what} {observer}', error


def _table(title: str, columns: dict[str, str], names: dict[str, str]) -> Table:
    body = {name: [f'{stem} {each}' for stem in columns.values()] for each, name in names.items()}
    return Table(title, tuple(columns), body)


THREE = {name: NAMES[name] for name in VARIANTS}

REPRODUCTION = Reproduction(
    name='pmsm',
    summary='Bosso, Azzollini, Tilli: A semi-global hybrid sensorless observer for permanent '
    'magnets synchronous machines with unknown mechanical model (2020)',
    parts=parts(
        'pmsm',
        {'Table 1': gain_values, 'F2': run_values, 'starts': start_values, 'vector': vector_values},
    ),
    tables=(
        _table(
            'Figure 2: settling time of speed (2 %), angle (5 deg), xi, back-EMF (2 %) [ms]',
            {what: f'F2 {what}' for what in QUANTITIES},
            NAMES,
        ),
        _table(
            'Figure 2: largest error in the last 0.1 s: speed [%], angle [deg], xi [%], EMF [%]',
            {what: f'F2 final {what}' for what in QUANTITIES},
            NAMES,
        ),
        *(
            _table(
                f'The observer `pmsm`, form: paper, 20 kHz, start {start}: eta {eta:g} deg, '
                f'xi {xi:.0f}/Wb',
                {
                    'speed [ms]': f'starts {start} speed',
                    'angle [ms]': f'starts {start} angle',
                    'final speed [%]': f'starts {start} final speed',
                    'final angle [deg]': f'starts {start} final angle',
                },
                THREE,
            )
            for start, (_, eta, xi) in ((start, STARTS[start]) for start in FROM)
        ),
    ),
    figures='sim_pkg.reproduce.pmsm.figures',
    notes=(
        f'{NEVER:g}: never settles. The paper draws curves and prints no result as a number; its '
        'profile, load and start are not published.',
        'Meaning of each row, misprints and limits: docs/papers/pmsm.md',
    ),
)
