# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""All checks of the joints of a bag, or of a single angle in messages of any type."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from estimator_pkg.bags import recording as recordings
from estimator_pkg.bags.log_file import is_log
from estimator_pkg.bags.reader import Bag
from estimator_pkg.bags.selection import measured_topics
from estimator_pkg.bags.series import joint_series, why_none
from estimator_pkg.bags.wiring import Setup
from estimator_pkg.circle import LARGEST
from estimator_pkg.driver.configuration import AS_RATE
from estimator_pkg.errors import UserError
from estimator_pkg.evaluation.checks.joint import (
    FEWEST_READINGS,
    as_read,
    checked,
    cut,
    failed,
    reference,
    stamped,
    stretch,
    usable,
)
from estimator_pkg.evaluation.checks.readings import Readings
from estimator_pkg.evaluation.checks.row import WARN, Finding
from estimator_pkg.evaluation.doctor import second, velocities
from estimator_pkg.evaluation.doctor.choice import JointRanking, answer
from estimator_pkg.evaluation.options import in_window, wrap_periods
from estimator_pkg.evaluation.plots import Curve
from estimator_pkg.evaluation.text import units
from estimator_pkg.messages.joint_state import TYPE
from estimator_pkg.sensor.stamp_repair import REPAIRED, StampRepair
from estimator_pkg.streams.contract import PUBLISHER
from estimator_pkg.streams.drive import DriveStream

JITTER_CHECKS = ('jitter', 'lying stamps')


@dataclass(frozen=True)
class Examined:
    """One joint's findings, and the verdict on its estimates; None if there is none.

    said : the verdict in words, if it is none of an angle. panels : of its plots, as well.
    sources : parameters of the second sensor that pays.
    """

    readings: Readings
    findings: list[Finding]
    answer: JointRanking | None = None
    said: tuple[str, ...] = ()
    panels: Mapping[str, Sequence[Curve]] = field(default_factory=dict)
    sources: Mapping[str, Any] = field(default_factory=dict)

    @property
    def failed(self) -> list[Finding]:
        """The checks that FAIL."""
        return failed(self.findings)

    @property
    def refused(self) -> list[Finding]:
        """Those because of which nothing is recommended."""
        return [] if self.answer is not None else self.failed


def is_drive(bag: Bag, measurement: str | None, angle: str | None) -> bool:
    """Return True if the bag has currents and voltages, and no angle to examine."""
    if measurement is not None or angle is not None or measured_topics(bag):
        return False
    return DriveStream.recognises(lambda name: name in bag.topics, False)


def readings(bag: Bag, chosen: Setup, begin: float = 0.0, end: float = math.inf) -> list[Readings]:
    """Return the readings of each joint of the measurement, from `begin` to `end` [s].

    Raises
    ------
    UserError : no joint is readable, or none has samples in that time.
    """
    topic = chosen.topics[0]
    period, own_periods = wrap_periods(None, [chosen.values])
    if topic.type == TYPE and not chosen.path:
        by_stamp = joint_series(bag, topic.name)
        arrived = {
            name: each.stamps_ns for name, each in joint_series(bag, topic.name, True).items()
        }
    else:
        by_stamp = recordings.measured(bag, chosen)
        published = chosen.having({'stamp_source': PUBLISHER})
        arrived = {
            name: each.stamps_ns for name, each in recordings.measured(bag, published).items()
        }
    if not any(np.isfinite(each.position).any() for each in by_stamp.values()):
        raise UserError(
            f'{bag.path}: {why_none(bag, topic.name)}: name another topic with --measurement'
        )
    stamps = np.concatenate([each.stamps_ns for each in by_stamp.values()])
    start = int(np.min(stamps[stamps > 0])) if np.any(stamps > 0) else 0
    found = [
        Readings(
            name,
            each.stamps_ns,
            arrived[name],
            np.where(np.abs(each.position) < LARGEST, each.position, np.nan),
            each.velocity,
            own_periods.get(name, period),
            start,
            log=is_log(bag.path),
        )
        for name, each in by_stamp.items()
    ]
    if begin <= 0.0 and end == math.inf:
        return found
    return [cut(each, in_window(each.stamps_ns, start, begin, end)) for each in found]


def examine(
    seen: Readings,
    motion_hz: float | None = None,
    topic: str = '',
    others: Sequence[second.Candidate] = (),
) -> Examined:
    """Return all findings on one joint, and the verdict on its estimates.

    There is no verdict if a check FAILs in all parts that are long enough, see `usable`.

    Parameters
    ----------
    motion_hz : highest frequency at which the joint moves [Hz]; None: not known.
    topic : of the readings. others : what may be second sensors.
    """
    seen = as_read(seen)
    found, seen = checked(seen), stamped(seen)
    for each in found:
        if each.level == WARN and 'wrap_period' in each.numbers:  # one wrap, of degrees
            seen = replace(seen, period=each.numbers['wrap_period'], free=True)
    if len(seen.rows) < FEWEST_READINGS:
        return Examined(seen, found)
    found = _repairable(seen, found)
    good, said = usable(seen, found)
    part = seen if good is None else good
    rows = np.sort(stretch(part))
    moved = reference(part, rows)
    found += velocities.checks(part, moved, rows)
    made, sources = None, dict[str, Any]()
    if moved is not None and good is not None:
        made = answer(part, moved, rows, motion_hz)
        if said:
            verdict = replace(made.verdict, cautions=(said, *made.verdict.cautions))
            made = made._replace(verdict=verdict)
        wrong = velocities.misleads(found)
        may = [
            each
            for each in others
            if not wrong or (each.topic, each.joint, each.kind) != (topic, seen.name, AS_RATE)
        ]
        more, sources = second.examine(part, moved, rows, topic, may, motion_hz)
        found += more
    found = [each._replace(value=units(each.value, seen.period)) for each in found]
    return Examined(seen, found, made, sources=sources)


def _repairable(seen: Readings, found: list[Finding]) -> list[Finding]:
    """Return the findings; those on jitter name `stamp_repair` where it repairs the stamps."""
    jittery = [each.level == WARN and each.check in JITTER_CHECKS for each in found]
    if not any(jittery):
        return found
    repair = StampRepair(lambda _: seen.period)
    usable = np.sort(seen.rows)
    for stamp, reading in zip(seen.stamps_ns[usable].tolist(), seen.position[usable].tolist()):
        repair(stamp, (seen.name,), (reading,))
    if repair.state != REPAIRED:
        return found
    remedy = "or set 'stamp_repair: regular': the readings show a device that samples regularly"
    return [
        each._replace(remedy=f'{each.remedy}; {remedy}') if late else each
        for each, late in zip(found, jittery)
    ]
