# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The Kalman filter of a joint that is moved by white noise, with wrapped innovation and true dt.

    constant_velocity        v' = w,         w white acceleration of density q [(rad/s^2)^2 s]
    constant_acceleration    a' = w, v' = a, w white jerk of density q [(rad/s^3)^2 s]

The covariance is propagated over each sample's own dt, in units of the measurement noise variance
R. A start knows nothing of speed and acceleration, so the speed is right from the second sample.

With `bandwidth_hz` set, the density is not used; instead q = w0^(2n) R dt, which puts the poles of
the continuous-time filter on the Butterworth circle of radius w0 (n = 2 or 3), whatever R and dt:

    constant_velocity        v/v_true = w0^2/(s^2 + sqrt(2) w0 s + w0^2)
    constant_acceleration    (2 w0^2 s + w0^3)/(s^3 + 2 w0 s^2 + 2 w0^2 s + w0^3)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.circle import Circle, wrap
from estimator_pkg.observers.angle.shared import (
    LAG_2,
    LAG_3,
    AngleGains,
    LinearObserver,
    SharedDesign,
    set_shared,
    variance_of,
)
from estimator_pkg.observers.maths import covariance
from estimator_pkg.observers.maths.covariance import PRIOR_ACCELERATION, Covariance
from estimator_pkg.observers.maths.tracking import noise_of_three
from estimator_pkg.parameters import parameter, structural
from estimator_pkg.record import record
from estimator_pkg.sensor import scatter
from estimator_pkg.sensor.scatter import INITIAL_VARIANCE, Scatter

CONSTANT_VELOCITY, CONSTANT_ACCELERATION = 'constant_velocity', 'constant_acceleration'
# -3 dB frequency of the velocity over w0; of the third order: the root of u^3 - 8 u - 1, u = w^2
BANDWIDTH_RATIO = {CONSTANT_VELOCITY: 1.0, CONSTANT_ACCELERATION: 1.6996647}
SETTLING = 4.0  # times 1/w0: the start's gains have come down to the steady ones
USUAL_DT = 1e-3  # [s] where a number is needed before the first sample (the sixth root of it)


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `kalman`."""

    model: str = structural(
        CONSTANT_ACCELERATION,
        choices=(CONSTANT_VELOCITY, CONSTANT_ACCELERATION),
        description='what a joint does when left alone; constant_acceleration also gives the '
        'acceleration and has no ramp lag',
    )
    jerk_psd: float = parameter(
        1e3,
        unit='(rad/s^3)^2 s',
        range=(1e-12, 1e18),
        description='density of the white jerk that moves a constant_acceleration joint',
        equation='Q = q [[dt^5/20, dt^4/8, dt^3/6], [dt^4/8, dt^3/3, dt^2/2], '
        '[dt^3/6, dt^2/2, dt]]',
    )
    acceleration_psd: float = parameter(
        10.0,
        unit='(rad/s^2)^2 s',
        range=(1e-12, 1e18),
        description='density of the white acceleration that moves a constant_velocity joint',
        equation='Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]',
    )
    bandwidth_hz: float | None = parameter(
        None,
        unit='Hz',
        range=(0.001, 1e5),
        search=(0.5, 500.0),
        description='-3 dB frequency from true to estimated velocity; set, it takes the place of '
        'the density; automatic: follows from density and noise',
        equation='q = w0^(2n) R dt, w0 = 2 pi f / (1 or 1.69966), n = 2 or 3',
    )


class Kalman(LinearObserver):
    """The Kalman filter."""

    name = 'kalman'
    summary = 'Kalman filter of constant velocity or constant acceleration'
    reference = 'textbook; Bar-Shalom, Li, Kirubarajan (2001), section 6.2'
    gains = Gains

    @record
    class Design:
        """What the gains imply whatever the sample time is."""

        shared: SharedDesign
        order: int  # 2: constant velocity, 3: constant acceleration
        prior: float  # variance of the acceleration at a start, see `covariance.set_line`
        density: float  # q of the white jerk or acceleration, per R where that is known
        per_dt: bool  # the density is per R dt
        estimated: bool  # R is estimated
        variance: float  # R where it is known [rad^2]

    @record
    class Coefficients:
        """What follows from the sample time."""

        dt: float  # [s]
        q: Covariance  # Q over dt, per R

    @record
    class Core:
        """The filter."""

        position: float  # [rad]
        velocity: float  # [rad/s]
        acceleration: float  # [rad/s^2]; nan: constant velocity
        p: Covariance  # P/R
        started: bool  # after the second sample
        scatter: Scatter  # of the measurement, where R is estimated

    @staticmethod
    def design(gains: Gains, circle: Circle) -> Kalman.Design:
        """Return what follows from the gains whatever the sample time is."""
        made = Kalman.Design()
        variance = variance_of(gains)
        made.variance = variance if variance > 0.0 else INITIAL_VARIANCE
        made.order, made.prior, lag = 3, PRIOR_ACCELERATION, LAG_3
        if gains.model == CONSTANT_VELOCITY:
            made.order, made.prior, lag = 2, 0.0, LAG_2
        if gains.bandwidth_hz is not None:
            radius = 2.0 * math.pi * gains.bandwidth_hz / BANDWIDTH_RATIO[gains.model]
            made.density, made.per_dt = radius ** (2 * made.order), True
        else:
            density = gains.acceleration_psd if made.order == 2 else gains.jerk_psd
            made.estimated = variance == 0.0
            made.density = density if made.estimated else density / variance
            radius = (density / made.variance / USUAL_DT) ** (0.5 / made.order)
        set_shared(made.shared, gains, circle, SETTLING / radius, lag)
        return made

    @staticmethod
    def prepare(coefficients: Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]."""
        coefficients.dt = dt
        density = design.density * dt if design.per_dt else design.density
        covariance.set_noise(coefficients.q, design.order, density, dt)

    @staticmethod
    def begin(core: Core, design: Design, measurement: float) -> None:
        """Begin at a measurement [rad], without a speed."""
        Kalman.resume_core(core, design, measurement)
        core.velocity = 0.0
        scatter.begin_scatter(core.scatter, measurement)

    @staticmethod
    def resume_core(core: Core, design: Design, measurement: float) -> None:
        """Go on after a gap: a start, whose kept speed finds the next sample's turn."""
        scatter.resume_scatter(core.scatter, measurement)
        core.position = measurement
        core.acceleration = 0.0 if design.order == 3 else math.nan
        core.started = False
        covariance.set_first(core.p)

    @staticmethod
    def correct(
        core: Core, coefficients: Coefficients, design: Design, measurement: float
    ) -> float:
        """Take a measurement [rad]; return the innovation [rad]."""
        dt, period, scale = coefficients.dt, design.shared.period, 1.0
        if design.estimated:
            scatter.follow_scatter(core.scatter, measurement, dt, period)
            scale = 1.0 / core.scatter.variance
        gained = core.acceleration * dt if design.order == 3 else 0.0
        innovation = measurement - core.position - (core.velocity + 0.5 * gained) * dt
        if innovation + innovation >= period or innovation + innovation < -period:
            innovation = wrap(innovation, period)
        if not core.started:  # a straight line through two samples
            core.position = measurement
            core.velocity += innovation / dt
            core.started = True
            covariance.set_line(core.p, dt, design.prior)
            return 0.0
        K1, K2, of_s = covariance.update(core.p, coefficients.q, dt, scale, design.prior)
        # prediction + K0 e is measurement - e/S, which stays on the measurement's turn
        core.position = measurement - of_s * innovation
        core.velocity = core.velocity + gained + K1 * innovation
        core.acceleration += K2 * innovation  # stays nan where there is none
        return innovation

    @staticmethod
    def noise_gains(
        core: Core, coefficients: Coefficients, design: Design
    ) -> tuple[float, float, float]:
        """Return the variances that white noise alone causes at the present gains, per R.

        P itself also holds the motion that the model allows for: at constant speed it is several
        times what is really there. The gains of the third sample, if they stayed, could be those of
        an unstable observer: it is a line through two, corrected by the second difference.
        """
        dt, p = coefficients.dt, core.p
        if not core.started:
            return 1.0, 2.0 / (dt * dt), 2.0  # as the second sample will leave it
        alpha, beta, gamma = p.p00, p.p01 * dt, p.p02 * dt * dt
        if 2.0 * alpha + beta < 4.0 and alpha * (2.0 * beta + gamma) > 2.0 * gamma:
            return noise_of_three(alpha, beta, gamma, dt)
        return alpha, (2.0 - 6.0 * beta * (1.0 - beta)) / (dt * dt), 6.0

    @staticmethod
    def group_delay(design: Design, dt: float) -> float:
        """Return the delay of the velocity at low frequency [s]; nan: not known."""
        if design.order == 3:
            return 0.0  # a constant acceleration is followed without lag
        if design.estimated:
            return math.nan  # it follows from noise that is not known
        of_r = design.density * dt if design.per_dt else design.density
        alpha, beta = covariance.steady_gains(of_r, dt)
        return dt * (alpha / beta - 0.5)

    @staticmethod
    def gives_acceleration(gains: Gains) -> bool:
        """Return True if `estimate` sets the acceleration."""
        return gains.model == CONSTANT_ACCELERATION
