# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare one bag's estimates with its truth: recorded estimates, or observers run now."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
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
    source_of_stamps,
    sources,
)
from estimator_pkg.evaluation.compare.truth import Truth, check_common, truth
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.options import Options
from estimator_pkg.evaluation.ranking.ranking import at_reference, rank
from estimator_pkg.evaluation.ranking.verdict import Verdict
from estimator_pkg.evaluation.reference.reference import Reference
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed
from estimator_pkg.observers import DEFAULT
from estimator_pkg.progress import progress
from estimator_pkg.sensor.guard import why_dropped
from estimator_pkg.streams.contract import stamp_remedy
from estimator_pkg.streams.drive import ELECTRICAL

Array = NDArray[np.float64]

SIGMAS_95 = 1.96  # the 95 % interval of a normal distribution [standard deviations]
ZERO_BELOW = 1e-10  # smaller values count as zero [s], [rad/s]


@dataclass(frozen=True)
class Row:
    """The comparison of one joint's estimates.

    validity : seconds by status, or published and withheld.
    coverage : fraction of the errors within the 95 % interval, widened by the reference's own
        noise; nan without a standard deviation.
    reference_cannot_tell : the error is below the reference's own error.
    reference_noise : the reference's own error [rad/s].
    time : shape (m,) [s]; truth, estimate, stddev : shape (m,), velocities at these times [rad/s].
    status_time, status : shape (k,), of every used sample; empty if it is not known.
    """

    source: str
    joint: str
    velocity: dict[str, Any]
    position: dict[str, Any]
    samples: dict[str, Any]
    matched: dict[str, int]
    validity: dict[str, float]
    coverage: float
    reference_cannot_tell: bool
    time: Array
    truth: Array
    estimate: Array
    stddev: Array
    reference_noise: float
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


@dataclass(frozen=True)
class Comparison:
    """The result of one bag: rows, and the quality of each joint's reference.

    measurement : the measured positions by joint; starts : their first stamps [ns].
    smoothed : results of the off-line smoother; empty if the bag has a truth.
    verdicts : the ranking without truth, by joint; empty if the bag has a truth.
    """

    bag: str
    truth: str
    rows: tuple[Row, ...]
    references: dict[str, Reference]
    corrected: dict[str, dict[str, float]]
    notes: tuple[str, ...]
    measurement: dict[str, Series]
    starts: dict[str, int]
    smoothed: dict[str, Smoothed]
    verdicts: dict[str, Verdict]

    @property
    def refused(self) -> dict[str, str]:
        """Why estimates cannot be ranked, by joint."""
        return {
            joint: f'{joint}: {verdict.sentences()[0]}'
            for joint, verdict in self.verdicts.items()
            if not verdict.best
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison for ``--json``."""
        estimates: dict[str, Any] = {}
        for row in self.rows:
            estimates.setdefault(row.source, {'joints': {}})['joints'][row.joint] = row.as_dict()
        return {
            'truth': self.truth,
            'estimates': estimates,
            'reference': {
                joint: {
                    **known.as_dict(),
                    'corrected': self.corrected.get(joint, {}),
                    'smoother': _smoother(self.smoothed.get(joint)),
                }
                for joint, known in self.references.items()
            },
            'verdict': {joint: each.as_dict() for joint, each in self.verdicts.items()},
            'refused': self.refused,
            'notes': list(self.notes),
        }


def compare(path: str, options: Options) -> Comparison:
    """Compare all estimates in the bag at `path`.

    Raises
    ------
    UserError : no truth, no estimates, no joint in common, no overlap in time; the message has one
        line and names the alternatives.
    """
    with open_bag(path, options.unpack_limit, options.columns) as bag:
        with progress(f'{path}: reading', None):
            measurement = measured(bag, options)
        true = truth(bag, path, measurement, options)
        count = len(options.observers) + len(options.estimates)
        return compared(
            path,
            measurement,
            true,
            sources(bag, path, measurement, options),
            options,
            count * (1 + len(measurement)) or None,
        )


def compared(
    path: str,
    measurement: dict[str, Series],
    true: Truth,
    found: Iterable[tuple[str, dict[str, EstimateSeries]]],
    options: Options,
    steps: int | None = None,
) -> Comparison:
    """Compare estimates that are in memory, for a page or a ranking.

    Parameters
    ----------
    path : name of the record.
    measurement : measured positions by joint.
    true : the truth, or the off-line reference (`truth.from_smoother`).
    found : (name of the source, estimates by joint).
    steps : number of sources, each with one more than their joints, for the progress bar.

    Raises
    ------
    UserError : no joint in common, no overlap in time.
    """
    rows: list[Row] = []
    some = False  # an estimate, of any joint
    notes = list(true.notes)
    starts = {joint: _start(series) for joint, series in {**true.series, **measurement}.items()}
    candidates: dict[str, dict[str, Array]] = {joint: {} for joint in true.motions}
    clocks = {entry.label: source_of_stamps(entry) for entry in options.observers}
    with progress(path, steps) as advance:
        for source, estimates in found:
            advance(1)
            check_common(path, source, estimates, true)
            for joint, estimate in estimates.items():
                advance(1)
                moved = true.motions.get(joint)
                if moved is not None and len(estimate.stamps):
                    velocity = at_reference(moved, estimate.stamps, estimate.velocity)
                    candidates[joint][source] = velocity
                some = some or len(estimate.stamps) > 0
                known = joint in true.series or {joint, joint + ELECTRICAL} & set(true.motions)
                if len(estimate.stamps) and known and joint not in true.series:
                    continue
                if not known:
                    notes.append(f"joint '{joint}' has no truth")
                elif not len(estimate.stamps):
                    samples, remedy = estimate.samples, stamp_remedy(clocks.get(source, ''))
                    why = why_dropped(samples['received'], samples['dropped'], remedy)
                    notes.append(
                        f"{source}: joint '{joint}' has no valid estimate{why and f' ({why})'}"
                    )
                else:
                    try:
                        rows.append(
                            _row(
                                source,
                                joint,
                                estimate,
                                true.series[joint],
                                starts[joint],
                                true.references[joint],
                                options,
                            )
                        )
                    except UserError as error:
                        raise UserError(f"{path}: {source}, joint '{joint}': {error}") from None
    if not rows and not (some and true.motions):
        raise UserError(f'{path}: nothing to compare: ' + '; '.join(dict.fromkeys(notes)))
    return Comparison(
        path,
        true.name,
        tuple(rows),
        true.references,
        true.corrected,
        tuple(dict.fromkeys(notes)),
        measurement,
        starts,
        true.smoothed,
        {
            joint: Verdict(cautions=(), why=true.faults[joint], tunable=False)
            if joint in true.faults
            else _cautioned(
                rank(candidates[joint], moved, DEFAULT, skip=0.0 if options.begin else None),
                true.caveats.get(joint, ''),
            )
            for joint, moved in true.motions.items()
        },
    )


def _row(
    source: str,
    joint: str,
    estimate: EstimateSeries,
    truth: Series,
    start: int,
    known: Reference,
    options: Options,
) -> Row:
    matched = match(
        estimate.stamps, truth.stamps_ns, truth.velocity, truth.position, options.period(joint)
    )
    if not len(matched.rows):
        raise UserError(
            f'estimates ({_span(estimate.stamps)}) and truth ({_span(truth.stamps_ns)}) do not '
            'overlap in time: check their stamps'
        )
    elapsed = matched.time + (int(estimate.stamps[matched.rows[0]]) - start) * 1e-9
    kept = options.within(np.rint(1e9 * elapsed).astype(np.int64), 0)
    rows, time, true = matched.rows[kept], matched.time[kept], matched.velocity[kept]
    velocity, stddev = estimate.velocity[rows], estimate.velocity_stddev[rows]
    if np.isinf(stddev).any():  # not known: no band, no coverage
        stddev = np.where(np.isinf(stddev), np.nan, stddev)
    noise = known.noise if np.isfinite(known.noise) else 0.0
    speeds = metrics.velocity(time, velocity, true, noise)
    angles = metrics.position(
        time, estimate.position[rows], matched.position[kept], options.period(joint)
    )
    counts = {
        'estimates': len(estimate.stamps),
        'compared': len(rows),
        'interpolated': len(matched.rows) - matched.exact,
        'unmatched': matched.unmatched,
    }
    return Row(
        source,
        joint,
        speeds,
        angles,
        estimate.samples,
        counts,
        estimate.validity,
        coverage(velocity - true, np.hypot(stddev, noise)),
        known.cannot_tell(speeds['rms']),
        elapsed[kept],
        true,
        velocity,
        stddev,
        noise,
        (estimate.status_stamps - start) * 1e-9,
        estimate.status,
    )


def _cautioned(verdict: Verdict, caveat: str) -> Verdict:
    """Return the verdict with one more caution, the most important; '': none."""
    return replace(verdict, cautions=(caveat, *verdict.cautions)) if caveat else verdict


def coverage(errors: Array, stddev: Array) -> float:
    """Return the fraction of the errors, shape (n,), within 1.96 stddev; nan if none is known."""
    known = np.isfinite(errors) & np.isfinite(stddev)
    if not known.any():
        return np.nan
    return float(np.mean(np.abs(errors[known]) <= SIGMAS_95 * stddev[known]))


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


def _start(series: Series) -> int:
    """Return the first valid stamp [ns]."""
    good = series.stamps_ns[series.stamps_ns > 0]
    return int(good[0]) if len(good) else 0


def _span(stamps: NDArray[np.int64]) -> str:
    return f'{np.min(stamps) * 1e-9:.3f} to {np.max(stamps) * 1e-9:.3f} s'
