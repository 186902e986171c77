# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Velocity error with the sensor's errors learnt, over that with `sensor_map: none`.

    python -m docs.examples.sensor_errors    # prints the table of docs/stamps_and_quantisation.md

Joints turn at constant speed for 20 s; errors are those of the second half.
"""

from __future__ import annotations

import numpy as np

from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.text import markdown
from sim_pkg.joints.sensor import AngleSensor, SensorParameters

SECONDS = 20.0
SENSORS = range(1, 6)  # seeds of random edges and noise
EDGE, HYBRID = 'edge_adaptive', 'hybrid_angle'
ROWS = (
    ('4096 counts, eccentric by 0.01 rad', EDGE, 10.0, 1e3, 4096, {'eccentricity': 0.01}),
    ('4096 counts, eccentric by 0.03 rad', HYBRID, 12.0, 1e3, 4096, {'eccentricity': 0.03}),
    ('floats, eccentric by 0.003 rad', EDGE, 10.0, 1e3, 0, {'eccentricity': 0.003}),
    ('64 counts, edges misplaced by 0.1 counts', EDGE, 10.0, 1e4, 64, {'misplaced_edges': 0.1}),
    ('64 counts, edges misplaced by 0.1 counts', EDGE, 10.0, 1e3, 64, {'misplaced_edges': 0.1}),
    ('4096 exact counts', EDGE, 10.0, 1e3, 4096, {}),
    ('64 exact counts', EDGE, 10.0, 1e3, 64, {}),
    ('floats, 1 mrad of noise', EDGE, 10.0, 1e3, 0, {'noise': 1e-3}),
)


def ratio(
    observer: str, speed: float, rate: float, counts: int, faults: dict[str, float], seed: int
) -> float:
    """Return the rms velocity error with `learn` over that with `none`."""
    time = np.arange(round(rate * SECONDS)) / rate
    stamps = 10**18 + np.rint(1e9 * time).astype(np.int64)
    parameters = SensorParameters(rate=rate, counts_per_revolution=counts, **faults)
    readings = AngleSensor(parameters, seed).read(0.3 + speed * time)
    learnt, raw = (
        Entry('', observer, (('sensor_map', choice),)).joint().run(stamps, readings).velocity
        for choice in ('learn', 'none')
    )
    late = slice(len(time) // 2, None)
    return float(np.sqrt(np.mean((learnt[late] - speed) ** 2) / np.mean((raw[late] - speed) ** 2)))


def main() -> None:
    """Print the table."""
    lines = []
    for name, observer, speed, rate, counts, faults in ROWS:
        ratios = [
            ratio(observer, direction * speed, rate, counts, faults, seed)
            for direction in (1.0, -1.0)
            for seed in SENSORS
        ]
        lines.append(
            (
                name,
                f'{speed:.0f} rad/s',
                f'{rate / 1e3:.0f} kHz',
                observer,
                *(f'{value:.3f}' for value in (np.median(ratios), max(ratios))),
            )
        )
    print(markdown(('sensor', 'speed', 'rate', 'observer', 'median', 'largest'), lines))


if __name__ == '__main__':
    main()
