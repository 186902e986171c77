# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Super-twisting differentiators of order 1, 2 and 3 (sliding-mode observers of an angle alone).

The continuous differentiator of order n bounds its error by L, the bound of derivative n + 1:

    z_j' = z_{j+1} + c_{j+1} L^{(j+1)/(n+1)} |e|^{(n-j)/(n+1)} sgn e,   e = y - z_0,  j = 0..n

What matters in practice is how it is sampled (`form`). Both forms are written here as a prediction
over the true dt and a correction by the wrapped innovation, so that the estimate belongs to the
newest sample. The published predictor forms (correction first, then the step) are the same
filters: their gain is A times ours. With s = dt (L/|e|)^(1/(n+1)), dt times the speed of the error
dynamics at an innovation e, the gains are

    explicit   those of forward Euler
    matching   those of a Taylor chain whose eigenvalues are exp(s p_i); p_i are the roots of
               p^(n+1) + c_1 p^n + ... + c_{n+1}

For one size of innovation the observer is linear, and its noise gains follow.

Barbot, Djemai, Manamanni (2007), use order 1: equations (5) and (14).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.observers.angle.shared import (
    LAG_3,
    OUTSIDE_PART,
    AngleGains,
    LinearObserver,
    SharedDesign,
    set_shared,
)
from estimator_pkg.observers.maths.steady_noise import steady_variances
from estimator_pkg.observers.maths.tracking import noise_of_three, noise_of_two
from estimator_pkg.parameters import parameter, structural
from estimator_pkg.record import record

# c_1 .. c_{n+1} for a bound of 1; larger ones converge faster and are noisier.
COEFFICIENTS = {1: (1.5, 1.1), 2: (2.0, 2.12, 1.1), 3: (3.0, 4.16, 3.06, 1.1)}
ZERO_INNOVATION = 1e-150  # innovations below this are zero: no power of them overflows
TABLE = 48  # points of the noise table
TABLE_FROM = -3.0  # log10 of the smallest speed of the error dynamics in it
TABLE_STEP = 0.1
ERROR_DECAY = 0.55  # of (L/|e|)^(1/(n+1)): its slowest error decays so fast
REFRESH = 8  # samples after which the noise gains are computed again
POWER_WEIGHT = 0.15  # weight of the mean square of the newest REFRESH samples: 50 samples in all
TRANSIENT_RATIO = 16.0  # times less than the mean square: a transient is over, ...
TRANSIENT_DECAY = 0.5  # ... and is forgotten by this factor every REFRESH samples


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `super_twisting`."""

    order: int = structural(
        2,
        range=(1, 3),
        description='1: velocity, from a bound of acceleration; 2: and acceleration, from a bound '
        'of jerk; 3: from a bound of snap',
    )
    bound: float = parameter(
        5000.0,
        unit='rad/s^(order+1)',
        range=(1e-6, 1e15),
        search=(1.0, 1e7),
        description='largest acceleration (order 1), jerk (2) or snap (3) of the motion; too small '
        'fails hard, too large costs about its square root in noise',
        equation='L in lambda_j = c_j L^(j/(n+1))',
    )
    form: str = structural(
        'matching',
        choices=('matching', 'explicit'),
        description='sampling: matching (eigenvalues matched to dt), explicit (Euler; chatters by '
        'dt times the gain, kept to show why not)',
    )


@record
class Roots:
    """Roots of p^m + c_1 p^(m-1) + ..., in units of (L/|e|)^(1/(n+1))."""

    single: float  # the real one (order 2)
    real: float  # of a pair
    imaginary: float
    real_2: float  # of the second pair (order 3)
    imaginary_2: float


def predict(core: Any, design: SuperTwisting.Design, dt: float) -> None:
    """Move the chain on by dt [s], its highest derivative constant; explicit: by forward Euler."""
    v, a, j = core.velocity, core.acceleration if design.order > 1 else 0.0, core.jerk
    if design.explicit:
        core.position += dt * v
        core.velocity += dt * a
    else:
        core.position += dt * (v + dt * (0.5 * a + dt * j / 6.0))
        core.velocity += dt * (a + 0.5 * dt * j)
    core.acceleration += dt * j


def explicit(s: float, design: SuperTwisting.Design) -> tuple[float, float, float, float]:
    """Return the gains of forward Euler, in the units of `matched`.

    The corrections come after the step of the published predictor form; before it they are A^-1 of
    them.
    """
    k3 = design.c[3] * s * s * s * s
    k2 = design.c[2] * s * s * s - k3
    k1 = design.c[1] * s * s - k2
    return design.c[0] * s - k1, k1, k2, k3


def matched(order: int, s: float, roots: Roots) -> tuple[float, float, float, float]:
    """Return the gains of position, velocity dt, acceleration dt^2 and jerk dt^3.

    Parameters
    ----------
    s : dt times the speed (L/|e|)^(1/(n+1)) of the error dynamics.
    """
    total, product = pair(s, roots.real, roots.imaginary)
    if order == 1:
        return total - product, product, 0.0, 0.0
    if order == 2:
        d = -math.expm1(roots.single * s)
        e2, e3 = product + total * d, product * d
        return total + d - e2 + e3, e2 - 1.5 * e3, e3, 0.0
    total_2, product_2 = pair(s, roots.real_2, roots.imaginary_2)
    e2, e3 = product + product_2 + total * total_2, total * product_2 + total_2 * product
    e4 = product * product_2
    return (total + total_2 - e2 + e3 - e4, e2 - 1.5 * e3 + 11.0 / 6.0 * e4, e3 - 2.0 * e4, e4)


def pair(s: float, real: float, imaginary: float) -> tuple[float, float]:
    """Return sum and product of 1 - z for the eigenvalues z = exp(s (real +- i imaginary)).

    Made of 1 - |z| and of 2 (|z| - Re z), so that no digits are lost where s is small.
    """
    short = -math.expm1(real * s)
    half = math.sin(0.5 * imaginary * s)
    turned = 4.0 * (1.0 - short) * half * half
    return 2.0 * short + turned, short * short + turned


def noise_gains_at(
    power: float, dt: float, design: SuperTwisting.Design
) -> tuple[float, float, float]:
    """Return variances of position, velocity [1/s^2] and innovation per unit variance of noise.

    Parameters
    ----------
    power : mean square innovation [rad^2].
    """
    # dt times the speed of the error dynamics
    s = dt * design.scale / math.pow(max(power, ZERO_INNOVATION), 0.5 / (design.order + 1.0))
    if design.order == 3:
        return tabled(s, dt, design)
    k0, k1, k2, k3 = matched(design.order, s, design.roots)
    if design.order == 1:
        return noise_of_two(k0, k1, dt)
    return noise_of_three(k0, k1, k2, dt)


def tabled(s: float, dt: float, design: SuperTwisting.Design) -> tuple[float, float, float]:
    """Return the noise gains of order 3, which have no short closed form, from the table."""
    at = (math.log10(s) - TABLE_FROM) / TABLE_STEP
    at = min(max(at, 0.0), TABLE - 1.001)
    i = int(at)
    part, rate, row, after = at - i, 1.0 / dt, design.table[i], design.table[i + 1]
    return (
        math.exp(row[0] + part * (after[0] - row[0])),
        math.exp(row[1] + part * (after[1] - row[1])) * (rate * rate),
        math.exp(row[2] + part * (after[2] - row[2])),
    )


def refresh_noise(core: Any, power: float, dt: float, design: SuperTwisting.Design) -> None:
    """Compute the noise gains at this mean square innovation [rad^2], and average anew."""
    core.power, core.total, core.ticks = power, 0.0, 1
    core.of_position, core.of_velocity, core.of_innovation = noise_gains_at(power, dt, design)


def roots_of(order: int) -> Roots:
    """Return the roots of p^m + c_1 p^(m-1) + ..., with the c_i of this order."""
    found = np.roots((1.0, *COEFFICIENTS[order]))
    pairs = [complex(root) for root in sorted(found, key=cmath.phase) if root.imag > 1e-9]
    reals = [float(root.real) for root in found if abs(root.imag) <= 1e-9]
    made = Roots()
    made.single = reals[0] if reals else 0.0
    made.real, made.imaginary = pairs[0].real, pairs[0].imag
    if len(pairs) > 1:
        made.real_2, made.imaginary_2 = pairs[1].real, pairs[1].imag
    return made


def noise_table(roots: Roots) -> list[list[float]]:
    """Return logarithms of the noise gains of order 3 at dt = 1, shape (TABLE, 3).

    One row for each speed of the error dynamics.
    """
    chain = np.array(
        [[1.0 / math.factorial(j - i) if j >= i else 0.0 for j in range(4)] for i in range(4)]
    )
    speeds = [10.0 ** (TABLE_FROM + TABLE_STEP * point) for point in range(TABLE)]
    gains = [steady_variances(chain, np.array(matched(3, s, roots))) for s in speeds]
    return [list(map(math.log, each)) for each in gains]


class SuperTwisting(LinearObserver):
    """The differentiator."""

    name = 'super_twisting'
    summary = 'super-twisting differentiators of order 1 to 3'
    reference = 'Barbot, Djemai, Manamanni (2007); Levant (2003); matching discretisation'
    gains = Gains
    TURNS = False  # its position is wrapped

    @record
    class Design:
        """What the gains imply whatever the sample time is."""

        shared: SharedDesign
        explicit: bool  # sampled by forward Euler; else with matched eigenvalues
        order: int  # n
        scale: float  # L^(1/(n+1))
        c: Annotated[list[float], 4]  # of the differentiator; those beyond n + 1 are 0
        roots: Roots
        table: Annotated[list[list[float]], TABLE, 3]  # logarithms of noise gains (order 3)
        longest_dt: float  # [s] beyond which it chatters over more than an eighth of a turn

    @record
    class Coefficients:
        """What follows from the sample time; the gains depend on the innovation, too."""

        dt: float  # [s]
        rate: float  # 1/dt

    @record
    class Core:
        """The differentiator, and what noise makes of its gains."""

        position: float  # [rad]
        velocity: float  # [rad/s]
        acceleration: float  # [rad/s^2]; order 1: nan
        jerk: float  # [rad/s^3]
        ticks: int  # samples since the noise gains were computed; 0: only one sample has come
        total: float  # sum of the squared innovations of these samples [rad^2]
        power: float  # mean square innovation [rad^2]
        of_position: float  # the noise gains
        of_velocity: float
        of_innovation: float

    @staticmethod
    def design(gains: Gains, circle: Circle) -> SuperTwisting.Design:
        """Return what follows from the gains whatever the sample time is."""
        order, made = gains.order, SuperTwisting.Design()
        made.explicit, made.order = gains.form == 'explicit', order
        made.scale = gains.bound ** (1.0 / (order + 1))
        made.c[: order + 1] = COEFFICIENTS[order]
        made.roots = roots_of(order)
        if order == 3:
            made.table = noise_table(made.roots)
        widest = OUTSIDE_PART * circle.period if circle.period > 0.0 and made.explicit else math.inf
        made.longest_dt = (widest / gains.bound) ** (1.0 / (order + 1))
        # Convergence from an error that one sample can hide: about the time that the bound needs to
        # make a speed of its own scale.
        settle = 3.0 * (0.01 / gains.bound) ** (1.0 / (order + 1))
        set_shared(made.shared, gains, circle, settle, LAG_3)
        return made

    @staticmethod
    def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]."""
        coefficients.dt, coefficients.rate = dt, 1.0 / dt

    @staticmethod
    def begin(core: Core, design: Design, measurement: float) -> None:
        """Begin at a measurement [rad], without a speed."""
        SuperTwisting.resume_core(core, design, measurement)
        core.velocity = core.power = core.total = 0.0
        core.ticks = 0
        core.of_position = core.of_velocity = core.of_innovation = 1.0

    @staticmethod
    def resume_core(core: Core, design: Design, measurement: float) -> None:
        """Go on after a gap: the speed is kept, higher derivatives are not."""
        core.position, core.jerk = measurement, 0.0
        core.acceleration = 0.0 if design.order > 1 else math.nan

    @staticmethod
    def correct(
        core: Core, coefficients: Coefficients, design: Design, measurement: float
    ) -> float:
        """Take a measurement [rad]; return the innovation [rad]."""
        dt, rate, period = coefficients.dt, coefficients.rate, design.shared.period
        if core.ticks == 0:  # the second sample gives the speed: right below half a turn per sample
            core.velocity = wrap(measurement - core.position, period) / dt
            core.position = measurement
            refresh_noise(core, 0.0, dt, design)
            return 0.0
        predict(core, design, dt)
        innovation = measurement - core.position
        if not -period <= innovation + innovation < period:
            innovation = wrap(innovation, period)
        size = abs(innovation)
        if size > ZERO_INNOVATION:
            s = dt * design.scale / math.pow(size, 1.0 / (design.order + 1.0))
            if design.explicit:
                k0, k1, k2, k3 = explicit(s, design)
            else:
                k0, k1, k2, k3 = matched(design.order, s, design.roots)
            core.position += k0 * innovation
            core.velocity += k1 * innovation * rate
            core.acceleration += k2 * innovation * rate * rate
            core.jerk += k3 * innovation * rate * rate * rate
        if not -period <= core.position + core.position < period:
            core.position = wrap(core.position, period)
        core.total += innovation * innovation
        core.ticks += 1
        if core.ticks > REFRESH:
            mean, power = core.total / REFRESH, core.power
            if TRANSIENT_RATIO * mean < power:  # a transient must not stay in it for long
                power *= TRANSIENT_DECAY
            else:
                power += POWER_WEIGHT * (mean - power)
            refresh_noise(core, power, dt, design)
        return innovation

    @staticmethod
    def noise_gains(
        core: Core, coefficients: Coefficients, design: Design
    ) -> tuple[float, float, float]:
        """Return the noise gains as they were computed, REFRESH samples ago at most."""
        return core.of_position, core.of_velocity, core.of_innovation

    @staticmethod
    def pace(
        observer: Any, core: Core, coefficients: Coefficients, design: Design, dt: float
    ) -> float:
        """Return how fast errors decay [1/s]: the slower, the larger the innovation is."""
        power = max(core.total, core.power, ZERO_INNOVATION)  # of a transient, from its begin
        # one neper per sample: dead beat is no faster
        return min(
            ERROR_DECAY * design.scale / math.pow(power, 0.5 / (design.order + 1.0)), 1.0 / dt
        )

    @staticmethod
    def limits(design: Design, dt: float) -> str | None:
        """Return why the form cannot work at this dt [s]; None: it can."""
        if dt <= design.longest_dt:
            return None
        return (
            f"form 'explicit' chatters over more than an eighth of a turn at a sample time "
            f'of {dt:.3g} s: it needs less than {design.longest_dt:.3g} s, or a lower bound; '
            "'matching' does not chatter"
        )

    @staticmethod
    def group_delay(design: Design, dt: float) -> float:
        """Return 0 [s]."""
        return 0.0

    @staticmethod
    def gives_acceleration(gains: Gains) -> bool:
        """Return True if `estimate` sets the acceleration."""
        return gains.order > 1
