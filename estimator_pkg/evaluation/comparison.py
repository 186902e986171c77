"""One bag's estimates held against its truth: recorded estimates, or observers run on the spot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags.reader import Bag, open_bag
from estimator_pkg.bags.series import Series, joint_series
from estimator_pkg.driver.guard import DUPLICATE
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation import metrics, reference
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.matching import match
from estimator_pkg.evaluation.reference import Reference
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.observers.contract import COASTING, TRACKING
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

MEASUREMENT = '/joint_states'
TRUTH = '/ground_truth/joint_states'
ESTIMATE = 'estimate'       # last part of an estimate topic's name
COUNTER = Entry('', 'finite_difference')  # its guard counts the samples of recorded estimates
LAG_SEEN = 2.0              # a lag or bias is corrected if it is so many standard deviations


@dataclass(frozen=True)
class Options:
    """What is compared, and how.

    measurement, truth : topics; None: the usual ones.
    estimates : topics; empty: every JointState whose name ends in '/estimate'.
    observers : run these on the measurement, in place of recorded estimates.
    skip : seconds left out at the beginning.
    wrap_period : of the positions [rad]; 0: none.
    correct_reference : take the reference's own lag and bias off before it is compared with.
    """

    measurement: str | None = None
    truth: str | None = None
    estimates: tuple[str, ...] = ()
    observers: tuple[Entry, ...] = ()
    skip: float = 0.0
    wrap_period: float = 2.0 * np.pi
    correct_reference: bool = False


class Estimate(NamedTuple):
    """One joint's estimates, those that were published, and what became of its samples."""

    stamps: NDArray[np.int64]
    position: Array
    velocity: Array
    samples: dict[str, Any]


@dataclass(frozen=True)
class Row:
    """One estimate of one joint, compared.

    time : shape (m,) [s]; truth, estimate : shape (m,), velocities at these times.
    reference_cannot_tell : the error is no larger than the reference's own noise.
    """

    source: str
    joint: str
    velocity: dict[str, Any]
    position: dict[str, Any]
    samples: dict[str, Any]
    matched: dict[str, int]
    reference_cannot_tell: bool
    time: Array
    truth: Array
    estimate: Array

    def as_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return {'velocity': self.velocity, 'position': self.position, 'samples': self.samples,
                'matched': self.matched, 'reference_cannot_tell': self.reference_cannot_tell}


@dataclass(frozen=True)
class Comparison:
    """What one bag gives: rows, and what is known of the reference of each joint."""

    bag: str
    truth: str
    rows: tuple[Row, ...]
    references: dict[str, Reference]
    corrected: dict[str, dict[str, float]]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        estimates: dict[str, Any] = {}
        for row in self.rows:
            estimates.setdefault(row.source, {'joints': {}})['joints'][row.joint] = row.as_dict()
        return {'truth': self.truth, 'estimates': estimates,
                'reference': {joint: {**known.as_dict(),
                                      'corrected': self.corrected.get(joint, {})}
                              for joint, known in self.references.items()},
                'notes': list(self.notes)}


def compare(path: str, options: Options) -> Comparison:
    """Everything that can be said of the estimates in the bag at `path`.

    Raises
    ------
    UserError : no truth, no estimates, no joint in common, no overlap in time; one line each, with
        what there is instead.
    """
    with open_bag(path) as bag:
        topic = _truth_topic(bag, path, options.truth)
        measurement = _measurement(bag, options)
        truths = {joint: _finite(series) for joint, series in joint_series(bag, topic).items()}
        truths = {joint: series for joint, series in truths.items() if len(series.stamps_ns)}
        if not truths:
            raise UserError(f'{path}: {topic} carries no velocity')
        references, corrected = {}, {}
        for joint, series in truths.items():
            references[joint] = _reference(series, measurement.get(joint), options.wrap_period)
            if options.correct_reference:
                truths[joint], corrected[joint] = _correct(series, references[joint])
        rows: list[Row] = []
        notes: list[str] = []
        for source, estimates in _sources(bag, path, measurement, options):
            if not set(estimates) & set(truths):
                raise UserError(f'{path}: {source} has the joints {_list(estimates)}, {topic} has '
                                f'{_list(truths)}: none in common')
            for joint, estimate in estimates.items():
                if joint not in truths:
                    notes.append(f"{source}: joint '{joint}' has no truth")
                elif not len(estimate.stamps):
                    notes.append(f"{source}: joint '{joint}' has no valid estimate")
                else:
                    try:
                        rows.append(_row(source, joint, estimate, truths[joint],
                                         _start(measurement.get(joint, truths[joint])),
                                         references[joint], options))
                    except UserError as error:
                        raise UserError(f"{path}: {source}, joint '{joint}': {error}") from None
        if not rows:
            raise UserError(f'{path}: nothing to compare: ' + '; '.join(notes))
    return Comparison(path, topic, tuple(rows), references, corrected, tuple(notes))


def _truth_topic(bag: Bag, path: str, asked: str | None) -> str:
    if asked is not None:
        bag.require(asked, (TYPE,))
        return asked
    if TRUTH not in bag.topics:
        raise UserError(f'{path}: no truth: there is no topic {TRUTH}; name another JointState '
                        f'that carries velocities with --truth ({_joint_state_topics(bag)})')
    bag.require(TRUTH, (TYPE,))
    return TRUTH


def _measurement(bag: Bag, options: Options) -> dict[str, Series]:
    """The measured positions by joint; none where nobody asked and there is no usual topic."""
    topic = options.measurement or MEASUREMENT
    if options.measurement or options.observers:
        bag.require(topic, (TYPE,))
    elif topic not in bag.topics or bag.topics[topic].type != TYPE:
        return {}
    return {joint: series for joint, series in joint_series(bag, topic).items()
            if np.isfinite(series.position).any()}


def _sources(bag: Bag, path: str, measurement: dict[str, Series], options: Options
             ) -> Iterator[tuple[str, dict[str, Estimate]]]:
    """(name, estimates by joint) of everything that is to be compared."""
    if options.observers:
        if not measurement:
            raise UserError(f'{path}: {options.measurement or MEASUREMENT} carries no position')
        with progress(path, len(options.observers) * len(measurement)) as advance:
            for entry in options.observers:
                found = {}
                for joint, series in measurement.items():
                    found[joint] = _run(entry, series, options.wrap_period)
                    advance(1)
                yield entry.label, found
        if not options.estimates:
            return
    topics = list(options.estimates) or sorted(
        name for name, topic in bag.topics.items()
        if topic.type == TYPE and name.rpartition('/')[2] == ESTIMATE)
    if not topics:
        raise UserError(f"{path}: no estimates (no JointState topic '.../{ESTIMATE}'): make them "
                        "with 'velocity_estimator replay', or compare observers on the measurement "
                        "with '--observer all'")
    for topic in topics:
        bag.require(topic, (TYPE,))
        yield topic, {joint: Estimate(series.stamps_ns, series.position, series.velocity,
                                      _samples(series, measurement.get(joint)))
                      for joint, series in joint_series(bag, topic).items()}


def _run(entry: Entry, measurement: Series, wrap_period: float) -> Estimate:
    """What this observer publishes for this measurement."""
    joint = entry.joint(wrap_period=wrap_period)
    out = joint.run(measurement.stamps_ns, measurement.position)
    valid = (out.verdict < DUPLICATE) & ((out.status == TRACKING) | (out.status == COASTING))
    return Estimate(measurement.stamps_ns[valid], out.position[valid], out.velocity[valid],
                    _counts(joint))


def _samples(estimates: Series, measurement: Series | None) -> dict[str, Any]:
    """What the guard says of the samples in the bag; of the estimates alone where there are none.

    Which samples are dropped does not depend on the observer, unless it was misconfigured.
    """
    if measurement is None:
        count = len(estimates.stamps_ns)
        return {'received': count, 'used': count, 'dropped': {}}
    joint = COUNTER.joint()
    joint.run(measurement.stamps_ns, measurement.position)
    return _counts(joint)


def _counts(joint: Joint) -> dict[str, Any]:
    return {'received': joint.received, 'used': joint.used, 'dropped': joint.dropped()}


def _row(source: str, joint: str, estimate: Estimate, truth: Series, start: int,
         known: Reference, options: Options) -> Row:
    matched = match(estimate.stamps, truth.stamps_ns, truth.velocity, truth.position,
                    options.wrap_period)
    if not len(matched.rows):
        raise UserError(f'estimates ({_span(estimate.stamps)}) and truth ({_span(truth.stamps_ns)})'
                        ' do not overlap in time')
    elapsed = matched.time + (int(estimate.stamps[matched.rows[0]]) - start) * 1e-9
    kept = elapsed >= options.skip
    if not kept.any():
        raise UserError(f'nothing is left after the first {options.skip:g} s')
    rows, time, true = matched.rows[kept], matched.time[kept], matched.velocity[kept]
    velocity = estimate.velocity[rows]
    speeds = metrics.velocity(time, velocity, true,
                              known.noise if np.isfinite(known.noise) else 0.0)
    angles = metrics.position(time, estimate.position[rows], matched.position[kept],
                              options.wrap_period)
    counts = {'estimates': len(estimate.stamps), 'compared': len(rows),
              'interpolated': len(matched.rows) - matched.exact, 'unmatched': matched.unmatched}
    return Row(source, joint, speeds, angles, estimate.samples, counts,
               known.cannot_tell(speeds['rms']), elapsed[kept], true, velocity)


def _reference(truth: Series, measurement: Series | None, period: float) -> Reference:
    """The truth's own lag, bias and noise against the measured position; without one, its noise."""
    if measurement is None:
        alone = match(truth.stamps_ns, truth.stamps_ns, truth.velocity, truth.velocity, 0.0)
        nan = np.nan
        return Reference(nan, nan, nan, nan, nan, nan,
                         reference.noise(alone.time, alone.velocity), nan)
    good = np.isfinite(measurement.position)
    position = measurement.position[good]
    at = match(truth.stamps_ns, measurement.stamps_ns[good], position, position, period)
    return reference.fit(at.time, truth.velocity[at.rows], at.position, period)


def _correct(truth: Series, known: Reference) -> tuple[Series, dict[str, float]]:
    """The truth without the lag and bias that were found, and what was taken off."""
    lag = known.lag_s if abs(known.lag_s) > LAG_SEEN * known.lag_stddev else 0.0
    bias = known.bias if abs(known.bias) > LAG_SEEN * known.bias_stddev else 0.0
    series = truth._replace(stamps_ns=truth.stamps_ns - round(lag * 1e9),
                            velocity=truth.velocity - bias)
    return series, {'lag_s': lag, 'bias': bias}


def _finite(series: Series) -> Series:
    """Only the rows that carry a velocity."""
    good = np.isfinite(series.velocity)
    return Series(series.stamps_ns[good], series.position[good], series.velocity[good],
                  series.effort[good])


def _start(series: Series) -> int:
    """The first stamp that is one [ns]."""
    good = series.stamps_ns[series.stamps_ns > 0]
    return int(good[0]) if len(good) else 0


def _span(stamps: NDArray[np.int64]) -> str:
    return f'{np.min(stamps) * 1e-9:.3f} to {np.max(stamps) * 1e-9:.3f} s'


def _list(names: Iterable[str]) -> str:
    return ', '.join(sorted(names)) or 'none'


def _joint_state_topics(bag: Bag) -> str:
    names = [name for name, topic in bag.topics.items() if topic.type == TYPE]
    return f'here: {_list(names)}' if names else 'here: no JointState at all'
