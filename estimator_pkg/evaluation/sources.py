"""Where estimates come from: recorded topics, or observers run on the recorded measurement."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator_pkg.bags import kinds
from estimator_pkg.bags.kinds.contract import Estimate, Recording, Request
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import measurement_topic
from estimator_pkg.bags.series import Series, at_stamps, joint_series
from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation import per_sample
from estimator_pkg.evaluation.entries import Entry
from estimator_pkg.evaluation.options import ESTIMATE, MEASUREMENT, Options
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.progress import progress

Array = NDArray[np.float64]

COUNTER = Entry('', 'finite_difference')  # its guard counts the samples of recorded estimates
PUBLISHED, WITHHELD = 'published', 'withheld'
HELD = 5.0          # an estimate stands for the time since the one before, up to so many steps


def measured(bag: Bag, options: Options) -> dict[str, Series]:
    """The measured positions by joint; none where nobody asked and there is no usual topic.

    Observers that need something else may be run on a bag without them.
    """
    topic = options.measurement or MEASUREMENT
    if not options.observers:
        if options.measurement:
            bag.require(topic, (TYPE,))
    elif options.measurement:
        bag.require(topic)
    else:
        with suppress(UserError):  # the observer says what it misses
            topic = measurement_topic(bag)
    if topic not in bag.topics or bag.topics[topic].type != TYPE:
        return {}
    found = {}
    for joint, series in joint_series(bag, topic).items():
        if np.isfinite(series.position).any():
            nothing = np.broadcast_to(np.nan, len(series.stamps_ns))  # nobody reads the rest here
            found[joint] = series._replace(velocity=nothing, effort=nothing)
    return found


def sources(bag: Bag, path: str, measurement: dict[str, Series], options: Options
            ) -> Iterator[tuple[str, dict[str, Estimate]]]:
    """(name, estimates by joint) of everything that is to be compared.

    Raises
    ------
    UserError : there is nothing.
    """
    if options.observers:
        with progress(path, len(options.observers)) as advance:
            for entry in options.observers:
                yield entry.label, recording(entry, bag, measurement, options).run(
                    entry.observer, {})
                advance(1)
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
        deviations: dict[str, Series] = {}
        beside = bag.topics.get(f'{topic}_stddev')
        if beside is not None and beside.type == TYPE and beside.count:
            with suppress(UserError):  # no joint was ever valid
                deviations = joint_series(bag, beside.name)
        found = joint_series(bag, topic)
        if per_sample.available(bag, options):
            found = per_sample.finer(bag, f'{topic}{per_sample.BATCHES}', found)
        yield topic, {joint: _recorded(series, deviations.get(joint), measurement.get(joint))
                      for joint, series in found.items()}


def recording(entry: Entry, bag: Bag, measurement: Mapping[str, Series], options: Options
              ) -> Recording:
    """What this observer needs of the bag, with its parameters.

    Raises
    ------
    UserError, UsageError : the bag lacks it, or a parameter is wrong.
    """
    kind = kinds.of_observer(entry.observer)
    values: dict[str, Any] = {'observer': entry.observer}
    if kind.wraps:
        values['wrap_period'] = options.wrap_period
    setup = kind.prepare(bag, {**values, **dict(entry.values)}, Request(options.measurement))
    found = kind.recording(bag, setup, measurement)
    return found.per_sample() if per_sample.available(bag, options) else found


def _recorded(estimates: Series, deviations: Series | None, measurement: Series | None
              ) -> Estimate:
    """What a topic of estimates says of one joint."""
    stddev = np.full(len(estimates.stamps_ns), np.nan)
    if deviations is not None:
        stddev = at_stamps(estimates.stamps_ns, deviations.stamps_ns, deviations.velocity)
    return Estimate(estimates.stamps_ns, estimates.position, estimates.velocity, stddev,
                    _samples(estimates, measurement), _published(estimates, measurement),
                    np.zeros(0, np.int64), np.zeros(0, np.int8))


def _published(estimates: Series, measurement: Series | None) -> dict[str, float]:
    """Seconds with estimates, and seconds with samples alone."""
    if measurement is None or not len(measurement.stamps_ns):
        return {}
    good = measurement.stamps_ns[np.isfinite(measurement.position) & (measurement.stamps_ns > 0)]
    steps = np.diff(good) * 1e-9
    steps = np.where(steps > 0.0, steps, 0.0)
    if not len(steps):
        return {}
    steps = np.minimum(steps, HELD * float(np.median(steps)))
    shown = np.isin(good[1:], estimates.stamps_ns[np.isfinite(estimates.velocity)])
    return {PUBLISHED: float(steps[shown].sum()), WITHHELD: float(steps[~shown].sum())}


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
