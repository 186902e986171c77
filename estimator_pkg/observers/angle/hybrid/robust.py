# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The robust sampled form of the hybrid observer: pole-matched gains, noise, corrections.

The poles are those of the continuous design at any sample time (pole matching), so no sample time
is unstable and each sample may have its own. Against Algorithm 1 of Brentari et al. (2018):

* The innovation is continued from the error that the last correction left: it may pass pi, where
  the wrapped one would fold over and could hold a false speed for ever.
* The reset (J2) comes before the injection, and the injection never moves the position past the
  measurement (that tames tan).
* The start is an expanding memory: least squares over the samples so far, until its gains have come
  down to the steady ones. The speed is right from the second sample on.
* A sample that is off by more than an eighth of a turn, at once, is not injected: one kick could
  carry the speed to another that fits the samples as well (v + n 2 pi/T). The speed is held. If
  the next samples fit again it was an outlier; if they do not, a new start is made from them. Where
  a turn has so few counts that the next one is further, `quantum` says so: 1.5 of them then.

The innovation is the error that the last correction left plus the motion that was not predicted.
Order 2 is order 3 without an acceleration, but for its gains and its start.
"""

from __future__ import annotations

import math

from estimator_pkg.circle import wrap
from estimator_pkg.observers.angle.hybrid.design import Coefficients, Core, Design
from estimator_pkg.observers.angle.hybrid.injections import SAW, inject
from estimator_pkg.observers.maths.tracking import matched, noise_of_three, noise_of_two

# Doubtful samples do not correct the speed for HOLD [s] and HOLD_SAMPLES samples; then comes a new
# start.
HOLD = 0.02
HOLD_SAMPLES = 3


def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
    """Set the gains of this dt [s].

    With p, v, a the prediction and e the innovation, x = p + alpha e, v += beta/dt e,
    a += gamma/dt^2 e have the z-polynomial of order 3
    z^3 + (alpha + beta + gamma/2 - 3) z^2 + (3 - 2 alpha - beta + gamma/2) z + alpha - 1.
    With the elementary symmetric sums E1, E2, E3 of d_i = 1 - z_i, so that nothing cancels in a
    slow loop: alpha = E1 - E2 + E3, beta = E2 - 3/2 E3, gamma = E3. The z of a triple real pole is
    one exponential.
    """
    coefficients.dt = dt
    if design.triple:
        z = math.exp(-design.single * dt)
        rate = (1.0 - z) / dt
        slope = (1.0 - z) * rate
        coefficients.alpha = 1.0 - z * z * z
        coefficients.beta = 1.5 * slope * (1.0 + z)
        coefficients.gamma = slope * rate
        coefficients.z = z
        return
    of_pair, product = matched(design.decay, design.discriminant, dt)  # d1 + d2 - d1 d2, d1 d2
    if design.order == 2:
        coefficients.alpha, coefficients.beta = of_pair, product / dt
        coefficients.gamma = coefficients.z = 0.0
        return
    d = -math.expm1(-design.single * dt)
    gamma = d * product
    coefficients.alpha = d + of_pair - d * of_pair
    coefficients.beta = (product + d * of_pair - 0.5 * gamma) / dt
    coefficients.gamma = gamma / (dt * dt)
    coefficients.z = 1.0 - d


def place(core: Core, measurement: float, error: float, phase: float) -> None:
    """Set the position to a measurement [rad] less the error [rad] that a correction left."""
    core.last, core.error, core.phase = measurement, error, phase
    core.position = measurement - error


def forget_acceleration(core: Core, design: Design) -> None:
    """Set the acceleration to 0; order 2 has none."""
    core.acceleration = 0.0 if design.order == 3 else math.nan


def begin(core: Core, design: Design, measurement: float) -> None:
    """Begin at a measurement [rad], without a speed."""
    place(core, measurement, 0.0, 1.0)
    core.velocity = 0.0
    forget_acceleration(core, design)


def resume(core: Core, design: Design, measurement: float) -> None:
    """Go on after a gap: at the measurement [rad], with the speed as it was."""
    place(core, measurement, 0.0, core.phase)
    forget_acceleration(core, design)


def clamped(velocity: float, fastest: float) -> float:
    """Return `velocity` clamped to +-fastest [rad/s]."""
    return min(max(velocity, -fastest), fastest)


def correct(core: Core, coefficients: Coefficients, design: Design, measurement: float) -> float:
    """Take a measurement [rad]; return the innovation [rad]."""
    dt, doubtful, fastest = coefficients.dt, design.doubtful, design.fastest
    gained = core.acceleration * dt if design.order == 3 else 0.0
    unpredicted = measurement - core.last - (core.velocity + 0.5 * gained) * dt
    strange = False
    if not -doubtful <= unpredicted <= doubtful:
        unpredicted = wrap(unpredicted, design.shared.period)
        strange = not -doubtful <= unpredicted <= doubtful
    innovation = core.error + unpredicted
    if strange or core.phase != 0.0:
        if core.phase > 0.0:
            return start(core, coefficients, design, measurement, innovation)
        return hold(core, coefficients, design, measurement, unpredicted, innovation)
    velocity = core.velocity + gained
    if not -design.reset_from < innovation < design.reset_from:  # in J2
        place(core, measurement, 0.0, 0.0)
        core.velocity = clamped(velocity, fastest)
        return innovation
    injected = innovation
    if design.injection != SAW:
        injected = inject(innovation, design)
        if abs(injected) * coefficients.alpha > abs(innovation):
            injected = innovation / coefficients.alpha
    velocity += coefficients.beta * injected
    core.acceleration += coefficients.gamma * injected
    if not -fastest <= velocity <= fastest:
        velocity = clamped(velocity, fastest)
        forget_acceleration(core, design)
    core.velocity = velocity
    place(core, measurement, innovation - coefficients.alpha * injected, 0.0)
    return innovation


def start_again(core: Core, design: Design, measurement: float, dt: float) -> None:
    """Start again with the straight line through the last measurement and this one [rad]."""
    moved = wrap(measurement - core.last, design.shared.period)
    core.velocity = clamped(moved / dt, design.fastest)
    forget_acceleration(core, design)
    place(core, measurement, 0.0, 2.0)


def start(
    core: Core, coefficients: Coefficients, design: Design, measurement: float, innovation: float
) -> float:
    """Take a sample of a start: a line through two samples, then an expanding memory.

    That is least squares of a line (order 2) or a parabola through all samples so far.
    """
    dt, n = coefficients.dt, core.phase + 1.0
    if n < 3.0:  # the speed was not known: no innovation
        core.velocity = clamped(core.velocity + innovation / dt, design.fastest)
        forget_acceleration(core, design)
        place(core, measurement, 0.0, n)
        return 0.0
    if not -design.doubtful <= innovation <= design.doubtful:
        start_again(core, design, measurement, dt)
        return innovation
    alpha, beta, gamma = coefficients.alpha, coefficients.beta, coefficients.gamma
    if design.order == 2:
        part = 1.0 / (n * (n + 1.0))
        begins = 6.0 * part / dt >= beta
        if begins:
            alpha, beta = (4.0 * n - 2.0) * part, 6.0 * part / dt
        velocity = core.velocity + beta * innovation
    else:
        part = 1.0 / (n * (n + 1.0) * (n + 2.0))
        begins = 60.0 * part / (dt * dt) >= gamma
        if begins:
            alpha, beta = (9.0 * n * (n - 1.0) + 6.0) * part, (36.0 * n - 18.0) * part / dt
            gamma = 60.0 * part / (dt * dt)
        velocity = core.velocity + core.acceleration * dt + beta * innovation
        core.acceleration += gamma * innovation
    core.velocity = clamped(velocity, design.fastest)
    place(core, measurement, innovation - alpha * innovation, n if begins else 0.0)
    return innovation


def hold(
    core: Core,
    coefficients: Coefficients,
    design: Design,
    measurement: float,
    unpredicted: float,
    innovation: float,
) -> float:
    """Take an outlier, or the sample after one: the speed is held; inf: a new start is made."""
    dt, doubtful = coefficients.dt, design.doubtful
    innovation = wrap(innovation, design.shared.period)
    if design.order == 3:
        core.velocity = clamped(core.velocity + core.acceleration * dt, design.fastest)
    if -doubtful <= innovation <= doubtful and -doubtful <= unpredicted <= doubtful:
        place(core, measurement, innovation, 0.0)
        return innovation
    phase = core.phase - 1.0
    if -phase > HOLD_SAMPLES and -phase * dt > HOLD:
        start_again(core, design, measurement, dt)
        return math.inf
    forget_acceleration(core, design)
    place(core, measurement, innovation, phase)
    return innovation


def noise_gains(coefficients: Coefficients, design: Design) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise.

    For a triple real pole z the equation factors. With d = 1 - z:
    d (1 + 6 z + 16 z^2 + 24 z^3 + 19 z^4), d^3 (13 + 50 z + 49 z^2)/(2 dt^2) and
    20 + 10 z + 2 z^2, all over (1 + z)^5.
    """
    dt = coefficients.dt
    if design.order == 2:
        return noise_of_two(coefficients.alpha, coefficients.beta * dt, dt)
    if not design.triple:
        gamma = coefficients.gamma * dt * dt
        return noise_of_three(coefficients.alpha, coefficients.beta * dt, gamma, dt)
    z = coefficients.z
    d = 1.0 - z
    rate = d / dt
    one = 1.0 + z
    two = one * one
    scale = 1.0 / (two * two * one)
    return (
        d * (1.0 + z * (6.0 + z * (16.0 + z * (24.0 + z * 19.0)))) * scale,
        d * rate * rate * (6.5 + z * (25.0 + 24.5 * z)) * scale,
        (20.0 + z * (10.0 + 2.0 * z)) * scale,
    )
