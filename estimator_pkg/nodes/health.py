# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The health of an observer node: status of each joint, diagnostics, warnings."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from time import monotonic
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from estimator_pkg.driver.guard import DUPLICATE, VERDICTS, ZERO_STAMP
from estimator_pkg.driver.joint import Joint
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes import faults
from estimator_pkg.nodes.diagnostics import (
    ERROR,
    OK,
    WARN,
    array,
    counters,
    dropped_for,
    entry,
    joint_status,
)
from estimator_pkg.nodes.endpoints import UNNAMED_PUBLISHER, Endpoints, Input, latched
from estimator_pkg.nodes.faults import Faults, listed, of_joints, say
from estimator_pkg.nodes.ros_parameters import RosParameters
from estimator_pkg.observers.contract import INITIALISING, LOST, MISCONFIGURED, STATUS_NAMES, VALID
from estimator_pkg.streams.contract import PUBLISHER, Stream

DIAGNOSTICS = 1.0  # time between two messages on /diagnostics [s]
INPUT_PATIENCE = 2.5  # time after the start in which publishers appear [s]
JOINT_PATIENCE = 1.0  # time after the first joint in which the others appear too [s]
CLOCKS_DIFFER = 1.0  # smaller distances of stamps from the clock are latency [s]
OFTEN = 0.05  # fraction of dropped samples that is reported
LOSSES = 5  # seconds that are searched for lost messages,
LASTING = 3  # and those of them in which messages were lost, if the loss is reported
RATE_CHANGE = 0.2  # relative change of a rate that is reported,
RATE_AGREES = 0.1  # if two measurements of the new one differ by less than this
RATE_SAMPLES = 4  # samples of one measurement at least
ELSEWHERE = (
    'zero_stamp',
    'duplicate',
    'repeated',
)  # reasons of drops that are faults by themselves
RECENT = 5.0  # age of names that a topic carries [s]
NEW_CLOCK = 1.0  # simulated time before which samples may have the stamp 0 [s]


class Health:
    """Watches the joints of a bank by the steady clock, which runs while simulated time is paused.

    Parameters
    ----------
    node : the node.
    stream : its stream.

    Attributes
    ----------
    inputs : the inputs by port, the measurement first; set after their creation.
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

    inputs: list[Input]

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
        self._reported_unknown = False
        self._first_input = 0.0
        self._faults = Faults(lambda text: self._node.get_logger().warning(text))
        self._suspected: dict[str, str] = {}  # by others; seen twice in a row they are faults
        self._seen: set[str] = set()  # needed names that messages of the measurement have had
        # received messages by port, and when their number last grew
        self._arrivals = [(0, self._started)] * len(stream.inputs)
        self._patience = DIAGNOSTICS  # longest pause of the messages that is no outage [s]
        self._silent: dict[str, float] = {}  # joints whose samples ended; since when
        self._returned: dict[str, float] = {}  # joints that are back; length of the outage [s]
        self._offset = math.inf  # least distance of stamps from the clock since the report [s]
        self._often: set[str] = set()  # kinds of drops that were often at the last report
        self._losses: deque[tuple[int, int]] = deque(maxlen=LOSSES)
        self._rates: dict[str, _Rate] = {}
        self._good_news = False
        self._clock_ran = False  # simulated time was beyond NEW_CLOCK
        # used samples; time of their last increase, and the number of received ones then
        self._used: dict[str, tuple[int, float, int]] = {}
        self._alive: set[str] = set()  # joints that are not lost
        self._expired: dict[str, int] = {}  # counters of expired joints
        self._published: dict[str, tuple[int, str]] = {}  # published status and reason
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
        self._faults.begin(
            'failed',
            f'the observer failed on a message of {topic}, and all '
            f'{self._stream.KEPT}s are reset: {why}',
            monotonic(),
            self._node.get_logger().error,
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
        self._note_arrivals(now)
        self._measure_offset(now)
        if not self._first_input and any(self._stream.received):
            self._first_input = now
        if changed:
            self._report_changes(changed)
            published.update(changed)
        if self._returned:
            subject = of_joints(list(self._returned), self._stream.KEPT, ('is', 'are'))
            self._report_return(0, subject, max(self._returned.values()), now)
            self._returned.clear()
        if due:
            self._report(now)
            self._report_tracking(now)
            if now - self._started >= INPUT_PATIENCE:
                self._report_unknown_parameters()
        if changed or due:
            self._publish_status()

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
            for kept in (self._used, self._published, self._silent, self._rates):
                for name in old:
                    kept.pop(name, None)
            self._alive.difference_update(old)
            self._faults.begin(
                'expired',
                f'{self._stream.KEPT} {listed(old, chr(39))}: no sample for {expiry:g} s, removed '
                '(expiry)',
                now,
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
            if name in self._silent:
                self._returned[name] = now - self._silent.pop(name)
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
                    *(
                        joint_status(
                            name,
                            joint,
                            *self._published.get(name, (INITIALISING, '')),
                            self._stream.about(name),
                        )
                        for name, joint in self._stream.bank.joints.items()
                    ),
                    self._of_node({'faults': len(self._faults.present)}),
                ),
            )
        )

    def _report(self, now: float) -> None:
        passed, self._last_report = now - self._last_report, now
        totals = self._totals()
        new = totals.since(self._before)
        self._before = totals
        self._faults.update(self._present(totals, new, now), now)
        name = self._node.get_fully_qualified_name()
        self._diagnostics.publish(
            array(
                self._node,
                (
                    self._of_node(self._values(totals, new, passed), self._counted(new)),
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

    def _of_node(self, values: Mapping[str, Any], counted: Iterable[str] = ()) -> DiagnosticStatus:
        """Return the entry of the node, which is never OK while nothing is estimated."""
        statuses = [status for status, _ in self._published.values()]
        estimated = any(status in VALID for status in statuses)
        wrong = [*self._faults.present.values(), *counted]
        if not (wrong or estimated):
            wrong = [self._why_nothing()]
        level = OK if not wrong else WARN if estimated or not self._faults.present else ERROR
        name = self._node.get_fully_qualified_name()
        return entry(level, name, ', '.join(wrong) or 'ok', values)

    def _why_nothing(self) -> str:
        """Return why there is no estimate, where this is no fault (yet)."""
        for name, (status, why) in self._published.items():
            said = f'{STATUS_NAMES[status]}{why and ": "}{why}'
            return f"no {self._stream.KEPT} has an estimate; '{name}' is {said}"
        return 'no input yet'

    def _values(self, totals: _Totals, new: _Totals, passed: float) -> dict[str, Any]:
        decoded = (
            new['messages_received']
            - new['messages_dropped.malformed']
            - new['messages_dropped.failed']
        )
        return {
            'rate_hz': new['messages_received'] / passed,
            **totals,
            'publishers': self.inputs[0].publishers(),
            'step_time_mean_us': 1e6 * self._step_time / decoded if decoded else 0.0,
            'step_time_max_us': 1e6 * self._longest_step,
        }

    def _counted(self, new: _Totals) -> list[str]:
        """Return the counters that grew, as texts; no input is one of them."""
        counted = [f'{new[key]} {text}' for key, text in self._wrong.items() if new.get(key)]
        if new['messages_dropped.malformed']:
            why = self._stream.complaint[1]
            counted.insert(0, f'{new["messages_dropped.malformed"]} malformed messages ({why})')
        if not new['messages_received'] and not self._faults.present:
            topic = self.inputs[0].topic_name
            counted.insert(
                0,
                'no input'
                if self.inputs[0].subscription
                else f'no input: waits for a publisher of {topic}',
            )
        return counted

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

    # Faults

    def _present(self, totals: _Totals, new: _Totals, now: float) -> dict[str, str]:
        """Return the faults that are present, as texts by kind."""
        found = self._of_graph(now)
        found.update(self._of_names(now))
        found.update(self._of_silence(now))
        found.update(self._of_messages(new))
        if 'missing' in found:  # this is why
            found.pop('mismatched', None)
        mixed = any(kind.startswith('twice') for kind in found)
        found.update(self._of_stamps(new, mixed))
        self._find_rates(new, now, mixed)
        return found

    def _of_graph(self, now: float) -> dict[str, str]:
        """Return faults among publishers and subscribers, once two reports have seen them."""
        suspected = self._endpoints.faults()
        for port, each in enumerate(self.inputs):
            if each.found and not self._stream.received[port] and not each.optional:
                who = listed(each.found)
                suspected[f'mute {each.topic_name}'] = say('mute', who=who, topic=each.topic_name)
        before, self._suspected = self._suspected, suspected
        if now - self._started < INPUT_PATIENCE:
            return {}
        heard = [each for port, each in enumerate(self.inputs) if self._stream.received[port]]
        ended = {f'nobody {each.topic_name}' for each in heard}  # reported as silence
        return {
            kind: text for kind, text in suspected.items() if kind in before and kind not in ended
        }

    def _of_names(self, now: float) -> dict[str, str]:
        """Return joints that are not in the messages, and those that several publishers send."""
        stream, found = self._stream, {}
        for port, each in enumerate(self.inputs):
            several = len(each.found) > 1 and not each.optional
            if port == 0:
                joints = stream.bank.joints
                needed = stream.needed() - self._seen
                came = {name for name in needed if name in joints and joints[name].received}
                self._seen |= came | needed.intersection(each.senders.names)
                missing = sorted(needed - self._seen)
            watched = several or (port == 0 and bool(missing or self._silent))
            if not watched and each.watched:
                each.senders.forget()
            each.watched = watched
            twice = each.senders.twice(now)
            unnamed = UNNAMED_PUBLISHER in each.found and not each.unnamed
            each.unnamed = UNNAMED_PUBLISHER in each.found
            if several and twice and not unnamed:
                verb = ('comes', 'come')
                names = of_joints(twice, 'joint', verb) if any(twice) else 'messages come'
                who = faults.publishers(sorted(each.found))
                found[f'twice {each.topic_name}'] = say(
                    'twice', names=names, topic=each.topic_name, who=who
                )
        if missing and self._first_input and now - self._first_input >= JOINT_PATIENCE:
            found['missing'] = self._absent(missing, now, "set 'joints' to names of the topic")
        return found

    def _absent(self, missing: list[str], now: float, otherwise: str) -> str:
        each = self.inputs[0]
        carried = each.senders.recent(now - RECENT) or set(self._stream.bank.joints)
        return faults.absent(missing, each.topic_name, carried, otherwise)

    def _note_arrivals(self, now: float) -> None:
        """Note which inputs have new messages, and report those that are back."""
        received = self._stream.received
        for port, (count, since) in enumerate(self._arrivals):
            if received[port] > count:
                self._arrivals[port] = received[port], now
                each = self.inputs[port]
                if count and not each.optional and now - since > self._patience:
                    self._report_return(port, 'the messages are', now - since, now)

    def _report_return(self, port: int, subject: str, outage: float, now: float) -> None:
        """Report what is back, with the length of the outage [s]."""
        each = self.inputs[port]
        self._faults.begin(
            f'back {each.topic_name}',
            say('back', subject=subject, topic=each.topic_name, passed=outage),
            now,
        )

    def _of_silence(self, now: float) -> dict[str, str]:
        """Return the inputs whose messages ended, and the joints that are in none any more."""
        joints, found = self._stream.bank.joints, {}
        patience = max([DIAGNOSTICS, *(joint.silence for joint in joints.values())])
        self._patience = patience
        for (count, since), each in zip(self._arrivals, self.inputs):
            if not count or each.optional or now - since <= patience:
                continue
            what = f'no message on {each.topic_name}'
            found[f'silent {each.topic_name}'] = self._ended(each, what, since, now)
        if found:
            return found
        _, arrived = self._arrivals[0]
        for name, (_, since, before) in self._used.items():
            lost = before and self._published.get(name, (INITIALISING, ''))[0] == LOST
            if lost and before == joints[name].received and arrived - since > joints[name].silence:
                self._silent.setdefault(name, since)
        measured = self.inputs[0]
        carried = measured.senders.recent(now - patience)
        gone = sorted(set(self._names_of(self._silent)) - carried)
        if gone and carried:
            what = f'no sample of {listed(gone, chr(39))} on {measured.topic_name}'
            ended = self._ended(measured, what, max(self._silent.values()), now)
            found['silent'] = (
                ended if 'ended;' in ended else self._absent(gone, now, 'check its publisher')
            )
        return found

    def _ended(self, each: Input, what: str, since: float, now: float) -> str:
        """Return the text about an input, or some joints of it, that came until `since`."""
        left = sorted(name for name, when in each.left.items() if when > since - DIAGNOSTICS)
        kind = 'ended' if left or not each.found else 'silent'
        who = listed(left or each.found) or 'its publisher'
        return say(kind, what=what, passed=now - since, who=who)

    def _of_messages(self, new: _Totals) -> dict[str, str]:
        """Return faults of whole messages: those that are dropped or lost."""
        stream, topic, found = self._stream, self.inputs[0].topic_name, {}
        if new['messages_dropped.malformed']:
            where, why = stream.complaint
            found['malformed'] = say('malformed', topic=where, why=why)
        if new.get('messages_dropped.mismatched'):
            found['mismatched'] = say('mismatched', topic=topic, why=stream.MISMATCH)
        if new['dropped.refused']:
            bank: Any = stream.bank
            found['refused'] = say(
                'refused',
                count=new['dropped.refused'],
                topic=topic,
                name=bank.refused_name,
                joints=len(bank.joints),
            )
        lost = self._endpoints.lost
        self._losses.append((new['lost_by_dds'], new['messages_received']))
        if sum(count > 0 for count, _ in self._losses) >= LASTING:
            count, came = (sum(each[k] for each in self._losses) for k in (0, 1))
            where = ' and '.join(each for each, total in lost.items() if total)
            found['lost'] = say(
                'lost', count=count, sent=count + came, topic=where, passed=len(self._losses)
            )
        return found

    def _of_stamps(self, new: _Totals, mixed: bool) -> dict[str, str]:
        """Return faults of stamps and readings.

        Parameters
        ----------
        mixed : several publishers send the same joint, which explains the rest.
        """
        node, stream, topic = self._node, self._stream, self.inputs[0].topic_name
        source = getattr(stream.settings, 'stamp_source', PUBLISHER)
        header = source != PUBLISHER and self.inputs[0].type == JOINT_STATE
        found = {}
        simulated = node.get_parameter('use_sim_time').value
        clock = node.get_clock().now().nanoseconds * 1e-9
        ran, self._clock_ran = self._clock_ran, simulated and clock > NEW_CLOCK
        if new['dropped.zero_stamp'] and (ran or not simulated):
            count = new['dropped.zero_stamp']
            found['zero_stamp'] = say(
                'zero_stamp', count=count, topic=topic, remedy=stream.NO_STAMP
            )
        offset, self._offset = self._offset, math.inf
        if simulated and not node.count_publishers(node.resolve_topic_name('/clock')):
            if self._last_report - self._started >= INPUT_PATIENCE:
                found['no_clock'] = say('no_clock')
        elif CLOCKS_DIFFER < abs(offset) < math.inf and not (mixed or (simulated and not ran)):
            found['clock'] = say(
                'clock',
                topic=topic,
                offset=faults.distance(offset),
                clock='simulated time' if simulated else 'system time',
                remedy='check the clock of its publisher'
                + (", set 'stamp_source: publisher'" if header else '')
                + ('' if simulated else ', or set use_sim_time for a bag or a simulation'),
            )
        often = set()
        for kind in ('duplicate', 'late', 'repeated'):
            if new[f'dropped.{kind}'] <= OFTEN * new['received']:
                continue
            often.add(kind)
            if kind in self._often and not mixed:
                found[kind] = say(
                    kind,
                    count=new[f'dropped.{kind}'],
                    received=new['received'],
                    topic=topic,
                    remedy=", or set 'stamp_source: publisher'" if header else '',
                )
        self._often = often
        if new['events.clock_jump'] and not mixed:
            publishers = self.inputs[0].publishers()
            several = f', {publishers} publishers whose clocks differ' if publishers > 1 else ''
            self._faults.begin(
                'jump', say('jump', several=several, kept=stream.KEPT), self._last_report
            )
        return found

    def _measure_offset(self, now: float) -> None:
        """Compare the stamps of new samples with the clock."""
        joints = self._stream.bank.joints
        fresh = [name for name, (used, since, _) in self._used.items() if used and since == now]
        if fresh and getattr(self._stream.settings, 'stamp_source', '') != PUBLISHER:
            clock_ns = self._node.get_clock().now().nanoseconds
            offsets = [1e-9 * (joints[name].stamp_ns - clock_ns) for name in fresh]
            self._offset = min(self._offset, *offsets, key=abs)

    def _find_rates(self, new: _Totals, now: float, mixed: bool) -> None:
        """Report rates that changed; losses and gaps are reported elsewhere."""
        holes = ('events.outage', 'events.gap', 'events.clock_jump', 'events.stray_stamp')
        holed = mixed or new['lost_by_dds'] or any(new[kind] for kind in holes)
        changed = []
        for name, joint in self._stream.bank.joints.items():
            rate = self._rates.setdefault(name, _Rate())
            counts = joint.counts
            count = sum(counts) - counts[DUPLICATE] - counts[ZERO_STAMP]
            change = rate.measure(count, joint.last_ns, bool(holed))
            if change:
                changed.append(change)
        if changed:
            before, after = map(faults.rounded, changed[0])
            self._faults.begin(
                'rate',
                say('rate', topic=self.inputs[0].topic_name, before=before, after=after),
                now,
            )

    def _report_tracking(self, now: float) -> None:
        """Log once what is tracked, when all joints have had time to appear."""
        if self._good_news or not self._first_input:
            return
        statuses = {name: status for name, (status, _) in self._published.items()}
        tracked = [name for name, status in statuses.items() if status in VALID]
        passed = now - self._first_input
        if not tracked or passed < JOINT_PATIENCE:
            return
        if len(tracked) < len(statuses) and passed < 3.0 * JOINT_PATIENCE:
            return
        names = list(self._names_of(tracked))
        measured = [self._rates[name].newest for name in tracked if name in self._rates]
        rate = max(measured, default=0.0)
        if not rate:
            if passed < 3.0 * JOINT_PATIENCE:
                return
            rate = 1.0 / (self._stream.bank.joints[tracked[0]].mean_dt or math.inf)
        some = f' of {len(list(self._names_of(statuses)))}' if len(tracked) < len(statuses) else ''
        self._good_news = True
        self._node.get_logger().info(
            f'tracking {len(names)}{some} joint{"s" * (len(names) > 1 or bool(some))} of '
            f'{self.inputs[0].topic_name} at {faults.rounded(rate)} Hz ({listed(names)})'
        )

    def _names_of(self, kept: Iterable[str]) -> Iterator[str]:
        return (joint for name in kept for joint in self._stream.names_of(name))

    def _report_changes(self, statuses: Mapping[str, tuple[int, str]]) -> None:
        """Log joints that have become misconfigured, or whose samples are all dropped."""
        lost: dict[str, list[str]] = {}
        for name, (status, why) in statuses.items():
            before, reason = self._published.get(name, (INITIALISING, ''))
            if status == before and (status != LOST or ';' in reason):
                continue  # a lost joint may be silent first; then its samples are dropped
            if status == MISCONFIGURED:
                self._node.get_logger().error(
                    f"{self._stream.KEPT} '{name}' is misconfigured: {why}"
                )
            verdict = self._stream.bank.joints[name].verdict
            if status == LOST and ';' in why and VERDICTS[verdict] not in ELSEWHERE:
                lost.setdefault(why, []).append(name)
        for why, names in lost.items():
            text = f'{self._stream.KEPT} {listed(names, chr(39))}: {why}'
            self._faults.begin(f'lost {why}', text, monotonic())

    def _report_unknown_parameters(self) -> None:
        """Log unknown parameters, once."""
        if not self._reported_unknown:
            self._reported_unknown = True
            for name, hint in self._ros.unknown().items():
                self._node.get_logger().warning(f"unknown parameter '{name}': {hint}")


class _Rate:
    """The rate of a joint's samples by their stamps, measured again and again.

    Attributes
    ----------
    newest : the newest measurement [Hz]; 0: none.
    """

    def __init__(self) -> None:
        self._count, self._last_ns = 0, 0
        self._rate = self.newest = 0.0

    def measure(self, count: int, last_ns: int, holed: bool) -> tuple[float, float] | None:
        """Return the rates (before, after) a change, else None.

        Parameters
        ----------
        count, last_ns : number of samples so far, and the newest stamp [ns].
        holed : samples are missing since the last call.
        """
        new, passed = count - self._count, 1e-9 * (last_ns - self._last_ns)
        if not self._count or holed or passed < 0.0:
            self._count, self._last_ns, self.newest = count, last_ns, 0.0
            return None
        if new < RATE_SAMPLES or passed <= 0.0:
            return None
        self._count, self._last_ns = count, last_ns
        rate, candidate = new / passed, self.newest
        self.newest = rate
        if abs(rate - candidate) > RATE_AGREES * rate:
            return None
        before = self._rate
        if before and abs(rate - before) <= RATE_CHANGE * before:
            return None
        self._rate = rate
        return (before, rate) if before else None


class _Totals(dict[str, int]):
    """Counters since the start."""

    def since(self, before: _Totals) -> _Totals:
        """Return the increase since `before`."""
        return _Totals({key: count - before.get(key, 0) for key, count in self.items()})
