# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""The executor of our executables: services and timers run at every rate of messages.

rclpy's EventsExecutor has the lowest cost per message, but it queues one event for each, without a
bound, and services and timers wait behind them. With a stream that is faster than its callback this
queue, and the response time of a service, grow without end: most events then find no message,
because the subscription's own queue (KEEP_LAST) keeps only the newest. So the age of the queue is
measured. When it is too old `TurnsExecutor`, which has no such queue, takes over. It costs about
25 us more per message if messages arrive one by one, and less if several wait.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from inspect import iscoroutinefunction
from time import monotonic, perf_counter, thread_time
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.utilities import get_default_context

TURN = 0.01  # time for the messages of one subscription before everything else may run [s]
ASK_EVERY = 0.05  # time between two measurements of the queue's age [s]
OLDEST = 0.2  # allowed age of the queue [s]: longer than what a start takes
AT_LEAST = 20  # smallest number of callbacks in that time, or it was spent in callbacks: else the
# process had no CPU time


class TurnsExecutor(SingleThreadedExecutor):
    """Takes waiting messages for a limited time, then lets everything else run.

    Callbacks run in the thread that calls `spin` or `spin_once`.
    """

    def __init__(self, *, context: Any = None) -> None:
        super().__init__(context=context)
        self._changed = True  # nodes or their entities have changed
        self._entities: dict[str, list[Any]] = {}
        self._takes: dict[int, Subscription] = {}  # by pointer, as the wait set returns them
        self._wait_set: Any = None

    def add_node(self, node: Node) -> bool:
        """See `rclpy.executors.Executor`."""
        self._changed = True
        return super().add_node(node)

    def remove_node(self, node: Node) -> None:
        """See `rclpy.executors.Executor`."""
        self._changed = True
        super().remove_node(node)

    def wake(self) -> None:
        """React to a new or destroyed entity of a node."""
        self._changed = True
        super().wake()

    def can_execute(self, entity: Any) -> bool:
        """Return True if rclpy's executor handles `entity`; messages are taken here instead."""
        return not _taken_here(entity) and super().can_execute(entity)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait until something is ready; then run a turn of messages, and everything else."""
        if not self._context.ok():
            raise ExternalShutdownException
        if self._is_shutdown:
            return
        came, others = self._wait(timeout_sec)
        for subscription in came:
            self._take(subscription)
        if others:
            self._run_others()

    def _wait(self, timeout_sec: float | None) -> tuple[list[Subscription], bool]:
        """Return (the subscriptions with messages, True if anything else may be ready)."""
        if self._changed:
            self._collect()
        if self._tasks:
            timeout_sec = 0.0
        wait_set = self._wait_set
        try:
            wait_set.clear_entities()
            for kind, entities in self._entities.items():
                add = getattr(wait_set, f'add_{kind}')
                for entity in entities:
                    add(entity)
        except InvalidHandle:  # destroyed by another thread
            self._changed = True
            return [], False
        wait_set.wait(-1 if timeout_sec is None or timeout_sec < 0.0 else round(1e9 * timeout_sec))
        takes = self._takes
        came = [takes[pointer] for pointer in wait_set.get_ready_entities('subscription')]
        # Waitables (events of the middleware about publishers) wait for a timer or the timeout:
        # checking them costs as much as everything else.
        return came, not came or bool(self._tasks) or any(
            wait_set.get_ready_entities(kind)
            for kind in ('timer', 'service', 'client', 'guard_condition')
        )

    def _collect(self) -> None:
        """Make the wait set for the present entities of the nodes."""
        self._changed = False  # first: later changes are then seen next time
        nodes = self.get_nodes()
        taken = [each for node in nodes for each in node.subscriptions if _taken_here(each)]
        self._takes = {each.handle.pointer: each for each in taken}
        guards = [self._guard, self._sigint_gc, *(each for node in nodes for each in node.guards)]
        self._entities = {
            'subscription': [each.handle for node in nodes for each in node.subscriptions],
            'guard_condition': [each.handle for each in guards],
            'timer': [each.handle for node in nodes for each in node.timers],
            'client': [each.handle for node in nodes for each in node.clients],
            'service': [each.handle for node in nodes for each in node.services],
        }
        counts = [len(entities) for entities in self._entities.values()]
        context: Any = self._context.handle
        with context:
            self._wait_set = rclpy_implementation.WaitSet(*counts, 0, context)

    def _take(self, subscription: Subscription) -> None:
        """Call the callback with the waiting messages, for one turn."""
        callback = subscription.callback
        alone = subscription._callback_type is Subscription.CallbackType.MessageOnly
        receive = (lambda message, _: callback(message)) if alone else callback
        take_turn(subscription, receive)

    def _run_others(self) -> None:
        """Run everything that is ready except messages, once."""
        while not self._is_shutdown and self._context.ok():
            try:
                handler, _, _ = self.wait_for_ready_callbacks(0.0)
            except (TimeoutException, ShutdownException):
                return
            handler()
            if handler.exception() is not None:
                raise handler.exception()


class SteadyExecutor:
    """Uses EventsExecutor until it does not keep up, then `TurnsExecutor`.

    Callbacks run in the thread that calls `spin` or `spin_once`.
    """

    def __init__(self, *, context: Any = None) -> None:
        self._context = context or get_default_context()
        self._nodes: list[Node] = []
        self._turns = TurnsExecutor(context=context)
        self._events: Any = EventsExecutor(context=context)
        self._asked = 0.0  # when an event was queued to measure its waiting time; 0: it has run
        self._ask_at = 0.0
        self._ran = 0  # callbacks since then
        self._worked = 0.0  # CPU time of this thread at that time [s]

    @property
    def context(self) -> Any:
        """See `rclpy.executors.Executor`."""
        return self._context

    @property
    def in_turns(self) -> bool:
        """True since EventsExecutor did not keep up."""
        return self._events is None

    def add_node(self, node: Node) -> bool:
        """See `rclpy.executors.Executor`."""
        if node in self._nodes:
            return False
        self._nodes.append(node)
        return (self._events or self._turns).add_node(node)

    def remove_node(self, node: Node) -> None:
        """See `rclpy.executors.Executor`."""
        if node in self._nodes:
            self._nodes.remove(node)
            (self._events or self._turns).remove_node(node)

    def get_nodes(self) -> list[Node]:
        """See `rclpy.executors.Executor`."""
        return list(self._nodes)

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Any:
        """See `rclpy.executors.Executor`."""
        return (self._events or self._turns).create_task(callback, *args, **kwargs)

    def wake(self) -> None:
        """See `rclpy.executors.Executor`."""
        (self._events or self._turns).wake()

    def spin(self) -> None:
        """Run callbacks until the context ends."""
        while self._context.ok():
            self.spin_once(0.1)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait until something is ready, and run it."""
        if self._events is None:
            self._turns.spin_once(timeout_sec)
            return
        now = monotonic()
        self._ran += 1
        if now >= self._ask_at:
            if not self._asked:
                self._asked, self._ask_at, self._ran = now, now + ASK_EVERY, 0
                self._worked = thread_time()
                self._events.create_task(self._answer)
            elif now - self._asked > OLDEST and (
                self._ran >= AT_LEAST or thread_time() - self._worked > OLDEST
            ):
                self._take_turns()
                return
        with suppress(InvalidHandle):  # an event of a subscription that was destroyed before it ran
            self._events.spin_once(timeout_sec=timeout_sec)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """See `rclpy.executors.Executor`."""
        if self._events is not None:
            self._events.shutdown()
        return self._turns.shutdown(timeout_sec)

    def _answer(self) -> None:
        self._asked = 0.0

    def _take_turns(self) -> None:
        """Discard the queue of events: `TurnsExecutor` finds by itself what is ready."""
        for node in self._nodes:
            self._turns.add_node(node)  # this removes it from the other executor
        self._events.shutdown()
        self._events = None


def _taken_here(entity: Any) -> bool:
    return isinstance(entity, Subscription) and not iscoroutinefunction(entity.callback)


def take_turn(
    subscription: Subscription, receive: Callable[[Any, Any], None], seconds: float = TURN
) -> bool:
    """Pass the waiting messages to `receive`, for so long; return True if none is left.

    Parameters
    ----------
    receive : takes a message, or its CDR bytes from a raw subscription, and its info.
    """
    kind, raw, handle = subscription.msg_type, subscription.raw, subscription.handle
    end = perf_counter() + seconds
    while perf_counter() < end:
        try:
            with handle:
                taken = handle.take_message(kind, raw)
        except InvalidHandle:  # the previous message's callback has destroyed it
            return True
        if taken is None:
            return True
        receive(*taken)
    return False
