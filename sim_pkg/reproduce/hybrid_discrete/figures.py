# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 2 to 4 of the hybrid paper, drawn with matplotlib."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim_pkg.reproduce.drawing import TRUTH, lines, panels
from sim_pkg.reproduce.hybrid_discrete.runs import example

STEP = 1e-3  # [s]
UNTIL = 10.0  # [s]
PANELS = {'x': 'continuous states', 'zeta': 'in the coordinates of the outputs', 'z': 'discrete'}


def states(name: str) -> Figure:
    """Return Figure 2, 3 or 4: real and observed, one panel for each state."""
    run, style = example(STEP), dict[str, Any]()
    kept = slice(0, round(UNTIL / STEP), 5)
    time, real, observed = run.times, run.zeta, run.zeta_hat
    if name == 'x':
        real, observed = run.state, run.state + run.state_error
    elif name == 'z':
        real, observed, kept = run.z, run.z_hat, slice(0, round(UNTIL / 0.5) + 1)
        time, style = 0.5 * np.arange(len(real)), {'drawstyle': 'steps-post'}
    labels = tuple(f'{name}{i + 1}' for i in range(real.shape[1]))
    figure, axes = panels(len(labels), f'{PANELS[name]}: real and observed', labels)
    for i, each in enumerate(axes):
        curves = {'observed': observed[kept, i], 'real': real[kept, i]}
        lines(each, time[kept], curves, {'real': TRUTH}, **style)
    return figure


FIGURES = {
    f'hybrid_discrete_figure_{number}': partial(states, name)
    for number, name in zip((2, 3, 4), PANELS)
}
