# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The phase-locked loop of motor drives: a PI loop on the wrapped error, with true sample times.

    x' = v + 2 zeta w0 e,   v' = w0^2 e,   e = wrap(y - x)

so that v follows the true velocity through w0^2/(s^2 + 2 zeta w0 s + w0^2). The loop is sampled
with matched poles: there is no sample time at which it is unstable. It starts at v = 0, as such
loops do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.circle import Circle
from estimator_pkg.observers.angle.loop import TrackingLoop
from estimator_pkg.observers.angle.shared import LAG_2, AngleGains, SharedDesign, set_shared
from estimator_pkg.observers.maths.tracking import matched, natural_frequency
from estimator_pkg.parameters import parameter
from estimator_pkg.record import record

SETTLING = 7.0  # time constants of the slower pole until a start from v = 0 is right to 1 %


@dataclass(frozen=True)
class Gains(AngleGains):
    """Parameters of `pll`."""

    bandwidth_hz: float = parameter(
        50.0,
        unit='Hz',
        range=(0.001, 1e5),
        search=(0.5, 500.0),
        description='-3 dB frequency from true to estimated velocity',
        equation='w0 = 2 pi f / sqrt(1 - 2 zeta^2 + sqrt((1 - 2 zeta^2)^2 + 1))',
    )
    damping: float = parameter(
        1.0,
        range=(0.2, 10.0),
        advanced=True,
        description='zeta of the loop; 1: two equal poles, 0.707: flattest response',
        equation='s^2 + 2 zeta w0 s + w0^2',
    )


class Pll(TrackingLoop):
    """The phase-locked loop."""

    name = 'pll'
    summary = 'phase-locked loop of motor drives, second order'
    reference = 'textbook; Harnefors and Nee, IEEE Trans. Ind. Electron. 47(1), 2000'
    gains = Gains

    @record
    class Design:
        """What the gains imply whatever dt is: poles at -decay +- sqrt(discriminant)."""

        shared: SharedDesign
        decay: float  # zeta w0 [1/s]
        discriminant: float  # (zeta^2 - 1) w0^2 [1/s^2]

    @staticmethod
    def design(gains: Gains, circle: Circle) -> Pll.Design:
        """Return what follows from the gains whatever the sample time is."""
        made = Pll.Design()
        natural = natural_frequency(gains.bandwidth_hz, gains.damping)
        made.decay = gains.damping * natural
        made.discriminant = (gains.damping * gains.damping - 1.0) * natural * natural
        slow = made.decay
        if made.discriminant > 0.0:
            slow -= math.sqrt(made.discriminant)
        set_shared(made.shared, gains, circle, SETTLING / slow, LAG_2)
        return made

    @staticmethod
    def prepare(coefficients: TrackingLoop.Coefficients, design: Design, dt: float) -> None:
        """Set what follows from dt [s]."""
        alpha, beta = matched(design.decay, design.discriminant, dt)
        coefficients.dt, coefficients.alpha, coefficients.rate = dt, alpha, beta / dt

    @staticmethod
    def begin(core: TrackingLoop.Core, design: Design, measurement: float) -> None:
        """Begin at a measurement [rad] and v = 0."""
        TrackingLoop.begin(core, design, measurement)
        core.started = True
