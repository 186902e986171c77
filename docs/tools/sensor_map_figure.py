# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The figure of sensor errors in docs/stamps_and_quantisation.md.

python -m docs.tools.sensor_map_figure docs/figures
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.signals import START_NS
from estimator_pkg.evaluation.entries import Entry
from sim_pkg.joints.sensor import AngleSensor, SensorParameters

TURN = 2.0 * np.pi
NAME = 'sensor_map.png'
SECONDS, RATE, SPEED = 10.0, 2000.0, 12.0
SENSORS = (
    ('4096 counts, eccentric by 0.01 rad', {'eccentricity': 0.01}, 4096),
    ('32 counts, edges misplaced by 0.1 counts', {'misplaced_edges': 0.1}, 32),
)


def errors(faults: dict[str, float], counts: int, sensor_map: str) -> tuple[Any, Any, Any]:
    """Return (time [s], velocity error [rad/s], corrections over the turn [rad])."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    parameters = SensorParameters(rate=RATE, counts_per_revolution=counts, **faults)
    readings = AngleSensor(parameters, seed=1).read(SPEED * time)
    values = (('sensor_map', sensor_map), ('quantum', TURN / counts))
    joint = Entry('', 'edge_adaptive', values).joint()
    out = joint.run(START_NS + np.rint(1e9 * time).astype(np.int64), readings, fast=False)
    angles = np.linspace(0.0, TURN, 361)
    return time, out.velocity - SPEED, joint.sensor_errors(1)(angles, np.full(361, SPEED))


def ripple(sensor_map: str) -> tuple[Any, Any, Any]:
    """Return (time [s], velocity and its estimate [rad/s]) of a shaft that ripples when slow."""
    time = np.arange(round(18.0 * RATE)) / RATE
    velocity, angle, at = np.zeros(len(time)), np.zeros(len(time)), 0.1
    for k, mean in enumerate(np.where(time < 5.0, 20.0, 3.0).tolist()):
        velocity[k] = mean * (1.0 + 5.4 / mean**2 * np.cos(2.0 * at))
        at += velocity[k] / RATE
        angle[k] = at
    parameters = SensorParameters(rate=RATE, counts_per_revolution=12, misplaced_edges=0.1)
    readings = AngleSensor(parameters, seed=1).read(angle)
    values = (('sensor_map', sensor_map), ('quantum', TURN / 12))
    joint = Entry('', 'edge_adaptive', values).joint()
    out = joint.run(START_NS + np.rint(1e9 * time).astype(np.int64), readings, fast=False)
    return time, velocity, out.velocity


def draw(folder: Path) -> Path:
    """Draw the figure; return its path."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 2, figsize=(8, 7))
    for (title, faults, counts), (left, right) in zip(SENSORS, axes):
        for sensor_map, colour in (('none', 'C1'), ('learn', 'C0')):
            time, error, learnt = errors(faults, counts, sensor_map)
            left.plot(time, error, colour, linewidth=0.8, label=f'sensor_map: {sensor_map}')
        largest = 1.3 * np.nanmax(np.abs(error[round(RATE) : round(2.0 * RATE)]))
        left.set(title=title, ylabel='velocity error [rad/s]', ylim=(-largest, largest))
        right.plot(np.linspace(0.0, 360.0, 361), np.degrees(learnt), 'C0')
        right.set(title='correction as learnt', ylabel='[deg]')
    left, right = axes[2]
    for sensor_map, colour in (('none', 'C1'), ('learn', 'C0')):
        time, velocity, found = ripple(sensor_map)
        left.plot(time, found - velocity, colour, linewidth=0.8)
        right.plot(time, found, colour)
    right.plot(time, velocity, 'k--', linewidth=0.8, label='true')
    left.set(title='12 counts, ripples while slow', ylabel='velocity error [rad/s]')
    left.set(xlim=(4.0, 18.0), ylim=(-3.0, 3.0), xlabel='time [s]')
    right.set(title='the ripple as foreseen', ylabel='[rad/s]', xlim=(15.0, 18.0), ylim=(0.0, 6.0))
    right.set_xlabel('time [s]')
    right.legend(fontsize=8)
    axes[0][0].legend(fontsize=8)
    axes[1][0].set_xlabel('time [s]')
    axes[1][1].set_xlabel('angle [deg]')
    figure.tight_layout()
    path = folder / NAME
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


if __name__ == '__main__':
    draw(Path(sys.argv[1] if len(sys.argv) > 1 else 'docs/figures'))
