# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A package outside ours: an observer in one file, and how to install it into a folder."""

from __future__ import annotations

import textwrap
from pathlib import Path

OBSERVER = '''
    """An alpha-beta filter: its gains, three records, and what it does with a measurement."""

    import math
    from dataclasses import dataclass

    from estimator_pkg.observers.angle.shared import (  # noqa: F401  (its functions too)
        DRIVEN, EDGES, LAG_2, SINGLE_ANGLE, TURNS, AngleGains, SharedDesign, State, deviation,
        estimate, is_reading, pace, restart, resume, set_shared, start, step)
    from estimator_pkg.circle import Circle, wrap
    from estimator_pkg.observers.contract import Observer
    from estimator_pkg.observers.contract import no_limit as limits  # noqa: F401
    from estimator_pkg.observers.contract import no_reason as why  # noqa: F401
    from estimator_pkg.observers.maths.tracking import noise_of_two
    from estimator_pkg.parameters import parameter
    from estimator_pkg.record import record


    @dataclass(frozen=True)
    class Gains(AngleGains):
        alpha: float = parameter(0.3, unit='', range=(0.001, 1.0), search=(0.01, 0.9),
                                 description='weight of the innovation in the position')


    @record
    class Design:
        shared: SharedDesign
        alpha: float


    @record
    class Coefficients:
        dt: float  # [s]
        rate: float  # beta/dt [1/s]


    @record
    class Core:
        position: float  # [rad]
        velocity: float  # [rad/s]
        acceleration: float  # nan
        started: bool  # after the second sample


    def design(gains: Gains, circle: Circle) -> Design:
        made = Design()
        made.alpha = gains.alpha
        set_shared(made.shared, gains, circle, 0.05, LAG_2)
        return made


    def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
        coefficients.dt = dt
        coefficients.rate = design.alpha * design.alpha / (2.0 - design.alpha) / dt


    def begin(core: Core, design: Design, measurement: float) -> None:
        core.position, core.velocity, core.acceleration = measurement, 0.0, math.nan
        core.started = False


    def resume_core(core: Core, design: Design, measurement: float) -> None:
        core.position = measurement


    def correct(
        core: Core, coefficients: Coefficients, design: Design, measurement: float
    ) -> float:
        moved = measurement - core.position
        if not core.started:
            core.position, core.started = measurement, True
            core.velocity = wrap(moved, design.shared.period) / coefficients.dt
            return 0.0  # the speed was not known: no innovation
        error = wrap(moved - core.velocity * coefficients.dt, design.shared.period)
        core.position = measurement - (1.0 - design.alpha) * error
        core.velocity += coefficients.rate * error
        return error


    def noise_gains(
        core: Core, coefficients: Coefficients, design: Design
    ) -> tuple[float, float, float]:
        dt = coefficients.dt
        return noise_of_two(design.alpha, coefficients.rate * dt, dt)


    def group_delay(design: Design, dt: float) -> float:
        return dt * (2.0 / design.alpha - 1.5)


    OBSERVER = Observer(name='mine', summary='an alpha-beta filter', gains=Gains,
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
