# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 1 and 2 of the sensorless-motor paper, drawn with matplotlib."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_pkg.reproduce.pmsm.motor import FLUX, POLE_PAIRS, errors
from sim_pkg.reproduce.pmsm.paper import figure_2

BLUE, RED, GREY, SOFT = '#1f6fb4', '#d1342f', '#cfcfcf', '#555555'
CHI, K_ETA, GAMMA = 1.0, 1.5, 1.0  # of Figure 1, as printed
ROWS = (
    ('cont', 'observer (5)'),
    ('hyb', 'observer (16)'),
    ('id_post', 'observer (16), (25), (26)'),
)
LETTERS = ('adgj', 'behk', 'cfil')
RPM = 30.0 / math.pi

Array = NDArray[np.float64]


def reduced(angle: float, xi: float, duration: float) -> tuple[Array, Array]:
    """Return a trajectory of (6) from (angle, xi error), shape (n,); backwards if duration < 0."""

    def slope(_: float, state: Array) -> tuple[float, float]:
        sine = math.sin(state[0])
        return CHI * state[1] - K_ETA * CHI * sine, -GAMMA * CHI * sine

    at = np.linspace(0.0, duration, 8000)
    rows = solve_ivp(slope, (0.0, duration), (angle, xi), rtol=1e-8, atol=1e-9, t_eval=at).y
    return rows[0], rows[1]


def unstable_manifold() -> list[tuple[Array, Array]]:
    """Return both branches of the curve from which (6) runs into the saddle (pi, 0), backwards.

    A branch is (angle [rad], xi error [1/Wb]), shape (n,); nan: out of the picture.
    """
    # linearised at the saddle: d(angle) = chi xi + k chi angle, d(xi) = gamma chi angle
    slow = 0.5 * (K_ETA - math.sqrt(K_ETA**2 + 4.0 * GAMMA))
    direction = np.array([slow, GAMMA]) / math.hypot(slow, GAMMA)
    branches = []
    for sign in (1.0, -1.0):
        start = np.array([math.pi, 0.0]) + 1e-4 * sign * direction
        angle, xi = reduced(start[0], start[1], -40.0)
        xi[np.abs(xi) > 4.2] = np.nan  # out of the picture
        branches.append((angle, xi))
    return branches


def wrapped(angle: Array) -> Array:
    """Return the angle in [-pi, pi), shape (n,) [rad]; a nan where it jumps interrupts the line."""
    shown = np.mod(angle + math.pi, 2.0 * math.pi) - math.pi
    shown[1:][np.abs(np.diff(shown)) > math.pi] = np.nan
    return shown


def phase_portrait() -> Figure:
    """Figure 1: the reduced system (6) on the plane and on the cylinder."""
    figure = Figure(figsize=(8.0, 3.8), layout='constrained')
    plane = figure.add_subplot(1, 2, 1)
    cylinder = figure.add_subplot(1, 2, 2, projection='3d')
    starts = [
        (-math.pi, 3.6),
        (math.pi, -3.6),
        (-2.8, 2.0),
        (2.8, -2.0),
        (-1.5, 1.5),
        (1.5, -1.5),
        (-2.5, -0.3),
        (2.5, 0.3),
        (-1.0, -1.0),
        (1.0, 1.0),
    ]
    curves = [(*reduced(angle, xi, 30.0), BLUE, 0.8) for angle, xi in starts]
    curves += [(angle, xi, RED, 1.8) for angle, xi in unstable_manifold()]
    for angle, xi, colour, width in curves:
        plane.plot(wrapped(angle), xi, color=colour, linewidth=width)
        cylinder.plot(np.cos(angle), np.sin(angle), xi, color=colour, linewidth=width)
    plane.plot(0.0, 0.0, 'o', color=BLUE, label=r'$\bar x_s$')
    plane.plot([-math.pi, math.pi], [0.0, 0.0], 'o', color=RED, label=r'$\bar x_u$')
    plane.set(
        xlim=(-math.pi, math.pi),
        ylim=(-4.2, 4.2),
        xlabel=r'$\tilde\vartheta$ [rad]',
        ylabel=r'$\tilde\xi$ [1/Wb]',
        title='(6) on the plane',
    )
    plane.grid(color=GREY, linewidth=0.5)
    plane.legend(loc='upper right', frameon=False)
    cylinder.set(xlabel=r'$\eta_1$', ylabel=r'$\eta_2$', zlabel=r'$\tilde\xi$', zlim=(-4.2, 4.2))
    cylinder.set_title('(6) on the cylinder')
    return figure


def tidy(axes: Axes) -> None:
    """What all panels over time share."""
    axes.grid(color=GREY, linewidth=0.5)
    axes.tick_params(labelsize=8, colors=SOFT)
    axes.margins(x=0.0)


def transients() -> Figure:
    """Figure 2: speed, angle error, xi and back-EMF error for the three observers, start A."""
    figure = Figure(figsize=(8.0, 9.5), layout='constrained')
    panels = figure.subplots(4, 3, sharex=True, sharey='row').T
    for row, (observer, name) in enumerate(ROWS):
        run = figure_2(observer)
        wrong, time = errors(run), run.truth.time
        speed, angle, xi, emf = panels[row]
        speed.plot(time, np.abs(run.h) * run.x / POLE_PAIRS * RPM, color=RED, linewidth=0.9)
        speed.plot(time, run.truth.omega / POLE_PAIRS * RPM, color=BLUE, linewidth=0.9)
        speed.set_ylabel('speed [rpm]', fontsize=9)
        speed.set_ylim(-1000.0, 8000.0)
        angle.plot(time, np.degrees(wrapped(wrong.angle)), color=BLUE, linewidth=0.9)
        angle.set_ylabel('angle error [deg]', fontsize=9)
        angle.set_ylim(-180.0, 180.0)
        xi.axhline(1.0 / FLUX, color=BLUE, linewidth=0.9)
        xi.plot(time, run.x, color=RED, linewidth=0.9)
        xi.set_ylabel(r'$\xi$, $\hat\xi$ [1/Wb]', fontsize=9)
        xi.set_ylim(-50.0, 700.0)
        emf.plot(time, wrong.emf.real, color=BLUE, linewidth=0.9)
        emf.plot(time, wrong.emf.imag, color=RED, linewidth=0.9)
        emf.set_ylabel(r'$h-\hat h$ [V]', fontsize=9)
        emf.set_ylim(-1.2, 1.2)
        for letter, axes in zip(LETTERS[row], panels[row]):
            axes.set_title(f'({letter})', fontsize=9, color=SOFT)
            tidy(axes)
            if row:
                axes.set_ylabel('')
        speed.set_title(f'{name} ({LETTERS[row][0]})', fontsize=9)
        emf.set_xlabel('time [s]', fontsize=9)
    return figure


FIGURES = {'pmsm_figure_1': phase_portrait, 'pmsm_figure_2': transients}
