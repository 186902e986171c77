# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The hybrid velocity observer for wrapped angles (Brentari, Bosetti, Zaccarian, 2018)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.observers.angle.core import LAG_2, AngleCore, AngleGains, around
from estimator_pkg.observers.angle.hybrid import correction, injections, paper, robust
from estimator_pkg.observers.angle.hybrid.design import Design, continuous_design, paper_limit
from estimator_pkg.observers.circle import Circle
from estimator_pkg.observers.contract import Functions, Observer
from estimator_pkg.parameters import parameter, structural

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
        choices=(*injections.NAMES, 'package.module:name'),
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


def design_of(gains: Gains) -> Design:
    """Return the continuous design these gains mean.

    Raises
    ------
    UsageError : an unstable design, or gains of another order.
    """
    return continuous_design(
        order_of(gains), gains.bandwidth_hz, gains.k1, gains.k2, gains.k3, gains.epsilon
    )


def build(gains: Gains, circle: Circle) -> Functions:
    """Return the functions of the hybrid observer at these gains; raises as `core` does."""
    return around(core(gains, circle), gains, circle)


def core(gains: Gains, circle: Circle) -> AngleCore:
    """Return the observer itself, without what all angle-only observers share around it.

    Raises
    ------
    UsageError : gains that contradict each other, or an injection that needs a circle where the
        joint has none.
    """
    design = design_of(gains)
    if circle.period <= 0.0 and (gains.form == 'paper' or gains.injection not in ('saw', 'sat')):
        what = "form 'paper'" if gains.form == 'paper' else f"injection '{gains.injection}'"
        raise UsageError(
            f'{what} needs a circle, and wrap_period is 0: '
            "use form 'robust' with injection 'saw' or 'sat'"
        )
    scale = circle.period / (2.0 * math.pi)
    margin = gains.delta_pi * scale
    injection = injections.find(gains.injection, margin=gains.delta_pi)
    make = _paper if gains.form == 'paper' else _robust
    return make(gains, design, injection, margin, circle.period)


def _robust(
    gains: Gains, design: Design, injection: injections.Injection, margin: float, period: float
) -> AngleCore:
    reset_from = 0.5 * period - margin if period > 0.0 else math.inf
    fastest = math.inf if gains.max_speed is None else gains.max_speed
    doubtful = correction.doubtful(gains.quantum, period)
    values = robust.sampled_design(design, reset_from, doubtful, gains.M, fastest)
    linear = gains.injection == 'saw'
    if len(design.k) == 2:

        def group_delay(dt: float) -> float:
            alpha, rate, _, _, _, _, _ = robust.prepare_2(values, dt)
            return alpha / rate - 0.5 * dt

        return AngleCore(
            design=lambda: values,
            settle=SETTLING / design.slowest,
            prepare=robust.prepare_2,
            init=robust.init_2,
            correct=correction.make_correct_2(injection, linear, period),
            estimate=robust.estimate_2,
            resume=robust.resume_2,
            noise_gains=robust.noise_gains_2,
            limits=lambda dt: None,
            group_delay=group_delay,
            lag=LAG_2,
        )
    return AngleCore(
        design=lambda: values,
        settle=SETTLING / design.slowest,
        prepare=robust.prepare_triple if design.triple else robust.prepare_3,
        init=robust.init_3,
        correct=correction.make_correct_3(injection, linear, period),
        estimate=robust.estimate_3,
        resume=robust.resume_3,
        noise_gains=robust.noise_gains_triple if design.triple else robust.noise_gains_3,
        limits=lambda dt: None,
        group_delay=lambda dt: 0.0,
    )  # a ramp of speed is followed without lag at any sample time


def _paper(
    gains: Gains, design: Design, injection: injections.Injection, margin: float, period: float
) -> AngleCore:
    if gains.max_speed is not None:
        raise UsageError("form 'paper' has no speed limit: leave 'max_speed' automatic (0.0)")
    k1, k2 = design.k
    l1, l2 = k1 / design.epsilon, k2 / design.epsilon**2  # L = (k1/eps, k2/eps^2), section III
    values = paper.Design(l1, l2, margin, gains.M, float(period))
    ratio = paper_limit(design.k)

    def limits(dt: float) -> str | None:
        if dt < ratio * design.epsilon:
            return None
        return (
            f'Algorithm 1 is unstable at {1.0 / dt:.4g} Hz: epsilon = {design.epsilon:.4g} s '
            f'must exceed {dt / ratio:.4g} s (bandwidth_hz below '
            f'{design.bandwidth_hz * design.epsilon * ratio / dt:.4g})'
        )

    return AngleCore(
        design=lambda: values,
        settle=SETTLING / design.slowest,
        prepare=paper.prepare,
        init=paper.init,
        correct=paper.make_correct(paper.make_algorithm_1(injection, period)),
        estimate=paper.estimate,
        resume=paper.make_resume(period),
        noise_gains=paper.noise_gains,
        limits=limits,
        group_delay=lambda dt: l1 / l2 - 0.5 * dt,
        restarts=False,
        lag=LAG_2 * l1 / l2 * design.slowest,  # the lag behind a ramp, times the pace
        pace=paper.pace,
    )


OBSERVER = Observer(
    name='hybrid_angle',
    summary='hybrid high-gain observer for wrapped angles',
    gains=Gains,
    build=build,
    reference='Brentari, Bosetti, Zaccarian: A class of hybrid velocity observers for angular '
    'measurements with jumps, IEEE L-CSS 2(4), 2018; form robust: its sampled form made '
    'safe at any sample time',
    gives_acceleration=lambda gains: order_of(gains) == 3,
)
