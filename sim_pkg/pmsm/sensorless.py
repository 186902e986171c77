# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A drive whose controller uses the observer's own angle and speed.

It starts in two ways: with a rotor that spins already (zero current until the observer has found
it), or with a rotor at rest (a current vector turns faster and faster until the observer tracks).
"""

from __future__ import annotations

import math

from estimator_pkg.estimate import NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm.drive import DriveSample, Electrical
from estimator_pkg.observers.pmsm.observer import OBSERVER
from estimator_pkg.observers.pmsm.state import Coefficients, Design, State
from sim_pkg.pmsm.parameters import PmsmParameters

observer = OBSERVER.module
WAITING, FORCED, RUNNING = 0.0, 1.0, 2.0


class Sensorless:
    """A feedback for `drive.Drive`.

    Parameters
    ----------
    design : of the observer.
    forced : start from rest with a turning current vector; else wait for a spinning rotor.
    rise_rpm : rate of the forced speed [rpm/s].
    pull : forced current over rated current.
    handover_rpm : speed from which the observer takes over [rpm].

    Attributes
    ----------
    mode : RUNNING once the observer controls the drive.
    angle, omega : of the controller, electrical [rad], [rad/s]. seen : the observer's estimate.
    """

    def __init__(
        self,
        design: Design,
        parameters: PmsmParameters,
        *,
        forced: bool,
        rise_rpm: float = 3000.0,
        pull: float = 0.5,
        handover_rpm: float = 600.0,
    ) -> None:
        self._design, self._state, self._coefficients = design, State(), Coefficients()
        self._sample, self.seen = DriveSample(), Electrical()
        observer.start(observer, self._state, design, self._sample)
        observer.prepare(self._coefficients, design, parameters.period)
        electrical = parameters.pole_pairs * math.pi / 30.0
        self.mode = FORCED if forced else WAITING
        self.angle = self.omega = 0.0
        self._rise = rise_rpm * electrical
        self._pull = pull * parameters.rated_current
        self._enough = handover_rpm * electrical if forced else 0.0

    def __call__(
        self,
        current: complex,
        voltage: complex,
        theta: float,
        speed: float,
        poles: float,
        reference: float,
    ) -> tuple[float, float, float]:
        """Return (electrical angle, electrical speed, forced i_q); see `drive.sensored`."""
        sample, seen, dt = self._sample, self.seen, self._coefficients.dt
        sample.i_alpha, sample.i_beta = current.real, current.imag
        sample.u_alpha, sample.u_beta = voltage.real, voltage.imag
        observer.step(observer, self._state, self._coefficients, self._design, sample, 0.0)
        observer.electrical(seen, self._state, self._design)
        omega = seen.speed / self._design.pole_pairs * poles
        if self.mode != RUNNING and seen.status == TRACKING and abs(omega) >= self._enough:
            self.mode = RUNNING
        if self.mode == RUNNING:
            if seen.status != NOT_OBSERVABLE:
                self.angle, self.omega = seen.angle, omega
            else:  # extrapolated at the last speed until the observer has it again
                self.angle += self.omega * dt
            return self.angle, self.omega, 0.0
        if self.mode == FORCED:
            self.omega += self._rise * dt
            self.angle += self.omega * dt
            return self.angle, self.omega, self._pull
        return self.angle, self.omega, 1e-9  # keeps the current at zero in the static frame
