# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""All checks of the joints of a bag, or of a single angle in messages of any type."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from estimator_pkg import streams
from estimator_pkg.bags import recording as recordings
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.series import Series, joint_series
from estimator_pkg.bags.wiring import Setup, settled
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.doctor import angles, stamps, velocities
from estimator_pkg.evaluation.doctor.readings import FAIL, Finding, Readings
from estimator_pkg.evaluation.reference.smoother.smoother import Smoothed
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.observers.angle.core import LARGEST
from estimator_pkg.streams.contract import PUBLISHER, Request

FEWEST = angles.FEWEST


@dataclass(frozen=True)
class Examined:
    """One joint's findings; `smoothed` is the reference of its velocity, None without one."""

    readings: Readings
    findings: list[Finding]
    smoothed: Smoothed | None = field(default=None, repr=False)

    def as_dict(self) -> list[dict[str, Any]]:
        """Return the findings for ``--json``."""
        return [
            {
                'check': each.check,
                'level': each.level,
                'value': each.value,
                'remedy': each.remedy,
                **each.numbers,
            }
            for each in self.findings
        ]


def setup(bag: Bag, measurement: str | None, angle: str | None, period: float) -> Setup:
    """Return the wiring of the measurement in the bag, as `joint_observer` would have it."""
    stream = streams.named(streams.USUAL)
    return settled(stream, bag, {'wrap_period': period}, Request(measurement, angle))


def readings(bag: Bag, chosen: Setup) -> list[Readings]:
    """Return the readings of each joint of the measurement.

    Raises
    ------
    UserError : no joint is readable.
    """
    topic, period = chosen.topics[0], float(chosen.values['wrap_period'])
    if topic.type == TYPE and not chosen.path:
        by_stamp = joint_series(bag, topic.name)
        arrived = {name: each.stamps_ns for name, each in joint_series(bag, topic.name, True).items()}
    else:
        by_stamp = recordings.measured(bag, chosen)
        published = chosen.having({'stamp_source': PUBLISHER})
        arrived = {name: each.stamps_ns for name, each in recordings.measured(bag, published).items()}
    if not any(np.isfinite(each.position).any() for each in by_stamp.values()):
        raise UserError(f'{bag.path}: {topic.name} has no readable joint: no position is finite')
    if not any((each.stamps_ns > 0).any() for each in by_stamp.values()):
        start = 0
    else:
        start = min(int(np.min(each.stamps_ns[each.stamps_ns > 0], initial=2**62)) for each in by_stamp.values())
    return [
        _readings(name, each, arrived[name], period, start) for name, each in by_stamp.items()
    ]


def _readings(
    name: str, series: Series, arrival: np.ndarray, period: float, start: int
) -> Readings:
    position = np.where(np.abs(series.position) < LARGEST, series.position, np.nan)
    return Readings(name, series.stamps_ns, arrival, position, series.velocity, period, start)


def examine(seen: Readings) -> Examined:
    """Return all findings on one joint; readings without a stamp are taken at their arrival."""
    found = [stamps.missing_stamps(seen)]
    if found[0].level == FAIL and not np.any(seen.stamps_ns > 0):
        seen = Readings(
            seen.name, seen.arrival_ns, seen.arrival_ns, seen.position, seen.velocity, seen.period,
            int(seen.arrival_ns[0]),
        )
    if len(seen.rows) < FEWEST:
        text = f'{len(seen.rows)} usable of {len(seen.position)} readings'
        found.append(Finding('readings', FAIL, text, 'record the joint for some seconds'))
        return Examined(seen, found)
    found = [
        found[0] if check is stamps.missing_stamps else check(seen) for check in stamps.CHECKS
    ]
    found += [check(seen) for check in angles.CHECKS]
    smoothed = velocities.reference(seen)
    return Examined(seen, found + velocities.checks(seen, smoothed), smoothed)
