# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The sensorless-motor paper: Figure 2, its claims, and the observer `pmsm` on the same motor."""

from __future__ import annotations

from functools import lru_cache

from sim_pkg.reproduce.contract import Reproduction, Values
from sim_pkg.reproduce.pmsm.motor import (
    CONTINUOUS,
    HYBRID,
    IDENTIFIER,
    STARTS,
    Run,
    continuous_run,
    final_errors,
    settle_times,
)
from sim_pkg.reproduce.pmsm.observer import observer_run

VARIANTS = {'cont': CONTINUOUS, 'hyb': HYBRID, 'id_post': IDENTIFIER}
NAMES = {'cont': '(5)', 'hyb': '(16)', 'id_post': '(16), (26)'}
QUANTITIES = ('speed', 'angle', 'xi', 'emf')
WHAT = (
    'settling time [ms] of speed (2 %), angle (5 deg), xi and back-EMF (2 %); final: largest error '
    'in the last 0.1 s of speed [%], angle [deg], xi [%], back-EMF [%]'
)


@lru_cache
def figure_2(observer: str) -> Run:
    """Return a run of Figure 2, from start A."""
    return continuous_run(VARIANTS[observer], *STARTS['A'])


def run_values() -> Values:
    """Figure 2: settling times [ms] and final errors of each observer, in continuous time."""
    for observer in VARIANTS:
        yield from _both('F2', observer, figure_2(observer), QUANTITIES)


def start_values() -> Values:
    """The observer `pmsm` (``form: paper``) at 20 kHz, from near and far."""
    for start, begun in STARTS.items():
        for observer, variant in VARIANTS.items():
            run = observer_run(variant, *begun)
            yield from _both(f'starts {start}', observer, run, QUANTITIES[:2])


def _both(name: str, observer: str, run: Run, quantities: tuple[str, ...]) -> Values:
    times, finals = settle_times(run), final_errors(run)
    for what in quantities:
        yield f'{name} {what} {observer}', times[what]
        yield f'{name} final {what} {observer}', finals[what]


REPRODUCTION = Reproduction(
    name='pmsm',
    summary='Bosso, Azzollini, Tilli: A semi-global hybrid sensorless observer for permanent '
    'magnets synchronous machines with unknown mechanical model (2020)',
    parts={
        'F2': (
            f'Figure 2, observers {", ".join(map(" ".join, NAMES.items()))}: {WHAT}',
            run_values,
        ),
        'starts': (
            'the observer `pmsm`, form: paper, 20 kHz, from the starts '
            + '; '.join(
                f'{k}: eta {eta:g} deg, xi {xi:.0f}/Wb' for k, (_, eta, xi) in STARTS.items()
            ),
            start_values,
        ),
    },
    notes=(
        'The paper draws curves and prints no result as a number; its profile, load and start are '
        'not published.',
        'Meaning of each row, misprints and limits: docs/papers/pmsm.md',
    ),
)
