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

THIN = 20  # every n-th point is drawn


def estimation() -> Figure:
    """Return Figure 1: the velocity while the parameters are learnt, and after that."""
    run = continuous(VELOCITY, example_1(), freeze=FROZEN_FROM)
    figure = Figure(figsize=(8.0, 6.0), layout='constrained')
    for axes, begin, end, title in zip(
        figure.subplots(2, 1),
        (0.0, FROZEN_FROM),
        (40.0, FROZEN_FROM + 40.0),
        ('a) during estimation', 'b) estimation stopped at 100 s, another input'),
    ):
        part = slice(run.at(begin), run.at(end), THIN)
        axes.plot(run.time[part], run.velocity[part], label='velocity')
        axes.plot(run.time[part], run.estimate[part], '--', label='estimate (38)')
        axes.set(title=title, xlabel='time [s]', ylabel='[rad/s]')
        axes.grid(True)
        axes.legend()
    return figure


def identification() -> Figure:
    """Return Figure 2: the parameters, and the identified model next to the plant."""
    run = identified()
    inputs = random_input(IDENTIFICATION, 100.0, seed=999)
    plant = response(IDENTIFICATION, inputs)
    model = parallel(run.theta[run.at(400.0)], inputs)
    time = np.arange(len(plant)) * STEP
    figure = Figure(figsize=(8.0, 9.0), layout='constrained')
    first, second, third = figure.subplots(3, 1)
    for name, values in zip(NAMES, run.theta.T):
        first.plot(run.time[::100], values[::100], label=name)
    first.set(title='a) parameters during training', xlabel='time [s]', ylim=(-3.0, 6.0))
    first.legend(loc='upper right', ncols=4)
    second.plot(time[::THIN], plant[::THIN], label='plant')
    second.plot(time[::THIN], model[::THIN], '--', label='model of 400 s')
    second.set(
        title='b) plant and identified model under another input', xlabel='time [s]', ylabel='[rad]'
    )
    second.legend()
    third.plot(time[::THIN], (model - plant)[::THIN])
    third.set(title='c) their difference', xlabel='time [s]', ylabel='[rad]')
    for axes in (first, second, third):
        axes.grid(True)
    return figure


FIGURES = {'adaptive_figure_1': estimation, 'adaptive_figure_2': identification}
