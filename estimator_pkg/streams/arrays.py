# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Single angles in arrays: process many messages at once through guard and observer.

The results equal those of single messages, because the driver's functions are the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.circle import LARGEST
from estimator_pkg.driver.bank import Bank
from estimator_pkg.driver.batch import Estimates
from estimator_pkg.driver.configuration import JointSettings
from estimator_pkg.driver.joint import Joint
from estimator_pkg.estimate import VALID
from estimator_pkg.sensor.guard import DUPLICATE, UNSTABLE_GAINS
from estimator_pkg.streams.history import History


class Samples(NamedTuple):
    """Messages that name the same joints.

    rows : shape (n,), indices of these messages in the block, ascending.
    frame_id, names : the same for all of them.
    stamps_ns : shape (n,), int64.
    positions : shape (n, joints) [rad or m]; as many columns as the messages have numbers.
    efforts : as positions [N m or N]; no columns where there are none.
    """

    rows: NDArray[np.int64]
    frame_id: str
    names: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    positions: NDArray[np.float64]
    efforts: NDArray[np.float64]


class Estimated(NamedTuple):
    """The estimates for `Samples`: arrays of shape (n, joints).

    samples : of the joints to estimate alone, positions in the convention of the estimates.
    used : the guard let the sample through. valid : the estimate may be published.
    position, velocity, acceleration, position_stddev, velocity_stddev : SI.
    """

    samples: Samples
    used: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    position_stddev: NDArray[np.float64]
    velocity_stddev: NDArray[np.float64]

    def of(self, rows: NDArray[np.bool_]) -> Estimated:
        """Return the estimates of these messages alone; rows: shape (k,), indices or a mask."""
        samples, *arrays = self
        samples = samples._replace(
            rows=samples.rows[rows],
            stamps_ns=samples.stamps_ns[rows],
            positions=samples.positions[rows],
            efforts=samples.efforts[rows],
        )
        return Estimated._make((samples, *(array[rows] for array in arrays)))


class Estimation:
    """Estimates joints from blocks of samples.

    Parameters
    ----------
    bank : the joints.

    Attributes
    ----------
    seen : all received names, selected or not.
    """

    def __init__(self, bank: Bank) -> None:
        self.bank = bank
        self.seen: set[str] = set()

    def update(
        self,
        groups: list[Samples],
        history: dict[str, History] | None,
        times: list[NDArray[np.int64]] | None = None,
    ) -> list[Estimated]:
        """Take one block of messages; return the estimates of every group, in the same order.

        A group whose messages have different numbers of positions and names has no estimates.

        Parameters
        ----------
        history : receives the time by status of each joint.
        times : when the readings of each group were taken [ns], shape (n,); None: at their stamps.
        """
        results = []
        parts: dict[str, list[tuple[int, int]]] = {}
        for index, group in enumerate(groups):
            count, width = group.positions.shape
            self.seen.update(group.names)
            if width != len(group.names) or not width:
                if width:
                    self.bank.mismatched += count
                else:
                    self.bank.empty += count
                group = group._replace(names=(), positions=np.zeros((count, 0)))
            group = self._selected(group)
            results.append(_room(group))
            for column, name in enumerate(group.names):
                parts.setdefault(name, []).append((index, column))
        for name, places in parts.items():
            joint = self.bank.joint(name)
            if joint is not None:
                self._run(name, joint, places, results, history, times)
        return results

    def _selected(self, group: Samples) -> Samples:
        """As `Bank.selected`, for a group."""
        if group.efforts.shape[1] != len(group.names):
            group = group._replace(efforts=group.efforts[:, :0])
        if not self.bank.only:
            return group
        places = [k for k, name in enumerate(group.names) if name in self.bank.only]
        return group._replace(
            names=tuple(group.names[k] for k in places),
            positions=group.positions[:, places],
            efforts=group.efforts[:, places] if group.efforts.shape[1] else group.efforts,
        )

    def _run(
        self,
        name: str,
        joint: Joint,
        places: list[tuple[int, int]],
        results: list[Estimated],
        history: dict[str, History] | None,
        times: list[NDArray[np.int64]] | None,
    ) -> None:
        """Process one joint over the block, its samples in the order of the messages."""
        sources = [results[index].samples for index, _ in places]
        stamps = np.concatenate(
            [
                results[index].samples.stamps_ns if times is None else times[index]
                for index, _ in places
            ]
        )
        positions = np.concatenate(
            [source.positions[:, column] for source, (_, column) in zip(sources, places)]
        )
        order = None
        if len(places) > 1:
            order = np.argsort(np.concatenate([source.rows for source in sources]), kind='stable')
            stamps, positions = stamps[order], positions[order]
        before = joint.estimate()[0]
        out = joint.run(stamps, positions)
        if history is not None:
            history.setdefault(name, History()).add(stamps, out.status, out.verdict)
        used = out.verdict < DUPLICATE
        columns: tuple[NDArray[Any], ...] = (
            _written(positions, out, before, joint.settings),
            used,
            used & np.isin(out.status, VALID),
            out.position,
            out.velocity,
            out.acceleration,
            out.position_stddev,
            out.velocity_stddev,
        )
        if order is not None:
            back = np.empty_like(order)
            back[order] = np.arange(len(order))
            columns = tuple(values[back] for values in columns)
        start = 0
        for index, column in places:
            end = start + len(results[index].samples.rows)
            samples, *targets = results[index]
            for target, values in zip((samples.positions, *targets), columns):
                target[:, column] = values[start:end]
            start = end


def _room(group: Samples) -> Estimated:
    shape = group.positions.shape
    return Estimated(
        group._replace(positions=group.positions.copy()),
        np.zeros(shape, bool),
        np.zeros(shape, bool),
        *(np.full(shape, np.nan) for _ in range(5)),
    )


def _written(
    positions: NDArray[np.float64], out: Estimates, before: float, settings: JointSettings
) -> NDArray[np.float64]:
    """As `Joint.in_estimate_convention`, for each sample; `before`: the position before them."""
    period = settings.wrap_period
    if not settings.unwrap or period <= 0.0 or not len(positions):
        return positions
    known = (out.verdict < DUPLICATE) | (out.verdict == UNSTABLE_GAINS)
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    near = np.where(last < 0, before, out.position[last])
    angles = (np.abs(near) < LARGEST) & (np.abs(positions) < LARGEST)  # False for nan, too
    off = np.subtract(near, positions, where=angles, out=np.zeros(len(angles)))
    return positions + period * np.floor(off / period + 0.5)


def patterns(
    shown: NDArray[np.bool_],
) -> Iterator[tuple[NDArray[np.bool_] | slice, NDArray[np.bool_]]]:
    """Yield (rows, joints) of every set of joints that are published together.

    Both are masks, shape (n,) and (m,); rows are a slice if all messages publish all joints.

    Parameters
    ----------
    shown : shape (n, m), True where a message publishes a joint.
    """
    if shown.all():
        if len(shown):
            yield slice(None), np.ones(shown.shape[1], bool)
        return
    kinds, which = np.unique(shown, axis=0, return_inverse=True)
    for index, joints in enumerate(kinds):
        if joints.any():
            yield which.ravel() == index, joints
