# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""What keeps a node from estimating, or makes its estimates doubtful: each fault, as the user reads
it.

A fault is reported in three ways: once on the terminal when it begins, and while it lasts in
``~/status`` and in ``/diagnostics``.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from time import monotonic

from estimator_pkg.errors import suggestion
from estimator_pkg.messages.cdr import MalformedMessageError
from estimator_pkg.messages.joint_state import Layout

SHOWN = 5.0  # time for which an event stays among the faults [s]
AGAIN = 2.0  # a fault that returns after this time is logged again [s]
NAMED = 5  # largest number of names in a text
SLOWEST_TURNS = 5.0  # time in which several publishers of a joint must alternate [s],
RETURNS = 3  # this many times
TRACKS = 8  # publishers of a joint that are distinguished
FORGOTTEN = 60.0  # names that have not come for this time are forgotten [s]
MEANT = 'did you mean '  # how `suggestion` begins where a name is near
LAYOUTS = 8  # layouts that are kept to read names

TEXTS: Mapping[str, str] = {
    'nobody': 'nobody publishes {topic} ({type}): start its publisher, or remap the input with '
    "'-r {port}:=TOPIC'{hint}",
    'mute': '{who} publishes {topic}, but no message has arrived: check that it runs and is not '
    'paused',
    'type': '{who} publishes {other} on {topic}, where this node needs {type}: they are not '
    'connected; remap one of them',
    'qos': 'a {role} on {topic} has an incompatible QoS and is not connected: {who} has '
    '{policy} {theirs}, this node {ours}; {remedy}',
    'shared': '{who} publishes {topic} as this node does, so its subscribers get both: stop one of '
    "them, remap the topic, or start this node with another name ('-r __node:=NAME')",
    'twice': '{names} on {topic} from {who}: stop one of them, or remap its topic; the estimates '
    'mix their samples{which}',
    'missing': '{names} not in {topic}: {hint} ({which}it carries {carried})',
    'ended': '{what} for {passed:.1f} s: {who} ended; start it again{which}',
    'silent': '{what} for {passed:.1f} s: nothing comes from {who}; check that it runs and is not '
    'paused (after a crash it stays visible for up to 20 s){which}',
    'back': '{subject} back on {topic} after an outage of {passed:.1f} s{which}',
    'equal_names': '{names} several positions in {count} of {received} messages on {topic}, and '
    'one is used: give each joint of the publisher its own name{which}',
    'zero_stamp': '{count} of {received} samples on {topic} have no time stamp and are dropped: '
    '{remedy}',
    'no_clock': 'use_sim_time is true, but nobody publishes /clock: start the simulation, play the '
    "bag with '--clock', or unset use_sim_time",
    'clock': "stamps on {topic} are {offset} this node's clock ({clock}): {remedy}",
    'duplicate': '{count} of {received} samples on {topic} repeat the previous stamp and are '
    'dropped: stamp each measurement once{remedy}',
    'late': '{count} of {received} samples on {topic} are older than the previous one and are '
    'dropped: publish them in the order of their stamps',
    'repeated': '{count} of {received} samples on {topic} repeat the previous reading and are '
    'dropped: publish each reading once; the sensor is slower than its driver',
    'jump': 'the clock of the measurements jumped (a looping bag, a restarted simulation{several}):'
    ' its {kept}s are reset',
    'malformed': '{count} of {received} messages on {topic} are malformed and dropped: {why}',
    'unused': '{count} of {received} messages on {topic} {why}',
    'nothing': 'no estimate for {passed:.0f} s, though messages come on {topic}: {why}',
    'sensor': "the sensor of '{name}' on {topic} may be faulty: {what}; check sensor, cable and "
    'bus; an angle in degrees needs counts_per_revolution=360 (input angle or field)',
    'mismatched': '{count} of {received} messages on {topic} are dropped: {why}',
    'refused': '{count} of {received} samples on {topic} are beyond joints_max and are dropped '
    "(newest name: '{name}'; {joints} joints exist): name the required joints in 'joints', or "
    "raise 'joints_max'",
    'lost': '{count} of {sent} messages on {topic} were lost in {passed:.0f} s: their rate is too '
    'high for this node or the network; lower it, or stop other processes',
}
# Faults that do not explain why nothing is estimated
HARMLESS = (
    'sensor',
    *('back', 'clock', 'equal_names', 'expired', 'jump', 'lost', 'no_clock', 'shared'),
    *('silent', 'twice'),
)


def say(fault: str, **values: object) -> str:
    """Return the text of a fault."""
    return TEXTS[fault].format(**values)


def listed(names: Iterable[str], quote: str = '') -> str:
    """Return names for a text: 'a, b and 3 more'."""
    names = list(names)
    more = f' and {len(names) - NAMED} more' if len(names) > NAMED else ''
    return ', '.join(f'{quote}{name}{quote}' for name in names[:NAMED]) + more


def of_joints(names: Sequence[str], kept: str, verb: tuple[str, str]) -> str:
    """Return the subject of a text about joints, and its verb: "joint 'a' is", "2 joints are"."""
    return (
        f"{kept} '{names[0]}' {verb[0]}" if len(names) == 1 else f'{len(names)} {kept}s {verb[1]}'
    )


def which(names: Sequence[str], form: str = ' ({})') -> str:
    """Return the names that `of_joints` only counts; they come last, after the remedy."""
    return form.format(listed(names, "'")) if len(names) > 1 else ''


def publishers(names: Sequence[str]) -> str:
    """Return the publishers that may have sent something: two of them, or candidates among many."""
    if len(names) == 2:
        one, other = names
        return f'two publishers of {one}' if one == other else f'two publishers, {one} and {other}'
    return f'several of the publishers {listed(names)}'


def absent(
    missing: Sequence[str],
    topic: str,
    carried: Collection[str],
    otherwise: str,
    always: str = '',
    alike: Collection[str] | None = None,
) -> str:
    """Return the text about joints that a topic does not carry.

    Parameters
    ----------
    otherwise : remedy, if no name of the topic is similar. always : remedy in both cases.
    alike : names of the topic that a missing joint may have; None: all.
    """
    hints = [suggestion(name, carried if alike is None else alike) for name in missing]
    near = dict.fromkeys(hint[len(MEANT) : -1] for hint in hints if hint.startswith(MEANT))
    meant = f'{MEANT}{", ".join([*near][:NAMED])}?' if near else ''
    return say(
        'missing',
        names=of_joints(missing, 'joint', ('is', 'are')),
        which=which(missing, 'missing: {}; '),
        topic=topic,
        carried=listed(sorted(carried)) or 'no names',
        hint=' '.join(filter(None, [meant, always])) or otherwise,
    )


def rounded(rate: float) -> str:
    """Return a rate for a text, as '500' [Hz]."""
    return f'{rate:.0f}' if rate >= 10.0 else f'{rate:.3g}'


def distance(seconds: float) -> str:
    """Return the distance of a stamp from the clock, as '3600 s behind'."""
    digits = 0 if abs(seconds) > 10.0 else 1
    return f'{abs(seconds):.{digits}f} s {"behind" if seconds < 0.0 else "ahead of"}'


class Faults:
    """The present faults of a node; each is logged once, when it begins.

    Parameters
    ----------
    log : logs a fault: its kind, whose first word is that of `TEXTS`, and its text.

    Attributes
    ----------
    present : texts of the present faults, by kind.
    logged : kinds that were logged since somebody cleared this set.
    """

    def __init__(self, log: Callable[[str, str], None]) -> None:
        self._log = log
        self.present: dict[str, str] = {}
        self.logged: set[str] = set()
        self._lasting: dict[str, str] = {}
        self._events: dict[str, tuple[str, float]] = {}  # text, and until when it is shown
        self._seen: dict[str, float] = {}  # when a fault was last present

    def begin(self, kind: str, text: str, now: float) -> None:
        """Report an event at once, and show it for a while."""
        self._enter(kind, text, now)
        self._events[kind] = text, now + SHOWN
        self._collect(now)

    def update(self, lasting: Mapping[str, str], now: float) -> None:
        """Take the faults that are present now; events are kept."""
        for kind, text in lasting.items():
            self._enter(kind, text, now)
        self._lasting = dict(lasting)
        self._collect(now)

    def _enter(self, kind: str, text: str, now: float) -> None:
        if now - self._seen.get(kind, -math.inf) > AGAIN:
            self._log(kind, text)
            self.logged.add(kind)
        self._seen[kind] = now

    def _collect(self, now: float) -> None:
        self._events = {kind: each for kind, each in self._events.items() if now < each[1]}
        self._seen = {kind: when for kind, when in self._seen.items() if now - when <= AGAIN}
        self._seen.update(dict.fromkeys(self._events, now))
        self.present = self._lasting | {kind: text for kind, (text, _) in self._events.items()}


class Senders:
    """What the messages of a topic carry, and whether several publishers send the same joint.

    Messages do not name their publisher, but the sequence numbers of one publisher only grow. If
    two of them send a joint, its numbers go back again and again to where those of one ended. A
    publisher that was killed and started again goes back to its beginning, once.

    Parameters
    ----------
    named : the messages are JointStates.

    Attributes
    ----------
    names : joints of the messages, and when they last came, by `monotonic` [s].
    """

    def __init__(self, named: bool) -> None:
        self._named = named
        self._layouts: list[Layout] = []
        self.forget()

    def forget(self) -> None:
        """Start again, with other publishers."""
        self.names: dict[str, float] = {}
        # the next number of each publisher of a joint, that of its newest message first
        self._next: defaultdict[str, list[int]] = defaultdict(list)
        self._returned: dict[str, deque[float]] = {}  # when numbers went back to one of them

    def saw(self, raw: bytes, sequence: int | None) -> None:
        """Take a message."""
        names, now = self._names_of(raw), monotonic()
        self.names.update(dict.fromkeys(names, now))
        if not sequence:  # this middleware provides no numbers
            return
        for name in names:
            tracks = self._next[name]
            # after a loss it is the nearest number before
            known = max((each for each in tracks if each <= sequence), default=0)
            if known == sequence < tracks[0]:
                self._returned.setdefault(name, deque(maxlen=RETURNS)).append(now)
            if known:
                tracks.remove(known)
            tracks.insert(0, sequence + 1)
            del tracks[TRACKS:]

    def recent(self, since: float) -> set[str]:
        """Return the joints that came after this time."""
        return {name for name, when in self.names.items() if name and when > since}

    def twice(self, now: float) -> list[str]:
        """Return the joints that several publishers send; to be called regularly."""
        for name in [name for name, when in self.names.items() if now - when > FORGOTTEN]:
            for kept in (self.names, self._next, self._returned):
                kept.pop(name, None)
        return sorted(
            name
            for name, times in self._returned.items()
            if len(times) == RETURNS
            and now - times[-1] < SLOWEST_TURNS
            and times[-1] - times[0] < RETURNS * SLOWEST_TURNS
        )

    def _names_of(self, raw: bytes) -> Sequence[str]:
        if not self._named:
            return ('',)
        for layout in self._layouts:
            if layout.fits(raw):
                return layout.names
        try:
            layout = Layout(raw)
        except MalformedMessageError:
            return ()
        self._layouts = [layout, *self._layouts[: LAYOUTS - 1]]
        return layout.names
