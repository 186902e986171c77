# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 3 to 6 of the hybrid-angle paper, drawn with matplotlib."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim_pkg.joints import profiles
from sim_pkg.reproduce.hybrid_angle.continuous import FOUR, MARGIN, STEP, Trace, figure_4, figure_5
from sim_pkg.reproduce.hybrid_angle.observer import injection
from sim_pkg.reproduce.hybrid_angle.sampled import DECAY, PERIOD, algorithm_1, samples, wrapped

# As in the paper: sin blue, tan red, saw green, sat purple.
COLOURS = {'sin': '#1f6fb4', 'tan': '#d1342f', 'saw': '#2a9d4a', 'sat': '#8a4fbf'}
LABELS = {
    'sin': r'$\sin$',
    'tan': r'$2\,\tan(e/2)$',
    'saw': r'$\mathrm{saw}$',
    'sat': r'$\mathrm{sat}_M(\mathrm{saw})$',
}
TRUTH: dict[str, Any] = {
    'color': '#222222',
    'linewidth': 1.1,
    'linestyle': (0, (5, 2)),
    'label': 'true',
}
QUANTUM = 2.0 * math.pi / 2**14  # of the paper's encoder [rad]
GREY = '#cfcfcf'
SOFT = '#555555'
BAND = '#e9e4d8'  # of the jump set J2
THIN = 2  # every n-th row is drawn: 2 ms


def injection_curves() -> Figure:
    """Figure 3: the four injections, and the jump set J2."""
    figure = Figure(figsize=(7.0, 4.6), layout='constrained')
    axes = figure.subplots()
    error = np.linspace(-math.pi, math.pi, 1601)
    for name in ('tan', 'saw', 'sat', 'sin'):
        curve = [injection(FOUR.index(name), float(e), 1.0) for e in error]
        axes.plot(error[:-1], curve[:-1], color=COLOURS[name], label=LABELS[name], linewidth=1.8)
    axes.axvspan(-math.pi, -math.pi + MARGIN, color=BAND, label=r'jump set $J_2$')
    axes.axvspan(math.pi - MARGIN, math.pi, color=BAND)
    axes.set(
        xlim=(-math.pi, math.pi),
        ylim=(-5.0, 5.0),
        xlabel=r'output error $e_y$ [rad]',
        ylabel=r'injection $\varphi(e_y)$ [rad]',
        title=r'The four injections ($M = 1$ rad, $\delta_\pi = 5^\circ$)',
    )
    axes.set_xticks(
        [-math.pi, -0.5 * math.pi, 0.0, 0.5 * math.pi, math.pi],
        [r'$-\pi$', r'$-\pi/2$', '0', r'$\pi/2$', r'$\pi$'],
    )
    _tidy(axes)
    axes.legend(loc='upper left', frameon=False, bbox_to_anchor=(0.05, 1.0))
    return figure


def noise_free() -> Figure:
    """Figure 4: velocity, output error and Lyapunov function without noise, epsilon 0.7 s."""
    figure = Figure(figsize=(8.0, 8.6), layout='constrained')
    velocity, error, value = figure.subplots(3, 1, sharex=True, height_ratios=(1.25, 1.0, 1.0))
    traces = {name: figure_4(name) for name in FOUR}
    _velocities(velocity, traces)
    for name, trace in traces.items():
        error.plot(trace.time[::THIN], trace.output_error[::THIN], **_line(name))
        value.plot(trace.time, trace.lyapunov, **_line(name))
        at = (np.array(trace.reset_times) / STEP).astype(int)
        value.plot(
            trace.time[at],
            trace.lyapunov[at],
            linestyle='',
            marker='v',
            markersize=4,
            color=COLOURS[name],
        )
    _circle(error)
    error.set_ylabel(r'output error $e_y$ [rad]')
    value.plot(
        [], [], linestyle='', marker='v', markersize=4, color=SOFT, label=r'before a jump in $J_2$'
    )
    value.set(
        ylabel=r'Lyapunov function $V$ [rad$^2$]',
        xlabel='time [s]',
        xlim=(0.0, 8.0),
        ylim=(0.0, None),
    )
    value.legend(handles=[value.lines[-1]], loc='upper right', frameon=False)
    velocity.text(0.3, -3.0, 'all four nearly coincide', color=SOFT, fontsize=9)
    velocity.set_title(r'Continuous time, no noise, $\epsilon = 0.7$ s, $M = 1$ rad')
    for axes in (velocity, error, value):
        _tidy(axes)
    return figure


def noisy() -> Figure:
    """Figure 5: with +-15 degrees of noise, epsilon 0.1 s, M = 0.03 rad."""
    figure = Figure(figsize=(8.0, 7.4), layout='constrained')
    velocity, error, steady = figure.subplots(3, 1, height_ratios=(1.25, 1.0, 1.0))
    traces = {name: figure_5(name) for name in FOUR}
    _velocities(velocity, traces)
    velocity.set_xlim(0.0, 8.0)
    for name, trace in traces.items():
        error.plot(trace.time[::THIN], trace.position_error[::THIN], **_line(name))
        steady.plot(trace.time[::THIN], trace.velocity_error[::THIN], **_line(name))
    _circle(error)
    error.set(ylabel=r'position error $e_1$ [rad]', xlim=(0.0, 8.0))
    steady.axhline(0.0, color='#222222', linewidth=0.8)
    steady.set(
        ylabel=r'velocity error $e_2$ [rad/s]', xlabel='time [s]', xlim=(7.5, 8.0), ylim=(-0.8, 0.8)
    )
    velocity.text(5.5, -17.5, 'sin, tan and saw coincide', color=SOFT, fontsize=9)
    velocity.set_title(
        r'Continuous time, $w \in [-15^\circ, 15^\circ]$, $\epsilon = 0.1$ s, '
        r'$M = 0.03$ rad'
    )
    for axes in (velocity, error, steady):
        _tidy(axes)
    return figure


def sampled() -> Figure:
    """Figure 6: Algorithm 1 at 100 Hz on a motor's run-up and run-down.

    The measurement is simulated: 14 bits, uniform noise of +-2 mrad. The run-down is fast enough
    (3000 rad/s^2) to separate the injections. The dirty derivative is that of the unwrapped angle.
    """
    time, velocity, exact = samples(profiles.figure_6(DECAY), 8.0)
    noisy = exact + np.random.default_rng(1).uniform(-0.002, 0.002, len(time))
    angles = wrapped(QUANTUM * np.round(noisy / QUANTUM))
    dirty = np.diff(np.unwrap(angles), prepend=angles[0]) / PERIOD
    estimates = {name: algorithm_1(name, angles) for name in FOUR}
    figure = Figure(figsize=(9.0, 7.0), layout='constrained')
    whole, *parts = figure.subplot_mosaic([['whole'] * 3, ['up', 'steady', 'down']]).values()
    for axes in (whole, *parts):
        axes.plot(
            time,
            dirty,
            color=GREY,
            linewidth=1.2 if axes is parts[1] else 5.0,
            label='dirty derivative',
        )
        axes.plot(time, velocity, **TRUTH)
        for name in FOUR:
            axes.plot(time, estimates[name], **_line(name))
        axes.set_xlabel('time [s]')
        _tidy(axes)
    whole.set(
        xlim=(0.0, 8.0),
        ylabel='velocity [rad/s]',
        title=r'Algorithm 1 at 100 Hz, $\epsilon = 0.1$ s, $M = 1$ rad',
    )
    whole.legend(loc='upper right', frameon=False)
    limits: list[tuple[str, Any, Any]] = [
        ('run-up', (0.0, 1.5), (0.0, 150.0)),
        ('steady state', (4.0, 4.9), (149.3, 150.7)),
        ('run-down', (4.95, 5.7), (-25.0, 155.0)),
    ]
    for axes, (title, across, up) in zip(parts, limits):
        axes.set(title=title, xlim=across, ylim=up)
    parts[0].set_ylabel('velocity [rad/s]')
    parts[0].text(0.75, 60.0, 'all four coincide', color=SOFT, fontsize=9)
    return figure


def _velocities(axes: Axes, traces: dict[str, Trace]) -> None:
    """True and estimated velocities, with the legend of the figure."""
    truth = traces['sin']
    axes.plot(truth.time[::THIN], truth.true_velocity[::THIN], **TRUTH)
    for name, trace in traces.items():
        axes.plot(trace.time[::THIN], trace.velocity[::THIN], **_line(name))
    axes.set_ylabel(r'velocity $x_2$, $\hat x_2$ [rad/s]')
    axes.legend(loc='upper right', frameon=False, ncols=1)


def _circle(axes: Axes) -> None:
    """The vertical axis of an error on the circle, with the jump set J2."""
    axes.axhspan(-math.pi, -math.pi + MARGIN, color=BAND)
    axes.axhspan(math.pi - MARGIN, math.pi, color=BAND, label=r'jump set $J_2$')
    axes.set_ylim(-1.03 * math.pi, 1.03 * math.pi)
    axes.set_yticks(
        [-math.pi, -0.5 * math.pi, 0.0, 0.5 * math.pi, math.pi],
        [r'$-\pi$', r'$-\pi/2$', '0', r'$\pi/2$', r'$\pi$'],
    )
    axes.legend(
        handles=axes.patches[-1:], loc='upper right', frameon=False, bbox_to_anchor=(1.0, 0.97)
    )


def _line(name: str) -> dict[str, Any]:
    """Return the line style of a curve; tan is dashed and on top, because it nearly equals saw."""
    style = {'linestyle': (0, (4, 3)), 'zorder': 3.0} if name == 'tan' else {}
    return {'color': COLOURS[name], 'label': LABELS[name], 'linewidth': 1.5, **style}


def _tidy(axes: Axes) -> None:
    axes.spines[['top', 'right']].set_visible(False)
    axes.grid(color='#ececec', linewidth=0.7)
    axes.set_axisbelow(True)


FIGURES = {
    'hybrid_angle_figure_3': injection_curves,
    'hybrid_angle_figure_4': noise_free,
    'hybrid_angle_figure_5': noisy,
    'hybrid_angle_figure_6': sampled,
}
