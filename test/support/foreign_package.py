# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A package outside ours: an observer in one file, and how to install it into a folder."""

from __future__ import annotations

import textwrap
from pathlib import Path

OBSERVER = '''
    """An alpha-beta filter of any alpha, with beta = alpha^2/(2 - alpha)."""

    from dataclasses import dataclass

    from estimator_pkg.observers.angle.loop import TrackingLoop
    from estimator_pkg.observers.angle.shared import LAG_2, AngleGains, SharedDesign, set_shared
    from estimator_pkg.parameters import parameter
    from estimator_pkg.record import record


    @dataclass(frozen=True)
    class Gains(AngleGains):
        alpha: float = parameter(0.3, unit='', range=(0.001, 1.0), search=(0.01, 0.9),
                                 description='weight of the innovation in the position')


    class AlphaBeta(TrackingLoop):
        name, summary, reference = 'alpha_beta', 'an alpha-beta filter', 'Benedict and Bordner 1962'
        gains = Gains

        @record
        class Design:
            shared: SharedDesign
            alpha: float

        @staticmethod
        def design(gains, circle):
            made = AlphaBeta.Design()
            made.alpha = gains.alpha
            set_shared(made.shared, gains, circle, 0.05, LAG_2)
            return made

        @staticmethod
        def prepare(coefficients: TrackingLoop.Coefficients, design: Design, dt: float) -> None:
            alpha = design.alpha
            coefficients.dt, coefficients.alpha = dt, alpha
            coefficients.rate = alpha * alpha / (2.0 - alpha) / dt
'''


def install(folder: Path, files: dict[str, str], entry_points: str) -> Path:
    """Write a package with these modules and entry points into a folder for PYTHONPATH."""
    about = folder / 'foreign-0.0.1.dist-info'
    about.mkdir(parents=True)
    metadata = {'METADATA': 'Name: foreign\nVersion: 0.0.1\n', 'entry_points.txt': entry_points}
    for name, text in (*files.items(), *((f'{about.name}/{k}', v) for k, v in metadata.items())):
        (folder / name).write_text(textwrap.dedent(text))
    return folder
