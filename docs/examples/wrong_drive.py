# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What pmsm_observer reports when a log or the motor's data break a convention.

velocity_estimator simulate pmsm --duration 1 --out pmsm
python -m docs.examples.wrong_drive      # reads pmsm, prints the table of docs/first_drive.md
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.drive import DriveJoint
from estimator_pkg.evaluation.text import markdown
from estimator_pkg.messages import drive_samples
from estimator_pkg.parameters import build

Array = NDArray[np.float64]
MOTOR = {'resistance': 0.06, 'inductance': 3.375e-5, 'flux': 0.0019, 'pole_pairs': 7}


def batches(topic: str) -> tuple[NDArray[np.int64], Array]:
    """Return stamps, shape (n,), and values, shape (n, 4), of a topic of the bag `pmsm`."""
    with open_bag('pmsm') as bag:
        found = [drive_samples.decode(bytes(each.raw)) for each in bag.messages([topic])]
    return (
        np.concatenate([batch.stamps_ns for batch in found]),
        np.concatenate([batch.values for batch in found]),
    )


def line_to_line(samples: Array) -> Array:
    """Return samples whose phase voltages are replaced by those between two lines."""
    voltage = (samples[:, 2] + 1j * samples[:, 3]) * np.sqrt(3.0) * np.exp(1j * np.pi / 6.0)
    return np.column_stack([samples[:, :2], voltage.real, voltage.imag])


def moved(samples: Array, rows: int) -> Array:
    """Return samples whose voltages are those of `rows` rows later."""
    return np.column_stack([samples[: len(samples) - rows, :2], samples[rows:, 2:]])


def report(stamps: NDArray[np.int64], samples: Array, truth: Array, **motor: float) -> list[str]:
    """Return valid samples, speed and flux over the true ones, angle error, and the reason."""
    observer = observers.find('pmsm')
    gains = build(observer.gains, {**MOTOR, **motor}, owner='pmsm')
    joint = DriveJoint(observer, gains, JointSettings())
    rows = joint.take(stamps[: len(samples)], samples).rows
    good = rows[:, 3] == 1.0
    share = f'{100.0 * np.mean(good):.0f} %'
    if not good.any():
        return [share, '-', '-', '-', joint.why()]
    rows, truth = rows[good], truth[: len(samples)][good]
    angle = np.angle(np.mean(np.exp(1j * (rows[:, 0] - truth[:, 0]))), deg=True)
    return [
        share,
        f'{np.median(rows[:, 1] / truth[:, 1]):.2f}',
        f'{round(angle) + 0.0:.0f} deg',
        f'{np.median(rows[:, 2] / truth[:, 2]):.2f}',
        '',
    ]


def main() -> None:
    """Print the table."""
    stamps, samples = batches('/drive_samples')
    _, truth = batches('/ground_truth/samples')
    ones = np.ones(4)
    cases: list[tuple[str, Array, dict[str, float]]] = [
        ('nothing', samples, {}),
        ('current positive out of the motor', samples * [-1, -1, 1, 1], {}),
        ('two phases swapped, in currents and voltages', samples * [1, -1, 1, -1], {}),
        ('two phases swapped in the currents alone', samples * [1, -1, 1, 1], {}),
        ('voltages line to line', line_to_line(samples), {}),
        ('power-invariant vectors', samples * np.sqrt(1.5), {}),
        ('the same, `scaling: power`', samples * np.sqrt(1.5), {'scaling': 'power'}),
        ('voltage acts one sample later', moved(samples, 1), {}),
        ('the same, `voltage_delay: 1.0`', moved(samples, 1), {'voltage_delay': 1.0}),
        ('voltage not connected', samples * [1, 1, 0, 0], {}),
        ('`resistance` line to line', samples * ones, {'resistance': 0.12}),
        ('`inductance` line to line', samples * ones, {'inductance': 6.75e-5}),
        ('`flux` three times too large', samples * ones, {'flux': 0.0057}),
    ]
    lines = [(words, *report(stamps, wrong, truth, **motor)) for words, wrong, motor in cases]
    header = ('what is wrong', 'valid', 'speed / true', 'angle error', 'flux / true', 'reason')
    print(markdown(header, lines))


if __name__ == '__main__':
    main()
