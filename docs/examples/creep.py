# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The picture of README: a joint with a 12-bit encoder starts, creeps and reverses.

    python -m docs.examples.creep docs/figures/creep.png

draws it and prints its caption.
"""

from __future__ import annotations

import sys

import numpy as np

from estimator_pkg import VelocityEstimator

COUNTS, RATE, CREEP = 4096, 500, 0.1  # per turn, [Hz], [rad/s]
STAMPS = 10**9 + 2_000_000 * np.arange(3 * RATE)
TIME = (STAMPS - STAMPS[0]) * 1e-9
MOVES = TIME >= 0.5  # it rests before; then it starts in 0.1 s, and reverses in 0.2 s
VELOCITY = CREEP * np.interp(TIME, (0.5, 0.6, 1.6, 1.8), (0.0, 1.0, 1.0, -1.0))
QUANTUM = 2.0 * np.pi / COUNTS


def main(path: str | None) -> None:
    """Print the caption, and draw the picture if there is a path."""
    angle = np.concatenate(((0.0,), np.cumsum(0.5 * (VELOCITY[1:] + VELOCITY[:-1]) / RATE)))
    readings = np.floor((angle + 0.3 * QUANTUM) / QUANTUM) * QUANTUM
    found = {
        name: VelocityEstimator(name, quantum=QUANTUM).run(STAMPS, readings)
        for name in ('finite_difference', 'edge_adaptive')
    }
    error = {name: each.velocity - VELOCITY for name, each in found.items()}
    rms = {name: np.sqrt(np.mean(each[MOVES] ** 2)) for name, each in error.items()}
    bound = 1.96 * found['edge_adaptive'].velocity_stddev
    covered = 100.0 * np.mean((np.abs(error['edge_adaptive']) <= bound)[MOVES])
    print(
        f'*A simulated joint starts, creeps at {CREEP} rad/s and reverses. Its encoder has '
        f'{COUNTS} counts and is read at {RATE} Hz.\n'
        'The finite difference with a low-pass of 50 Hz has an '
        f'error of {rms["finite_difference"]:.2g} rad/s rms, the default observer\n'
        f'{rms["edge_adaptive"]:.2g} rad/s. The shaded 95 % interval contains the true velocity in '
        f'{covered:.0f} % of the samples in motion.*'
    )
    if path is None:
        return
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(10, 4), layout='tight')
    estimate = found['edge_adaptive'].velocity
    difference = found['finite_difference'].velocity
    axes.plot(TIME, difference, 'C0', linewidth=0.8, label='finite difference, low-passed at 50 Hz')
    axes.fill_between(TIME, estimate - bound, estimate + bound, color='C1', alpha=0.3)
    axes.plot(TIME, estimate, 'C1', label='velocity_estimator, with its 95 % interval')
    axes.plot(TIME, VELOCITY, 'k--', linewidth=1.0, label='true velocity')
    axes.set(xlim=(0.4, 2.6), ylim=(-0.42, 0.42), xlabel='time [s]', ylabel='velocity [rad/s]')
    axes.legend(loc='lower left')
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


if __name__ == '__main__':
    main(*sys.argv[1:2] or [None])
