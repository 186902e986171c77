"""A joint of the observer `adaptive`, with what its samples say of the parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.driver.batch import COMPILE_FROM, Estimates
from estimator_pkg.driver.joint import Joint, JointSettings
from estimator_pkg.observers.adaptive_evidence import Evidence
from estimator_pkg.observers.adaptive_gains import structure
from estimator_pkg.observers.adaptive_report import Origin, Report, report
from estimator_pkg.observers.contract import Observer

PIECE = 0.25  # of a block of evidence


class AdaptiveJoint(Joint):
    """A `Joint` that keeps what its samples say of the parameters.

    Parameters
    ----------
    observer, gains, settings, twin : as of `Joint`.

    Attributes
    ----------
    evidence : see `estimator_pkg.observers.adaptive_evidence`.
    origin : of the parameters that it starts with, where they come from a file.
    """

    def __init__(self, observer: Observer, gains: Any, settings: JointSettings,
                 twin: Joint | None = None) -> None:
        super().__init__(observer, gains, settings, twin)
        self.evidence = Evidence(structure(gains).slowest, gains.memory)
        self.origin: Origin | None = None

    def set_gains(self, gains: Any) -> None:
        """As of `Joint`."""
        super().set_gains(gains)
        self.evidence.memory = gains.memory

    def update(self, stamp_ns: int, measurement: Any, given: Any = 0.0) -> bool:
        """One sample in."""
        used = super().update(stamp_ns, measurement, given)
        self._look()
        return used

    def run(self, stamps: NDArray[np.int64], measurements: NDArray[np.float64],
            given: NDArray[np.float64] | None = None, *, fast: bool | None = None) -> Estimates:
        """Many samples in, piece by piece: blocks of evidence end where a piece does."""
        pieces: list[Estimates] = []
        begin = 0
        fast = len(stamps) >= COMPILE_FROM if fast is None else fast
        while begin < len(stamps) or not pieces:
            length_ns = round(PIECE * self.evidence.length * 1e9)
            end = len(stamps) and begin + 1 + int(
                np.searchsorted(stamps[begin + 1:], stamps[begin] + length_ns))
            part = slice(begin, end)
            pieces.append(super().run(stamps[part], measurements[part],
                                      None if given is None else given[part], fast=fast))
            self._look()
            begin = end
        return Estimates(*(np.concatenate(column) for column in zip(*pieces)))

    def report(self) -> Report:
        """What was identified."""
        return report(self.gains, self.state, self.mean_dt or 1e-3, self.evidence, self.origin)

    def _look(self) -> None:
        state = self.state
        self.evidence.look(state[7][4], state[9])
