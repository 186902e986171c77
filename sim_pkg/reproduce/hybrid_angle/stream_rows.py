# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows on streams with faults: jitter, drops, gaps, duplicates and outliers at 150 rad/s, 14 bit.

Three columns: Algorithm 1 with a fixed T, Algorithm 1 with the true sample times, the robust form
with the true sample times. Deterministic rows are means over start angles (the position within a
quantum changes small errors), random ones over seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from sim_pkg.reproduce import splitmix
from sim_pkg.reproduce.contract import Values, references
from sim_pkg.reproduce.hybrid_angle.continuous import SEEDS, rms
from sim_pkg.reproduce.hybrid_angle.sampled import (
    PERIOD,
    QUANTUM,
    Array,
    algorithm_1,
    error_of,
    robust,
    wrapped,
)

SPEED = 150.0  # [rad/s]
COUNT = 1001  # samples of a stream
SETTLED = 400  # samples before the first fault
PLACE = 500  # sample of the gap or outlier
ANGLES = tuple(0.0137 * SPEED * k for k in range(6))  # start angles [rad]
JITTER = 0.001  # largest jitter [s]
COLUMNS = ('fixed T', 'true T', 'robust')


def columns(
    taken: Array,
    stamped: Array,
    *,
    start: float = 0.0,
    outlier: float = 0.0,
    injection: str = 'saw',
) -> dict[str, Array]:
    """Return velocity errors [rad/s] from sample SETTLED on, by column.

    Parameters
    ----------
    taken, stamped : when the angle was read, and its stamp [s], shape (n,).
    start : angle at time 0 [rad].
    outlier : added to the reading at PLACE [rad].
    """
    exact = SPEED * taken + start
    angles = wrapped(exact, QUANTUM)
    angles[PLACE] = wrapped([angles[PLACE] + outlier])[0]
    periods = np.diff(stamped, prepend=stamped[0] - PERIOD)
    runs = (
        algorithm_1(injection, angles),
        algorithm_1(injection, angles, periods),
        robust(injection, angles, periods),
    )
    speed = np.full(len(angles), SPEED)
    return {column: error_of(run, speed)[SETTLED:] for column, run in zip(COLUMNS, runs)}


def mean_of(
    cases: Iterator[dict[str, Array]], measure: Callable[[Array], float]
) -> dict[str, float]:
    """Return the mean of a measure over the cases, by column; errors [rad/s] have shape (n,)."""
    found = [{column: measure(error) for column, error in case.items()} for case in cases]
    return {column: float(np.mean([case[column] for case in found])) for column in COLUMNS}


def largest(error: Array) -> float:
    """Return the largest absolute error; `error` has shape (n,) [rad/s]."""
    return float(np.abs(error).max())


def stream_values() -> Values:
    """Rows on streams with faults, for the columns that have a reference."""
    known = {row.id for row in references('hybrid_angle')}
    for name, values in measured():
        for column, value in values.items():
            if f'stream {name} {column}' in known:
                yield f'stream {name} {column}', value


def measured() -> Iterator[tuple[str, dict[str, float]]]:
    """Yield (fault and measure, values by column)."""
    time = PERIOD * np.arange(COUNT)
    jitter = {seed: splitmix.uniforms(seed, COUNT, JITTER) for seed in SEEDS}
    yield 'clean RMS', mean_of((columns(time, time, start=start) for start in ANGLES), rms)
    yield (
        'sampling jitter RMS',
        mean_of((columns(time + late, time + late) for late in jitter.values()), rms),
    )
    yield (
        'stamp jitter RMS',
        mean_of((columns(time, time + wrong) for wrong in jitter.values()), rms),
    )
    kept = [time[~dropped(seed)] for seed in SEEDS]
    yield '5 % drops RMS', mean_of((columns(left, left) for left in kept), rms)
    for name, length in (('40 ms', 4), ('1.01 s', 101)):
        left = np.delete(time, slice(PLACE + 1, PLACE + length))
        yield (
            f'gap {name} max',
            mean_of((columns(left, left, start=start) for start in ANGLES), largest),
        )
    twice = np.sort(np.concatenate([time, time[::50]]))
    run = algorithm_1('saw', wrapped(SPEED * twice, QUANTUM))
    yield 'duplicates 1 in 50 RMS', {'fixed T': rms(SPEED - run.velocity[SETTLED:])}
    for size in (0.5, 3.0, 3.13):
        for injection in ('saw', 'sat', 'sin'):
            yield (
                f'outlier {size:g} rad {injection} max',
                mean_of(
                    (
                        columns(time, time, start=start, outlier=size, injection=injection)
                        for start in ANGLES
                    ),
                    largest,
                ),
            )


def dropped(seed: int) -> NDArray[np.bool_]:
    """Return which samples never arrive, shape (COUNT,): 5 % of those after the start."""
    lost = splitmix.uniforms(seed, COUNT, 1.0) >= 0.9
    lost[:SETTLED] = False
    return lost
