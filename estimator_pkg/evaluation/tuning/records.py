# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The bags for tuning: parts for the search, and held-out parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.recording import Recording
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.compare.sources import measured, recording
from estimator_pkg.evaluation.compare.truth import Truth, check_common, listed, truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.ranking.cautions import cautions, unseen
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.evaluation.reference.quantum import quantum
from estimator_pkg.evaluation.signals import slopes
from estimator_pkg.evaluation.tuning.objective import Dataset, JointTruth, averaged

FEWEST_TRUTH_SAMPLES = 20  # smallest number of samples of a part with a truth
TOO_FEW = f'fewer than {FEWEST_TRUTH_SAMPLES} samples with a truth, too few for tuning'


@dataclass(frozen=True)
class TuningRecord:
    """A part of a bag that can have its own gains: a joint, or joints estimated together.

    label : the joint; None if there is no choice. seen : data of the search; it knows no joint if
    there is nothing to tune on. held_out : data for validation. quanta : of the readings, by joint
    [rad]; 0: not quantised. cautions : what limits a judgement without truth. why : why there is
    nothing to tune on; '' otherwise. notes : on the truth.
    """

    bag: str
    label: str | None
    seen: Dataset
    held_out: Dataset | None
    quanta: dict[str, float]
    cautions: tuple[str, ...]
    why: str = ''
    notes: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """The evaluated joints; those of the readings if none is."""
        return tuple(self.seen.known) or tuple(self.quanta)


def records(
    path: str, entry: Entry, options: Options, held_out: float, joints: Sequence[str] = ()
) -> list[TuningRecord]:
    """Return the records of a bag on which the observer can be tuned.

    Parameters
    ----------
    held_out : fraction at the end of each record that the search does not use.
    joints : only these; empty: all with a truth.

    Raises
    ------
    UserError, UsageError : the bag lacks an input of the observer, a parameter is wrong, or there
        is neither truth nor measured position.
    """
    with open_bag(path, options.unpack_limit, options.columns) as bag:
        measurement = measured(bag, options)
        whole = recording(entry, bag, measurement, options).between(options.begin, options.end)
        true = truth(bag, path, measurement, options)
    by_label = whole.by_joint()
    names = [label for label in by_label if label is not None]
    if names:
        check_common(path, entry.observer, names, true)
    elif joints:
        raise UsageError(f"--joint: '{entry.observer}' estimates its joints together: omit --joint")
    for name in joints:
        if name not in names:
            raise UserError(f"{path}: no joint '{name}'; it has {listed(names)}")
    found = []
    for label, each in by_label.items():
        if joints and label not in joints:
            continue
        if names and label not in true.series and label not in true.motions:
            continue
        of = tuple(true.motions or true.series) if label is None else (label,)
        why = {joint: _unfit(true, joint) for joint in of}
        usable = {joint: true.series[joint] for joint in of if not why[joint]}
        first, rest = each.of_stamps(*true.parts.get(label or '', (0, 2**62))).split(held_out)
        seen = _part(first, entry, usable, true, options)
        after = _part(rest, entry, usable, true, options, seen) if seen and held_out else None
        limits = [true.caveats[joint] for joint in usable if joint in true.caveats]
        for moved in filter(None, map(true.motions.get, usable)):
            limits += cautions(moved)
        if seen is None:
            reason = '; '.join(f'{joint}: {text}' for joint, text in why.items() if text) or TOO_FEW
        found.append(
            TuningRecord(
                path,
                label,
                seen or Dataset(first, {}),
                after,
                {each: quantum(measurement[each].position) for each in of if each in measurement},
                tuple(dict.fromkeys(limits)),
                '' if seen else reason,
                true.notes,
            )
        )
    if not found:
        raise UserError(f'{path}: no joint can be read: name another topic with --measurement')
    return found


def _unfit(true: Truth, joint: str) -> str:
    """Return why a joint has no motion to tune on; '' if it has."""
    if joint not in true.motions or joint in true.faults:
        return true.faults.get(joint, '')
    moved = true.motions[joint]
    if moved is None:
        return 'there are too few readings'
    if moved.seldom:
        return 'it moves too little: record a longer or faster motion'
    if moved.constant:
        return 'it moves at constant speed only: record a motion that accelerates'
    return unseen(moved)


def _part(
    part: Recording,
    entry: Entry,
    usable: Mapping[str, Series],
    true: Truth,
    options: Options,
    after: Dataset | None = None,
) -> Dataset | None:
    """Return the part with its truth; None for too few samples.

    Parameters
    ----------
    usable : true velocities of the joints to tune on.
    after : the data of the search: its samples do not count, although the observer may run through
        them first.
    """
    if not part.size() or not usable:
        return None
    known = {}
    for joint, estimate in part.run(entry.observer, {}).items():
        if joint not in usable:
            continue
        due = np.unique(estimate.due)
        if after is not None and joint in after.known:
            due = due[due > after.known[joint].stamps[-1]]
        one = _known(due, usable[joint], true.motions.get(joint), options.period(joint))
        if one is not None:
            known[joint] = one
    return Dataset(part, known) if known else None


def _known(
    due: NDArray[np.int64], true: Series, moved: ReferenceMotion | None, period: float
) -> JointTruth | None:
    """Return the truth at these of the stamps `due` that have one; None for too few."""
    if len(due) < FEWEST_TRUTH_SAMPLES:
        return None
    at = match(due, true.stamps_ns, true.velocity, true.position, period)
    good = np.isfinite(at.velocity)
    stamps, velocity, plain = due[at.rows[good]], at.velocity[good], None
    if moved is not None and moved.vibrates:
        plain = match(due, true.stamps_ns, moved.plain[moved.firm], true.position, period).velocity
        plain = plain[good]
    if len(stamps) < FEWEST_TRUTH_SAMPLES:
        return None
    time = (stamps - stamps[0]) * 1e-9
    width = averaged(time)
    smooth = np.convolve(velocity, np.ones(width) / width, 'valid')
    turns = slopes(time[: len(smooth)], smooth) if len(smooth) > 2 else np.zeros(1)
    return JointTruth(stamps, velocity, float(np.sqrt(np.mean(turns**2))), plain)
