# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""How the faults of a node are found: a method for each row of the table."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

from rclpy.node import Node

from estimator_pkg.errors import suggestion
from estimator_pkg.estimate import MISCONFIGURED, STATUS_NAMES
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes.endpoints import Endpoints, Input
from estimator_pkg.nodes.faults import FAULTS, HARMLESS, Fault, Values, called, listed
from estimator_pkg.nodes.graph import Graph
from estimator_pkg.nodes.joints import JointWatch
from estimator_pkg.sensor.faults import STOPPED
from estimator_pkg.streams.contract import PUBLISHER, Stream, stamp_remedy

INPUT_PATIENCE = 2.5  # time after the start in which publishers appear [s]
JOINT_PATIENCE = 1.0  # time after the first joint in which the others appear too [s]
PAUSE = 1.0  # longest pause of the messages that is no outage, whatever their rate [s]
CLOCKS_DIFFER = 1.0  # smaller distances of stamps from the clock are latency [s]
OFTEN = 0.05  # fraction of dropped samples that is reported
LOSSES = 5  # seconds that are searched for lost messages,
LASTING = 3  # and those of them in which messages were lost, if the loss is reported
RECENT = 5.0  # age of names that a topic carries [s]
SILENCE = 4.0  # time without an estimate that is reported [s],
MESSAGES = 8  # if so many messages have come in it: a slow stream takes longer to start
NEW_CLOCK = 1.0  # simulated time before which samples may have the stamp 0 [s]


class Detector:
    """Finds the faults of a node.

    The method of a row yields the values of its text for each fault; `key` distinguishes several.

    Parameters
    ----------
    node, stream, endpoints : of the node. watch : statuses of its joints.
    started : when the node started, by `monotonic` [s].

    Attributes
    ----------
    first_input : when the first message was seen, by `monotonic` [s]; 0: none has come.
    events : what the node has noted for a row since the last report: values by the row's name.
    """

    def __init__(
        self, node: Node, stream: Stream, endpoints: Endpoints, watch: JointWatch, started: float
    ) -> None:
        self._node, self._stream, self._watch = node, stream, watch
        self._endpoints, self._inputs = endpoints, endpoints.inputs
        self._graph, self._started, self._now = Graph(node, endpoints, started), started, started
        self.first_input = 0.0
        self.events: dict[str, list[Values]] = {}
        self._new: Mapping[str, int] = {}  # increase of the node's counters since the last report
        self._wrong: dict[str, list[Values]] = {}  # of the graph
        self._rows: set[str] = set()  # that have been found in this report
        self._suspected: set[str] = set()  # kinds of faults that the last report has found
        self._seen: set[str] = set()  # needed names that messages of the measurement have had
        # received messages by port, and when their number last grew
        self._arrivals = [(0, started)] * len(stream.inputs)
        self._patience = PAUSE  # longest pause of the messages that is no outage [s]
        self._offset = math.inf  # least distance of stamps from the clock since the report [s]
        self._losses: deque[tuple[int, int]] = deque(maxlen=LOSSES)
        self._without_estimate = started, 0  # since when, and received messages then
        self._estimated = False  # True after the first estimate

    def note(self, row: str, **values: Any) -> None:
        """Note an event for the next report."""
        self.events.setdefault(row, []).append(values)

    def look(self, now: float) -> None:
        """Note what has arrived; to be called often."""
        stream, used = self._stream, self._watch.used
        for port, (count, _) in enumerate(self._arrivals):
            if stream.received[port] > count:
                self._arrivals[port] = stream.received[port], now
        if not self.first_input and any(stream.received):
            self.first_input = now
        if self._watch.estimated:
            self._without_estimate, self._estimated = (now, stream.received[0]), True
        fresh = [name for name, (count, since, _) in used.items() if count and since == now]
        if fresh and getattr(stream.settings, 'stamp_source', '') != PUBLISHER:
            clock_ns = self._node.get_clock().now().nanoseconds
            offsets = [1e-9 * (stream.bank.joints[name].stamp_ns - clock_ns) for name in fresh]
            self._offset = min(self._offset, *offsets, key=abs)

    def report(self, new: Mapping[str, int], now: float) -> dict[str, tuple[Fault, str]]:
        """Return the faults that are present, by kind; to be called once a second.

        Parameters
        ----------
        new : increase of the node's counters since the last call.
        """
        self._new, self._now, self._rows = new, now, set()
        self._wrong = self._graph.look(now)
        for each in self._inputs:
            each.senders.several = len(each.found) > 1 and not each.optional
        found, suspected = {}, set()
        for fault in FAULTS:
            if not self._rows.isdisjoint(fault.unless):
                continue
            for values in self._of(fault):
                kind = f'{fault.name} {values.get("key", "")}'.rstrip()
                suspected.add(kind)
                if not fault.confirmed or kind in self._suspected:
                    found[kind] = fault, fault.report(values)
                    self._rows.add(fault.name)
        self._suspected, self._offset, self.events = suspected, math.inf, {}
        return found

    def _of(self, fault: Fault) -> Iterator[Values]:
        yield from self.events.get(fault.name, ())
        if fault.find:
            yield from getattr(self, fault.find)(fault.name)
        elif hasattr(self, fault.name):
            yield from getattr(self, fault.name)()

    def _counted(self, count: int, of: str, **values: Any) -> Iterator[Values]:
        """Yield the values of a fault of `count` of the messages or samples, if there are any."""
        if count:
            topic = self._inputs[0].topic_name
            yield {'topic': topic, 'count': count, 'received': self._new[of], **values}

    def _received(self) -> Iterator[tuple[Input, int]]:
        return zip(self._inputs, self._stream.received)

    # Publishers and names

    def graph(self, row: str) -> Iterator[Values]:
        """What does not fit among publishers and subscribers, after the start."""
        heard = [each.topic_name for each, count in self._received() if count]
        if self._now - self._started >= INPUT_PATIENCE:
            for values in self._wrong[row]:
                if row != 'nobody' or values['topic'] not in heard:  # else it is silent
                    yield values

    def mute(self) -> Iterator[Values]:
        """The inputs whose publishers send nothing."""
        for each, count in self._received():
            patient = self._now - self._started >= INPUT_PATIENCE
            if each.found and not count and not each.optional and patient:
                who = listed(dict.fromkeys(each.found))
                yield {'key': each.topic_name, 'who': who, 'topic': each.topic_name}

    def missing(self) -> Iterator[Values]:
        """The joints that the parameters name and no message has had."""
        stream, measured = self._stream, self._inputs[0]
        joints, senders = stream.bank.joints, measured.senders
        self._seen |= senders.recent(-math.inf)
        self._seen.update(name for name, joint in joints.items() if joint.received)
        missing = sorted(stream.needed() - self._seen)
        if missing and self.first_input and self._now >= self.first_input + JOINT_PATIENCE:
            names = senders.recent(self._now - RECENT) or senders.recent(-math.inf)
            carried = names if measured.type == JOINT_STATE else joints.keys()
            near = [suggestion(name, carried) for name in missing]
            meant = listed(dict.fromkeys(each for each in near if 'mean' in each))
            yield {
                'names': called(missing),
                'topic': measured.topic_name,
                'meant': meant and f'{meant} ',
                'named': stream.NAMED_IN,
                'carried': listed(sorted(carried)) or 'no names',
            }

    def twice(self) -> Iterator[Values]:
        """The inputs on which several publishers send the same joint."""
        for each in self._inputs:
            names = each.senders.twice(self._now)
            if names and each.senders.several:
                said = called(names) if any(names) else 'messages'
                who = ' and '.join(sorted(each.found)[:2])
                who = who if len(each.found) == 2 else f'several of {listed(sorted(each.found))}'
                yield {'key': each.port, 'names': said, 'topic': each.topic_name, 'who': who}

    # Silence

    def silent(self) -> Iterator[Values]:
        """The inputs whose messages ended, or the joints that are in none any more."""
        joints = self._stream.bank.joints
        self._patience = max([PAUSE, *(joint.silence for joint in joints.values())])
        ended = False
        for each, (count, since) in zip(self._inputs, self._arrivals):
            if count and not each.optional and self._now - since > self._patience:
                ended = True
                yield self._ended(each, 'message', since)
        measured = self._inputs[0]
        silent = self._watch.silent(self._arrivals[0][1])
        carried = measured.senders.recent(self._now - self._patience)
        gone = sorted(set(self._watch.names_of(silent)) - carried)
        if gone and carried and not ended:
            what = f'sample of {called(gone)}'
            values = self._ended(measured, what, max(silent.values()), sorted(carried))
            yield {**values, 'key': ''}

    def _ended(self, each: Input, what: str, since: float, carried: Any = ()) -> dict[str, Any]:
        """Return the values about an input, or joints of it, that came until `since`."""
        left = sorted(name for name, when in each.left.items() if when > since - PAUSE)
        who = listed(left or dict.fromkeys(each.found)) or 'its publisher'
        if left or not each.found:
            why = f'{who} ended; start it again'
        elif carried:
            why = f'check {who} (the topic carries {listed(carried)})'
        else:
            why = f'check that {who} runs and is not paused (a crash is visible after 20 s)'
        topic, passed = each.topic_name, self._now - since
        return {'key': topic, 'what': what, 'topic': topic, 'passed': passed, 'why': why}

    # Messages

    def malformed(self) -> Iterator[Values]:
        """The malformed messages."""
        topic, why = self._stream.complaint
        count = self._new['messages_dropped.malformed']
        yield from self._counted(count, 'messages_received', topic=topic, why=why)

    def unused(self) -> Iterator[Values]:
        """The kinds of messages that the family often does not use."""
        for kind, text in self._stream.UNUSED.items():
            count = self._new.get(f'messages_dropped.{kind}', 0)
            if count > OFTEN * self._new['messages_received']:
                what, _, remedy = text.partition(': ')
                values = {'key': kind, 'what': what, 'remedy': remedy}
                yield from self._counted(count, 'messages_received', **values)

    def mismatched(self) -> Iterator[Values]:
        """The messages whose arrays do not match."""
        count = self._new.get('messages_dropped.mismatched', 0)
        yield from self._counted(count, 'messages_received', why=self._stream.MISMATCH)

    def refused(self) -> Iterator[Values]:
        """The samples of more joints than `joints_max`."""
        bank: Any = self._stream.bank
        if self._new['dropped.refused']:
            values = {'name': bank.refused_name, 'joints': len(bank.joints)}
            yield from self._counted(self._new['dropped.refused'], 'received', **values)

    def lost(self) -> Iterator[Values]:
        """The messages that are lost for several seconds."""
        self._losses.append((self._new['lost_by_dds'], self._new['messages_received']))
        if sum(count > 0 for count, _ in self._losses) >= LASTING:
            count, came = (sum(each[k] for each in self._losses) for k in (0, 1))
            where = ' and '.join(name for name, total in self._endpoints.lost.items() if total)
            values = {'count': count, 'received': count + came, 'passed': len(self._losses)}
            yield {'topic': where, **values}

    # Stamps

    def _simulated(self) -> bool:
        return bool(self._node.get_parameter('use_sim_time').value)

    def _clock_runs(self) -> bool:
        """Return False while simulated time has just started."""
        return not self._simulated() or self._node.get_clock().now().nanoseconds > 1e9 * NEW_CLOCK

    def _other_stamps(self, text: str) -> str:
        """Return the end of a remedy where `stamp_source` can replace the stamps of headers."""
        source = getattr(self._stream.settings, 'stamp_source', PUBLISHER)
        headers = source != PUBLISHER and self._inputs[0].type == JOINT_STATE
        return f"{text}set 'stamp_source: publisher'" if headers else ''

    def no_clock(self) -> Iterator[Values]:
        """Simulated time without a publisher."""
        node, patient = self._node, self._now - self._started >= INPUT_PATIENCE
        topic = node.resolve_topic_name('/clock')
        if self._simulated() and patient and not node.count_publishers(topic):
            yield {}

    def zero_stamp(self) -> Iterator[Values]:
        """The samples without a stamp."""
        if self._clock_runs():
            why = stamp_remedy(self._stream.source_of_stamps)
            yield from self._counted(self._new['dropped.zero_stamp'], 'received', why=why)

    def clock(self) -> Iterator[Values]:
        """The distance of the stamps from the node's clock, where it is no latency."""
        if CLOCKS_DIFFER < abs(self._offset) < math.inf and self._clock_runs():
            other, clock = self._other_stamps(', '), 'simulated time'
            if not self._simulated():
                clock = 'system time'
                other += ', or set use_sim_time for a bag or a simulation'
            topic = self._inputs[0].topic_name
            yield {'topic': topic, 'offset': self._offset, 'clock': clock, 'other': other}

    def dropped(self, kind: str) -> Iterator[Values]:
        """The samples that are often dropped for this reason."""
        count = self._new[f'dropped.{kind}']
        if count > OFTEN * self._new['received']:
            other = self._other_stamps(', or, if each has a reading of its own, ')
            yield from self._counted(count, 'received', other=other)

    def jump(self) -> Iterator[Values]:
        """A jump of the clock of the measurements."""
        if self._new['events.clock_jump']:
            yield {'kept': self._stream.KEPT}

    # Joints

    def sensor(self) -> Iterator[Values]:
        """The faults that sensors have, or have just had."""
        for name, joint in self._stream.bank.joints.items():
            new = joint.new_faults()
            stopped = new.pop(STOPPED, '')
            if stopped:  # it may be a stop that machines make
                self._node.get_logger().info(f"'{name}': {stopped}")
            for kind, what in {**new, **joint.lasting_faults()}.items():
                topic = self._inputs[0].topic_name
                yield {'key': f'{name} {kind}', 'name': name, 'topic': topic, 'what': what}

    def nothing(self) -> Iterator[Values]:
        """Why nothing is estimated for `SILENCE`, if no other fault explains it."""
        stream, statuses = self._stream, self._watch.statuses
        received, (since, before) = stream.received[0], self._without_estimate
        if not received or 'silent' in self._rows:
            self._without_estimate = self._now, received
            return
        joints = stream.bank.joints.values()
        explained = (
            self._rows - HARMLESS
            or any(status == MISCONFIGURED for status, _ in statuses.values())
            or (self._estimated and all(joint.needs_motion for joint in joints))  # a motor at rest
        )
        if not explained and self._now - since >= SILENCE and received - before >= MESSAGES:
            topics = ' and '.join(each.topic_name for each, count in self._received() if count)
            why = stream.why() or ', '.join(
                f"'{name}' is {STATUS_NAMES[status]}" for name, (status, _) in statuses.items()
            )
            yield {'passed': self._now - since, 'topic': topics, 'why': why}
