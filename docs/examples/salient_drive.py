# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A motor with Ld unequal Lq: what pmsm_observer estimates with each choice of `inductance`.

    python -m docs.examples.salient_drive    # prints the table of docs/first_drive.md

The currents follow given curves in the frame of the rotor, so flux linkage and voltage are exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.parameters import build

Array = NDArray[np.float64]
RATE, SECONDS = 20_000.0, 1.0
RESISTANCE, LD, LQ, FLUX, PAIRS = 0.06, 25e-6, 50e-6, 0.0019, 7
SPEED, SWING = 1800.0, 600.0  # electrical, mean and amplitude of its sine [rad/s]


def drive(i_d: float, i_q: float) -> tuple[Array, Array, Array, Array]:
    """Return stamps [ns], samples (i_alpha, i_beta, u_alpha, u_beta), true angle and speed."""
    fine = np.arange(round(RATE * SECONDS) * 2 + 1) / (2.0 * RATE)  # two points per sample
    pulsation = 2.0 * np.pi * 4.0
    angle = SPEED * fine + SWING / pulsation * (1.0 - np.cos(pulsation * fine))
    speed = SPEED + SWING * np.sin(pulsation * fine)
    rise = np.minimum(fine / 0.05, 1.0)
    current = rise * (i_d + 1j * i_q)
    turned = np.exp(1j * angle)
    linkage = (FLUX + LD * current.real + 1j * LQ * current.imag) * turned
    current = current * turned
    mean = (current[:-2:2] + 4.0 * current[1:-1:2] + current[2::2]) / 6.0  # Simpson
    voltage = RESISTANCE * mean + np.diff(linkage[::2]) * RATE
    current = current[2::2]
    samples = np.column_stack([current.real, current.imag, voltage.real, voltage.imag])
    stamps = 10**9 + np.round(fine[2::2] * 1e9).astype(np.int64)
    return stamps, samples, angle[2::2], speed[2::2]


def estimates(inductance: float, i_d: float, i_q: float) -> tuple[float, float, float]:
    """Return mean angle error [deg], rms error of the speed and mean flux over the true ones."""
    observer = observers.find('pmsm')
    motor = {'resistance': RESISTANCE, 'flux': FLUX, 'pole_pairs': PAIRS}
    gains = build(observer.gains, {**motor, 'inductance': inductance}, owner='pmsm')
    stamps, samples, angle, speed = drive(i_d, i_q)
    rows = DriveJoint(observer, gains, JointSettings()).take(stamps, samples).rows
    late = slice(len(stamps) // 2, None)
    rows, angle, speed = rows[late], angle[late], speed[late]
    if not np.all(rows[:, 3] == 1.0):
        return np.nan, np.nan, np.nan
    error = np.angle(np.exp(1j * (rows[:, 0] - angle)), deg=True)
    difference = rows[:, 1] - speed
    return (
        float(np.mean(error)),
        float(np.sqrt(np.mean(difference**2)) / np.mean(speed)),
        float(np.mean(rows[:, 2]) / FLUX),
    )


def main() -> None:
    """Print the table."""
    lines = []
    for i_d, i_q in ((0.0, 20.0), (-15.0, 15.0)):
        for name, inductance in (('Ld', LD), ('mean of both', 0.5 * (LD + LQ)), ('Lq', LQ)):
            angle, speed, flux = estimates(inductance, i_d, i_q)
            lines.append(
                (
                    f'id {i_d:.0f} A, iq {i_q:.0f} A',
                    name,
                    f'{round(angle, 1) + 0.0:.1f} deg',  # without -0.0
                    f'{100.0 * speed:.2f} %',
                    f'{flux:.2f}',
                )
            )
    print(
        markdown(
            ('current', '`inductance`', 'mean angle error', 'speed error, rms', 'flux / true'),
            lines,
        )
    )


if __name__ == '__main__':
    main()
