# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The adaptation law: when the parameters adapt, how, and the sums for `evidence`."""

from __future__ import annotations

from operator import add

from estimator_pkg.observers.adaptive.state import Design, LearningSums, State
from estimator_pkg.observers.maths.least_squares import update
from estimator_pkg.observers.maths.vectors import exceeds, multiply, quadratic
from estimator_pkg.sensor.scatter import Scatter

# The phases of adaptation
INIT = 0  # the filters settle
ADAPTING = 1
GATED = 2  # too little excitation to determine the parameters
FROZEN = 3  # by the user
PHASE_NAMES = ('INIT', 'ADAPTING', 'GATED', 'FROZEN')
PHASE_TEXTS = (
    'the filters settle after a start',
    'the signals determine the parameters',
    'the signals do not determine the parameters: too little excitation',
    "frozen by the user ('adapt' is false)",
)
PAUSED = 'paused: a knock, or slower than moving_above'

LEAST_REGULAR = 1.0 - 1e-9  # on the diagonal: a matrix that only rounding makes regular is singular


def adapt(
    state: State, design: Design, psi: list[float], e: float, h: float, forget: float
) -> None:
    """Move the free parameters after an innovation e [rad]; P too, of least squares."""
    theta = state.theta
    if not design.is_gradient:
        update(theta, state.p, psi, e, forget, design.variance)
        return
    direction, seen = multiply(design.gamma, psi)
    size = h * e
    if not design.is_paper:  # the a posteriori innovation
        size = h * e / (1.0 + h * seen)
    for i, along in enumerate(direction):  # (12)
        theta[i] += size * along
        if design.bounded:
            theta[i] = min(max(theta[i], design.low[i]), design.high[i])


def variance(scatter: Scatter, design: Design) -> float:
    """Return the variance of the measurement noise [rad^2]."""
    if design.noise > 0.0:
        return design.noise
    return scatter.variance if scatter.variance > design.finest else design.finest


def expected(state: State, design: Design, h: float) -> float:
    """Return the innovation variance that this noise explains [rad^2]."""
    injected = list(map(add, design.k, state.plant))  # K + L
    return variance(state.scatter, design) * (1.0 + h * quadratic(design.w, injected))


def judged(state: State, design: Design, h: float) -> int:
    """Return the phase after INIT."""
    if not design.adapt:
        return FROZEN
    if design.gated:
        keep, noise = 1.0, 1.0
        if design.noise_gate:
            keep, noise = LEAST_REGULAR, h * variance(state.scatter, design)
        if not exceeds(state.information, keep, noise, design.floor):
            return GATED
    return ADAPTING


def gather(sums: LearningSums, state: State, psi: list[float], target: float) -> None:
    """Add one more sample to the sums of `evidence`."""
    matrix, vector = sums.matrix, sums.vector
    for i, x in enumerate(psi):
        row = matrix[i]
        for j in range(i + 1):
            row[j] += x * psi[j]
        vector[i] += target * x
    sums.count += 1.0
    sums.of_e += state.slow_e * state.slow_e
    sums.of_bend += state.slow_bend * state.slow_bend
