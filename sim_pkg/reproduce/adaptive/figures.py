# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 1 and 2 of the adaptive paper, drawn with matplotlib."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from sim_pkg.reproduce.adaptive.examples import FROZEN_FROM, NAMES, example_1, identified, parallel
from sim_pkg.reproduce.adaptive.plant import (
    IDENTIFICATION,
    STEP,
    VELOCITY,
    continuous,
    random_input,
    response,
)
from sim_pkg.reproduce.drawing import TRUTH, lines, panels

THIN = 20  # every n-th point is drawn


def estimation() -> Figure:
    """Return Figure 1: the velocity while the parameters are learnt, and after that."""
    run = continuous(VELOCITY, example_1(), freeze=FROZEN_FROM)
    title = 'during estimation (above), and stopped at 100 s, with another input'
    figure, axes = panels(2, title, ('[rad/s]',) * 2)
    for each, begin in zip(axes, (0.0, FROZEN_FROM)):
        part = slice(run.at(begin), run.at(begin + 40.0), THIN)
        time = run.time[part] - begin
        curves = {'estimate (38)': run.estimate[part], 'velocity': run.velocity[part]}
        lines(each, time, curves, {'velocity': TRUTH})
    return figure


def identification() -> Figure:
    """Return Figure 2: the parameters, and the identified model next to the plant."""
    run = identified()
    inputs = random_input(IDENTIFICATION, 100.0, seed=999)
    plant = response(IDENTIFICATION, inputs)
    model = parallel(run.theta[run.at(400.0)], inputs)
    time = np.arange(len(plant)) * STEP
    title = 'parameters during training; plant and model under another input; their difference'
    figure, axes = panels(3, title, ('', '[rad]', '[rad]'), sharex=False)
    lines(axes[0], run.time[::100], dict(zip(NAMES, run.theta[::100].T)), {})
    axes[0].set_ylim(-3.0, 6.0)
    thin = slice(None, None, THIN)
    curves = {'model of 400 s': model[thin], 'plant': plant[thin]}
    lines(axes[1], time[thin], curves, {'plant': TRUTH})
    lines(axes[2], time[thin], {'difference': (model - plant)[thin]}, {})
    return figure


FIGURES = {'adaptive_figure_1': estimation, 'adaptive_figure_2': identification}
