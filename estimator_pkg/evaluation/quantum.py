"""The step of a quantised reading, seen in the readings themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME = 1e-6     # readings this close (part of the largest) are one level: they were float32 once
ENOUGH = 8      # levels below which nothing can be said,
REPEATED = 10   # unless each was read so often
WHOLE = 0.1     # a spacing is a whole number of quanta if it is off by at most this part of one
SHARE = 0.9     # so many of the spacings have to be
FEW = 8.0       # only spacings up to so many quanta tell: wider ones may be whole by chance


def quantum(readings: Array) -> float:
    """The distance between neighbouring levels of `readings`; 0 where they are not quantised.

    Parameters
    ----------
    readings : shape (n,), wrapped or not [rad or m]; nan is left out.
    """
    finite = readings[np.isfinite(readings)]
    levels = np.unique(finite)
    if len(levels) < 2:
        return 0.0
    spacings = np.diff(levels)
    spacings = spacings[spacings > SAME * float(np.max(np.abs(levels)))]
    fewest = 1 if len(finite) >= REPEATED * len(levels) else ENOUGH - 1
    if len(spacings) < fewest:
        return 0.0
    step = float(np.min(spacings))
    step = float(np.mean(spacings[spacings < 1.5 * step]))
    near = spacings[spacings < FEW * step] / step
    whole = np.abs(near - np.rint(near)) < WHOLE
    if len(near) < fewest or np.mean(whole) < SHARE:
        return 0.0
    near = near[whole]
    return float(step * np.sum(near) / np.sum(np.rint(near)))
