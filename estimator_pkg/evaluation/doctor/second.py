# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Second sensors of a joint in a bag: gyros, other joints that move with it, its own velocity.

Ratio and delay of those that follow the joint are fitted to the off-line reference from the angle.
With them they run as `sources` of `joint_observer` would, each alone, and are judged as observers
are. The reference does not know the source, so the error with a source is an upper bound.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator_pkg import observers
from estimator_pkg.bags.definitions import fields_of
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import measured_topics
from estimator_pkg.bags.series import joint_series
from estimator_pkg.driver.configuration import AS_ANGLE, AS_RATE, Configuration, SourceSettings
from estimator_pkg.driver.fused import FusedJoint
from estimator_pkg.estimate import VALID
from estimator_pkg.evaluation.checks.readings import Readings, Rows
from estimator_pkg.evaluation.checks.row import PASS, Finding
from estimator_pkg.evaluation.ranking.ranking import at_reference, rank
from estimator_pkg.evaluation.ranking.verdict import shown
from estimator_pkg.evaluation.reference.motion import ReferenceMotion
from estimator_pkg.messages.field import Field
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.observers import DEFAULT

Array = NDArray[np.float64]

IMU = SourceSettings.field_type
FOLLOWS = 0.9  # correlation with the joint's position from which a sensor may be of the joint
GEARED = 0.99999  # and another joint of the same messages: joints of an arm move together, too
FEWEST_VALUES = 100  # values without which nothing is examined
MOST_RUN = 10_000  # readings that are run
TRIED_FIRST = 2_500  # of them before the sensor was used once
MOST_SENSORS = 3  # sensors of a joint that are run
MOST_JOINTS = 64  # of a topic, whose positions are compared with one another
USED_PART = 0.2  # of the readings, informed by a source that agrees
FIT_STEPS = 5  # of the fit of the delay
LARGEST_DELAY = 0.5  # [s]
WITHOUT, WITH = 'without', 'with'


class Candidate(NamedTuple):
    """A number that may measure a joint: settings of a source, and its values.

    joint : the joint that its messages name; '': none.
    stamps_ns, arrival_ns, values : shape (n,), in the order of their arrival.
    """

    topic: str
    type: str
    field: str
    kind: str
    joint: str
    stamps_ns: Rows
    arrival_ns: Rows
    values: Array

    def may_measure(self, joint: str, topic: str) -> bool:
        """Return True unless it is the angle itself, or the velocity of another joint."""
        same = self.joint == joint
        return not self.joint or (same if self.kind == AS_RATE else not same or self.topic != topic)

    def is_beside(self, joint: str, topic: str) -> bool:
        """Return True if it is another joint of the same messages."""
        return self.topic == topic and self.joint not in ('', joint)


def candidates(bag: Bag) -> list[Candidate]:
    """Return the angular velocities of the gyros, and positions and velocities of the joints."""
    found = []
    for topic in bag.topics.values():
        if topic.type == IMU and topic.count >= FEWEST_VALUES:
            definition = fields_of(topic.type, topic.definition)
            for axis in 'xyz':
                path, parts = f'angular_velocity.{axis}', []
                field = Field(definition, IMU, path)
                for _, block in bag.blocks([topic.name]):
                    for group in field.decode_block(block)[0]:
                        arrived = block.publish_ns[group.rows]
                        stamps = arrived if group.stamps_ns is None else group.stamps_ns
                        if group.values is not None:
                            parts.append((stamps, arrived, group.values))
                if parts:
                    arrays = map(np.concatenate, zip(*parts))
                    found.append(Candidate(topic.name, IMU, path, AS_RATE, '', *arrays))
    for name in measured_topics(bag):
        series, published = joint_series(bag, name), joint_series(bag, name, True)
        if len({len(each.stamps_ns) for each in series.values()}) != 1:
            continue  # not every message has every joint, so an index is not that of a joint
        for number, (joint, each) in enumerate(series.items()):
            times = each.stamps_ns, published[joint].stamps_ns
            numbers = [('velocity', AS_RATE, each.velocity)]
            if len(series) <= MOST_JOINTS:
                numbers.insert(0, ('position', AS_ANGLE, each.position))
            for path, kind, values in numbers:
                if np.count_nonzero(np.isfinite(values)) >= FEWEST_VALUES and np.nanmax(
                    values
                ) > np.nanmin(values):
                    found.append(
                        Candidate(name, TYPE, f'{path}[{number}]', kind, joint, *times, values)
                    )
    return found


def examine(
    seen: Readings,
    moved: ReferenceMotion,
    rows: Rows,
    topic: str,
    every: Sequence[Candidate],
    motion_hz: float | None,
) -> tuple[list[Finding], dict[str, Any]]:
    """Return a finding for each second sensor of a joint, and the parameters of the best one.

    Parameters
    ----------
    moved : the reference. rows : the readings that it is of. topic : of the readings.
    every : those of the bag. motion_hz : see `rank`.
    """
    found: list[Finding] = []
    best, least = dict[str, Any](), math.inf
    may = [each for each in every if each.may_measure(seen.name, topic)]
    follows = {id(each): _follows(each, moved, seen.period) for each in may}
    for imu in dict.fromkeys(each.topic for each in may if each.type == IMU):
        axes = [each for each in may if each.topic == imu]
        chosen = max(axes, key=lambda each: follows[id(each)])
        if follows[id(chosen)] < FOLLOWS:
            text = f'{imu}: no axis follows the joint (correlation {follows[id(chosen)]:.2f})'
            found.append(Finding('second sensor', PASS, text))
        may = [each for each in may if each.topic != imu or each is chosen]
    may = [
        each
        for each in may
        if follows[id(each)] >= (GEARED if each.is_beside(seen.name, topic) else FOLLOWS)
    ]
    for each in sorted(may, key=lambda each: -follows[id(each)])[:MOST_SENSORS]:
        text, error, numbers = _judged(each, seen, moved, rows, motion_hz)
        found.append(Finding('second sensor', PASS, text, '', numbers))
        if error < least:
            least, best = error, _parameters(each, seen.name, numbers)
    return found, best


def _values(each: Candidate, moved: ReferenceMotion, period: float) -> tuple[Array, Array]:
    """Return times after the reference's first reading [s], and values without wraps."""
    start, end = int(moved.stamps[0]), int(moved.stamps[-1])
    kept = (each.stamps_ns >= start) & (each.stamps_ns <= end) & np.isfinite(each.values)
    values = each.values[kept]
    if each.kind == AS_ANGLE and period:
        values = np.unwrap(values, period=period)
    return np.asarray((each.stamps_ns[kept] - start) * 1e-9, np.float64), values


def _follows(each: Candidate, moved: ReferenceMotion, period: float) -> float:
    """Return the correlation of its angle or integral with the joint's position, without trends."""
    time, angle = _values(each, moved, period)
    if len(time) < FEWEST_VALUES or not np.all(np.diff(time) >= 0.0):
        return 0.0
    if each.kind == AS_RATE:
        angle = np.cumsum(angle * np.diff(time, prepend=time[0]))
    other = np.interp(time, moved.time - moved.time[0], moved.position)
    a, b = (v - np.polyval(np.polyfit(time, v, 1), time) for v in (angle, other))
    size = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return abs(float(np.sum(a * b))) / size if size > 0.0 else 0.0


def fit(each: Candidate, moved: ReferenceMotion, period: float) -> dict[str, dict[str, float]]:
    """Return ratio r and delay d [s] with standard deviations, by least squares.

    A value w at time t is (y(t - d) - b)/r, with the joint's velocity or position y: linear in 1/r
    and b/r, and in -d/r after a first guess of the delay.
    """
    time, values = _values(each, moved, period)
    at = moved.time - moved.time[0]
    y = moved.velocity if each.kind == AS_RATE else moved.position
    slope, delay = np.gradient(y, at), 0.0
    for _ in range(FIT_STEPS):
        A = np.column_stack(
            [np.ones_like(time), *(np.interp(time - delay, at, v) for v in (y, slope))]
        )
        (_, gain, shift), *_ = np.linalg.lstsq(A, values)
        delay = float(np.clip(delay - shift / gain, -LARGEST_DELAY, LARGEST_DELAY))
    residual = values - A @ np.linalg.lstsq(A, values)[0]
    variance = np.linalg.pinv(A.T @ A).diagonal() * (residual @ residual) / (len(time) - 3)
    _, of_gain, of_shift = np.sqrt(variance) / abs(gain)
    return {
        'ratio': {'value': 1.0 / gain, 'stddev': of_gain / abs(gain)},
        'delay': {'value': delay, 'stddev': of_shift},
    }


def _judged(
    each: Candidate, seen: Readings, moved: ReferenceMotion, rows: Rows, motion_hz: float | None
) -> tuple[str, float, dict[str, Any]]:
    """Return the result in words, the error if it pays (else infinite), and its numbers."""
    numbers: dict[str, Any] = {'topic': each.topic, 'field': each.field}
    numbers |= fit(each, moved, seen.period)
    more = {'quantum': seen.own_quantum} if seen.own_quantum else {}
    observer = observers.find(DEFAULT)
    configuration = Configuration(observer, {'wrap_period': seen.period, **more})
    settings = SourceSettings(kind=each.kind, **_parameters_of(numbers))
    joint = FusedJoint(observer, *configuration.for_joint(''), [(0, each.field, settings)])
    source, at, used = joint.sources[0], 0, 0
    made: list[tuple[int, float, float]] = []
    first = int(np.searchsorted(each.arrival_ns, seen.arrival_ns[rows[0]] - 10**9))
    arrived, stamps, values = (
        array[first:].tolist() for array in (each.arrival_ns, each.stamps_ns, each.values)
    )
    rows = rows[:MOST_RUN]
    for stamp, now, position in zip(
        seen.stamps_ns[rows].tolist(), seen.arrival_ns[rows].tolist(), seen.position[rows].tolist()
    ):
        while at < len(arrived) and arrived[at] <= now:
            joint.receive(0, stamps[at], values[at])
            at += 1
        if not used and len(made) >= TRIED_FIRST:
            break
        if joint.update(stamp, position):
            used += source.used
            informed, alone = joint.estimate(), joint.alone.estimate()
            if informed[3] in VALID and alone[3] in VALID:
                made.append((stamp, informed[1], alone[1]))
    numbers['used'] = used / len(rows)
    lead = f'{each.topic} {each.field}: ' + ''.join(
        f'{name} {numbers[name]["value"]:.4g} +- {numbers[name]["stddev"]:.1g}{unit}, '
        for name, unit in (('ratio', ''), ('delay', ' s'))
    )
    if used < USED_PART * len(rows) or not made:
        return f'{lead}{source.text()}', math.inf, numbers
    times, *velocities = (np.array(column) for column in zip(*made))
    part = moved.between(int(times[0]) - 1, int(times[-1]))
    estimates = {
        name: at_reference(part, times, one) for name, one in zip((WITH, WITHOUT), velocities)
    }
    verdict = rank(estimates, part, WITHOUT, motion_hz)
    if len(verdict.rms) < 2:
        return f'{lead}{source.text()}', math.inf, numbers
    pays = verdict.better(WITH, WITHOUT) > 0
    numbers |= {
        'error_with': verdict.rms[WITH],
        'error_without': verdict.rms[WITHOUT],
        'pays': pays,
    }
    text = (
        f'{lead}{source.text()}; error {shown(verdict.rms[WITHOUT])} rad/s rms without it, at most '
        f'{shown(verdict.rms[WITH])} with it: '
        + ('it pays (95 %)' if pays else 'no gain is proven')
    )
    return text, verdict.rms[WITH] if pays else math.inf, numbers


def _parameters_of(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return ratio and delay as they are written: the ratio to five digits, the delay to 1 us."""
    ratio, delay = numbers['ratio']['value'], numbers['delay']['value']
    return {'ratio': float(f'{ratio:.5g}'), 'delay': round(delay, 6)}


def _parameters(each: Candidate, joint: str, numbers: Mapping[str, Any]) -> dict[str, Any]:
    name = re.sub(r'\W+', '_', f'{each.topic}_{joint}').strip('_')
    own = {'topic': each.topic, 'field_type': each.type, 'field': each.field, 'kind': each.kind}
    own |= {'joint': joint} if joint else {}
    own |= _parameters_of(numbers)
    return {'sources': [name]} | {f'source.{name}.{key}': value for key, value in own.items()}


def together(every: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the parameters of the sources of several joints."""
    names = [name for each in every for name in each.get('sources', ())]
    found = {key: value for each in every for key, value in each.items()}
    return {**found, 'sources': names} if names else {}
