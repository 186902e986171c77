"""How many messages were lost between the publishers and us, from their sequence numbers.

A queue that overflows (KEEP_LAST) overwrites messages, reliable or not, and Fast DDS reports none
of them by its message-lost event. The publication sequence numbers do: what is missing between two
of them was lost.
"""

from __future__ import annotations

from collections.abc import Callable


class Loss:
    """Counts what is missing in the sequence numbers of one subscription's publishers.

    Messages do not say who sent them. That matters little: a number counted for the wrong one of
    two publishers makes up for it when both have come to that number. What several publishers lose
    before they are told apart may stay uncounted.

    Parameters
    ----------
    publishers : how many publishers are matched now.
    since_ns : time from which messages could have come [ns]; what a publisher that started later
        sent before its first message here was lost too. A publisher knows of a subscription some
        time before the subscription knows of the publisher, up to 0.1 s where both are new.

    Attributes
    ----------
    count : what is missing in the sequence numbers.
    known : the middleware gives sequence numbers.
    new : the newest number that nobody's next was is that of a new publisher.
    reported : messages lost by the middleware's own account.
    """

    def __init__(self, publishers: Callable[[], int], since_ns: int = 0) -> None:
        self._since_ns = since_ns
        self._first: tuple[int, int] | None = None  # (number, time) of a new publisher's message
        self._publishers = publishers
        self._expected: list[int] = []  # the next number of each publisher
        self.known = self.new = False
        self.count = self.reported = 0

    @property
    def lost(self) -> int:
        """Messages lost, as far as it can be known."""
        return self.count if self.known else self.reported

    def saw(self, sequence: int | None, sent_ns: int = 0) -> None:
        """A message with this publication sequence number came, sent at this time [ns]."""
        if not sequence:  # None or 0: this middleware has none
            return
        try:
            self._expected[self._expected.index(sequence)] += 1
        except ValueError:
            self._jump(sequence)
            if sequence > 1 and self.new and self._since_ns:
                self._first = sequence, sent_ns
        else:
            if self._first is not None:
                self._began(sequence, sent_ns)

    def begins(self, since_ns: int) -> None:
        """The subscription is made now [ns]."""
        self._since_ns = since_ns

    def forget(self) -> None:
        """A publisher left: nobody can tell which number was its next."""
        self._expected.clear()

    def _began(self, sequence: int, sent_ns: int) -> None:
        """Take the second message of a new publisher: the spacing shows when it sent its first."""
        assert self._first is not None
        number, first_ns = self._first
        self._first = None
        before = number - 1
        if sequence == number + 1 and first_ns - before * (sent_ns - first_ns) > self._since_ns:
            self.count += before

    def _jump(self, sequence: int) -> None:
        """A number that nobody's next was: a new publisher, or a gap."""
        self.known = True
        self.new = len(self._expected) < max(1, self._publishers())
        before = [expected for expected in self._expected if expected < sequence]
        if self.new:
            self._expected.append(sequence + 1)
        elif before:
            nearest = max(before)
            self.count += sequence - nearest
            self._expected[self._expected.index(nearest)] = sequence + 1
        else:  # numbers only grow: a publisher has gone and another came
            self._expected[:] = [sequence + 1]
