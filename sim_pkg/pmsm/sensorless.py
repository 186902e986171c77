# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A drive whose controller uses the observer's own angle and speed.

It starts in two ways: with a rotor that spins already (zero current until the observer has found
it), or with a rotor at rest (a current vector turns faster and faster until the observer tracks).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from estimator_pkg.observers.contract import NOT_OBSERVABLE, TRACKING
from estimator_pkg.observers.pmsm.drive import DriveFunctions
from estimator_pkg.observers.pmsm.equations import rotor_angle
from sim_pkg.pmsm.parameters import PmsmParameters

WAITING, FORCED, RUNNING = 0.0, 1.0, 2.0


def make_feedback(functions: DriveFunctions) -> Callable[..., tuple]:
    """Return a feedback for `drive.make_loop`; its state comes from `begin`."""
    step, output = functions.step, functions.output

    def feedback(
        held: tuple,
        current: complex,
        voltage: complex,
        theta: float,
        speed: float,
        poles: float,
        reference: float,
    ) -> tuple:
        state: Any
        state, design, coefficients, mode, angle, omega, rise, pull, enough = held
        dt = coefficients.dt
        sample = (current.real, current.imag, voltage.real, voltage.imag)
        state = step(state, coefficients, design, sample, 0.0)
        position, velocity, spare, status = output(state, coefficients, design, sample, 0.0)
        forced = 0.0
        if mode != RUNNING and status == TRACKING and abs(velocity) * poles >= enough:
            mode = RUNNING
        if mode == RUNNING:
            if status != NOT_OBSERVABLE:
                omega = velocity * poles
                (_, _, z, xi_hat, _, _), _, _, _, _, _, _, _ = state
                angle = rotor_angle(z, xi_hat)
            else:  # extrapolated at the last speed until the observer has it again
                angle += omega * dt
        elif mode == FORCED:
            omega += rise * dt
            angle += omega * dt
            forced = pull
        else:
            forced = 1e-9  # keeps the current at zero in the static frame
        return (
            (state, design, coefficients, mode, angle, omega, rise, pull, enough),
            angle,
            omega,
            forced,
        )

    return feedback


def begin(
    functions: DriveFunctions,
    parameters: PmsmParameters,
    *,
    forced: bool,
    rise_rpm: float = 3000.0,
    pull: float = 0.5,
    handover_rpm: float = 600.0,
) -> tuple:
    """Return the state of the feedback before the first sample.

    Parameters
    ----------
    forced : start from rest with a turning current vector; else wait for a spinning rotor.
    rise_rpm : rate of the forced speed [rpm/s].
    pull : forced current over rated current.
    handover_rpm : speed from which the observer takes over [rpm].
    """
    design = functions.design()
    electrical = parameters.pole_pairs * math.pi / 30.0
    return (
        functions.init((0.0, 0.0, 0.0, 0.0), design),
        design,
        functions.prepare(design, parameters.period),
        FORCED if forced else WAITING,
        0.0,
        0.0,
        rise_rpm * electrical,
        pull * parameters.rated_current,
        handover_rpm * electrical if forced else 0.0,
    )
