# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Sources of estimates: recorded topics, or observers run on the recorded measurement."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import streams
from estimator_pkg.bags import recording as recordings
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.recording import EstimateSeries, Recording
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series, at_stamps, joint_series, positions, with_velocity
from estimator_pkg.bags.source import UnreadableError
from estimator_pkg.bags.wiring import Setup, wired
from estimator_pkg.errors import UsageError, UserError
from estimator_pkg.evaluation.compare import per_sample
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import AUTO, ESTIMATE, SMOOTHER, TRUTH, Options
from estimator_pkg.evaluation.reference import back_emf
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.observers import DEFAULT
from estimator_pkg.parameters import declared
from estimator_pkg.streams.angle import AngleSettings
from estimator_pkg.streams.contract import Request, Stream
from estimator_pkg.streams.drive import DriveStream

Array = NDArray[np.float64]

COUNTER = Entry('', 'finite_difference')  # its guard counts the samples of recorded estimates
PUBLISHED, WITHHELD = 'published', 'withheld'
STAMP_SOURCE = 'stamp_source'
HELD_STEPS = 5.0  # an estimate counts for the time since the previous one, at most this many steps


def measured(bag: Bag, options: Options) -> dict[str, Series]:
    """Return the measured positions by joint, as the observers use them; {} without any.

    Observers of other measurements can run on a bag without positions.

    Raises
    ------
    UserError, UsageError : a requested topic does not exist, a parameter is wrong, or the observers
        use different clocks.
    """
    _check_clocks(options.observers)
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
    try:
        topic = measurement_topic(bag, options.measurement)
        if topic != options.truth:
            found = positions(bag, topic)
            if any((series.stamps_ns > 0).any() for series in found.values()):
                return found
            return positions(bag, topic, by_publisher=True)  # as the estimates must have been
    except UnreadableError:
        raise
    except UserError:  # estimates can be compared with a truth without a measurement
        pass
    return {}


def without_truth(bag: Bag, options: Options) -> bool:
    """Return True if there is no truth, or the off-line reference is requested instead."""
    if options.reference == SMOOTHER:
        return True
    return options.reference == AUTO and options.truth is None and TRUTH not in bag.topics


def _check_clocks(observers: Sequence[Entry]) -> None:
    """Raise UsageError unless all observers, which share a reference, use the same clock."""
    clocks = {source for entry in observers if (source := source_of_stamps(entry))}
    if len(clocks) > 1:
        raise UsageError(
            f"the observers have different '{STAMP_SOURCE}' ({', '.join(sorted(clocks))}): "
            'set one for all with --set'
        )


def source_of_stamps(entry: Entry) -> str:
    """Return the `stamp_source` of an observer; '' for families without it."""
    declares = STAMP_SOURCE in declared(_stream(entry).SETTINGS)
    return dict(entry.values).get(STAMP_SOURCE, AngleSettings.stamp_source) if declares else ''


def _stream(entry: Entry) -> type[Stream]:
    return streams.of_observer(entry.observer)


def _setup(entry: Entry, bag: Bag, options: Options) -> Setup:
    """Return parameters and topics of an observer; raise UserError or UsageError."""
    stream = _stream(entry)
    values: dict[str, Any] = {'observer': entry.observer}
    if stream.WRAPS:
        values['wrap_period'] = options.wrap_period
    return wired(
        stream, bag, {**values, **dict(entry.values)}, Request(options.measurement, options.angle)
    )


def sources(
    bag: Bag, path: str, measurement: dict[str, Series], options: Options
) -> Iterator[tuple[str, dict[str, EstimateSeries]]]:
    """Yield (name, estimates by joint) of everything to compare.

    Raises
    ------
    UserError : there is nothing to compare.
    """
    if options.observers:
        for entry in options.observers:
            yield (entry.label, recording(entry, bag, measurement, options).run(entry.observer, {}))
        if not options.estimates:
            return
    topics = list(options.estimates) or sorted(
        name
        for name, topic in bag.topics.items()
        if topic.type == TYPE and name.rpartition('/')[2] == ESTIMATE
    )
    if not topics and measurement:
        usual = Entry(DEFAULT, DEFAULT)
        yield DEFAULT, recording(usual, bag, measurement, options).run(DEFAULT, {})
        return
    if not topics:
        raise UserError(
            f"{path}: no estimates (no JointState topic '.../{ESTIMATE}'): make them "
            "with 'velocity_estimator replay', or run observers on the measurement "
            'with --observer'
        )
    for topic in topics:
        deviations: dict[str, Series] = {}
        beside = bag.topics.get(f'{topic}_stddev')
        if beside is not None and beside.type == TYPE and beside.count:
            try:
                deviations = joint_series(bag, beside.name)
            except UnreadableError:
                raise
            except UserError:  # no joint was valid at any time
                pass
        found = joint_series(bag, topic)
        if per_sample.available(bag, options):
            found = per_sample.finer(bag, f'{topic}{per_sample.BATCH_SUFFIX}', found)
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
    return found.per_sample() if of_drive or per_sample.available(bag, options) else found


def _recorded(
    estimates: Series, deviations: Series | None, measurement: Series | None
) -> EstimateSeries:
    """Return the estimates of one joint from a recorded topic."""
    stddev: NDArray[np.float64] = np.full(len(estimates.stamps_ns), np.nan)
    if deviations is not None:
        deviations = with_velocity(deviations)
        stddev = at_stamps(estimates.stamps_ns, deviations.stamps_ns, deviations.velocity)
    return EstimateSeries(
        estimates.stamps_ns,
        estimates.position,
        estimates.velocity,
        stddev,
        _samples(estimates, measurement),
        _published(estimates, measurement),
        np.zeros(0, np.int64),
        np.zeros(0, np.int8),
    )


def _published(estimates: Series, measurement: Series | None) -> dict[str, float]:
    """Return seconds with estimates, and seconds with samples but no estimate."""
    if measurement is None or not len(measurement.stamps_ns):
        return {}
    good = measurement.stamps_ns[np.isfinite(measurement.position) & (measurement.stamps_ns > 0)]
    steps = np.diff(good) * 1e-9
    steps = np.where(steps > 0.0, steps, 0.0)
    if not len(steps):
        return {}
    steps = np.minimum(steps, HELD_STEPS * float(np.median(steps)))
    shown = np.isin(good[1:], estimates.stamps_ns[np.isfinite(estimates.velocity)])
    return {PUBLISHED: float(steps[shown].sum()), WITHHELD: float(steps[~shown].sum())}


def _samples(estimates: Series, measurement: Series | None) -> dict[str, Any]:
    """Return the guard's counts of the samples in the bag, or the number of estimates without one.

    The dropped samples do not depend on the observer, unless it was misconfigured.
    """
    if measurement is None:
        count = len(estimates.stamps_ns)
        return {'received': count, 'used': count, 'dropped': {}}
    joint = COUNTER.joint()
    joint.run(measurement.stamps_ns, measurement.position)
    return joint.samples()
