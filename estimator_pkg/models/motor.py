# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The electrical data of a permanent-magnet motor.

A two-vector (alpha, beta) is the complex number alpha + j beta. Currents, voltages and flux are
amplitude-invariant inside: the length of the vector is the amplitude of the phase quantity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estimator_pkg.errors import UsageError
from estimator_pkg.parameters import structural

POWER_INVARIANT = math.sqrt(1.5)  # length of a power-invariant vector per amplitude
MOTOR_DATA = ('resistance', 'inductance', 'flux', 'pole_pairs')


@dataclass(frozen=True)
class MotorData:
    """Motor data from a nameplate or a measurement; there are no defaults."""

    resistance: float | None = structural(
        None,
        required=True,
        unit='ohm',
        range=(1e-6, 1e4),
        description='stator resistance of one phase to the star point (half of line to line)',
        equation='R in (1)',
    )
    inductance: float | None = structural(
        None,
        required=True,
        unit='H',
        range=(1e-9, 10.0),
        description='stator inductance of one phase to the star point (half of line to line)',
        equation='L in (1)',
    )
    flux: float | None = structural(
        None,
        required=True,
        unit='Wb',
        range=(1e-7, 100.0),
        description='nominal flux linkage of the magnets: amplitude of the phase back-EMF [V] '
        'per electrical speed [rad/s]',
        equation='phi in (1)',
    )
    pole_pairs: int | None = structural(
        None,
        required=True,
        range=(1, 200),
        kind=int,
        description='pole pairs: electrical turns per mechanical turn',
        equation='p',
    )


def check_motor(data: MotorData, owner: str) -> tuple[float, float, float, float]:
    """Return (resistance, inductance, flux, pole pairs), all set and positive.

    Raises
    ------
    UsageError : with the names that are missing or not positive.
    """
    missing = [name for name in MOTOR_DATA if getattr(data, name) is None]
    if missing:
        raise UsageError(
            f'{owner} needs the motor data {", ".join(missing)}: set them as parameters, '
            'resistance [ohm] and inductance [H] of one phase to the star point, which are half of '
            'line to line, flux linkage [Wb], pole pairs'
        )
    bad = [name for name in MOTOR_DATA if not getattr(data, name) > 0]
    if bad:
        values = ', '.join(f'{name} = {getattr(data, name)}' for name in bad)
        raise UsageError(f'{owner}: {values} must be positive')
    assert data.resistance and data.inductance and data.flux and data.pole_pairs
    return data.resistance, data.inductance, data.flux, float(data.pole_pairs)
