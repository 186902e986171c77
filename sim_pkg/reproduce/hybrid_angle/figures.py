# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 3 to 6 of the hybrid-angle paper, drawn with matplotlib."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim_pkg.joints import profiles
from sim_pkg.reproduce.drawing import BLUE, GREEN, GREY, PURPLE, RED, TRUTH, lines, panels
from sim_pkg.reproduce.hybrid_angle.continuous import FOUR, MARGIN, STEP, Trace, figure_4, figure_5
from sim_pkg.reproduce.hybrid_angle.observer import injection
from sim_pkg.reproduce.hybrid_angle.sampled import DECAY, PERIOD, algorithm_1, samples, wrapped

# The colours are those of the paper; tan is dashed and on top, because it nearly equals saw.
STYLES: dict[str, Any] = {
    'sin': BLUE,
    'tan': {'color': RED, 'linestyle': (0, (4, 3)), 'zorder': 3.0},
    'saw': GREEN,
    'sat': PURPLE,
    'true': TRUTH,
    'dirty derivative': {'color': GREY, 'linewidth': 3.0},
}
QUANTUM = 2.0 * math.pi / 2**14  # of the paper's encoder [rad]
BAND = '#e9e4d8'  # of the jump set J2
THIN = slice(None, None, 2)  # every second row is drawn: 2 ms


def injection_curves() -> Figure:
    """Figure 3: the four injections, and the jump set J2."""
    figure, (axes,) = panels(1, r'The four injections ($M = 1$ rad, $\delta_\pi = 5^\circ$)')
    error = np.linspace(-math.pi, math.pi, 1601)[:-1]
    curves = {name: [injection(FOUR.index(name), float(e), 1.0) for e in error] for name in FOUR}
    lines(axes, error, curves, STYLES)
    mark_jumps(axes.axvspan)
    axes.set(ylim=(-5.0, 5.0), xlabel='output error [rad]', ylabel='injection [rad]')
    return figure


def continuous(title: str, run: Callable[[str], Trace], panel: dict[str, str]) -> tuple[Any, ...]:
    """Return (figure, axes, traces): attributes of all injections' traces, by their labels."""
    traces = {name: run(name) for name in FOUR}
    panel = {r'velocity $x_2$ [rad/s]': 'velocity'} | panel
    figure, axes = panels(3, title, tuple(panel), sharex=False)
    time, truth = traces['sin'].time[THIN], traces['sin'].true_velocity[THIN]
    for each, what in zip(axes, panel.values()):
        curves = {name: getattr(trace, what)[THIN] for name, trace in traces.items()}
        lines(each, time, curves | ({'true': truth} if what == 'velocity' else {}), STYLES)
    mark_jumps(axes[1].axhspan)
    return figure, axes, traces


def mark_jumps(span: Callable[..., Any]) -> None:
    """Shade the jump set J2, within delta_pi of pi on the circle."""
    for edge in (-math.pi, math.pi - MARGIN):
        span(edge, edge + MARGIN, color=BAND)


def noise_free() -> Figure:
    """Figure 4: velocity, output error and Lyapunov function without noise, epsilon 0.7 s."""
    figure, axes, traces = continuous(
        r'Continuous time, no noise, $\epsilon = 0.7$ s, $M = 1$ rad',
        figure_4,
        {
            r'output error $e_y$ [rad]': 'output_error',
            r'Lyapunov function $V$ [rad$^2$]': 'lyapunov',
        },
    )
    for name, trace in traces.items():  # before each jump in J2
        at = (np.array(trace.reset_times) / STEP).astype(int)
        color = RED if name == 'tan' else STYLES[name]
        axes[2].plot(trace.time[at], trace.lyapunov[at], 'v', markersize=4, color=color)
    return figure


def noisy() -> Figure:
    """Figure 5: with +-15 degrees of noise, epsilon 0.1 s, M = 0.03 rad."""
    figure, axes, _ = continuous(
        r'Continuous time, $w \in [-15^\circ, 15^\circ]$, $\epsilon = 0.1$ s, $M = 0.03$ rad',
        figure_5,
        {
            r'position error $e_1$ [rad]': 'position_error',
            r'velocity error $e_2$ [rad/s]': 'velocity_error',
        },
    )
    axes[2].set(xlim=(7.5, 8.0), ylim=(-0.8, 0.8))
    return figure


def sampled() -> Figure:
    """Figure 6: Algorithm 1 at 100 Hz on a motor's run-up and run-down.

    The measurement is simulated: 14 bits, uniform noise of +-2 mrad. The run-down is fast enough
    (3000 rad/s^2) to separate the injections. The dirty derivative is that of the unwrapped angle.
    """
    time, velocity, exact = samples(profiles.figure_6(DECAY), 8.0)
    noise = np.random.default_rng(1).uniform(-0.002, 0.002, len(time))
    angles = wrapped(QUANTUM * np.round((exact + noise) / QUANTUM))
    dirty = np.diff(np.unwrap(angles), prepend=angles[0]) / PERIOD
    curves = {'dirty derivative': dirty, 'true': velocity}
    curves |= {name: algorithm_1(name, angles) for name in FOUR}
    title = r'Algorithm 1 at 100 Hz, $\epsilon = 0.1$ s, $M = 1$ rad: all; run-up, steady, run-down'
    figure, axes = panels(4, title, ('velocity [rad/s]',) * 4, sharex=False)
    for each, across, up in zip(
        axes,
        ((0.0, 8.0), (0.0, 1.5), (4.0, 4.9), (4.95, 5.7)),
        (None, (0.0, 150.0), (149.3, 150.7), (-25.0, 155.0)),
    ):
        lines(each, time, curves, STYLES)
        each.set(xlim=across, ylim=up)
    return figure


FIGURES = {
    'hybrid_angle_figure_3': injection_curves,
    'hybrid_angle_figure_4': noise_free,
    'hybrid_angle_figure_5': noisy,
    'hybrid_angle_figure_6': sampled,
}
