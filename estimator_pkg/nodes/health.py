# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The health of an observer node: status of each joint, diagnostics, warnings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from time import monotonic
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import suggestion
from estimator_pkg.nodes.diagnostics import (
    OK,
    WARN,
    array,
    counters,
    dropped_for,
    entry,
    joint_status,
)
from estimator_pkg.nodes.endpoints import Endpoints, Input, latched
from estimator_pkg.nodes.ros_parameters import RosParameters
from estimator_pkg.observers.contract import INITIALISING, LOST, MISCONFIGURED
from estimator_pkg.streams.contract import Stream

DIAGNOSTICS = 1.0  # time between two messages on /diagnostics [s]
INPUT_PATIENCE = 5.0  # time after which missing inputs are reported [s]
JOINT_PATIENCE = 1.0  # time after the first joint in which the others appear too [s]
WARNING_PERIOD = 10.0  # time between two warnings of the same kind [s]
NAMED = 5  # largest number of joints in a warning


class Health:
    """Watches the joints of a bank by the steady clock, which runs while simulated time is paused.

    Parameters
    ----------
    node : the node.
    stream : its stream.

    Attributes
    ----------
    input : the input of the measurement; set after its creation.
    WRONG : description of each problem, by the name of its counter.
    """

    WRONG: ClassVar[Mapping[str, str]] = {
        'messages_dropped.empty': 'messages without positions',
        'messages_dropped.mismatched': 'messages whose arrays do not match',
        'messages_dropped.failed': 'messages on which the observer failed',
        'dropped.duplicate': 'duplicates',
        'dropped.late': 'late samples',
        'dropped.non_finite': 'samples that are not finite',
        'dropped.zero_stamp': 'samples without a stamp',
        'dropped.misconfigured': 'samples of misconfigured joints',
        'dropped.repeated': 'repeated readings',
        'events.outage': 'outages',
        'events.clock_jump': 'clock jumps',
        'events.stray_stamp': 'stamps far in the future',
        'dropped.refused': 'samples of new joints beyond joints_max (name the required joints '
        'in joints, or raise joints_max)',
        'joints_expired': 'joints that were removed after expiry',
        'lost_by_dds': 'messages lost by DDS',
    }

    input: Input

    def __init__(
        self, node: Node, stream: Stream, endpoints: Endpoints, ros: RosParameters
    ) -> None:
        self._node, self._stream, self._endpoints, self._ros = node, stream, endpoints, ros
        self._wrong = {**self.WRONG, **stream.WRONG}
        self._status = endpoints.publisher(DiagnosticArray, '~/status', latched())
        self._diagnostics = endpoints.publisher(DiagnosticArray, '/diagnostics')
        self._failed = 0
        self._step_time = self._longest_step = 0.0
        self._started = self._last_report = monotonic()
        self._reported_unknown = self._reported_missing = False
        self._reported: set[str] = set()  # texts about topics without messages
        self._first_input = 0.0
        # used samples; time of their last increase, and the number of received ones then
        self._used: dict[str, tuple[int, float, int]] = {}
        self._alive: set[str] = set()  # joints that are not lost
        self._expired: dict[str, int] = {}  # counters of expired joints
        self._lost: Mapping[str, int] = {}  # by topic
        self._published: dict[str, tuple[int, str]] = {}  # published status and reason
        self._warned: dict[str, float] = {}
        self._before = _Totals()
        self._publish_status()

    def took(self, seconds: float) -> None:
        """Count the time that decoding, estimating and answering a message took [s]."""
        self._step_time += seconds
        if seconds > self._longest_step:
            self._longest_step = seconds

    def failed(self, topic: str, why: str) -> None:
        """Report an exception of the observer on a message; the joints are reset."""
        self._failed += 1
        self._warn_about(
            'failed',
            f'the observer failed on a message of {topic}, and all '
            f'{self._stream.KEPT}s are reset: {why}',
            severe=True,
        )

    def look(self) -> None:
        """Publish changes, and once a second the diagnostics."""
        now = monotonic()
        due = now - self._last_report >= DIAGNOSTICS
        if due:
            self._expire(now)
        joints, published = self._stream.bank.joints, self._published
        # A lost joint stays lost until a sample arrives: only the others are checked ten times a
        # second, and all of them once a second.
        touched = self._stream.bank.touched()
        names = set(joints) if due or len(joints) != len(published) else self._alive.union(touched)
        new = {name: self._judge(name, joints[name], now) for name in names}
        changed = {
            name: new[name]
            for name in (joints if len(new) == len(joints) else sorted(new))
            if published.get(name) != new[name]
        }
        self._alive.update(name for name in changed if new[name][0] != LOST)
        self._alive.difference_update(name for name in changed if new[name][0] == LOST)
        if changed:
            self._report_changes(changed)
            published.update(changed)
        if changed or due:
            self._publish_status()
        if due:
            self._report(now)
            if now - self._started >= INPUT_PATIENCE:
                self._report_unknown_parameters()
                self._report_missing_input()
        if not self._reported_missing and published:
            self._first_input = self._first_input or now
            if now >= max(self._started + INPUT_PATIENCE, self._first_input + JOINT_PATIENCE):
                self._reported_missing = True
                self._report_missing_joints()

    def _expire(self, now: float) -> None:
        """Remove joints that had no sample for the stream's `expiry`."""
        expiry = getattr(self._stream.settings, 'expiry', 0.0)
        bank = self._stream.bank
        old = (
            [
                name
                for name, (_, since, _) in self._used.items()
                if now - since > expiry and not bank.named(name)
            ]
            if expiry > 0.0
            else []
        )
        if old:
            counts = self._counts_of(old)
            if not self._stream.expire(old):
                return
            for key, count in counts.items():
                self._expired[key] = self._expired.get(key, 0) + count
            for kept in (self._used, self._published):
                for name in old:
                    kept.pop(name, None)
            self._alive.difference_update(old)
            more = f' and {len(old) - NAMED} more' if len(old) > NAMED else ''
            named = ', '.join(map(repr, old[:NAMED]))
            self._warn_about(
                'expired',
                f'{self._stream.KEPT} {named}{more}: no sample for {expiry:g} s, removed (expiry)',
            )

    def _counts_of(self, names: Iterable[str]) -> dict[str, int]:
        joints = {name: self._stream.bank.joints[name] for name in names}
        return {**counters(joints), 'resets': sum(each.reset_count for each in joints.values())}

    def _judge(self, name: str, joint: Joint, now: float) -> tuple[int, str]:
        """Return (status, why) of a joint; it is lost after too long without a usable sample."""
        status = joint.estimate()[3]
        if self._stream.always_awake(name):
            return status, joint.why()
        # a misconfigured joint uses no sample: it is lost when none arrives
        used, received = joint.received if status == MISCONFIGURED else joint.used, joint.received
        known, since, before = self._used.get(name, (-1, now, 0))
        if used != known:
            since, before = now, received
            self._used[name] = (used, now, received)
        if now - since > joint.silence:
            reason = self._stream.why_silent(name)
            if not reason and received > before:
                reason = dropped_for(joint.verdict)
            return LOST, (
                f'no usable sample for {joint.silence:.3g} s' + (f'; {reason}' if reason else '')
            )
        return status, joint.why()

    def _publish_status(self) -> None:
        self._status.publish(
            array(
                self._node,
                (
                    joint_status(
                        name,
                        joint,
                        *self._published.get(name, (INITIALISING, '')),
                        self._stream.about(name),
                    )
                    for name, joint in self._stream.bank.joints.items()
                ),
            )
        )

    def _report(self, now: float) -> None:
        passed, self._last_report = now - self._last_report, now
        totals = self._totals()
        new = totals.since(self._before)
        self._before = totals
        self._warn_of_faults(new)
        name = self._node.get_fully_qualified_name()
        self._diagnostics.publish(
            array(
                self._node,
                (
                    self._of_node(name, totals, new, passed),
                    *(
                        joint_status(
                            f'{name}: {joint}', self._stream.bank.joints[joint], status, why
                        )
                        for joint, (status, why) in self._published.items()
                    ),
                ),
            )
        )
        self._step_time = self._longest_step = 0.0

    def _of_node(self, name: str, totals: _Totals, new: _Totals, passed: float) -> DiagnosticStatus:
        decoded = (
            new['messages_received']
            - new['messages_dropped.malformed']
            - new['messages_dropped.failed']
        )
        values: dict[str, Any] = {
            'rate_hz': new['messages_received'] / passed,
            **totals,
            'publishers': self.input.publishers(),
            'step_time_mean_us': 1e6 * self._step_time / decoded if decoded else 0.0,
            'step_time_max_us': 1e6 * self._longest_step,
        }
        wrong = [f'{new[key]} {text}' for key, text in self._wrong.items() if new.get(key)]
        if new['messages_dropped.malformed']:
            wrong.insert(
                0,
                f'{new["messages_dropped.malformed"]} malformed messages '
                f'({self._stream.complaint[1]})',
            )
        if not new['messages_received']:
            wrong.insert(
                0,
                'no input'
                if self.input.subscription
                else f'no input: waits for a publisher of {self.input.topic_name}',
            )
        return entry(WARN if wrong else OK, name, ', '.join(wrong) or 'ok', values)

    def _totals(self) -> _Totals:
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
        return _Totals(
            {
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
        )

    # Warnings

    def _warn_of_faults(self, new: _Totals) -> None:
        """Log problems for the user, each kind at most once in ten seconds."""
        topic = self.input.topic_name
        if new['dropped.zero_stamp']:
            self._warn_about(
                'zero',
                f'{new["dropped.zero_stamp"]} samples on {topic} have no time stamp '
                f'and are dropped: {self._stream.NO_STAMP}',
            )
        if new['events.clock_jump']:
            publishers = self.input.publishers()
            several = f', {publishers} publishers whose clocks differ' if publishers > 1 else ''
            self._warn_about(
                'jump',
                'the clock of the measurements jumped (a looping bag, a restarted '
                f'simulation{several}): its {self._stream.KEPT}s are reset',
            )
        if new['messages_dropped.malformed']:
            where, why = self._stream.complaint
            self._warn_about('malformed', f'messages on {where} are malformed and dropped: {why}')
        if new.get('messages_dropped.mismatched'):
            self._warn_about(
                'mismatched', f'messages on {topic} are dropped: {self._stream.MISMATCH}'
            )
        if new['dropped.refused']:
            bank: Any = self._stream.bank
            self._warn_about(
                'refused',
                f'{new["dropped.refused"]} samples on {topic} are beyond '
                f"joints_max (newest name: '{bank.refused_name}'; "
                f'{len(bank.joints)} joints exist): name the required joints in '
                "'joints', or raise 'joints_max'",
            )
        before, self._lost = self._lost, self._endpoints.lost
        where = ' and '.join(
            each for each, count in self._lost.items() if count > before.get(each, 0)
        )
        if where:
            self._warn_about(
                'lost',
                f'{new["lost_by_dds"]} messages on {where} were lost: their rate is too high for '
                'this node or the network, or they were sent before the '
                'connection was complete',
            )

    def _report_changes(self, statuses: Mapping[str, tuple[int, str]]) -> None:
        """Log joints that have become misconfigured, or whose samples are all dropped."""
        lost: dict[str, list[str]] = {}
        for name, (status, why) in statuses.items():
            if status == self._published.get(name, (INITIALISING, ''))[0]:
                continue
            if status == MISCONFIGURED:
                self._node.get_logger().error(
                    f"{self._stream.KEPT} '{name}' is misconfigured: {why}"
                )
            if status == LOST and ';' in why:  # with a reason beyond silence
                lost.setdefault(why, []).append(f"'{name}'")
        for why, names in lost.items():
            more = f' and {len(names) - NAMED} more' if len(names) > NAMED else ''
            self._warn_about(why, f'{self._stream.KEPT} {", ".join(names[:NAMED])}{more}: {why}')

    def _warn_about(self, kind: str, text: str, *, severe: bool = False) -> None:
        now = monotonic()
        if now - self._warned.get(kind, -math.inf) >= WARNING_PERIOD:
            self._warned[kind] = now
            if severe:
                self._node.get_logger().error(text)
            else:
                self._node.get_logger().warning(text)

    def _report_unknown_parameters(self) -> None:
        """Log unknown parameters, once."""
        if not self._reported_unknown:
            self._reported_unknown = True
            for name, hint in self._ros.unknown().items():
                self._node.get_logger().warning(f"unknown parameter '{name}': {hint}")

    def _report_missing_input(self) -> None:
        """Log missing input, or publishers of another type, whenever this changes."""
        texts = self._endpoints.of_other_types()
        if not sum(self._stream.received):
            texts.append(
                f'no message has been received on {self.input.topic_name} yet; connected '
                f'publishers: {self.input.publishers()}'
            )
        for text in texts:
            if text not in self._reported:
                self._reported.add(text)
                self._node.get_logger().warning(text)

    def _report_missing_joints(self) -> None:
        """Log joints that were named in the parameters but have not appeared."""
        seen = self._stream.bank.joints
        for joint in sorted({*self._ros.overrides, *self._stream.bank.only} - set(seen)):
            self._node.get_logger().warning(
                f"{self._stream.KEPT} '{joint}' is named in the parameters but did not appear: "
                f'{suggestion(joint, seen)}'
            )


class _Totals(dict[str, int]):
    """Counters since the start."""

    def since(self, before: _Totals) -> _Totals:
        """Return the increase since `before`."""
        return _Totals({key: count - before.get(key, 0) for key, count in self.items()})
