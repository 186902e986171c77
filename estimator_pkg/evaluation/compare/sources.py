# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sources of estimates: recorded topics, or observers run on the recorded measurement.

If a bag has the truth of every sample of a drive, its electrical joint is compared sample by
sample: their batches contain truth and estimate of each. The mechanical joint keeps one state per
batch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import streams
from estimator_pkg.bags import recording as recordings
from estimator_pkg.bags.reader import Bag, UnreadableError
from estimator_pkg.bags.recording import EstimateSeries, Recording
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series, at_stamps, joint_series, positions, with_velocity
from estimator_pkg.bags.wiring import Setup, wired
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import AUTO, ESTIMATE, SMOOTHER, TRUTH, Options
from estimator_pkg.evaluation.reference import back_emf
from estimator_pkg.messages import drive_samples
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.observers import DEFAULT
from estimator_pkg.parameters import declared
from estimator_pkg.streams.angle import AngleSettings
from estimator_pkg.streams.contract import Request
from estimator_pkg.streams.drive import ELECTRICAL, DriveStream

Array = NDArray[np.float64]

COUNTER = Entry('', 'finite_difference')  # its guard counts the samples of recorded estimates
STAMP_SOURCE = 'stamp_source'
TRUE_SAMPLES = '/ground_truth/samples'  # batches of a drive, with the truth of every sample
HELD_STEPS = 5.0  # an estimate counts for the time since the previous one, at most this many steps


def measured(bag: Bag, options: Options) -> dict[str, Series]:
    """Return the measured positions by joint, as the observers use them; {} without any.

    Observers of other measurements can run on a bag without positions.

    Raises
    ------
    UserError, UsageError : a requested topic does not exist, a parameter is wrong, or the observers
        use different clocks.
    """
    clocks = set(map(source_of_stamps, options.observers)) - {''}
    if len(clocks) > 1:  # the observers share a reference
        raise UsageError(
            f"the observers have different '{STAMP_SOURCE}' ({', '.join(sorted(clocks))}): "
            'set one for all with --set'
        )
    chosen = options.observers or ((Entry('', DEFAULT),) if options.angle else ())
    for entry in chosen:
        setup = _setup(entry, bag, options)
        found = recordings.measured(bag, setup)
        if not found and setup.kind == DriveStream.KIND and without_truth(bag, options):
            found = back_emf.measured(bag, setup)
        if found:
            return found
    if options.measurement is not None and not chosen:
        bag.require(options.measurement, (TYPE,))
    with _optional():
        topic = measurement_topic(bag, options.measurement)
        if topic != options.truth:
            found = positions(bag, topic)
            if any((series.stamps_ns > 0).any() for series in found.values()):
                return found
            return positions(bag, topic, by_publisher=True)  # as the estimates must have been
    return {}


@contextmanager
def _optional() -> Iterator[None]:
    """Ignore a topic without values, but not a damaged one."""
    try:
        yield
    except UnreadableError:
        raise
    except UserError:
        pass


def without_truth(bag: Bag, options: Options) -> bool:
    """Return True if there is no truth, or the off-line reference is requested instead."""
    if options.reference == SMOOTHER:
        return True
    return options.reference == AUTO and options.truth is None and TRUTH not in bag.topics


def source_of_stamps(entry: Entry) -> str:
    """Return the `stamp_source` of an observer; '' for families without it."""
    declares = STAMP_SOURCE in declared(streams.of_observer(entry.observer).SETTINGS)
    return dict(entry.values).get(STAMP_SOURCE, AngleSettings.stamp_source) if declares else ''


def _setup(entry: Entry, bag: Bag, options: Options) -> Setup:
    """Return parameters and topics of an observer; raise UserError or UsageError."""
    stream = streams.of_observer(entry.observer)
    period = {'wrap_period': options.wrap_period} if stream.WRAPS else {}
    values = {'observer': entry.observer, **period, **dict(entry.values)}
    return wired(stream, bag, values, Request(options.measurement, options.angle))


def sources(
    bag: Bag, path: str, measurement: Mapping[str, Series], options: Options
) -> Iterator[tuple[str, dict[str, EstimateSeries]]]:
    """Yield (name, estimates by joint) of everything to compare.

    Raises
    ------
    UserError : there is nothing to compare.
    """
    topics = list(options.estimates)
    if not topics and not options.observers:
        topics = sorted(
            name
            for name, topic in bag.topics.items()
            if topic.type == TYPE and name.rpartition('/')[2] == ESTIMATE
        )
    entries = options.observers
    if not topics and not entries:
        if not measurement:
            raise UserError(
                f"{path}: no estimates (no JointState topic '.../{ESTIMATE}'): make them "
                "with 'velocity_estimator replay', or run observers on the measurement "
                'with --observer'
            )
        entries = (Entry(DEFAULT, DEFAULT),)
    for entry in entries:
        yield entry.label, recording(entry, bag, measurement, options).run(entry.observer, {})
    for topic in topics:
        deviations: dict[str, Series] = {}
        beside = bag.topics.get(f'{topic}_stddev')
        if beside is not None and beside.type == TYPE and beside.count:
            with _optional():
                deviations = joint_series(bag, beside.name)
        found = joint_series(bag, topic)
        if has_true_samples(bag, options):
            found = of_samples(bag, f'{topic}_samples', found)
        yield (
            topic,
            {
                joint: _recorded(
                    with_velocity(series), deviations.get(joint), measurement.get(joint)
                )
                for joint, series in found.items()
            },
        )


def recording(
    entry: Entry, bag: Bag, measurement: Mapping[str, Series], options: Options
) -> Recording:
    """Return the input of this observer from the bag, with its parameters.

    Raises
    ------
    UserError, UsageError : the bag lacks an input, or a parameter is wrong.
    """
    setup = _setup(entry, bag, options)
    found = recordings.recording(bag, setup, measurement)
    of_drive = setup.kind == DriveStream.KIND and without_truth(bag, options)
    return found.per_sample() if of_drive or has_true_samples(bag, options) else found


def has_true_samples(bag: Bag, options: Options) -> bool:
    """Return True if the bag has the truth of every sample, and no other truth is requested."""
    if options.truth is not None or options.reference == SMOOTHER or TRUTH not in bag.topics:
        return False
    return _has_batches(bag, TRUE_SAMPLES)


def of_samples(bag: Bag, topic: str, series: Mapping[str, Series]) -> dict[str, Series]:
    """Return the series, with the electrical joint taken from the batches of `topic` if possible.

    Raises
    ------
    UserError : a message there is not a batch.
    """
    electrical = [joint for joint in series if joint.endswith(ELECTRICAL)]
    if len(electrical) != 1 or not _has_batches(bag, topic):
        return dict(series)
    bag.require(topic)
    try:
        batches = [drive_samples.decode(bytes(message.raw)) for message in bag.messages([topic])]
    except MalformedMessageError as error:
        raise UserError(f'{topic} of {bag.path}: {error}') from None
    stamps = np.concatenate([batch.stamps_ns for batch in batches])
    values = np.concatenate([batch.values for batch in batches])
    stamps, values = stamps[values[:, 3] > 0.5], values[values[:, 3] > 0.5]
    nothing = np.full(len(stamps), np.nan)
    return {**series, electrical[0]: Series(stamps, values[:, 0], values[:, 1], nothing)}


def _has_batches(bag: Bag, topic: str) -> bool:
    found = bag.topics.get(topic)
    return found is not None and found.type == drive_samples.TYPE and found.count > 0


def _recorded(
    estimates: Series, deviations: Series | None, measurement: Series | None
) -> EstimateSeries:
    """Return the estimates of one joint from a recorded topic."""
    stddev: NDArray[np.float64] = np.full(len(estimates.stamps_ns), np.nan)
    if deviations is not None:
        deviations = with_velocity(deviations)
        stddev = at_stamps(estimates.stamps_ns, deviations.stamps_ns, deviations.velocity)
    count = len(estimates.stamps_ns)
    samples, validity = {'received': count, 'used': count, 'dropped': {}}, dict[str, float]()
    if measurement is not None:  # what is dropped does not depend on the observer
        joint = COUNTER.joint()
        joint.run(measurement.stamps_ns, measurement.position)
        samples, validity = joint.samples(), _published(estimates, measurement)
    unknown = np.zeros(0, np.int64), np.zeros(0, np.int8)
    return EstimateSeries(*estimates[:3], stddev, samples, validity, *unknown)


def _published(estimates: Series, measurement: Series) -> dict[str, float]:
    """Return seconds with estimates, and seconds with samples but no estimate."""
    good = measurement.stamps_ns[np.isfinite(measurement.position) & (measurement.stamps_ns > 0)]
    steps = np.maximum(np.diff(good) * 1e-9, 0.0)
    if not len(steps):
        return {}
    steps = np.minimum(steps, HELD_STEPS * float(np.median(steps)))
    shown = np.isin(good[1:], estimates.stamps_ns[np.isfinite(estimates.velocity)])
    return {'published': float(steps[shown].sum()), 'withheld': float(steps[~shown].sum())}
