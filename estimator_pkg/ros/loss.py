# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Count the messages lost between the publishers and us, from their sequence numbers.

A queue that overflows (KEEP_LAST) overwrites messages, reliable or not, and Fast DDS reports none
of them by its message-lost event. The publication sequence numbers show them: a number missing
between two others was lost.
"""

from __future__ import annotations

from collections.abc import Callable


class Loss:
    """Counts the missing sequence numbers of one subscription's publishers.

    Messages do not name their publisher. This matters little: a number counted for the wrong one of
    two publishers is compensated when both have reached it. Losses of several publishers before
    their numbers can be assigned may stay uncounted.

    Parameters
    ----------
    publishers : returns the number of matched publishers.
    since_ns : time from which messages could have arrived [ns]; messages that a later publisher
        sent before its first one here were lost too. A publisher knows a subscription before the
        subscription knows the publisher, by up to 0.1 s if both are new.

    Attributes
    ----------
    count : number of missing sequence numbers.
    known : True if the middleware provides sequence numbers.
    new : True if the newest number that was expected from no publisher is that of a new one.
    reported : messages lost according to the middleware.
    """

    def __init__(self, publishers: Callable[[], int], since_ns: int = 0) -> None:
        self._since_ns = since_ns
        # number and time of a message that may be a new publisher's first one, and the nearest
        # number that was expected before it; 0: none was
        self._first: tuple[int, int, int] | None = None
        self._gap = 0, 0  # such a number, and how many after it were counted as lost
        self._publishers = publishers
        self._expected: list[int] = []  # the next number of each publisher
        self.known = self.new = False
        self.count = self.reported = 0

    @property
    def lost(self) -> int:
        """Number of lost messages, as far as it is known."""
        return self.count if self.known else self.reported

    def saw(self, sequence: int | None, sent_ns: int = 0) -> None:
        """Count a message with this publication sequence number, sent at this time [ns]."""
        if not sequence:  # None or 0: this middleware provides none
            return
        try:
            self._expected[self._expected.index(sequence)] += 1
        except ValueError:
            nearest = self._jump(sequence)
            if self.new and (nearest or (sequence > 1 and self._since_ns)):
                self._first = sequence, sent_ns, nearest
        else:
            self._goes_on(sequence)
            if self._first is not None:
                self._began(sequence, sent_ns)

    def begins(self, since_ns: int) -> None:
        """The subscription is made now [ns]."""
        self._since_ns = since_ns

    def forget(self, now_ns: int) -> None:
        """Forget the expected numbers after a publisher left [ns]: it is unknown which one was its.

        Those that stay, and its last messages if they still wait, are no new publishers.
        """
        self._expected.clear()
        self._first, self._gap = None, (0, 0)
        if self._since_ns:
            self._since_ns = now_ns

    def _began(self, sequence: int, sent_ns: int) -> None:
        """Take the second message of a new publisher: the spacing shows when it sent its first.

        It is none if the publisher whose number was the nearest does not go on: this is its gap,
        and one that is silent was taken for new.
        """
        assert self._first is not None
        number, first_ns, nearest = self._first
        self._first = None
        before = number - 1
        if nearest in self._expected:
            self._gap = nearest, number - nearest
            self.count += number - nearest
        elif (
            self._since_ns
            and sequence == number + 1
            and first_ns - before * (sent_ns - first_ns) > self._since_ns
        ):
            self.count += before

    def _goes_on(self, expected: int) -> None:
        """Take back a gap that was none: the publisher of this expected number is there."""
        number, lost = self._gap
        if lost and expected == number:
            self.count -= lost
            self._gap = 0, 0

    def _jump(self, sequence: int) -> int:
        """Handle a number that no publisher was expected to send: a new publisher, or a gap.

        Returns the nearest number that was expected before it; 0: none was.
        """
        self.known = True
        self.new = len(self._expected) < max(1, self._publishers())
        nearest = max((each for each in self._expected if each < sequence), default=0)
        if self.new:
            self._expected.append(sequence + 1)
        elif nearest:
            self._goes_on(nearest)
            self.count += sequence - nearest
            self._expected[self._expected.index(nearest)] = sequence + 1
        else:  # numbers only grow: one publisher left and another appeared
            self._expected[:] = [sequence + 1]
        return nearest
