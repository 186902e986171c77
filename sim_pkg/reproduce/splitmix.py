# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The splitmix64 generator: the same numbers on every machine and in every numpy version."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MASK = (1 << 64) - 1
GOLDEN = 0x9E3779B97F4A7C15


def integers(seed: int, count: int) -> NDArray[np.uint64]:
    """The first `count` outputs, shape (count,), from the state `seed`."""
    with np.errstate(over='ignore'):
        states = np.uint64(seed & MASK) + np.uint64(GOLDEN) * np.arange(
            1, count + 1, dtype=np.uint64
        )
        mixed = (states ^ (states >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))


def uniforms(seed: int, count: int, bound: float = 1.0) -> NDArray[np.float64]:
    """Uniform numbers in [-bound, bound), shape (count,), from the upper 53 bits of each output."""
    fractions = (integers(seed, count) >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return bound * (2.0 * fractions - 1.0)
