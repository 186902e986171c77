# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The truth in a bag, or the off-line smoother if there is none."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import (
    ESTIMATE_SUFFIXES,
    USUAL_MEASUREMENT,
    a_number,
    measured_topics,
)
from estimator_pkg.bags.series import Series, joint_series, why_none
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.checks.joint import FEWEST_READINGS, checked, stretch, usable
from estimator_pkg.evaluation.checks.joint import reference as reference_of
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.compare.sources import (
    TRUE_SAMPLES,
    has_true_samples,
    of_samples,
    source_of_stamps,
    without_truth,
)
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.options import SMOOTHER, TRUTH, Options
from estimator_pkg.evaluation.ranking.ranking import SKIP_PART, SKIPPED
from estimator_pkg.evaluation.reference import reference
from estimator_pkg.evaluation.reference.back_emf import of_angles
from estimator_pkg.evaluation.reference.late import LEAST_LAG, common_lag, confirmed
from estimator_pkg.evaluation.reference.motion import ReferenceMotion, motion
from estimator_pkg.evaluation.reference.reference import Reference
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.progress import progress
from estimator_pkg.streams.angle import AngleSettings
from estimator_pkg.streams.contract import HEADER
from estimator_pkg.streams.drive import ELECTRICAL, DriveStream

LAG_SEEN = 2.0  # a lag or bias is corrected above this many standard deviations
OFFLINE_SMOOTHER = 'the off-line smoother'
SHIFTED_NOTE = 'it is shifted by that (--no-correct-reference keeps it)'


@dataclass
class Truth:
    """The reference velocities by joint.

    name : the topic, or `OFFLINE_SMOOTHER`.
    series : positions and velocities.
    references : quality of each.
    corrected : lag and bias that were removed.
    motions : what the off-line smoother found, None for too few readings; empty if the bag has a
        truth.
    faults : why nothing is recommended for a joint: what its readings must be mended of first.
    caveats : on the part of a joint's record by which it is judged, or on its readings.
    parts : that part, if it is not the whole record: first and last stamp [ns].
    notes : what the user must know of it.
    """

    name: str
    series: dict[str, Series]
    references: dict[str, Reference]
    corrected: dict[str, dict[str, float]] = field(default_factory=dict)
    motions: dict[str, ReferenceMotion | None] = field(default_factory=dict)
    faults: dict[str, str] = field(default_factory=dict)
    caveats: dict[str, str] = field(default_factory=dict)
    parts: dict[str, tuple[int, int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def smoothed(self) -> dict[str, Smoothed]:
        """Results of the smoother by joint."""
        return {joint: each.smoothed for joint, each in self.motions.items() if each is not None}


def truth(bag: Bag, path: str, measurement: dict[str, Series], options: Options) -> Truth:
    """Return the truth of the bag, or the reference computed from its measurement.

    Raises
    ------
    UserError : neither truth nor measurement, a truth without velocity, or a requested topic does
        not exist.
    """
    if options.truth is not None:
        bag.require(options.truth, (TYPE,))
    if without_truth(bag, options) and (measurement or options.reference == SMOOTHER):
        return from_smoother(path, measurement, options)
    return _from_topic(bag, path, measurement, options)


def _from_topic(bag: Bag, path: str, measurement: dict[str, Series], options: Options) -> Truth:
    bag.check_messages()
    topic = options.truth or TRUTH
    if options.truth is None and topic not in bag.topics:
        raise UserError(f'{path}: {_no_truth(bag, path, measurement, options)}')
    bag.require(topic, (TYPE,))
    series = joint_series(bag, topic)
    if has_true_samples(bag, options):
        series = of_samples(bag, TRUE_SAMPLES, series)
        topic = f'{topic} and {TRUE_SAMPLES}'
    series = {joint: _kept(each, np.isfinite(each.velocity)) for joint, each in series.items()}
    series = {joint: each for joint, each in series.items() if len(each.stamps_ns)}
    if not series:
        raise UserError(f'{path}: {topic} has no velocities: name another topic with --truth')
    if not any((each.stamps_ns > 0).any() for each in series.values()):
        raise UserError(
            f"{path}: {topic} has no stamps: compare with an off-line reference, '--reference "
            "smoother', or name another topic with --truth"
        )
    found = Truth(topic, series, {})
    for joint, each in series.items():
        known = _reference(each, measurement.get(joint), options.period(joint))
        found.references[joint] = known
        if options.correct_reference:
            series[joint], found.corrected[joint] = _correct(each, known)
            lag = found.corrected[joint]['lag_s']
            if abs(lag) > LEAST_LAG:
                way = 'later' if lag > 0.0 else 'earlier'
                found.notes += (
                    f'{joint}: the truth is {abs(lag) * 1e3:.2f} ms {way} than the positions: '
                    f'{SHIFTED_NOTE}',
                )
    if options.correct_reference is None:
        _shift(found, measurement, options)
    return found


def _no_truth(bag: Bag, path: str, measurement: dict[str, Series], options: Options) -> str:
    """Return what to do about a bag without a truth."""
    if not options.observers and DriveStream.recognises(bag.topics.__contains__, False):
        return (
            'a drive without truth: add --observer pmsm and its motor data (--params FILE), or try '
            f"'velocity_estimator doctor {path}'"
        )
    why = f'no truth: there is no topic {TRUTH}'
    if not measurement and USUAL_MEASUREMENT in measured_topics(bag):
        why += f', and {why_none(bag, USUAL_MEASUREMENT)}'
    others = [
        name
        for name, topic in bag.topics.items()
        if topic.type == TYPE and not name.endswith(ESTIMATE_SUFFIXES)
    ]
    return (
        f'{why}; name another JointState with velocities with --truth (here: {listed(others)}), or '
        f'a measurement for an off-line reference with --measurement or --angle {a_number(bag)}'
    )


def _shift(found: Truth, measurement: dict[str, Series], options: Options) -> None:
    """Remove the lag of a truth that is certainly late."""
    late = common_lag(found.references)
    if late is None:
        return
    lags = {joint: each for joint, each in found.references.items() if np.isfinite(each.lag_s)}
    surest = min(lags, key=lambda joint: lags[joint].lag_stddev)
    if not confirmed(late, found.series[surest], measurement[surest], options.period(surest)):
        return
    for joint, each in found.series.items():
        found.series[joint] = each._replace(stamps_ns=each.stamps_ns - round(late.lag * 1e9))
        found.corrected[joint] = {'lag_s': late.lag, 'bias': 0.0}
    of = f'on {", ".join(lags)}' if len(lags) < 4 else f'on {len(lags)} joints'
    found.notes = (
        f'the truth is {late.lag * 1e3:.2f} +- {late.stddev * 1e3:.2f} ms later than the positions '
        f'{of}: {SHIFTED_NOTE}',
    )


def from_smoother(path: str, measurement: dict[str, Series], options: Options) -> Truth:
    """Return the off-line reference of measured positions by joint; raise UserError."""
    if not measurement:
        raise UserError(
            f'{path}: no measured positions for an off-line reference: name them with '
            '--measurement or --angle'
        )
    found = Truth(OFFLINE_SMOOTHER, {}, {})
    steps = len(measurement) if len(measurement) > 1 else None
    with progress(f'{path}: reference', steps) as advance:
        for joint, whole in measurement.items():
            start = int(np.min(whole.stamps_ns[whole.stamps_ns > 0], initial=2**62))
            each = _kept(whole, options.within(whole.stamps_ns, start))
            if joint.endswith(ELECTRICAL):
                moved = motion(each.stamps_ns, each.position, 0.0)
                moved = None if moved is None else of_angles(moved)
            else:
                moved = _examined(found, joint, each, options.period(joint), start)
            if moved is not None and options.motion_hz is not None:
                moved = moved.below(options.motion_hz)
            found.motions[joint] = moved
            advance(1)
            if moved is None:
                continue
            firm = moved.firm
            nothing = np.full(int(np.count_nonzero(firm)), np.nan)
            found.series[joint] = Series(
                moved.stamps[firm], moved.position[firm], moved.velocity[firm], nothing
            )
            found.references[joint] = reference.from_smoother(moved.uncertainty)
    if not any((each.stamps_ns > 0).any() for each in measurement.values()):
        by_header = HEADER in (set(map(source_of_stamps, options.observers)) or {HEADER})
        remedy = 'use --set stamp_source=publisher' if by_header else 'the bag has no times'
        raise UserError(f'{path}: no truth, and readings without a stamp: {remedy}')
    return found


def _examined(
    found: Truth, joint: str, measurement: Series, period: float, start: int
) -> ReferenceMotion | None:
    """Return the motion of a joint as `doctor` sees it: between jumps, and its faults noted."""
    stamps, position = measurement.stamps_ns, measurement.position
    seen = Readings(joint, stamps, stamps, position, measurement.velocity, period, start)
    part, said = usable(seen, checked(seen) if len(seen.rows) >= FEWEST_READINGS else [])
    if part is None:
        found.faults[joint], part = said, seen
    elif said:
        found.caveats[joint] = said
    if part is seen and not np.any(seen.leaps):
        return motion(stamps, position, period)
    rows = np.sort(stretch(part, len(part.rows)))
    moved = reference_of(part, rows)
    if part is not seen:
        found.parts[joint] = int(part.stamps_ns[rows[0]]), int(part.stamps_ns[rows[-1]])
    if moved is not None:
        begin, end = part.when(rows[[0, -1]])
        found.notes += (f'{joint}: compared from {begin:.2f} to {end:.2f} s, between its jumps',)
        if part.stamps_ns[rows[0]] != seen.stamps_ns[np.min(seen.rows)]:
            elapsed = moved.time - moved.time[0]  # after a jump the observers settle first
            calm = elapsed >= min(SKIPPED, SKIP_PART * elapsed[-1])
            moved = replace(moved, firm=moved.firm & calm)
    return moved


def _reference(truth: Series, measurement: Series | None, period: float) -> Reference:
    """Return the quality of a truth against the measured position, or its noise only."""
    if measurement is None:
        alone = match(truth.stamps_ns, truth.stamps_ns, truth.velocity, truth.velocity, 0.0)
        return reference.noise_only(alone.time, alone.velocity, truth.position[alone.rows], period)
    good = np.isfinite(measurement.position)
    position = measurement.position[good]
    at = match(truth.stamps_ns, measurement.stamps_ns[good], position, position, period)
    return reference.fit(
        at.time, truth.velocity[at.rows], at.position, period, truth.position[at.rows]
    )


def measured_truth(truth: Series, measurement: Series, period: float) -> tuple[Series, float]:
    """Return a measured velocity without its fitted lag and bias, and the rms of its noise."""
    truth = _kept(truth, np.isfinite(truth.velocity))
    known = _reference(truth, measurement, period)
    return _correct(truth, known)[0], known.noise


def _kept(series: Series, rows: NDArray[np.bool_]) -> Series:
    return Series._make(values[rows] for values in series)


def _correct(truth: Series, known: Reference) -> tuple[Series, dict[str, float]]:
    """Return the truth without the fitted lag and bias, and the removed values."""
    lag = known.lag_s if abs(known.lag_s) > LAG_SEEN * known.lag_stddev else 0.0
    bias = known.bias if abs(known.bias) > LAG_SEEN * known.bias_stddev else 0.0
    series = truth._replace(
        stamps_ns=truth.stamps_ns - round(lag * 1e9), velocity=truth.velocity - bias
    )
    return series, {'lag_s': lag, 'bias': bias}


def check_common(path: str, source: str, joints: Iterable[str], true: Truth) -> None:
    """Raise UserError if the truth has none of these joints."""
    if set(joints) & (set(true.series) | set(true.motions)):
        return
    hint = ''
    if list(joints) == [AngleSettings.angle_joint] and len(true.series) == 1:
        hint = f': --set angle_joint={next(iter(true.series))} gives the number that name'
    raise UserError(
        f'{path}: {source} has the joints {listed(joints)}, {true.name} has '
        f'{listed(true.series)}: none in common{hint}'
    )


def listed(names: Iterable[str]) -> str:
    """Return names in one line."""
    return ', '.join(name or "''" for name in sorted(names)) or 'none'
