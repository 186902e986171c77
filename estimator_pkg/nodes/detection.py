# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Fault detection: what is wrong with a node's inputs, seen ten times and named once a second."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from time import monotonic
from typing import Any

from rclpy.node import Node

from estimator_pkg.estimate import MISCONFIGURED, STATUS_NAMES
from estimator_pkg.messages.joint_state import TYPE as JOINT_STATE
from estimator_pkg.nodes import faults
from estimator_pkg.nodes.endpoints import Endpoints, Input
from estimator_pkg.nodes.faults import Faults, listed, of_joints, say, which
from estimator_pkg.nodes.joint_watch import JointWatch
from estimator_pkg.nodes.misfits import UNNAMED_PUBLISHER
from estimator_pkg.params_file import OVERRIDES
from estimator_pkg.sensor.faults import STOPPED
from estimator_pkg.streams.contract import PUBLISHER, Stream, stamp_remedy

INPUT_PATIENCE = 2.5  # time after the start in which publishers appear [s]
JOINT_PATIENCE = 1.0  # time after the first joint in which the others appear too [s]
CLOCKS_DIFFER = 1.0  # smaller distances of stamps from the clock are latency [s]
OFTEN = 0.05  # fraction of dropped samples that is reported
LOSSES = 5  # seconds that are searched for lost messages,
LASTING = 3  # and those of them in which messages were lost, if the loss is reported
RECENT = 5.0  # age of names that a topic carries [s]
SILENCE = 4.0  # time without an estimate that is reported [s],
MESSAGES = 8  # if so many messages have come in it: a slow stream takes longer to start
NEW_CLOCK = 1.0  # simulated time before which samples may have the stamp 0 [s]


class Detector:
    """Finds the faults of a node's inputs by the steady clock.

    Parameters
    ----------
    node, stream, endpoints : of the node.
    watch : statuses of its joints.
    faults : takes what begins between two reports.
    patience : longest pause of the messages that is no outage, whatever their rate [s].

    Attributes
    ----------
    first_input : when the first message was seen, by `monotonic` [s]; 0: none has come.
    """

    def __init__(
        self,
        node: Node,
        stream: Stream,
        endpoints: Endpoints,
        watch: JointWatch,
        faults: Faults,
        patience: float,
    ) -> None:
        self._node, self._stream, self._endpoints = node, stream, endpoints
        self._inputs = endpoints.inputs
        self._watch, self._faults = watch, faults
        self._started = monotonic()
        self.first_input = 0.0
        self._suspected: dict[str, str] = {}  # by others; seen twice in a row they are faults
        self._missing: list[str] = []  # needed names that no message has had yet
        self._missed: dict[str, str] = {}  # kind of the fault by joint of `per_joint`
        self._seen: set[str] = set()  # needed names that messages of the measurement have had
        self._malformed = [(0, 0)] * len(stream.inputs)  # malformed and received messages by port
        self._doubled = 0  # messages with equal names
        # received messages by port, and when their number last grew
        self._arrivals = [(0, self._started)] * len(stream.inputs)
        self._shortest = self._patience = patience
        self._offset = math.inf  # least distance of stamps from the clock since the report [s]
        self._often: set[str] = set()  # kinds of drops that were often at the last report
        self._losses: deque[tuple[int, int]] = deque(maxlen=LOSSES)
        self._without_estimate = self._started, 0  # since when, and received messages then
        self._estimated = False  # True after the first estimate
        self._clock_ran = False  # simulated time was beyond NEW_CLOCK

    def look(self, now: float) -> None:
        """Note what has arrived, and report what is back; to be called often."""
        self._note_arrivals(now)
        self._measure_offset(now)
        if not self.first_input and any(self._stream.received):
            self.first_input = now
        if self._watch.estimated:
            self._without_estimate, self._estimated = (now, self._stream.received[0]), True
            self._faults.logged.clear()
        returned = self._watch.returned
        if returned:
            names = list(returned)
            subject = of_joints(names, self._stream.KEPT, ('is', 'are'))
            self._report_return(0, subject, max(returned.values()), now, which(names))
            returned.clear()
        for name, joint in self._stream.bank.joints.items():
            found = joint.new_faults()
            stopped = found.pop(STOPPED, '')
            if stopped:  # it may be a stop that machines make
                self._node.get_logger().info(f"'{name}': {stopped}")
            for fault, text in self._of_sensor(name, found).items():
                self._faults.begin(fault, text, now)

    def _of_sensor(self, name: str, found: Mapping[int, str]) -> dict[str, str]:
        """Return the faults of a joint's sensor, as texts by kind."""
        topic = self._inputs[0].topic_name
        return {
            f'sensor {name} {kind}': say('sensor', name=name, topic=topic, what=what)
            for kind, what in found.items()
        }

    def present(self, new: Mapping[str, int], now: float) -> dict[str, str]:
        """Return the faults that are present, as texts by kind; to be called once a second.

        Parameters
        ----------
        new : increase of the node's counters since the last call.
        """
        found = self._of_graph(now)
        found.update(self._of_names(now))
        found.update(self._of_silence(now))
        for name, joint in self._stream.bank.joints.items():
            found.update(self._of_sensor(name, joint.lasting_faults()))
        found.update(self._of_messages(new))
        found.update(self._of_equal_names(new['messages_received']))
        if self._missing:  # this is why
            found.pop('mismatched', None)
        mixed = any(kind.startswith('twice') for kind in found)
        found.update(self._of_stamps(new, mixed, now))
        if 'equal_names' in found:  # the second position of a name repeats its stamp
            found.pop('duplicate', None)
        found.update(self._of_nothing(found, new, now))
        return found

    def _of_nothing(
        self, found: Mapping[str, str], new: Mapping[str, int], now: float
    ) -> dict[str, str]:
        """Return why nothing is estimated for `SILENCE`, if no other fault explains it."""
        stream, statuses, logged = self._stream, self._watch.statuses, self._faults.logged
        kinds = {kind.partition(' ')[0] for kind in (*found, *logged)}
        received = stream.received[0]
        if not received or 'silent' in kinds:
            self._without_estimate = now, received
            logged.clear()
            return {}
        since, before = self._without_estimate
        if now - since < SILENCE or received - before < MESSAGES:
            return {}
        explained = 'failed' in kinds or any(
            status == MISCONFIGURED for status, _ in statuses.values()
        )
        if not new['used']:
            explained = explained or bool(kinds.difference(faults.HARMLESS, ['nothing']))
        joints = stream.bank.joints.values()
        if explained or (self._estimated and all(joint.needs_motion for joint in joints)):
            return {}
        topics = ' and '.join(
            each.topic_name for each, count in zip(self._inputs, stream.received) if count
        )
        why = stream.why() or ', '.join(
            f"'{name}' is {STATUS_NAMES[status]}" for name, (status, _) in statuses.items()
        )
        return {'nothing': say('nothing', passed=now - since, topic=topics, why=why)}

    def _of_graph(self, now: float) -> dict[str, str]:
        """Return faults among publishers and subscribers, once two reports have seen them."""
        suspected = self._endpoints.faults()
        for port, each in enumerate(self._inputs):
            if each.found and not self._stream.received[port] and not each.optional:
                who = listed(dict.fromkeys(each.found))
                suspected[f'mute {each.topic_name}'] = say('mute', who=who, topic=each.topic_name)
        before, self._suspected = self._suspected, suspected
        if now - self._started < INPUT_PATIENCE:
            return {}
        heard = [each for port, each in enumerate(self._inputs) if self._stream.received[port]]
        ended = {f'nobody {each.topic_name}' for each in heard}  # reported as silence
        return {
            kind: text for kind, text in suspected.items() if kind in before and kind not in ended
        }

    def _of_names(self, now: float) -> dict[str, str]:
        """Return joints that are not in the messages, and those that several publishers send."""
        stream, found = self._stream, {}
        shown = True  # the messages have shown their names
        for port, each in enumerate(self._inputs):
            several = len(each.found) > 1 and not each.optional
            if port == 0:
                joints = stream.bank.joints
                needed = stream.needed() - self._seen
                came = {name for name in needed if name in joints and joints[name].received}
                self._seen |= came | needed.intersection(each.senders.names)
                self._missing = sorted(needed - self._seen)
            watched = several or (port == 0 and bool(self._missing or self._watch.silent))
            if not watched and each.watched:
                each.senders.forget()
            fresh, each.watched = watched and not each.watched, watched
            shown = shown and not (port == 0 and fresh)
            twice = each.senders.twice(now)
            unnamed = UNNAMED_PUBLISHER in each.found and not each.unnamed
            each.unnamed = UNNAMED_PUBLISHER in each.found
            if several and twice and not unnamed:
                verb = ('comes', 'come')
                found[f'twice {each.topic_name}'] = say(
                    'twice',
                    names=of_joints(twice, 'joint', verb) if any(twice) else 'messages come',
                    topic=each.topic_name,
                    who=faults.publishers(sorted(each.found)),
                    which=which(twice),
                )
        patience = self.first_input + JOINT_PATIENCE
        if self._missing and shown and self.first_input and now >= patience:
            found.update(self._of_missing(self._missing, now))
        return found

    def _of_missing(self, missing: list[str], now: float) -> dict[str, str]:
        """Return the texts about joints that have never come, by the parameters that name them."""
        each, overrides = self._inputs[0], self._stream.overrides
        names = each.senders.recent(now - RECENT) or each.senders.recent(-math.inf)
        carried = names if each.type == JOINT_STATE else set(self._stream.bank.joints)
        selected = [name for name in missing if name not in overrides]
        overridden = [name for name in missing if name in overrides]
        first = next((name for name in overridden if name not in self._missed), '')
        self._missed = {  # those of a file are one fault, one that is set later is another
            name: self._missed.get(name, f'missing override {first}') for name in overridden
        }
        found = {}
        if selected:
            found['missing'] = faults.absent(
                selected,
                each.topic_name,
                carried,
                f'set {self._stream.NAMED_IN} to names of the topic',
            )
        for kind in set(self._missed.values()):
            joints = [name for name, its in self._missed.items() if its == kind]
            correct = listed(
                (f'{OVERRIDES}.{name}.{key}' for name in joints for key in overrides[name]), "'"
            )
            found[kind] = faults.absent(joints, each.topic_name, carried, '', f'correct {correct}')
        return found

    def _note_arrivals(self, now: float) -> None:
        """Note which inputs have new messages, and report those that are back."""
        received = self._stream.received
        for port, (count, since) in enumerate(self._arrivals):
            if received[port] > count:
                self._arrivals[port] = received[port], now
                each = self._inputs[port]
                if count and not each.optional and now - since > self._patience:
                    self._report_return(port, 'the messages are', now - since, now)

    def _report_return(
        self, port: int, subject: str, outage: float, now: float, which: str = ''
    ) -> None:
        """Report what is back, with the length of the outage [s]."""
        topic = self._inputs[port].topic_name
        text = say('back', subject=subject, topic=topic, passed=outage, which=which)
        self._faults.begin(f'back {topic}', text, now)

    def _of_silence(self, now: float) -> dict[str, str]:
        """Return the inputs whose messages ended, and the joints that are in none any more."""
        joints, found = self._stream.bank.joints, {}
        patience = max([self._shortest, *(joint.silence for joint in joints.values())])
        self._patience = patience
        for (count, since), each in zip(self._arrivals, self._inputs):
            if not count or each.optional or now - since <= patience:
                continue
            what = f'no message on {each.topic_name}'
            found[f'silent {each.topic_name}'] = self._ended(each, what, since, now)
        if found:
            return found
        _, arrived = self._arrivals[0]
        for name, (_, since, before) in self._watch.used.items():
            lost = before and self._watch.lost(name)
            if lost and before == joints[name].received and arrived - since > joints[name].silence:
                self._watch.silent.setdefault(name, since)
        measured = self._inputs[0]
        carried = measured.senders.recent(now - patience)
        gone = sorted(set(self._watch.names_of(self._watch.silent)) - carried)
        if gone and carried:
            some = f"'{gone[0]}'" if len(gone) == 1 else f'{len(gone)} joints'
            what = f'no sample of {some} on {measured.topic_name}'
            ended = self._ended(measured, what, max(self._watch.silent.values()), now, which(gone))
            found['silent'] = (
                ended
                if 'ended;' in ended
                else faults.absent(
                    gone,
                    measured.topic_name,
                    carried,
                    'check its publisher',
                    alike=carried.intersection(self._watch.new()),
                )
            )
        return found

    def _ended(self, each: Input, what: str, since: float, now: float, which: str = '') -> str:
        """Return the text about an input, or some joints of it, that came until `since`."""
        left = sorted(name for name, when in each.left.items() if when > since - self._shortest)
        kind = 'ended' if left or not each.found else 'silent'
        who = listed(left or dict.fromkeys(each.found)) or 'its publisher'
        return say(kind, what=what, passed=now - since, who=who, which=which)

    def _counted(
        self, kind: str, count: int, received: int, fault: str = '', **values: Any
    ) -> dict[str, str]:
        """Return the fault `kind` (with the text of `fault`) of `count` of the received, if any."""
        values = {'topic': self._inputs[0].topic_name, **values}
        text = say(fault or kind, count=count, received=received, **values) if count else ''
        return {kind: text} if text else {}

    def _of_messages(self, new: Mapping[str, int]) -> dict[str, str]:
        """Return faults of whole messages: those that are dropped or lost."""
        stream, found = self._stream, {}
        received, counted = new['messages_received'], self._counted
        before, self._malformed = self._malformed, [*zip(stream.malformed, stream.received)]
        if new['messages_dropped.malformed']:
            where, why = stream.complaint
            port = stream.topics.index(where)
            bad, every = (now - old for now, old in zip(self._malformed[port], before[port]))
            found.update(counted('malformed', bad, every, topic=where, why=why))
        for kind, why in stream.UNUSED.items():
            count = new.get(f'messages_dropped.{kind}', 0)
            if count > OFTEN * received:
                found.update(counted(kind, count, received, 'unused', why=why))
        count = new.get('messages_dropped.mismatched', 0)
        found.update(counted('mismatched', count, received, why=stream.MISMATCH))
        if new['dropped.refused']:
            bank: Any = stream.bank
            values = {'name': bank.refused_name, 'joints': len(bank.joints)}
            found.update(counted('refused', new['dropped.refused'], new['received'], **values))
        self._losses.append((new['lost_by_dds'], received))
        if sum(count > 0 for count, _ in self._losses) >= LASTING:
            count, came = (sum(each[k] for each in self._losses) for k in (0, 1))
            where = ' and '.join(each for each, total in self._endpoints.lost.items() if total)
            found['lost'] = say(
                'lost', count=count, sent=count + came, topic=where, passed=len(self._losses)
            )
        return found

    def _of_equal_names(self, received: int) -> dict[str, str]:
        """Return the joints that one message has more than once."""
        bank = self._stream.bank
        count, self._doubled = bank.doubled - self._doubled, bank.doubled
        names = sorted(bank.doubled_names.intersection(self._watch.names_of(bank.joints)))
        if not names:
            return {}
        values = {'names': of_joints(names, 'joint', ('has', 'have')), 'which': which(names)}
        return self._counted('equal_names', count, received, **values)

    def _of_stamps(self, new: Mapping[str, int], mixed: bool, now: float) -> dict[str, str]:
        """Return faults of stamps and readings.

        Parameters
        ----------
        mixed : several publishers send the same joint, which explains the rest.
        """
        node, stream, topic = self._node, self._stream, self._inputs[0].topic_name
        source = getattr(stream.settings, 'stamp_source', PUBLISHER)
        header = source != PUBLISHER and self._inputs[0].type == JOINT_STATE
        found, received = {}, new['received']
        simulated = node.get_parameter('use_sim_time').value
        clock = node.get_clock().now().nanoseconds * 1e-9
        before, self._clock_ran = self._clock_ran, simulated and clock > NEW_CLOCK
        ran = before and self._clock_ran  # it may have started again
        if ran or not simulated:
            remedy = stamp_remedy(stream.source_of_stamps)
            count = new['dropped.zero_stamp']
            found.update(self._counted('zero_stamp', count, received, remedy=remedy))
        offset, self._offset = self._offset, math.inf
        if simulated and not node.count_publishers(node.resolve_topic_name('/clock')):
            if now - self._started >= INPUT_PATIENCE:
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
        counts = {kind: new[f'dropped.{kind}'] for kind in ('duplicate', 'late', 'repeated')}
        often = {kind for kind, count in counts.items() if count > OFTEN * received}
        remedy = ", or, if each has a reading of its own, set 'stamp_source: publisher'"
        for kind in often & self._often if not mixed else ():
            found.update(
                self._counted(kind, counts[kind], received, remedy=remedy if header else '')
            )
        self._often = often
        if new['events.clock_jump'] and not mixed:
            publishers = self._inputs[0].publishers()
            several = f', {publishers} publishers whose clocks differ' if publishers > 1 else ''
            self._faults.begin('jump', say('jump', several=several, kept=stream.KEPT), now)
        return found

    def _measure_offset(self, now: float) -> None:
        """Compare the stamps of new samples with the clock."""
        joints = self._stream.bank.joints
        fresh = [
            name for name, (used, since, _) in self._watch.used.items() if used and since == now
        ]
        if fresh and getattr(self._stream.settings, 'stamp_source', '') != PUBLISHER:
            clock_ns = self._node.get_clock().now().nanoseconds
            offsets = [1e-9 * (joints[name].stamp_ns - clock_ns) for name in fresh]
            self._offset = min(self._offset, *offsets, key=abs)
