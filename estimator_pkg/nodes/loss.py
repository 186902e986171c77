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

    Attributes
    ----------
    count : what is missing in the sequence numbers.
    known : the middleware gives sequence numbers.
    reported : messages lost by the middleware's own account.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self._publishers = publishers
        self._expected: list[int] = []  # the next number of each publisher
        self.known = False
        self.count = self.reported = 0

    @property
    def lost(self) -> int:
        """Messages lost, as far as it can be known."""
        return self.count if self.known else self.reported

    def saw(self, sequence: int | None) -> None:
        """A message with this publication sequence number came."""
        if not sequence:  # None or 0: this middleware has none
            return
        try:
            self._expected[self._expected.index(sequence)] += 1
        except ValueError:
            self._jump(sequence)

    def forget(self) -> None:
        """A publisher left: nobody can tell which number was its next."""
        self._expected.clear()

    def _jump(self, sequence: int) -> None:
        """A number that nobody's next was: a new publisher, or a gap."""
        self.known = True
        before = [expected for expected in self._expected if expected < sequence]
        if len(self._expected) < max(1, self._publishers()):
            self._expected.append(sequence + 1)
        elif before:
            nearest = max(before)
            self.count += sequence - nearest
            self._expected[self._expected.index(nearest)] = sequence + 1
        else:  # numbers only grow: a publisher has gone and another came
            self._expected[:] = [sequence + 1]
