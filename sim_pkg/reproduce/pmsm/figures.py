# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures 1 and 2 of the sensorless-motor paper, drawn with matplotlib."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_pkg.reproduce.drawing import BLUE, GREY, RED, TRUTH, lines, panels
from sim_pkg.reproduce.pmsm.motor import FLUX, POLE_PAIRS, errors
from sim_pkg.reproduce.pmsm.paper import NAMES, figure_2

CHI, K_ETA, GAMMA = 1.0, 1.5, 1.0  # of Figure 1, as printed
STARTS = ((-math.pi, 3.6), (-2.8, 2.0), (-1.5, 1.5), (-2.5, -0.3), (-1.0, -1.0))  # and their minus
RPM = 30.0 / math.pi
OUTSIDE = 4.2  # of the picture [1/Wb]

Array = NDArray[np.float64]


def reduced(angle: float, xi: float, duration: float) -> tuple[Array, Array]:
    """Return a trajectory of (6) from (angle, xi error), shape (n,); backwards if duration < 0."""

    def slope(_: float, state: Array) -> tuple[float, float]:
        sine = math.sin(state[0])
        return CHI * state[1] - K_ETA * CHI * sine, -GAMMA * CHI * sine

    at = np.linspace(0.0, duration, 8000)
    rows = solve_ivp(slope, (0.0, duration), (angle, xi), rtol=1e-8, atol=1e-9, t_eval=at).y
    return rows[0], np.where(np.abs(rows[1]) > OUTSIDE, np.nan, rows[1])


def unstable_manifold() -> list[tuple[Array, Array]]:
    """Return both branches, shape (n,), of the curve on which (6) runs into the saddle (pi, 0)."""
    # linearised at the saddle: d(angle) = chi xi + k chi angle, d(xi) = gamma chi angle
    slow = 0.5 * (K_ETA - math.sqrt(K_ETA**2 + 4.0 * GAMMA))
    away = 1e-4 / math.hypot(slow, GAMMA)
    return [reduced(math.pi + s * away * slow, s * away * GAMMA, -40.0) for s in (1.0, -1.0)]


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
    starts = [(sign * angle, sign * xi) for angle, xi in STARTS for sign in (1.0, -1.0)]
    curves = [(*reduced(*start, 30.0), BLUE) for start in starts]
    curves += [(*branch, RED) for branch in unstable_manifold()]
    for angle, xi, colour in curves:
        plane.plot(wrapped(angle), xi, color=colour)
        cylinder.plot(np.cos(angle), np.sin(angle), xi, color=colour)
    plane.plot(0.0, 0.0, 'o', color=BLUE)
    plane.plot([-math.pi, math.pi], [0.0, 0.0], 'o', color=RED)
    plane.set(xlim=(-math.pi, math.pi), xlabel='angle [rad]', ylabel='xi error [1/Wb]')
    plane.grid(color=GREY, linewidth=0.5)
    figure.suptitle('(6) on the plane and on the cylinder')
    return figure


def transients() -> Figure:
    """Figure 2: speed, angle error, xi and error of the back-EMF of the three observers."""
    labels = 'speed [rpm]', 'angle error [deg]', 'xi [1/Wb]', 'back-EMF error [V]'
    figure, axes = panels(4, f'observers {", ".join(NAMES.values())}', labels, columns=3)
    for name, (speed, angle, xi, emf) in zip(NAMES, axes.T):
        run = figure_2(name)
        wrong, time = errors(run), run.truth.time
        estimate, true = np.abs(run.h) * run.x, run.truth.omega
        rpm = RPM / POLE_PAIRS
        lines(speed, time, {'estimate': rpm * estimate, 'true': rpm * true}, {'true': TRUTH})
        lines(angle, time, {'': np.degrees(wrapped(wrong.angle))}, {})
        lines(
            xi, time, {'estimate': run.x, 'true': np.full(len(time), 1.0 / FLUX)}, {'true': TRUTH}
        )
        lines(emf, time, {'h1': wrong.emf.real, 'h2': wrong.emf.imag}, {})
        speed.set_ylim(-1000.0, 8000.0)
        xi.set_ylim(-50.0, 700.0)
        emf.set_ylim(-1.2, 1.2)
    return figure


FIGURES = {'pmsm_figure_1': phase_portrait, 'pmsm_figure_2': transients}
