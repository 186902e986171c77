# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Exported headers in float: `python -m benchmarks.export_float`.

Prints the largest rms difference of their velocity from that in double [rad/s]: of a joint with an
encoder of 1024 to 65,536 counts, and of the check that `export` writes by default.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import registry
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.evaluation.entries import angle_observers
from estimator_pkg.export import folder, vectors
from estimator_pkg.export.header import Exported, exported

COUNTS = 1024, 4096, 65_536  # of a turn
TIMES = np.arange(10_000) * 1e-3  # [s]
SPEED = 20.0 * np.sin(4.0 * TIMES) * np.sin(0.9 * TIMES)  # [rad/s]
MOTIONS: dict[str, NDArray[Any]] = {  # the angle [rad]
    'one turn': 0.3 + np.cumsum(SPEED) * 1e-3,
    'up to 100 rad': 50.0 - 50.0 * np.cos(0.4 * TIMES),
}
KALMAN: dict[str, Callable[[float], dict[str, Any]]] = {  # by what is set, from the quantum
    'quantum': lambda quantum: {'quantum': quantum},
    'bandwidth_hz': lambda quantum: {'bandwidth_hz': 20.0},
}


def sampled(angle: NDArray[Any], quantum: float) -> vectors.Samples:
    """Return readings of an encoder, at 1 kHz with jitter; on one turn in [-pi, pi)."""
    readings = quantum * np.floor(angle / quantum)
    if np.ptp(angle) < math.tau:
        readings -= math.tau * np.floor(readings / math.tau + 0.5)
    jitter = np.random.default_rng(0).integers(-50_000, 50_000, len(angle))
    stamps = 10**9 + np.rint(TIMES * 1e9).astype(np.int64) + jitter
    return vectors.Samples(stamps, readings[:, None])


@lru_cache
def header(name: str, values: tuple[tuple[str, Any], ...]) -> Exported:
    """Return an observer in float."""
    observer = registry.find(registry.OBSERVERS, name)
    gains, settings = Configuration(observer, dict(values)).for_joint('')
    return exported(observer, gains, settings, name, float32=True)


def difference(made: Exported, samples: vectors.Samples) -> float:
    """Return the rms difference of the velocity from that in double [rad/s]."""
    with tempfile.TemporaryDirectory() as place:
        done = folder.write(Path(place) / 'out', made, samples)
    found = re.search(r'rms (\S+)', '\n'.join(done[1])) if done else None
    if found is None:
        raise SystemExit(f'{made.prefix}: the check did not run: {done}')
    return float(found[1])


def main() -> None:
    """Print the table."""
    print(f'| observer | {" | ".join(MOTIONS)} | check of export |')
    for name in angle_observers():
        variants: dict[str, Any] = {'': lambda quantum: {}} | (KALMAN if name == 'kalman' else {})
        for label, values in variants.items():

            def made(counts: int, values: Any = values, name: str = name) -> Exported:
                return header(name, tuple(values(math.tau / counts).items()))

            worst = [
                max(difference(made(n), sampled(angle, math.tau / n)) for n in COUNTS)
                for angle in MOTIONS.values()
            ]
            check = vectors.with_faults(vectors.simulated(made(vectors.COUNTS).joint))
            worst.append(difference(made(vectors.COUNTS), check))
            cells = ' | '.join(re.sub('e-0', 'e-', f'{each:.0e}') for each in worst)
            print(f'| `{name}`{label and f", `{label}`"} | {cells} |', flush=True)


if __name__ == '__main__':
    main()
