"""The driver's joints over blocks of messages: the same numbers as message by message."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.samples import Samples
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.batch import COMPILE_FROM, Estimates
from estimator_pkg.driver.compiled import available
from estimator_pkg.driver.configuration import Configuration
from estimator_pkg.driver.guard import (
    AFTER_CLOCK_JUMP,
    AFTER_GAP,
    AFTER_OUTAGE,
    AFTER_STRAY_STAMP,
    DUPLICATE,
)
from estimator_pkg.driver.joint import Joint
from estimator_pkg.observers.contract import COASTING, STATUS_NAMES, TRACKING

GAP = 'gap'  # time without samples, beside the statuses


class Estimated(NamedTuple):
    """What became of `Samples`: arrays of shape (n, joints).

    valid : the estimate may be published.
    position, velocity, position_stddev, velocity_stddev : SI.
    """

    samples: Samples
    valid: NDArray[np.bool_]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    position_stddev: NDArray[np.float64]
    velocity_stddev: NDArray[np.float64]


@dataclass
class History:
    """How long a joint was in which status [s], and when its last used sample was."""

    seconds: dict[str, float] = field(default_factory=dict)
    last_ns: int | None = None
    status: int = 0
    _last_gap: float = 0.0      # of the last sample [s], if one was before it

    def add(self, stamps_ns: NDArray[np.int64], out: Estimates) -> None:
        """Samples that were taken in, and what came out."""
        used = out.verdict < DUPLICATE
        if not used.any():
            return
        times, status, verdict = stamps_ns[used], out.status[used], out.verdict[used]
        first = times[0] if self.last_ns is None else self.last_ns
        passed = np.diff(times, prepend=first) * 1e-9
        for row in np.flatnonzero(verdict == AFTER_STRAY_STAMP).tolist():
            self._take_back(passed, row)
        passed[(verdict == AFTER_CLOCK_JUMP) | (passed < 0.0)] = 0.0
        gap = (verdict == AFTER_GAP) | (verdict == AFTER_OUTAGE)
        self._last_gap = float(passed[-1]) if gap[-1] else 0.0
        for kind in np.unique(status).tolist():
            self._count(STATUS_NAMES[kind], passed[(status == kind) & ~gap])
        self._count(GAP, passed[gap])
        self.last_ns, self.status = int(times[-1]), int(status[-1])

    def _take_back(self, passed: NDArray[np.float64], row: int) -> None:
        """The gap before a stray stamp was none: its sample goes on from before it."""
        before = passed[row - 1] if row else self._last_gap
        passed[row] += before
        if row:
            passed[row - 1] = 0.0
        else:
            self._count(GAP, np.array([-before]))

    def _count(self, name: str, seconds: NDArray[np.float64]) -> None:
        if len(seconds):
            self.seconds[name] = self.seconds.get(name, 0.0) + float(seconds.sum())


class Estimation:
    """Estimates joints from blocks of samples.

    Parameters
    ----------
    configuration, only : as of `Bank`.
    messages : how many messages will come; decides whether compiling pays.
    fast : compile or not; None: where it pays.
    """

    def __init__(self, configuration: Configuration, only: Iterable[str] = (), *,
                 messages: int = 0, fast: bool | None = None) -> None:
        self.bank = Bank(configuration, only)
        self.history: dict[str, History] = {}
        self.seen: set[str] = set()      # every name that came, wanted or not
        self.malformed = 0
        self.messages = 0
        self._expected = messages
        self._fast = fast

    def update(self, groups: list[Samples], malformed: int = 0) -> list[Estimated]:
        """One block of messages in; the estimates of every group, in the same order.

        A group whose messages have another number of positions than of names gives no estimates.
        """
        self.malformed += malformed
        self.messages += malformed
        results = []
        parts: dict[str, list[tuple[int, int]]] = {}
        for index, group in enumerate(groups):
            count, width = group.positions.shape
            self.messages += count
            self.seen.update(group.names)
            if width != len(group.names) or not width:
                if width:
                    self.bank.mismatched += count
                else:
                    self.bank.empty += count
                group = group._replace(names=(), positions=np.zeros((count, 0)))
            names = group.names
            results.append(_room(group))
            for column, name in enumerate(names):
                parts.setdefault(name, []).append((index, column))
        for name, places in parts.items():
            joint = self.bank.joint(name)
            if joint is not None:
                self._run(name, joint, places, results)
        return results

    def _run(self, name: str, joint: Joint, places: list[tuple[int, int]],
             results: list[Estimated]) -> None:
        """Take one joint through the block, its samples in the order of the messages."""
        sources = [results[index].samples for index, _ in places]
        stamps = np.concatenate([source.stamps_ns for source in sources])
        positions = np.concatenate([source.positions[:, column]
                                    for source, (_, column) in zip(sources, places)])
        order = None
        if len(places) > 1:
            order = np.argsort(np.concatenate([source.rows for source in sources]), kind='stable')
            stamps, positions = stamps[order], positions[order]
        out = joint.run(stamps, positions, fast=self._decide(len(results[0].samples.names)))
        self.history.setdefault(name, History()).add(stamps, out)
        valid = (out.verdict < DUPLICATE) & ((out.status == TRACKING) | (out.status == COASTING))
        columns: tuple[NDArray[Any], ...] = (
            valid, out.position, out.velocity, out.position_stddev, out.velocity_stddev)
        if order is not None:
            back = np.empty_like(order)
            back[order] = np.arange(len(order))
            columns = tuple(values[back] for values in columns)
        start = 0
        for index, column in places:
            end = start + len(results[index].samples.rows)
            for target, values in zip(results[index][1:], columns):
                target[:, column] = values[start:end]
            start = end

    def _decide(self, joints: int) -> bool:
        """Compile for the whole bag or not at all, so that speed does not depend on blocks."""
        if self._fast is None:
            self._fast = available() and self._expected * max(joints, 1) >= COMPILE_FROM
        return self._fast


def _room(group: Samples) -> Estimated:
    shape = group.positions.shape
    return Estimated(group, np.zeros(shape, bool), np.full(shape, np.nan), np.full(shape, np.nan),
                     np.full(shape, np.nan), np.full(shape, np.nan))
