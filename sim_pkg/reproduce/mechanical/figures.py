# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 2, 3, 5 to 7 and 9 to 13 of the paper, drawn with matplotlib."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sim_pkg.reproduce.mechanical import cart as cart
from sim_pkg.reproduce.mechanical import lab as lab
from sim_pkg.reproduce.mechanical import leg as leg
from sim_pkg.reproduce.mechanical import loop as loop

Array = NDArray[np.float64]

COLOURS = {
    'GESO': '#2a9d4a',
    'HGO': '#1f6fb4',
    'SMO': '#d1342f',
    'SMO-BL': '#d1342f',
    'EHGO-BL': '#1f6fb4',
}
TRUTH: dict[str, Any] = {
    'color': '#222222',
    'linewidth': 1.1,
    'linestyle': (0, (5, 2)),
    'label': 'true',
}
MEASURED = '#e0912f'
SEED = 0


def _figure(count: int, title: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(8.0, 1.2 + 2.2 * count), layout='constrained')
    axes = np.atleast_1d(figure.subplots(count, 1, sharex=True))
    axes[0].set_title(title)
    for each in axes:
        each.grid(color='#e5e5e5', linewidth=0.6)
        each.spines[['top', 'right']].set_visible(False)
    return figure, axes


def cart_positions() -> Figure:
    """Figure 2: positions of section 5.1, true and measured."""
    figure, axes = _figure(2, 'Section 5.1: positions and their noisy, quantised measurements')
    q, readings = cart.truth()[0], cart.measured(SEED)
    time = cart.DT * np.arange(cart.COUNT)
    for joint, unit in enumerate(('rad', '')):
        axes[joint].plot(time, readings[:, joint], color=MEASURED, linewidth=0.5, label='measured')
        axes[joint].plot(time, q[:, joint], color='#222222', linewidth=0.5, label='true')
        axes[joint].set_ylabel(f'$q_{joint + 1}$' + (f' [{unit}]' if unit else ''))
    axes[0].legend(frameon=False)
    axes[-1].set_xlabel('time [s]')
    return figure


def cart_velocities() -> Figure:
    """Figure 3: estimates of the velocities of section 5.1."""
    figure, axes = _figure(2, 'Section 5.1: estimated velocities')
    v, readings = cart.truth()[1], cart.measured(SEED)
    time = cart.DT * np.arange(cart.COUNT)
    for name in ('HGO', 'SMO', 'GESO'):
        estimate = cart.estimate(name, readings)
        for joint in (0, 1):
            axes[joint].plot(
                time, estimate[:, joint], color=COLOURS[name], linewidth=0.8, label=name
            )
    for joint in (0, 1):
        axes[joint].plot(time, v[:, joint], **TRUTH)
        axes[joint].set_ylabel(rf'$\dot q_{joint + 1}$')
    figure.legend(
        *axes[0].get_legend_handles_labels(), frameon=False, ncols=4, loc='outside lower center'
    )
    axes[-1].set_xlabel('time [s]')
    return figure


def leg_errors(joint: int) -> Figure:
    """Figures 5 to 7: errors of one velocity of the leg."""
    figure, axes = _figure(1, f'Section 5.2: error of the velocity $\\dot q_{joint + 1}$')
    v, readings = leg.run()[1], leg.measured(SEED)
    time = leg.DT * np.arange(leg.COUNT)
    for name in ('HGO', 'SMO', 'GESO'):
        error = (leg.estimate(name, readings) - v)[:, joint]
        axes[0].plot(time, error, color=COLOURS[name], linewidth=0.8, label=name)
    axes[0].set(xlabel='time [s]', ylabel='error')
    figure.legend(frameon=False, ncols=3, loc='outside lower center')
    return figure


def lab_motion() -> Figure:
    """Figure 9: the open-loop experiment."""
    figure, axes = _figure(3, 'Section 6.2: open-loop excitation (simulated plant)')
    q, _, current = lab.truth('nominal')
    time = lab.DT * np.arange(lab.COUNT)
    for each, values, label in zip(
        axes, (current[:, 0], q[:, 0], q[:, 1]), ('current [A]', '$q_1$ [rad]', '$q_2$ [m]')
    ):
        each.plot(time, values, color='#222222', linewidth=1.0)
        each.set_ylabel(label)
    axes[-1].set_xlabel('time [s]')
    return figure


def lab_velocities(joint: int) -> Figure:
    """Figures 10 and 11: velocities from low-precision measurements."""
    what = ('pendulum [rad/s]', 'cart [m/s]')[joint]
    figure, axes = _figure(3, f'Section 6.2, low-precision measurements: velocity of the {what}')
    q, v, inputs = lab.truth('mismatch')
    readings = lab.measured(q, 'LPM', SEED)
    time = lab.DT * np.arange(lab.COUNT)
    for each, name in zip(axes, ('GESO', 'SMO-BL', 'EHGO-BL')):
        estimate = lab.estimate(lab.CASES[name], readings, inputs)[:, joint]
        each.plot(time, estimate, color=COLOURS[name], linewidth=0.8, label=name)
        each.plot(time, v[:, joint], **TRUTH)
        each.legend(frameon=False, ncols=2, loc='upper right')
    axes[-1].set_xlabel('time [s]')
    return figure


def tracking(name: str) -> Figure:
    """Figures 12 and 13: closed loop with this observer."""
    figure, axes = _figure(2, f'Section 6.3: closed loop with {name}, high-precision measurements')
    (run,) = loop.balance([(name, 'HPM')])
    time = lab.DT * np.arange(len(run.positions))
    axes[0].plot(time, run.positions[:, 0], color=COLOURS[name], linewidth=0.9)
    axes[1].plot(time, run.positions[:, 1], color=COLOURS[name], linewidth=1.0, label='cart')
    axes[1].plot(time, run.reference, **{**TRUTH, 'label': 'reference'})
    axes[0].set_ylabel('$q_1$ [rad]')
    axes[1].set(ylabel='$q_2$ [m]', xlabel='time [s]')
    axes[1].legend(frameon=False)
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
