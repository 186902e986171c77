# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid velocity observer for wrapped angles (Brentari, Bosetti, Zaccarian, 2018)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

from estimator_pkg.circle import FEW_COUNTS_MARGIN, Circle
from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.hybrid import design as records
from estimator_pkg.observers.angle.hybrid import injections, paper, robust
from estimator_pkg.observers.angle.hybrid.design import (
    Coefficients,
    Continuous,
    Core,
    Design,
    continuous_design,
    paper_limit,
)
from estimator_pkg.observers.angle.shared import (
    LAG_2,
    LAG_3,
    AngleGains,
    LinearObserver,
    set_shared,
)
from estimator_pkg.parameters import parameter, structural

DOUBTFUL = 0.125  # of a turn: a larger innovation is doubtful, unless a turn has few counts
SETTLING = 3.0  # time constants of the slowest pole until a start counts as settled


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `hybrid_angle`."""

    bandwidth_hz: float = parameter(
        45.0,
        unit='Hz',
        range=(0.001, 1e6),
        search=(0.5, 500.0),
        description='-3 dB frequency from true to estimated velocity of the continuous design',
        equation='sets epsilon',
    )
    order: int | None = structural(
        None,
        kind=int,
        range=(2, 3),
        description='3 also gives acceleration and has no ramp lag; automatic: 3 (form paper: 2)',
    )
    form: str = structural(
        'robust',
        choices=('robust', 'paper'),
        description='robust: poles matched at any sample time, innovation continued past half a '
        'turn, reset before injection; paper: Algorithm 1 exactly',
    )
    injection: str = structural(
        'saw',
        choices=(*injections.INJECTIONS, 'package.module:name'),
        description='how an error acts: sin(e), 2 tan(e/2), e, e held within M, or your own '
        'function of the error [rad]',
        equation='phi, section IV',
    )
    max_speed: float | None = parameter(
        None,
        unit='rad/s',
        kind=float,
        range=(1e-6, 1e9),
        description='speed limit: at a sample time T every speed + n 2 pi/T fits the samples as '
        'well; automatic: none',
    )
    epsilon: float | None = parameter(
        None,
        unit='s',
        kind=float,
        range=(1e-9, 1e6),
        advanced=True,
        description='high-gain scale; set, it goes before bandwidth_hz; automatic: follows from it',
        equation='L = (k1/eps, k2/eps^2)',
    )
    k1: float | None = parameter(
        None,
        kind=float,
        range=(1e-6, 1e6),
        advanced=True,
        description="the position equation's gain (k_v); automatic: 6 (order 3: 3)",
        equation='(3)',
    )
    k2: float | None = parameter(
        None,
        kind=float,
        range=(1e-6, 1e6),
        advanced=True,
        description="the velocity equation's gain (k_p); automatic: 5 (order 3: 3)",
        equation='(3)',
    )
    k3: float | None = parameter(
        None,
        kind=float,
        range=(1e-6, 1e6),
        advanced=True,
        description="the acceleration equation's gain, order 3 only; automatic: 1",
    )
    delta_pi: float = parameter(
        math.radians(5.0),
        unit='rad',
        range=(1e-6, 1.5),
        advanced=True,
        description='an error this close to half a turn resets the position to the measurement '
        '(of a turn of 2 pi; scaled with wrap_period)',
        equation='J2',
    )
    M: float = parameter(
        1.0,
        unit='rad',
        range=(1e-6, 1e6),
        advanced=True,
        description="saturation level of the injection 'sat'",
        equation='case study 4',
    )


def order_of(gains: Gains) -> int:
    """Return the order these gains mean: 2 or 3.

    Raises
    ------
    UsageError : the paper's form of the third order, which the paper does not have.
    """
    if gains.form == 'paper' and gains.order == 3:
        raise UsageError("form 'paper' is of second order: set 'order' to 2 or to 0 (automatic)")
    if gains.order is None:
        return 2 if gains.form == 'paper' else 3
    return gains.order


def design_of(gains: Gains) -> Continuous:
    """Return the continuous design these gains mean.

    Raises
    ------
    UsageError : an unstable design, or gains of another order.
    """
    k = (gains.k1, gains.k2, gains.k3)
    return continuous_design(order_of(gains), gains.bandwidth_hz, k, gains.epsilon)


def _set_robust(made: Design, gains: Gains, continuous: Continuous, period: float) -> None:
    made.reset_from = 0.5 * period - made.margin if period > 0.0 else math.inf
    made.doubtful = (
        max(DOUBTFUL * period, FEW_COUNTS_MARGIN * gains.quantum) if period > 0.0 else math.inf
    )
    made.fastest = math.inf if gains.max_speed is None else gains.max_speed
    # real ones first, so that a complex pair comes last; of three real ones any two are a pair
    *others, one, other = sorted(continuous.poles, key=lambda pole: (abs(pole.imag), pole.real))
    half_difference = 0.5 * (one - other)
    made.triple = continuous.triple
    made.single = others[0].real if others else 0.0
    made.decay = 0.5 * (one + other).real
    made.discriminant = (half_difference * half_difference).real


def _set_paper(made: Design, gains: Gains, continuous: Continuous) -> None:
    if gains.max_speed is not None:
        raise UsageError("form 'paper' has no speed limit: leave 'max_speed' automatic (0.0)")
    k1, k2 = continuous.k
    made.l1, made.l2 = k1 / continuous.epsilon, k2 / continuous.epsilon**2
    made.epsilon, made.bandwidth_hz = continuous.epsilon, continuous.bandwidth_hz
    made.ratio = paper_limit(continuous.k)


class HybridAngle(LinearObserver):
    """The hybrid observer, in the paper's form or the robust one."""

    name = 'hybrid_angle'
    summary = 'hybrid high-gain observer for wrapped angles'
    reference = (
        'Brentari, Bosetti, Zaccarian: A class of hybrid velocity observers for angular '
        'measurements with jumps, IEEE L-CSS 2(4), 2018; form robust: its sampled form made '
        'safe at any sample time'
    )
    gains = Gains
    TURNS = False  # it needs the circle to find outliers
    Design: TypeAlias = records.Design
    Coefficients: TypeAlias = records.Coefficients
    Core: TypeAlias = records.Core

    @staticmethod
    def design(gains: Gains, circle: Circle) -> Design:
        """Return what follows from the gains whatever the sample time is.

        Raises
        ------
        UsageError : gains that contradict each other, or an injection that needs a circle where the
            joint has none.
        """
        continuous, period = design_of(gains), circle.period
        if period <= 0.0 and (gains.form == 'paper' or gains.injection not in ('saw', 'sat')):
            what = "form 'paper'" if gains.form == 'paper' else f"injection '{gains.injection}'"
            raise UsageError(
                f'{what} needs a circle, and wrap_period is 0: '
                "use form 'robust' with injection 'saw' or 'sat'"
            )
        made = Design()
        made.order, made.paper = len(continuous.k), gains.form == 'paper'
        made.injection = injections.find(gains.injection, margin=gains.delta_pi)
        made.saturation, made.margin = gains.M, gains.delta_pi * (period / (2.0 * math.pi))
        restarts, lag = not made.paper, LAG_2 if made.order == 2 else LAG_3
        if made.paper:
            _set_paper(made, gains, continuous)
            lag = LAG_2 * made.l1 / made.l2 * continuous.slowest  # behind a ramp, times the pace
        else:
            _set_robust(made, gains, continuous, period)
        set_shared(made.shared, gains, circle, SETTLING / continuous.slowest, lag, restarts)
        return made

    @staticmethod
    def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]."""
        if design.paper:
            paper.prepare(coefficients, design, dt)
        else:
            robust.prepare(coefficients, design, dt)

    @staticmethod
    def begin(core: Core, design: Design, measurement: float) -> None:
        """Begin at a measurement [rad], at rest."""
        robust.begin(core, design, measurement)
        if design.paper:
            paper.place(core, design, measurement)

    @staticmethod
    def resume_core(core: Core, design: Design, measurement: float) -> None:
        """Go on after a gap: at the measurement [rad], with the speed as it was."""
        if design.paper:
            paper.place(core, design, measurement)
        else:
            robust.resume(core, design, measurement)

    @staticmethod
    def correct(
        core: Core, coefficients: Coefficients, design: Design, measurement: float
    ) -> float:
        """Take a measurement [rad]; return the innovation [rad]."""
        if design.paper:
            return paper.correct(core, coefficients, design, measurement)
        return robust.correct(core, coefficients, design, measurement)

    @staticmethod
    def noise_gains(
        core: Core, coefficients: Coefficients, design: Design
    ) -> tuple[float, float, float]:
        """Return variances of position, velocity [1/s^2], innovation per unit variance of noise."""
        if design.paper:
            return paper.noise_gains(coefficients, design)
        return robust.noise_gains(coefficients, design)

    @staticmethod
    def pace(
        observer: Any, core: Core, coefficients: Coefficients, design: Design, dt: float
    ) -> float:
        """Return how fast the errors of a start decay [1/s]."""
        if design.paper:
            return coefficients.pace
        return LinearObserver.pace(observer, core, coefficients, design, dt)

    @staticmethod
    def limits(design: Design, dt: float) -> str | None:
        """Return why Algorithm 1 cannot work at this dt [s]; None: it can."""
        if not design.paper or dt < design.ratio * design.epsilon:
            return None
        ratio, epsilon = design.ratio, design.epsilon
        return (
            f'Algorithm 1 is unstable at {1.0 / dt:.4g} Hz: epsilon = {epsilon:.4g} s '
            f'must exceed {dt / ratio:.4g} s (bandwidth_hz below '
            f'{design.bandwidth_hz * epsilon * ratio / dt:.4g})'
        )

    @staticmethod
    def group_delay(design: Design, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]."""
        if design.paper:
            return design.l1 / design.l2 - 0.5 * dt
        if design.order == 3:
            return 0.0  # a ramp of speed is followed without lag at any sample time
        coefficients = Coefficients()
        robust.prepare(coefficients, design, dt)
        return coefficients.alpha / coefficients.beta - 0.5 * dt

    @staticmethod
    def runs_plain(gains: Gains) -> bool:
        """Return True if the injection is a user's own function, which is no part of the engine."""
        return gains.injection not in injections.INJECTIONS

    @staticmethod
    def gives_acceleration(gains: Gains) -> bool:
        """Return True if `estimate` sets the acceleration."""
        return order_of(gains) == 3
