# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 2 to 4 of the hybrid paper, drawn with matplotlib."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from sim_pkg.reproduce.hybrid_discrete.runs import Array, example

STEP = 1e-3  # [s]
UNTIL = 10.0  # [s]
KEPT = slice(0, round(UNTIL / STEP), 5)


def continuous_states() -> Figure:
    """Figure 2."""
    run = example(STEP)
    return _panels(
        run.times[KEPT],
        run.state[KEPT],
        (run.state + run.state_error)[KEPT],
        'x',
        'continuous states',
    )


def output_coordinates() -> Figure:
    """Figure 3."""
    run = example(STEP)
    return _panels(
        run.times[KEPT],
        run.zeta[KEPT],
        run.zeta_hat[KEPT],
        'zeta',
        'in the coordinates of the outputs',
    )


def discrete_states() -> Figure:
    """Figure 4."""
    run = example(STEP)
    events = np.arange(round(UNTIL / 0.5) + 1)
    return _panels(
        0.5 * events, run.z[events], run.z_hat[events], 'z', 'discrete states', steps=True
    )


def _panels(
    time: Array, real: Array, observed: Array, name: str, title: str, steps: bool = False
) -> Figure:
    """Real and observed, one panel for each column."""
    figure = Figure(figsize=(8.0, 1.8 * real.shape[1] + 0.6), layout='constrained')
    figure.suptitle(f'{title}: real and observed')
    for i, axes in enumerate(figure.subplots(real.shape[1], 1, sharex=True, squeeze=False)[:, 0]):
        style = {'drawstyle': 'steps-post'} if steps else {}
        axes.plot(time, real[:, i], label='real', **style)
        axes.plot(time, observed[:, i], '--', label='observed', **style)
        axes.set_ylabel(f'{name}{i + 1}')
        axes.grid(True)
        if i == 0:
            axes.legend()
    axes.set_xlabel('time [s]')
    return figure


FIGURES = {
    'hybrid_discrete_figure_2': continuous_states,
    'hybrid_discrete_figure_3': output_coordinates,
    'hybrid_discrete_figure_4': discrete_states,
}
