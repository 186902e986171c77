# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Read the input of `identify` from a bag: one mechanism's times, positions and inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import Series, joint_series
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.evaluation.identify.pieces import MechanismSamples
from estimator_pkg.models.mechanics import Mechanics

Array = NDArray[np.float64]


def recording(
    bag: Bag, topic: str, mechanics: Mechanics, requested: Sequence[str]
) -> tuple[MechanismSamples, tuple[str, ...]]:
    """Return the mechanism's samples, sorted by time, and the names of its joints in the topic.

    Stamps at which a joint is missing are skipped, as are repeated and older ones.

    Parameters
    ----------
    requested : names of the joints, in the order of the positions; empty: the model's own, or
        the only joint of the topic.

    Raises
    ------
    UsageError : the joints must be named, or are too many or too few.
    UserError : a joint does not exist, or an input has no efforts.
    """
    every = joint_series(bag, topic)
    names = _names(bag, topic, mechanics, requested, every)
    stamps, rows = common(names, every)
    positions = np.column_stack([every[name].position[row] for name, row in zip(names, rows)])
    inputs = np.zeros((len(stamps), mechanics.inputs))
    for place, joint in enumerate(mechanics.actuated):
        inputs[:, place] = every[names[joint]].effort[rows[joint]]
        if np.count_nonzero(np.isfinite(inputs[:, place])) < 0.5 * len(stamps):
            raise UserError(
                f"joint '{names[joint]}' has no efforts, and identify needs positions and "
                'efforts in the same messages: record both'
            )
    good = np.all(np.isfinite(positions), axis=1) & np.all(np.isfinite(inputs), axis=1)
    stamps, positions, inputs = stamps[good], positions[good], inputs[good]
    if len(stamps) < 2:
        raise UserError(
            f"topic '{topic}' of {bag.path} has fewer than two samples of "
            f'{", ".join(names)} with positions and efforts at the same stamps'
        )
    for column, period in enumerate(mechanics.periods):
        if period > 0.0:
            positions[:, column] = np.unwrap(positions[:, column], period=period)
    return MechanismSamples((stamps - stamps[0]) * 1e-9, positions, inputs), names


def _names(
    bag: Bag, topic: str, mechanics: Mechanics, requested: Sequence[str], every: dict[str, Series]
) -> tuple[str, ...]:
    count = mechanics.degrees
    if not requested:
        if all(name in every for name in mechanics.joints):
            return mechanics.joints
        if len(every) == count == 1:
            return tuple(every)
        raise UsageError(
            f"topic '{topic}' has the joints {', '.join(every)}: choose those of model "
            f"'{mechanics.name}' with --joint, once for each of {', '.join(mechanics.joints)}"
        )
    for name in requested:
        if name not in every:
            raise UserError(
                f"topic '{topic}' of {bag.path} has no joint '{name}': {suggestion(name, every)}"
            )
    if len(requested) != count or len(set(requested)) != count:
        raise UsageError(
            f"model '{mechanics.name}' has {count} joints "
            f'({", ".join(mechanics.joints)}): give --joint {count} times, not '
            f'{len(requested)}'
        )
    return tuple(requested)


def common(
    names: tuple[str, ...], every: dict[str, Series]
) -> tuple[NDArray[np.int64], list[NDArray[np.int64]]]:
    """Return (ascending stamps that every joint has, rows of each joint at them), shape (n,)."""
    rows = []
    for name in names:
        stamps = every[name].stamps_ns
        newer = np.concatenate([[True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]])
        rows.append(np.flatnonzero(newer))
    shared = every[names[0]].stamps_ns[rows[0]]
    for name, row in zip(names[1:], rows[1:]):
        shared = np.intersect1d(shared, every[name].stamps_ns[row], assume_unique=True)
    return shared, [
        row[np.searchsorted(every[name].stamps_ns[row], shared)] for name, row in zip(names, rows)
    ]
