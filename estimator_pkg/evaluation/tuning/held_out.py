# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Whether the tuned gains replace the defaults: the pair on held-out data, and its test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.recording import EstimateSeries
from estimator_pkg.bags.series import at_stamps
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation import pairs
from estimator_pkg.evaluation.ranking.choice import chosen
from estimator_pkg.evaluation.signals import slopes
from estimator_pkg.evaluation.tuning.objective import (
    FEWEST_ESTIMATES,
    Dataset,
    JointTruth,
    Weights,
    averaged,
    settled,
    smooth,
)

Array = NDArray[np.float64]


class Compared(NamedTuple):
    """The tuned gains against the defaults.

    sign : 1: the tuned gains are better (95 %), -1: worse, 0: not known. difference : by how much
    the weighted error of the defaults is larger [%]; resolution : the smallest difference that
    would be declared [%].
    events : parts of the records that make half of the difference, if they are few; else 0.
    """

    sign: int
    difference: float
    resolution: float
    events: int = 0

    @property
    def used(self) -> bool:
        """True if the tuned gains are used, by the rule of `chosen`."""
        errors = {'defaults': 1.0 + self.difference / 100.0, 'tuned': 1.0}
        return chosen(errors, ('defaults',), lambda *_: self.sign) == 'tuned'


def compared(
    parts: Sequence[Dataset],
    observer: str,
    gains: Mapping[str, Any],
    weights: Weights,
    other: str = '',
) -> Compared | None:
    """Return the comparison over these parts; None if the gains or the defaults do not work.

    The squared errors are weighted as the costs, and every joint counts in units of its defaults.
    Both references must agree where there are two.

    Parameters
    ----------
    other : the observer whose defaults are compared; '': the same.
    """
    found: list[list[tuple[Array, Array]]] = [[], []]
    for part in parts:
        try:
            ran = [part.recording.run(observer, gains), part.recording.run(other or observer, {})]
        except UserError:
            return None
        for joint, known in part.known.items():
            both = _velocities([each.get(joint) for each in ran], known)
            if both is None:
                return None
            time, rows, tuned, default = both
            references = [known.velocity, known.velocity if known.plain is None else known.plain]
            block = pairs.blocks(time)
            for sums, reference in zip(found, references):
                scores = [
                    _score(time, each, reference[rows], weights, block) for each in (tuned, default)
                ]
                unit = max(float(np.sum(scores[1])), 1e-300) / len(time)
                count = np.bincount(block).astype(float)
                sums.append(((scores[0] - scores[1]) / unit, count))
    tests = [pairs.of_sums(*map(list, zip(*each))) for each in found]
    signs = {each.sign for each in tests}
    mean = tests[0].mean  # of the squares, in units of the defaults: -1 if no error is left
    return Compared(
        signs.pop() if len(signs) == 1 else 0,
        100.0 * ((1.0 + min(max(mean, -0.999999), 1e6)) ** -0.5 - 1.0),
        50.0 * max(each.half for each in tests),
        len(pairs.events(np.concatenate([each for each, _ in found[0]]))),
    )


def _velocities(
    estimates: Sequence[EstimateSeries | None], known: JointTruth
) -> tuple[Array, NDArray[np.int64], Array, Array] | None:
    """Return (time, rows of `known`, tuned, default) where both have an estimate."""
    columns = []
    for each in estimates:
        if each is None:
            return None
        columns.append(at_stamps(known.stamps, each.stamps, each.velocity))
    elapsed = (known.stamps - known.stamps[0]) * 1e-9
    rows = np.flatnonzero(settled(elapsed) & np.isfinite(columns).all(axis=0))
    if len(rows) < FEWEST_ESTIMATES:
        return None
    return elapsed[rows], rows, columns[0][rows], columns[1][rows]


def _score(
    time: Array, velocity: Array, truth: Array, weights: Weights, block: NDArray[np.int64]
) -> Array:
    """Return the weighted sum of squares by block: error, its part by delay, and noise.

    The part by delay is the projection of the error on the acceleration.
    """
    error = velocity - truth
    sums = weights.error**2 * np.bincount(block, error**2)
    inside = slice(averaged(time), -averaged(time))  # the average is wrong at the ends
    if weights.noise:
        noise = velocity - smooth(time, velocity)
        sums = sums + weights.noise**2 * np.bincount(
            block[inside], noise[inside] ** 2, minlength=len(sums)
        )
    if weights.delay:
        turns = np.zeros(len(time))
        turns[inside] = slopes(time, smooth(time, truth))[inside]
        power = np.maximum(np.bincount(block, turns**2), 1e-300)
        sums = sums + weights.delay**2 * np.bincount(block, error * turns) ** 2 / power
    return np.asarray(sums, float)
