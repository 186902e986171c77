"""The structural claim in numbers: fast, strongly coupled motion (rows H2).

The error of GESO is linear at any speed; that of the others contains products of velocities.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_pkg.reproduce.contract import Values
from sim_pkg.reproduce.mechanical.cart import START
from sim_pkg.reproduce.mechanical.runs import cart_of, make, move, normalised, observe

Array = NDArray[np.float64]

COUPLING = 0.9
DT, COUNT = 1e-4, 60001
WINDOW = slice(40000, 60000)  # 4 to 6 s
SPEEDS = (10.0, 40.0)  # rad/s, of the pendulum at the start

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    'GESO 10,70': ('geso', {'L': [10.0], 'Gamma': [70.0]}),
    'HGO 10,70': ('hgo', {'L': [10.0], 'K': [70.0]}),
    'HGO 75,1250': ('hgo', {'L': [75.0], 'K': [1250.0]}),
    'SMO 2.2,4': ('smo', {'mu': [2.2, 4.0]}),
}


@lru_cache
def truth(speed: float) -> tuple[Array, Array]:
    """(positions, velocities)."""
    return move(normalised(COUPLING), START, (speed, 0.35), np.zeros((COUNT, 1)), DT, 4)


def error(name: str, speed: float) -> float:
    """Rms of |velocity error| over the window."""
    observer, gains = CASES[name]
    q, v = truth(speed)
    functions = make(observer, 'cart_pendulum', cart_of(COUPLING), **gains)
    velocities = observe(functions, q, np.zeros((COUNT, 1)), DT, start=START)
    return math.sqrt(float(np.mean(np.sum((velocities - v)[WINDOW] ** 2, axis=1))))


def values() -> Values:
    """Rows H2."""
    for speed in SPEEDS:
        for name in CASES:
            yield f'H2.{speed:g}.{name}', error(name, speed)
