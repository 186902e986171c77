# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The bags for tuning: parts for the search, and held-out parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.recording import Estimate, Recording
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.compare.interpolation import slopes
from estimator_pkg.evaluation.compare.matching import match
from estimator_pkg.evaluation.compare.sources import measured, recording
from estimator_pkg.evaluation.compare.truth import check_common, truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.tuning.objective import Known, Part, averaged

SHORTEST = 20  # smallest number of samples of a part with a truth


@dataclass(frozen=True)
class Record:
    """A part of a bag that can have its own gains: a joint, or joints estimated together.

    label : the joint; '' if there is no choice. seen : data of the search. held_out : data for
    validation. uncertainty : the reference's own error [rad/s], by joint. origin : 'sensor' or
    'smoother', by joint.
    """

    bag: str
    label: str
    seen: Part
    held_out: Part | None
    uncertainty: dict[str, float]
    origin: dict[str, str]

    @property
    def joints(self) -> tuple[str, ...]:
        """The evaluated joints."""
        return tuple(self.seen.known)


def records(
    path: str, entry: Entry, options: Options, held_out: float, joints: Sequence[str] = ()
) -> list[Record]:
    """Return the records of a bag on which the observer can be tuned.

    Parameters
    ----------
    held_out : fraction at the end of each record that the search does not use.
    joints : only these; empty: all with a truth.

    Raises
    ------
    UserError, UsageError : the bag lacks an input of the observer, a parameter is wrong, or there
        is no truth and too little data for an off-line reference.
    """
    with open_bag(path, options.unpack_limit) as bag:
        measurement = measured(bag, options)
        whole = recording(entry, bag, measurement, options)
        true = truth(bag, path, measurement, options)
    apart = whole.by_joint()
    if '' not in apart:
        check_common(path, entry.observer, apart, true)
    if joints and set(apart) == {''}:
        raise UsageError(f"--joint: '{entry.observer}' estimates its joints together: omit --joint")
    for name in joints:
        if name not in apart:
            raise UserError(f"{path}: no joint '{name}'; it has {', '.join(sorted(apart))}")
    found = []
    for label, each in apart.items():
        if (joints and label not in joints) or (label and label not in true.series):
            continue
        first, rest = each.split(held_out)
        seen = _part(first, entry, true.series, options)
        if seen is None:
            continue
        after = None
        if held_out > 0.0:
            after = _part(rest, entry, true.series, options, after=seen)
        found.append(
            Record(
                path,
                label,
                seen,
                after,
                {joint: true.references[joint].noise for joint in seen.known},
                {joint: true.references[joint].origin for joint in seen.known},
            )
        )
    if not found:
        raise UserError(
            f'{path} has fewer than {SHORTEST} samples with a truth, too few for tuning'
        )
    return found


def _part(
    part: Recording,
    entry: Entry,
    true: Mapping[str, Series],
    options: Options,
    after: Part | None = None,
) -> Part | None:
    """Return the part with its truth; None for too few samples.

    Parameters
    ----------
    after : the data of the search: its samples do not count, although the observer may run through
        them first.
    """
    if not part.size():
        return None
    known = {}
    for joint, estimate in part.run(entry.observer, {}).items():
        if joint not in true:
            continue
        seen = after.known[joint].stamps if after is not None and joint in after.known else None
        one = _known(estimate, true[joint], options.wrap_period, seen)
        if one is not None:
            known[joint] = one
    return Part(part, known) if known else None


def _known(
    estimate: Estimate, true: Series, period: float, seen: NDArray[np.int64] | None
) -> Known | None:
    due = np.unique(estimate.due)
    if seen is not None:
        due = due[due > seen[-1]]
    if len(due) < SHORTEST:
        return None
    at = match(due, true.stamps_ns, true.velocity, true.position, period)
    good = np.isfinite(at.velocity)
    stamps, velocity = due[at.rows[good]], at.velocity[good]
    if len(stamps) < SHORTEST:
        return None
    time = (stamps - stamps[0]) * 1e-9
    width = averaged(time)
    smooth = np.convolve(velocity, np.ones(width) / width, 'valid')
    turns = slopes(time[: len(smooth)], smooth) if len(smooth) > 2 else np.zeros(1)
    return Known(stamps, velocity, float(np.sqrt(np.mean(turns**2))))
