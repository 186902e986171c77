"""Figures 2 to 4 of the hybrid paper, drawn with matplotlib."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sim_pkg.reproduce.adaptive_plant import Array
from sim_pkg.reproduce.hybrid_discrete_runs import example

UNTIL = 10.0  # [s]


def draw(folder: Path) -> list[Path]:
    """Draw the three figures into `folder`."""
    run = example(1e-3)
    kept = slice(0, round(UNTIL / 1e-3), 5)
    time = run.times[kept]
    figure_2 = _panels(folder / 'hybrid_discrete_figure_2.png', time, run.state[kept],
                       (run.state + run.state_error)[kept], 'x', 'continuous states')
    figure_3 = _panels(folder / 'hybrid_discrete_figure_3.png', time, run.zeta[kept],
                       run.zeta_hat[kept], 'zeta', 'in the coordinates of the outputs')
    events = np.arange(round(UNTIL / 0.5) + 1)
    figure_4 = _panels(folder / 'hybrid_discrete_figure_4.png', 0.5 * events, run.z[events],
                       run.z_hat[events], 'z', 'discrete states', steps=True)
    return [figure_2, figure_3, figure_4]


def _panels(path: Path, time: Array, real: Array, observed: Array, name: str, title: str,
            steps: bool = False) -> Path:
    """Real and observed, one panel for each column."""
    from matplotlib.figure import Figure

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
    figure.savefig(path, dpi=90)
    return path
