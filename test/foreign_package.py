# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A package outside ours: an observer in one file, and how to install it into a folder."""

from __future__ import annotations

import textwrap
from pathlib import Path

OBSERVER = '''
    """An alpha-beta filter: the seven small functions, and what is declared."""

    import math
    from dataclasses import dataclass

    from estimator_pkg.observers.angle.core import AngleCore, AngleGains, around
    from estimator_pkg.observers.circle import wrap
    from estimator_pkg.observers.contract import Observer
    from estimator_pkg.observers.maths.tracking import noise_of_two
    from estimator_pkg.parameters import parameter


    @dataclass(frozen=True)
    class Gains(AngleGains):
        alpha: float = parameter(0.3, unit='', range=(0.001, 1.0), search=(0.01, 0.9),
                                 description='weight of the innovation in the position')


    def prepare(design, dt):
        alpha, period = design
        return (alpha, alpha * alpha / (2.0 - alpha) / dt, dt, period)


    def init(measurement, design):
        return (measurement, 0.0)


    def correct(state, coefficients, measurement):
        alpha, rate, dt, period = coefficients
        error = wrap(measurement - state[0] - state[1] * dt, period)
        return (measurement - (1.0 - alpha) * error, state[1] + rate * error), error


    def estimate(state):
        return state[0], state[1], math.nan


    def resume(state, measurement):
        return (measurement, state[1])


    def noise_gains(state, coefficients):
        return noise_of_two(coefficients[0], coefficients[1] * coefficients[2], coefficients[2])


    def build(gains, circle):
        return around(AngleCore(
            design=lambda: (gains.alpha, float(circle.period)), settle=0.2, prepare=prepare,
            init=init, correct=correct, estimate=estimate, resume=resume, noise_gains=noise_gains,
            limits=lambda dt: None, group_delay=lambda dt: dt * (2.0 / gains.alpha - 1.5)),
            gains, circle)


    OBSERVER = Observer(name='mine', summary='an alpha-beta filter', gains=Gains, build=build,
                        reference='textbook')
'''


def install(folder: Path, files: dict[str, str], entry_points: str) -> Path:
    """Write a package with these modules and entry points into a folder for PYTHONPATH."""
    about = folder / 'foreign-0.0.1.dist-info'
    about.mkdir(parents=True)
    metadata = {'METADATA': 'Name: foreign\nVersion: 0.0.1\n', 'entry_points.txt': entry_points}
    for name, text in (*files.items(), *((f'{about.name}/{k}', v) for k, v in metadata.items())):
        (folder / name).write_text(textwrap.dedent(text))
    return folder
