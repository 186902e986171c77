# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Output topics: messages are made while somebody subscribes, and the first ones wait for that."""

from __future__ import annotations

from collections import deque
from time import monotonic
from typing import Any

from rclpy.publisher import Publisher

TOGETHER = 0.1  # [s] between the first and the last subscription of one process, at most


class Output:
    """A topic of answers, which at the start wait for their first subscriber.

    A publisher sends nothing to a subscription that it does not know, and on a busy machine DDS
    discovers a process seconds late: one that has found us may be unknown to us. So the answers of
    the first seconds are kept, as many as the publisher itself keeps, until somebody subscribes.
    (Fast DDS announces a process every 3 s.)

    Parameters
    ----------
    on_demand : its messages are made only while there is a subscriber, or one is waited for.

    Attributes
    ----------
    wanted : True if messages are to be made.
    publish : publishes a message, or keeps it.
    waits : True while messages are kept.
    topic_name : fully qualified.
    """

    def __init__(self, publisher: Publisher, on_demand: bool) -> None:
        self._publisher, self._on_demand = publisher, on_demand
        self.topic_name = publisher.topic_name
        self._kept: deque[bytes] = deque(maxlen=publisher.qos_profile.depth)
        self.wanted = self.waits = True
        self.publish: Any = self._kept.append

    def look(self, wait: bool) -> bool:
        """Check for subscribers and return True if there are any.

        Parameters
        ----------
        wait : keep waiting if there are none.
        """
        known = self._publisher.get_subscription_count() > 0
        if self.waits and (known or not wait):
            self.waits, self.publish = False, self._publisher.publish
            for message in self._kept:
                self.publish(message)
            self._kept.clear()
        self.wanted = known or self.waits or not self._on_demand
        return known


class Outputs(list[Output]):
    """The outputs of a node. They wait for a subscriber together.

    Parameters
    ----------
    wait : for how long after the inputs are connected [s]; 0: not at all.
    """

    def __init__(self, wait: float) -> None:
        super().__init__()
        self._wait = wait
        self._until = float('inf') if wait else 0.0

    def look(self, connected: bool) -> bool:
        """Check for subscribers; return True while an output waits for one.

        Parameters
        ----------
        connected : the inputs are subscribed to.
        """
        now = monotonic()
        if connected:
            self._until = min(self._until, now + self._wait)
        known = [each.look(now < self._until) for each in self]
        if any(known):
            self._until = min(self._until, now + TOGETHER)
        return any(each.waits for each in self)
