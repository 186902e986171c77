"""How the edge-aware observer comes to know a speed: at a start, and where a shaft has rested."""

from __future__ import annotations

import math

from estimator_pkg.observers.edge_bandwidth import Band, begin_band
from estimator_pkg.observers.edge_covariance import Covariance

SWERVE = 0.1      # half turns per sample by which a starting speed may change at most in a sample
VAGUE = 100.0     # the same in quanta, where there is no turn

Motion = tuple[float, float, float, float]


def started(measurement: float, change: float, dt: float, quantum: float, noise: float,
            period: float, longest: float) -> tuple[Motion, Covariance, Band]:
    """A straight line through the first two readings, `change` [rad] and `dt` [s] apart.

    Parameters
    ----------
    noise : variance of a reading, beside the quantum's own [rad^2].
    longest : memory of the filter that has seen nothing move [s].
    """
    rate = 1.0 / dt
    floor = quantum * quantum / 12.0 + noise
    bend = max(VAGUE * quantum, SWERVE * 0.5 * period)
    bend *= bend / 3.0
    return ((measurement, change * rate, 0.0, 0.0),
            (floor, floor * rate, 0.0, (2.0 * floor + 0.25 * bend) * rate * rate,
             0.5 * bend * rate * rate * rate, bend * rate * rate * rate * rate),
            begin_band(quantum * quantum / longest ** 5))


def waiting(rested: float, quantum: float, longest: float) -> Covariance:
    """The covariance at the first change after so long a rest [s]: no speed is known.

    It shows the quantum. Was it an edge of a shaft that still stands, or has it begun to move? The
    next reading tells.
    """
    rate = 1.0 / (rested if rested < longest else longest)
    least = quantum * quantum / 12.0
    return (least, 0.0, 0.0, 0.0, 0.0, least * rate * rate * rate * rate)


def stood(edge: float, p: Covariance, longest: float) -> tuple[Motion, Covariance, Band]:
    """A shaft that stands at an edge, after `waiting`."""
    return ((edge, 0.0, 0.0, 0.0),
            (p[0], 0.0, 0.0, math.sqrt(p[0] * p[5]), 0.0, p[5]),
            begin_band(12.0 * p[0] / longest ** 5))
