# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The adaptation law: when the parameters adapt, how, and the sums for `evidence`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from estimator_pkg.observers.adaptive.gains import GRADIENT, PAPER, Gains, Structure
from estimator_pkg.observers.adaptive.motion import Motion
from estimator_pkg.observers.maths.least_squares import make_update
from estimator_pkg.observers.maths.unroll import algebra

# The phases of adaptation
INIT = 0  # the filters settle
ADAPTING = 1
GATED = 2  # too little excitation to determine the parameters
FROZEN = 3  # by the user
PHASES = ('INIT', 'ADAPTING', 'GATED', 'FROZEN')
REASONS = (
    'the filters settle after a start',
    'the signals determine the parameters',
    'the signals do not determine the parameters: too little excitation',
    "frozen by the user ('adapt' is false)",
)
PAUSED = 'paused: a knock, or slower than moving_above'

REGULAR = 1.0 - 1e-9  # on the diagonal: a matrix that only rounding makes regular is singular


class Law(NamedTuple):
    """Functions of one structure.

    moved : (theta, P, psi, e, design, h, forget) -> (theta, P) after an innovation e [rad].
    judged : (information, scatter, design, h) -> the phase after INIT.
    variance : (scatter, design) -> variance of the measurement noise [rad^2].
    expected : (scatter, theta, design, h) -> innovation variance that this noise explains [rad^2].
    gathered : (evidence, psi, target, slow) -> the sums of `evidence` with one more sample.
    """

    moved: Callable[..., tuple]
    judged: Callable[..., int]
    variance: Callable[..., float]
    expected: Callable[..., float]
    gathered: Callable[..., tuple]


def law(gains: Gains, made: Structure, motion: Motion) -> Law:
    """Return the functions of this structure."""
    is_paper, is_gradient = gains.form == PAPER, gains.law == GRADIENT
    is_diagonal = bool(np.all(made.gamma == np.diag(np.diag(made.gamma))))
    is_gated, is_noise_gate = gains.gate != 'none', gains.gate == 'noise'
    bounded = any(map(math.isfinite, (*made.low, *made.high)))
    vectors, free = algebra(gains.order), algebra(len(made.free))
    dot, add, apply = vectors.dot, vectors.add, vectors.apply
    dot_m, add_m, apply_m, times_m, clip_m = free.dot, free.add, free.apply, free.times, free.clip
    rank_one, exceeds, parts = free.rank_one, free.exceeds, motion.parts
    update = make_update(len(made.free))

    def moved(
        theta: tuple, p: tuple, psi: tuple, e: float, design: Any, h: float, forget: float
    ) -> tuple:
        if is_gradient:
            if is_diagonal:
                direction = times_m(design.gamma, psi)
            else:
                direction = apply_m(design.gamma, psi)
            size = h * e if is_paper else h * e / (1.0 + h * dot_m(psi, direction))
            theta = add_m(theta, size, direction)
            if bounded:
                theta = clip_m(theta, design.low, design.high)
        else:
            theta, p, _ = update(theta, p, psi, e, forget, design.p_start)
        return theta, p

    def variance(scatter: tuple, design: Any) -> float:
        if design.noise > 0.0:
            return design.noise
        seen, count, last, rate, bend, before, earlier = scatter
        return seen if seen > design.finest else design.finest

    def expected(scatter: tuple, theta: tuple, design: Any, h: float) -> float:
        of_y, of_u, load, gravity = parts(theta, design)
        injected = add(design.k, 1.0, of_y)  # K + L
        return variance(scatter, design) * (1.0 + h * dot(injected, apply(design.w, injected)))

    def judged(information: tuple, scatter: tuple, design: Any, h: float) -> int:
        if design.adapt == 0.0:
            return FROZEN
        if is_gated:
            if is_noise_gate:
                noise = h * variance(scatter, design)
                open_now = exceeds(information, REGULAR, noise, design.floor)
            else:
                open_now = exceeds(information, 1.0, 1.0, design.floor)
            if not open_now:
                return GATED
        return ADAPTING

    def gathered(evidence: tuple, psi: tuple, target: float, slow: tuple) -> tuple:
        matrix, vector, sums = evidence
        count, of_e, of_bend = sums
        slow_e, slow_bend = slow
        return (
            rank_one(matrix, 1.0, 1.0, psi),
            add_m(vector, target, psi),
            (count + 1.0, of_e + slow_e * slow_e, of_bend + slow_bend * slow_bend),
        )

    return Law(moved, judged, variance, expected, gathered)
