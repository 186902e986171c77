# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Adaptation law: when the parameters adapt, how, and the sums for `evidence`.

psi, what multiplies the free parameters in an innovation, has shape (m,), and psi psi' (m, m).
"""

from __future__ import annotations

import numpy as np

from estimator_pkg.observers.adaptive.state import Array, Coefficients, Design, State
from estimator_pkg.observers.maths.least_squares import update

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

FILTER_SETTLING = 5.0  # time constants of the slowest pole until the filters have settled
SQUARE_CLIP = 25.0  # a square is clamped to this multiple of the usual one
START_SPEEDUP = 10.0  # factor by which powers are averaged faster after a start
LEAST_REGULAR = 1e-9  # part of the diagonal: a matrix that only rounding makes regular is singular
# Ratio of information above which the signals determine the parameters. Noise in the filtered
# measurement then biases them by at most about 1 % of their values.
SIGNAL_TO_NOISE = 100.0


def learn(
    state: State, coefficients: Coefficients, design: Design, psi: Array, e: float, target: float
) -> None:
    """Learn from the innovation e [rad] of psi theta = target: excitation, parameters, powers."""
    h, low_pass, recent = coefficients.h, coefficients.low_pass, coefficients.weight
    square = psi[:, None] * psi
    state.information = coefficients.keep * state.information + h * square
    state.slow_e += (e - state.slow_e) * low_pass
    bend = state.y + float(state.upsilon[0, : design.order] @ design.a_k[:, 0])
    state.slow_bend += (bend - state.slow_bend) * low_pass
    if state.phase == ADAPTING and design.adapt:
        pause(state, design, e, recent)
        if state.paused > 0.0:
            state.paused -= h
        else:
            gather(state, square, target * psi)
            adapt(state, design, psi, e, h, coefficients.forget)
            set_plant(state, design)
            state.adapted += h
    if state.age < design.settle + 2.0 * design.average:  # while theta converges
        recent = min(START_SPEEDUP * recent, 1.0)
    state.power += (e * e - state.power) * recent
    state.slow_power += (state.slow_e * state.slow_e - state.slow_power) * recent


def pause(state: State, design: Design, e: float, weight: float) -> None:
    """Follow the usual square of the innovation; pause the adaptation where the plant differs.

    The plant's equation is not valid after a knock, and while dry friction may stop the joint.
    Adaptation pauses until the filters have forgotten that.
    """
    square, n, pause = e * e, design.order, FILTER_SETTLING / design.slowest
    if design.moving_above > 0.0:
        speed = design.observer[-1] * state.upsilon[0, n - 2]
        if abs(speed) < design.moving_above:
            state.paused = pause
            return
    if design.knock > 0.0:
        if state.adapted > design.average:
            if square > design.knock * state.usual:
                state.paused = pause
            square = min(square, SQUARE_CLIP * state.usual)
        state.usual += (square - state.usual) * weight


def gather(state: State, square: Array, along: Array) -> None:
    """Add psi psi' and psi target of one more sample to the sums of `evidence`."""
    sums = state.sums
    sums.matrix, sums.vector = sums.matrix + square, sums.vector + along
    sums.count += 1.0
    sums.of_e += state.slow_e * state.slow_e
    sums.of_bend += state.slow_bend * state.slow_bend


def adapt(state: State, design: Design, psi: Array, e: float, h: float, forget: float) -> None:
    """Move the free parameters after an innovation e [rad]; P too, of least squares."""
    if not design.is_gradient:
        state.theta, state.p, _ = update(state.theta, state.p, psi, e, forget, design.variance)
        return
    direction = design.gamma @ psi
    size = h * e
    if not design.is_paper:  # the a posteriori innovation
        size /= 1.0 + h * float(psi @ direction)
    theta = state.theta + size * direction  # (12)
    state.theta = np.clip(theta, design.low[design.free], design.high[design.free])


def set_plant(state: State, design: Design) -> None:
    """Set all of theta from the free parameters.

    The free parameters of least squares are clamped to their bounds here alone: P assumes that
    theta moves, so the recursion would diverge at a bound.
    """
    plant = design.fixed.copy()
    plant[design.free] = state.theta
    state.plant = np.minimum(np.maximum(plant, design.low), design.high)


def variance(state: State, design: Design) -> float:
    """Return the variance of the measurement noise [rad^2]."""
    return design.noise if design.noise > 0.0 else max(state.scatter.variance, design.finest)


def injected(state: State, design: Design) -> Array:
    """Return K + L, by which the noise of the angle enters the filters, shape (n,)."""
    return (design.injection + state.plant)[: design.order]


def judged(state: State, design: Design, h: float) -> int:
    """Return the phase after INIT."""
    if not design.adapt:
        return FROZEN
    if design.gated:
        least = SIGNAL_TO_NOISE * h * variance(state, design) * design.noise_floor
        irregular = np.diag(LEAST_REGULAR * state.information.diagonal())
        try:
            np.linalg.cholesky(state.information - irregular - least)
        except np.linalg.LinAlgError:  # it is not positive definite
            return GATED
    return ADAPTING
