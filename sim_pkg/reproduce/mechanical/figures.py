# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 2, 3, 5 to 7 and 9 to 13 of the paper, drawn with matplotlib."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from sim_pkg.reproduce.drawing import BLUE, DARK, GREEN, ORANGE, RED, TRUTH, lines, panels
from sim_pkg.reproduce.mechanical import lab, loop
from sim_pkg.reproduce.mechanical.sections import CART, LEG

STYLES = {
    'GESO': GREEN,
    'HGO': BLUE,
    'EHGO-BL': BLUE,
    'SMO': RED,
    'SMO-BL': RED,
    'measured': ORANGE,
    'true': TRUTH,
    'reference': TRUTH | {'label': 'reference'},
    '': DARK,
}
THREE = ('HGO', 'SMO', 'GESO')
SEED = 0


def cart_positions() -> Figure:
    """Figure 2: positions of section 5.1, true and measured."""
    q, readings = CART.truth()[0], CART.measured(SEED)
    title = 'Section 5.1: positions and their noisy, quantised measurements'
    figure, axes = panels(2, title, ('$q_1$ [rad]', '$q_2$'))
    for joint, each in enumerate(axes):
        curves = {'measured': readings[:, joint], 'true': q[:, joint]}
        lines(each, CART.time, curves, STYLES)
    return figure


def cart_velocities() -> Figure:
    """Figure 3: estimates of the velocities of section 5.1."""
    v, readings = CART.truth()[1], CART.measured(SEED)
    found = {name: CART.estimate(name, readings) for name in THREE} | {'true': v}
    labels = r'$\dot q_1$', r'$\dot q_2$'
    figure, axes = panels(2, 'Section 5.1: estimated velocities', labels)
    for joint, each in enumerate(axes):
        curves = {name: values[:, joint] for name, values in found.items()}
        lines(each, CART.time, curves, STYLES)
    return figure


def leg_errors(joint: int) -> Figure:
    """Figures 5 to 7: errors of one velocity of the leg."""
    v, readings = LEG.truth()[1], LEG.measured(SEED)
    curves = {name: (LEG.estimate(name, readings) - v)[:, joint] for name in THREE}
    figure, axes = panels(
        1, f'Section 5.2: error of the velocity $\\dot q_{joint + 1}$', ('error',)
    )
    lines(axes[0], LEG.time, curves, STYLES)
    return figure


def lab_motion() -> Figure:
    """Figure 9: the open-loop experiment."""
    q, _, current = lab.truth('nominal')
    labels = 'current [A]', '$q_1$ [rad]', '$q_2$ [m]'
    figure, axes = panels(3, 'Section 6.2: open-loop excitation (simulated plant)', labels)
    for each, values in zip(axes, (current[:, 0], q[:, 0], q[:, 1])):
        lines(each, lab.DT * np.arange(lab.COUNT), {'': values}, STYLES)
    return figure


def lab_velocities(joint: int) -> Figure:
    """Figures 10 and 11: velocities from low-precision measurements."""
    what = ('pendulum [rad/s]', 'cart [m/s]')[joint]
    q, v, inputs = lab.truth('mismatch')
    readings = lab.measured(q, 'LPM', SEED)
    title = f'Section 6.2, low-precision measurements: velocity of the {what}'
    figure, axes = panels(3, title)
    for each, name in zip(axes, ('GESO', 'SMO-BL', 'EHGO-BL')):
        estimate = lab.estimate(lab.CASES[name], readings, inputs)[:, joint]
        curves = {name: estimate, 'true': v[:, joint]}
        lines(each, lab.DT * np.arange(lab.COUNT), curves, STYLES)
    return figure


def tracking(name: str) -> Figure:
    """Figures 12 and 13: closed loop with this observer."""
    (run,) = loop.balance([(name, 'HPM')])
    time = lab.DT * np.arange(len(run.positions))
    title = f'Section 6.3: closed loop with {name}, high-precision measurements'
    figure, axes = panels(2, title, ('$q_1$ [rad]', '$q_2$ [m]'))
    lines(axes[0], time, {name: run.positions[:, 0]}, STYLES)
    lines(axes[1], time, {'cart': run.positions[:, 1], 'reference': run.reference}, STYLES)
    return figure


FIGURES = {
    f'mechanical_figure_{number}': make
    for number, make in {
        2: cart_positions,
        3: cart_velocities,
        5: partial(leg_errors, 0),
        6: partial(leg_errors, 1),
        7: partial(leg_errors, 2),
        9: lab_motion,
        10: partial(lab_velocities, 0),
        11: partial(lab_velocities, 1),
        12: partial(tracking, 'GESO'),
        13: partial(tracking, 'SMO-BL'),
    }.items()
}
