# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The input of `identify` from a bag: one mechanism's samples, and the pieces they are cut into."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import Series, joint_series
from estimator_pkg.errors import UsageError, UserError, suggestion
from estimator_pkg.models.mechanics import Mechanics

Array = NDArray[np.float64]

FIT_FRACTION = 0.6  # fraction of the recording for the fit
PIECES = 30  # number of pieces in that part, if the recording is long enough
SHORTEST_PIECE, LONGEST_PIECE = 0.2, 1.0  # length of a piece [s]
FEWEST_PIECES = 10  # smallest number of pieces for the fit
LONGEST_GAP = 5.0  # longest gap within a piece, in median sample times
PLAIN_STEP = 1e-2  # sample time for models in plain Python [s]


class MechanismSamples(NamedTuple):
    """One mechanism: times, shape (N,), positions, (N, n), not wrapped, and inputs, (N, m).

    Row k of the inputs acted from sample k - 1 to sample k.
    """

    time: Array
    positions: Array
    inputs: Array


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


def thinned(recording: MechanismSamples) -> MechanismSamples:
    """Return samples `PLAIN_STEP` apart, inputs averaged: a model in plain Python is slow."""
    time = recording.time
    every = max(1, round(PLAIN_STEP / float(np.median(np.diff(time)))))
    keep = np.arange(0, len(time), every)
    total = accumulated(time, recording.inputs)[keep]
    inputs = np.zeros((len(keep), recording.inputs.shape[1]))
    inputs[1:] = np.diff(total, axis=0) / np.diff(time[keep])[:, None]
    return MechanismSamples(time[keep], recording.positions[keep], inputs)


def accumulated(time: Array, inputs: Array) -> Array:
    """Return the integral of the inputs, shape (n, k), up to each sample [input s]."""
    steps = np.diff(time, prepend=time[0])[:, None]
    return np.cumsum(np.where(steps > 0.0, inputs * steps, 0.0), axis=0)


def cut(recording: MechanismSamples) -> tuple[list[slice], list[slice]]:
    """Return the rows of the pieces for the fit and of those for validation; raise UserError."""
    time = recording.time
    if len(time) < 2:
        raise UserError('the recording has fewer than two usable samples: record longer')
    usual = float(np.median(np.diff(time)))
    split = time[0] + FIT_FRACTION * (time[-1] - time[0])
    length = min(max((split - time[0]) / PIECES, SHORTEST_PIECE), LONGEST_PIECE)
    holes = np.flatnonzero(np.diff(time) > LONGEST_GAP * usual) + 1
    parts: tuple[list[slice], list[slice]] = ([], [])
    for begin, end in itertools.pairwise([0, *holes, len(time)]):
        edges = np.arange(time[begin], time[end - 1] + 0.5 * usual, length)
        rows = np.searchsorted(time[begin:end], edges) + begin
        for left, right in itertools.pairwise(rows.tolist()):
            stop = min(right + 1, end)  # neighbours share their common sample
            if stop - left >= 8 and time[stop - 1] <= split:
                parts[0].append(slice(left, stop))
            elif stop - left >= 8 and time[left] >= split:
                parts[1].append(slice(left, stop))
    if len(parts[0]) < FEWEST_PIECES or len(parts[1]) < FEWEST_PIECES // 3:
        raise UserError(
            f'the recording is too short to identify a model: it has {len(parts[0])} pieces '
            f'of {length:.2g} s without a gap and needs {FEWEST_PIECES}: record longer'
        )
    return parts
