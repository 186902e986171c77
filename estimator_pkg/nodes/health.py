# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The health of an observer node, as its users read it: status, diagnostics, warnings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from estimator_pkg.estimate import LOST, MISCONFIGURED, STATUS_NAMES, VALID
from estimator_pkg.messages.diagnostics import ERROR, OK, WARN, encode, packed
from estimator_pkg.messages.diagnostics import Status as Entry
from estimator_pkg.nodes.detection import INPUT_PATIENCE, JOINT_PATIENCE, Detector
from estimator_pkg.nodes.endpoints import Endpoints, latched
from estimator_pkg.nodes.faults import Fault, Faults, called, listed
from estimator_pkg.nodes.joints import NEW, JointWatch, Status, counters, entry
from estimator_pkg.nodes.ros_parameters import RosParameters
from estimator_pkg.sensor.guard import VERDICTS
from estimator_pkg.streams.contract import Stream

DIAGNOSTICS = 1.0  # time between two messages on /diagnostics [s]
KINDS = ('messages_dropped', 'dropped')  # counters of losses by kind,
LOSSES = (  # and others
    *(f'events.{kind}' for kind in ('outage', 'clock_jump', 'stray_stamp')),
    *('joints_expired', 'lost_by_dds'),
)
ELSEWHERE = ('zero_stamp', 'duplicate', 'repeated')  # reasons of drops that have their own rows


class Health:
    """Publishes and logs how the joints of a bank and the node's inputs are.

    Parameters
    ----------
    node, stream, endpoints, ros : the node, its stream, endpoints and parameters.

    Attributes
    ----------
    watch : statuses of the joints.
    """

    def __init__(
        self, node: Node, stream: Stream, endpoints: Endpoints, ros: RosParameters
    ) -> None:
        self._node, self._stream, self._endpoints, self._ros = node, stream, endpoints, ros
        self._status = endpoints.publisher(DiagnosticArray, '~/status', latched())
        self._diagnostics = endpoints.publisher(DiagnosticArray, '/diagnostics')
        self._failed = 0
        self._step_time = self._longest_step = 0.0
        self._started = self._last_report = monotonic()
        self._reported_unknown = self._reported_tracking = False
        self._faults = Faults(self._log)
        self.watch = JointWatch(stream)
        self._detector = Detector(node, stream, endpoints, self.watch, self._started)
        self._expired: dict[str, int] = {}  # counters of expired joints
        self._entries: dict[str, Entry] = {}  # by joint, each at most a second old
        self._before: dict[str, int] = {}
        self._publish_status()

    def took(self, seconds: float) -> None:
        """Count the time that decoding, estimating and answering a message took [s]."""
        self._step_time += seconds
        if seconds > self._longest_step:
            self._longest_step = seconds

    def failed(self, topic: str, why: str) -> None:
        """Count an exception of the observer on a message; the joints are reset."""
        self._failed += 1
        self._detector.events.pop('failed', None)  # the newest one is reported
        self._detector.note('failed', topic=topic, why=why, kept=self._stream.KEPT)

    def _log(self, fault: Fault, text: str) -> None:
        """Log a fault; it is an error while messages come and nothing is estimated."""
        silent = any(self._stream.received) and not self.watch.estimated
        logger = self._node.get_logger()
        if fault.name == 'failed' or (silent and not fault.harmless):
            logger.error(text)
        else:
            logger.warning(text)

    def look(self) -> None:
        """Publish changes, and once a second the diagnostics; to be called ten times a second."""
        now = monotonic()
        due = now - self._last_report >= DIAGNOSTICS
        if due:
            self._expire(now)
        changed = self.watch.look(now)
        self._note_changes(changed)
        self._refresh([*changed, *self.watch.due])
        self._detector.look(now)
        if due:
            self._report(now)
            self._report_tracking(now)
            if now - self._started >= INPUT_PATIENCE and not self._reported_unknown:
                self._reported_unknown = True
                for name, hint in self._ros.unknown().items():
                    self._node.get_logger().warning(f"unknown parameter '{name}': {hint}")
        if changed or due:
            self._publish_status()

    def _expire(self, now: float) -> None:
        """Remove joints that had no sample for the stream's `expiry`."""
        expiry = getattr(self._stream.settings, 'expiry', 0.0)
        old = self.watch.older(expiry, now) if expiry > 0.0 else []
        counts = self._counts_of(old)
        if not old or not self._stream.expire(old):
            return
        for key, count in counts.items():
            self._expired[key] = self._expired.get(key, 0) + count
        self.watch.forget(old)
        for name in old:
            self._entries.pop(name, None)
        self._detector.note('expired', names=called(old, self._stream.KEPT), expiry=expiry)

    def _note_changes(self, changed: Mapping[str, tuple[Status, Status]]) -> None:
        """Report joints that have become misconfigured, or whose samples are all dropped."""
        unusable: dict[str, list[str]] = {}
        for name, ((before, reason), (status, why)) in changed.items():
            if status == before and (status != LOST or ';' in reason):
                continue  # a lost joint may be silent first; then its samples are dropped
            if status == MISCONFIGURED:
                self._node.get_logger().error(
                    f"{self._stream.KEPT} '{name}' is misconfigured: {why}"
                )
            verdict = self._stream.bank.joints[name].verdict
            if status == LOST and ';' in why and VERDICTS[verdict] not in ELSEWHERE:
                unusable.setdefault(why, []).append(name)
        for why, names in unusable.items():
            count = sum(self.watch.unused(name) for name in names)
            said = why.replace('; received', f'; all {count} received')
            kept = called(names, self._stream.KEPT)
            self._detector.note('unusable', key=why, names=kept, why=said)

    def _counts_of(self, names: Iterable[str]) -> dict[str, int]:
        return counters({name: self._stream.bank.joints[name] for name in names})

    def _refresh(self, names: Iterable[str]) -> None:
        """Make the entries of these joints again."""
        for name in names:
            joint, status = self._stream.bank.joints[name], self.watch.statuses.get(name, NEW)
            self._entries[name] = entry(name, joint, *status, self._stream.about(name))

    def _of_joints(self) -> list[Entry]:
        names = self._stream.bank.joints
        self._refresh(names.keys() - self._entries.keys())
        return [self._entries[name] for name in names]

    def _publish_status(self) -> None:
        of_node = self._of_node({'faults': len(self._faults.present)})
        self._status.publish(encode(self._now(), [*self._of_joints(), of_node]))

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _report(self, now: float) -> None:
        passed, self._last_report = now - self._last_report, now
        totals = self._totals()
        new = {key: count - self._before.get(key, 0) for key, count in totals.items()}
        self._before = totals
        self._faults.update(self._detector.report(new, now), now)
        of_node = self._of_node(self._values(totals, new, passed), self._counted(new))
        of_joints = [
            each._replace(name=f'{of_node.name}: {each.name}') for each in self._of_joints()
        ]
        self._diagnostics.publish(encode(self._now(), [of_node, *of_joints]))
        self._step_time = self._longest_step = 0.0

    def _of_node(self, values: Mapping[str, Any], counted: Iterable[str] = ()) -> Entry:
        """Return the entry of the node, which is never OK while nothing is estimated."""
        estimated = self.watch.estimated
        wrong = [*self._faults.present.values(), *counted]
        if not (wrong or estimated):
            wrong = [self._why_nothing()]
        level = OK if not wrong else WARN if estimated or not self._faults.present else ERROR
        name = self._node.get_fully_qualified_name()
        return Entry(level, name, name, ', '.join(wrong) or 'ok', packed(values))

    def _why_nothing(self) -> str:
        """Return why there is no estimate, where this is no fault (yet)."""
        for name, (status, why) in self.watch.statuses.items():
            said = f'{STATUS_NAMES[status]}{why and ": "}{why}'
            return f"no {self._stream.KEPT} has an estimate; '{name}' is {said}"
        return 'no input yet'

    def _values(self, totals: dict[str, int], new: dict[str, int], passed: float) -> dict[str, Any]:
        decoded = (
            new['messages_received']
            - new['messages_dropped.malformed']
            - new['messages_dropped.failed']
        )
        return {
            'rate_hz': new['messages_received'] / passed,
            **totals,
            'publishers': self._endpoints.inputs[0].publishers(),
            'step_time_mean_us': 1e6 * self._step_time / decoded if decoded else 0.0,
            'step_time_max_us': 1e6 * self._longest_step,
        }

    def _counted(self, new: dict[str, int]) -> list[str]:
        """Return the losses that were counted, as texts; no input is one of them."""
        counted = [
            f'{count} {key}'
            for key, count in new.items()
            if count and (key in LOSSES or key.partition('.')[0] in KINDS)
        ]
        if new['messages_dropped.malformed']:
            counted.insert(0, f'malformed: {self._stream.complaint[1]}')
        if not new['messages_received'] and not self._faults.present:
            measured = self._endpoints.inputs[0]
            waits = f': waits for a publisher of {measured.topic_name}'
            counted.insert(0, 'no input' + ('' if measured.subscription else waits))
        return counted

    def _totals(self) -> dict[str, int]:
        stream, bank = self._stream, self._stream.bank
        malformed, unused = sum(stream.malformed), stream.unused()
        decoded = (
            sum(
                count - bad
                for port, count, bad in zip(stream.inputs, stream.received, stream.malformed)
                if port.answered
            )
            - self._failed
        )
        samples = self._counts_of(bank.joints)
        for key, count in self._expired.items():
            samples[key] += count
        samples['received'] += bank.refused
        return {
            'messages_received': decoded + malformed + self._failed,
            'messages_used': decoded - sum(unused.values()),
            'messages_dropped.malformed': malformed,
            'messages_dropped.failed': self._failed,
            **{f'messages_dropped.{kind}': count for kind, count in unused.items()},
            **samples,
            'dropped.refused': bank.refused,
            'joints': len(bank.joints),
            'joints_expired': bank.expired,
            'lost_by_dds': sum(self._endpoints.lost.values()),
            'qos_mismatches': self._endpoints.qos_mismatches,
        }

    def _report_tracking(self, now: float) -> None:
        """Log once what is tracked, when all joints have had time to appear."""
        statuses = {name: status for name, (status, _) in self.watch.statuses.items()}
        tracked = [name for name, status in statuses.items() if status in VALID]
        passed = now - self._detector.first_input if self._detector.first_input else 0.0
        patience = JOINT_PATIENCE if len(tracked) == len(statuses) else 3.0 * JOINT_PATIENCE
        if self._reported_tracking or not tracked or passed < patience:
            return
        self._reported_tracking = True
        names, every = (list(self.watch.names_of(each)) for each in (tracked, statuses))
        some = f' of {len(every)}' if len(tracked) < len(statuses) else ''
        rate = 1.0 / (self._stream.bank.joints[tracked[0]].mean_dt or math.inf)
        shown = f'{rate:.0f}' if rate >= 10.0 else f'{rate:.3g}'
        self._node.get_logger().info(
            f'tracking {len(names)}{some} joint{"s" * (len(every) > 1)} of '
            f'{self._endpoints.inputs[0].topic_name} at {shown} Hz ({listed(names)})'
        )
