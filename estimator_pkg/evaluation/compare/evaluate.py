# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare one bag's estimates with its truth: recorded estimates, or observers run now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import open_bag
from estimator_pkg.bags.series import Series
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.compare import metrics
from estimator_pkg.evaluation.compare.sources import (
    EstimateSeries,
    measured,
    recording,
    source_of_stamps,
    sources,
)
from estimator_pkg.evaluation.compare.truth import Truth, check_common, truth
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.ranking.ranking import at_reference, rank
from estimator_pkg.evaluation.ranking.verdict import Verdict
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed
from estimator_pkg.observers import DEFAULT
from estimator_pkg.progress import progress
from estimator_pkg.sensor.guard import why_dropped
from estimator_pkg.streams.contract import stamp_remedy
from estimator_pkg.streams.drive import ELECTRICAL

Array = NDArray[np.float64]

RAW = Entry('finite_difference', 'finite_difference')  # what most users have today


@dataclass(frozen=True)
class Row:
    """The comparison of one joint's estimates.

    source : topic, or label of the observer.
    time : shape (m,) [s]; truth, estimate, stddev : shape (m,), velocities at these times [rad/s].
    velocity, position : see `metrics`. samples : of the measurement, by the guard. matched : number
        of estimates by what truth they have.
    validity : seconds by status, or published and withheld.
    coverage : fraction of the errors within the 95 % interval, widened by the reference's own
        noise; nan without a standard deviation.
    reference_cannot_tell : the error is below the reference's own error.
    status_time, status : shape (k,), of every used sample; empty if it is not known.
    """

    source: str
    joint: str
    time: Array
    truth: Array
    estimate: Array
    stddev: Array
    velocity: dict[str, Any]
    position: dict[str, Any]
    samples: dict[str, Any]
    matched: dict[str, int]
    validity: dict[str, float]
    coverage: float
    reference_cannot_tell: bool
    status_time: NDArray[np.floating]
    status: NDArray[np.int8]

    def as_dict(self) -> dict[str, Any]:
        """Return the row for ``--json``."""
        return {
            'velocity': self.velocity,
            'position': self.position,
            'samples': self.samples,
            'matched': self.matched,
            'validity_s': self.validity,
            'coverage_95': self.coverage,
            'reference_cannot_tell': self.reference_cannot_tell,
        }


@dataclass
class Comparison:
    """The result of one bag.

    truth : the reference velocities and their quality.
    measurement : the measured positions by joint.
    rows : of the estimates. raw : of the finite difference, by joint, if it is requested.
    verdicts : the ranking without truth, by joint; empty if the bag has a truth.
    """

    bag: str
    truth: Truth
    measurement: dict[str, Series]
    rows: list[Row] = field(default_factory=list)
    raw: dict[str, Row] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    verdicts: dict[str, Verdict] = field(default_factory=dict)

    @property
    def refused(self) -> dict[str, str]:
        """Why estimates cannot be ranked, by joint."""
        return {
            joint: f'{joint}: {verdict.sentences()[0]}'
            for joint, verdict in self.verdicts.items()
            if not verdict.best
        }

    def start(self, joint: str) -> int:
        """Return the first valid stamp [ns], which is time zero."""
        stamps = (self.measurement.get(joint) or self.truth.series[joint]).stamps_ns
        return int(next(iter(stamps[stamps > 0]), 0))

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison for ``--json``."""
        estimates: dict[str, Any] = {}
        for row in self.rows:
            estimates.setdefault(row.source, {'joints': {}})['joints'][row.joint] = row.as_dict()
        return {
            'truth': self.truth.name,
            'estimates': estimates,
            'reference': {
                joint: {
                    **known.as_dict(),
                    'corrected': self.truth.corrected.get(joint, {}),
                    'smoother': _smoother(self.truth.smoothed.get(joint)),
                }
                for joint, known in self.truth.references.items()
            },
            'verdict': {joint: each.as_dict() for joint, each in self.verdicts.items()},
            'refused': self.refused,
            'notes': self.notes,
        }


def evaluate(path: str, options: Options, with_raw: bool = False) -> Comparison:
    """Compare all estimates in the bag at `path`.

    Parameters
    ----------
    with_raw : compare the finite difference at its default, too, as `Comparison.raw`.

    Raises
    ------
    UserError : no truth, no estimates, no joint in common, no overlap in time; the message has one
        line and names the alternatives.
    """
    with open_bag(path, options.unpack_limit, options.columns) as bag:
        with progress(f'{path}: reading', None):
            measurement = measured(bag, options)
        true = truth(bag, path, measurement, options)
        found = Comparison(path, true, measurement)
        estimates: dict[str, dict[str, EstimateSeries]] = {}
        with progress(path, len(options.observers) + len(options.estimates) or None) as advance:
            for source, by_joint in sources(bag, path, measurement, options):
                check_common(path, source, by_joint, true)
                estimates[source] = by_joint
                advance(1)
        if with_raw and measurement:
            try:
                raw = recording(RAW, bag, measurement, options).run(RAW.observer, {})
            except UserError:  # a drive
                raw = {}
            for joint, series in raw.items():
                if joint in true.series and len(series.stamps):
                    found.raw[joint] = _row(found, RAW.label, joint, series, options)
    notes = [*true.notes]
    for source, by_joint in estimates.items():
        for joint, series in by_joint.items():
            known = joint in true.series or {joint, joint + ELECTRICAL} & set(true.motions)
            if not known:
                notes.append(f"joint '{joint}' has no truth")
            elif not len(series.stamps):
                why = _why_none(source, series, options.observers)
                notes.append(f"{source}: joint '{joint}' has no valid estimate{why}")
            elif joint in true.series:
                try:
                    found.rows.append(_row(found, source, joint, series, options))
                except UserError as error:
                    raise UserError(f"{path}: {source}, joint '{joint}': {error}") from None
    found.notes = list(dict.fromkeys(notes))
    some = any(len(each.stamps) for by_joint in estimates.values() for each in by_joint.values())
    if not found.rows and not (some and true.motions):
        raise UserError(f'{path}: nothing to compare: ' + '; '.join(found.notes))
    found.verdicts = {joint: _verdict(joint, true, estimates, options) for joint in true.motions}
    return found


def _why_none(source: str, series: EstimateSeries, observers: Sequence[Entry]) -> str:
    """Return why an observer has no estimate, in parentheses; '' if it is not known."""
    clock = next((source_of_stamps(each) for each in observers if each.label == source), '')
    dropped = series.samples['dropped']
    why = why_dropped(series.samples['received'], dropped, stamp_remedy(clock))
    return why and f' ({why})'


def _verdict(
    joint: str, true: Truth, estimates: dict[str, dict[str, EstimateSeries]], options: Options
) -> Verdict:
    """Return the ranking of a joint's estimates without truth."""
    if joint in true.faults:
        return Verdict(cautions=(), why=true.faults[joint], tunable=False)
    moved = true.motions[joint]
    candidates = {
        source: at_reference(moved, by_joint[joint].stamps, by_joint[joint].velocity)
        for source, by_joint in estimates.items()
        if moved is not None and joint in by_joint and len(by_joint[joint].stamps)
    }
    found = rank(candidates, moved, DEFAULT, skip=0.0 if options.begin else None)
    caveat = true.caveats.get(joint)
    return replace(found, cautions=(caveat, *found.cautions)) if caveat else found


def _row(
    found: Comparison, source: str, joint: str, estimate: EstimateSeries, options: Options
) -> Row:
    """Compare one joint's estimates; raise UserError if they and the truth have no common time."""
    true, known, period = (
        found.truth.series[joint],
        found.truth.references[joint],
        options.period(joint),
    )
    matched = match(estimate.stamps, true.stamps_ns, true.velocity, true.position, period)
    if not len(matched.rows):
        raise UserError(
            f'estimates ({_span(estimate.stamps)}) and truth ({_span(true.stamps_ns)}) do not '
            'overlap in time: check their stamps'
        )
    start = found.start(joint)
    elapsed = matched.time + (int(estimate.stamps[matched.rows[0]]) - start) * 1e-9
    kept = options.within(np.rint(1e9 * elapsed).astype(np.int64), 0)
    rows, time, truth = matched.rows[kept], matched.time[kept], matched.velocity[kept]
    velocity, stddev = estimate.velocity[rows], estimate.velocity_stddev[rows]
    stddev = np.where(np.isinf(stddev), np.nan, stddev)  # not known: no band, no coverage
    noise = known.noise if np.isfinite(known.noise) else 0.0
    speeds = metrics.velocity(time, velocity, truth, noise)
    return Row(
        source,
        joint,
        elapsed[kept],
        truth,
        velocity,
        stddev,
        speeds,
        metrics.position(time, estimate.position[rows], matched.position[kept], period),
        estimate.samples,
        {
            'estimates': len(estimate.stamps),
            'compared': len(rows),
            'interpolated': len(matched.rows) - matched.exact,
            'unmatched': matched.unmatched,
        },
        estimate.validity,
        metrics.coverage(velocity - truth, np.hypot(stddev, noise)),
        known.cannot_tell(speeds['rms']),
        (estimate.status_stamps - start) * 1e-9,
        estimate.status,
    )


def _smoother(found: Smoothed | None) -> dict[str, Any] | None:
    """Return the smoother's result for ``--json``."""
    if found is None:
        return None
    return {
        'uncertainty': found.uncertainty,
        'unexplained': found.unexplained,
        'reading_stddev': found.noise.reading,
        'jerk_intensity': found.noise.jerk,
        'quantum': found.noise.quantum,
        'at_quantisation_floor': found.noise.at_floor,
        'outliers': found.outliers,
    }


def _span(stamps: NDArray[np.int64]) -> str:
    return f'{np.min(stamps) * 1e-9:.3f} to {np.max(stamps) * 1e-9:.3f} s'
