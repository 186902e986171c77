"""How a node that estimates joints is: status of each joint, diagnostics, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from time import monotonic
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.subscription import Subscription

from estimator_pkg.driver.joint import Joint
from estimator_pkg.errors import suggestion
from estimator_pkg.nodes.diagnostics import OK, WARN, counters, entry, joint_status
from estimator_pkg.nodes.endpoints import Endpoints, latched
from estimator_pkg.nodes.ros_parameters import RosParameters
from estimator_pkg.observers.contract import INITIALISING, LOST, MISCONFIGURED

DIAGNOSTICS = 1.0       # [s] between two of /diagnostics
UNHEARD_OF = 5.0        # [s] after which what never appeared is named
ALL_HERE = 1.0          # [s] after the first joint by which the others have come too
SAY_AGAIN_AFTER = 10.0  # [s] between two warnings of the same kind


class WatchedBank(Protocol):
    """What a node keeps its joints in.

    Attributes
    ----------
    configuration : gains and settings of joints, as they are set now.
    only : names of the joints to estimate; empty: every joint that appears.
    mismatched, empty : messages whose arrays did not fit, and without a position.
    """

    configuration: Any
    only: frozenset[str]
    mismatched: int
    empty: int

    @property
    def joints(self) -> Mapping[str, Joint]:
        """The joints (or mechanisms) by name."""


class Health:
    """Watches the joints of a bank by the steady clock, which runs while a simulated one rests.

    Parameters
    ----------
    node : whose health it is.
    input : the subscription that feeds the bank.

    Attributes
    ----------
    malformed : messages whose bytes were none of their type.
    """

    MISMATCH = 'their names and positions differ in number'  # what may be wrong beside malformed

    def __init__(self, node: Node, bank: WatchedBank, endpoints: Endpoints, ros: RosParameters,
                 input: Subscription) -> None:
        self._node, self._bank, self._endpoints, self._ros = node, bank, endpoints, ros
        self._input = input
        self._status = endpoints.publisher(DiagnosticArray, '~/status', latched())
        self._diagnostics = endpoints.publisher(DiagnosticArray, '/diagnostics')
        self.malformed = 0
        self._decoded = 0
        self._step_time = self._longest_step = 0.0
        self._started = self._last_report = monotonic()
        self._named_unheard = self._named_unseen = False
        self._first_input = 0.0
        self._used: dict[str, tuple[int, float]] = {}  # samples used, and when that last grew
        self._said: dict[str, tuple[int, str]] = {}    # status and why, as published
        self._warned: dict[str, float] = {}
        self._before = _Totals()
        self._publish_status()

    def took(self, seconds: float) -> None:
        """A message was decoded, estimated and answered in so much time [s]."""
        self._decoded += 1
        self._step_time += seconds
        if seconds > self._longest_step:
            self._longest_step = seconds

    def look(self) -> None:
        """Publish what has changed, and once a second the diagnostics."""
        now = monotonic()
        statuses = {name: self._judge(name, joint, now)
                    for name, joint in self._bank.joints.items()}
        changed = statuses != self._said
        for name, (status, why) in statuses.items():
            if status == MISCONFIGURED and self._said.get(name, (0, ''))[0] != MISCONFIGURED:
                self._node.get_logger().error(f"joint '{name}' is misconfigured: {why}")
        self._said = statuses
        due = now - self._last_report >= DIAGNOSTICS
        if changed or due:
            self._publish_status()
        if due:
            self._report(now)
        if not self._named_unheard and now - self._started >= UNHEARD_OF:
            self._named_unheard = True
            self._name_unheard()
        if not self._named_unseen and statuses:
            self._first_input = self._first_input or now
            if now >= max(self._started + UNHEARD_OF, self._first_input + ALL_HERE):
                self._named_unseen = True
                self._name_unseen()

    def _judge(self, name: str, joint: Joint, now: float) -> tuple[int, str]:
        """(status, why) of a joint; without a usable sample for its timeout it is lost."""
        used = joint.used
        known, since = self._used.get(name, (-1, now))
        if used != known:
            since = now
            self._used[name] = (used, now)
        if now - since > joint.settings.timeout:
            reason = self._why_silent(name)
            return LOST, (f'no usable sample for {joint.settings.timeout:g} s'
                          + (f'; {reason}' if reason else ''))
        status = joint.estimate()[3]
        return status, joint.why()

    def _why_silent(self, name: str) -> str:
        """Why there may be no usable sample of a joint, where that can be known; else ''."""
        return ''

    def _more(self, name: str) -> Mapping[str, Any]:
        """What else a joint's status tells."""
        return {}

    def _publish_status(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        for name, joint in self._bank.joints.items():
            status, why = self._said.get(name, (INITIALISING, ''))
            message.status.append(joint_status(name, joint, status, why, self._more(name)))
        self._status.publish(message)

    def _report(self, now: float) -> None:
        passed, self._last_report = now - self._last_report, now
        totals = self._totals()
        new = totals.since(self._before)
        self._before = totals
        self._warn(new)
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        name = self._node.get_fully_qualified_name()
        message.status.append(self._of_node(name, totals, new, passed))
        for joint, (status, why) in self._said.items():
            message.status.append(joint_status(f'{name}: {joint}', self._bank.joints[joint],
                                               status, why))
        self._diagnostics.publish(message)
        self._step_time = self._longest_step = 0.0

    def _of_node(self, name: str, totals: _Totals, new: _Totals, passed: float
                 ) -> DiagnosticStatus:
        decoded = new['messages_received'] - new['messages_dropped.malformed']
        values: dict[str, Any] = {
            'rate_hz': new['messages_received'] / passed, **totals,
            'publishers': self._input.get_publisher_count(),
            'step_time_mean_us': 1e6 * self._step_time / decoded if decoded else 0.0,
            'step_time_max_us': 1e6 * self._longest_step}
        wrong = [f'{new[key]} {text}' for key, text in _WRONG.items() if new[key]]
        if not new['messages_received']:
            wrong.insert(0, 'no input')
        return entry(WARN if wrong else OK, name, ', '.join(wrong) or 'ok', values)

    def _totals(self) -> _Totals:
        bank = self._bank
        received = self._decoded + self.malformed
        return _Totals({
            'messages_received': received,
            'messages_used': self._decoded - bank.empty - bank.mismatched,
            'messages_dropped.malformed': self.malformed,
            'messages_dropped.empty': bank.empty,
            'messages_dropped.mismatched': bank.mismatched,
            **counters(bank.joints),
            'resets': sum(joint.reset_count for joint in bank.joints.values()),
            'lost_by_dds': self._endpoints.lost,
            'qos_mismatches': self._endpoints.qos_mismatches})

    # Warnings

    def _warn(self, new: _Totals) -> None:
        """One line for what a person should know of, at most one of a kind in ten seconds."""
        if new['dropped.zero_stamp']:
            self._say('zero', f'messages on {self._input.topic_name} carry no time stamp and are '
                              "dropped: start the node with 'stamp_source: publisher'")
        if new['events.clock_jump']:
            self._say('jump', 'the clock of the measurements jumped (a bag that loops, a '
                              'restarted simulation): its joints start again')
        if new['messages_dropped.malformed'] or new['messages_dropped.mismatched']:
            self._say('malformed', f'messages on {self._input.topic_name} are malformed, or '
                                   f'{self.MISMATCH}: they are dropped')
        if new['lost_by_dds']:
            self._say('lost', f"{new['lost_by_dds']} messages on {self._input.topic_name} were "
                              'lost: more come than this node or the network can take')

    def _say(self, kind: str, text: str) -> None:
        now = monotonic()
        if now - self._warned.get(kind, -SAY_AGAIN_AFTER) >= SAY_AGAIN_AFTER:
            self._warned[kind] = now
            self._node.get_logger().warning(text)

    def _name_unheard(self) -> None:
        """Misspelt parameters, no input at all."""
        log = self._node.get_logger().warning
        for name, hint in self._ros.unknown().items():
            log(f"unknown parameter '{name}': {hint}")
        if not self._decoded and not self.malformed:
            log(f'nothing has been received on {self._input.topic_name} for {UNHEARD_OF:g} s; '
                f'publishers connected: {self._input.get_publisher_count()}')

    def _name_unseen(self) -> None:
        """Joints that were named and did not come with the others."""
        seen = self._bank.joints
        for joint in sorted({*self._ros.overrides, *self._bank.only} - set(seen)):
            self._node.get_logger().warning(f"joint '{joint}' was named in the parameters and "
                                            f'never seen: {suggestion(joint, seen)}')


class _Totals(dict[str, int]):
    """Counters since the start."""

    def since(self, before: _Totals) -> _Totals:
        """What was counted since `before`."""
        return _Totals({key: count - before.get(key, 0) for key, count in self.items()})


_WRONG = {'messages_dropped.malformed': 'malformed messages',
          'messages_dropped.empty': 'messages without positions',
          'messages_dropped.mismatched': 'messages whose arrays do not match',
          'dropped.duplicate': 'duplicates', 'dropped.late': 'late samples',
          'dropped.non_finite': 'samples that are not finite',
          'dropped.zero_stamp': 'samples without a stamp',
          'dropped.misconfigured': 'samples of misconfigured joints',
          'events.clock_jump': 'clock jumps', 'lost_by_dds': 'messages lost by DDS'}
