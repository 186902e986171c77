"""The executor of our executables: no stream of messages, however fast, starves the rest.

rclpy's EventsExecutor costs least per message, but it queues one event for each, without a bound,
and services and timers behind them. A stream that is faster than its callback makes that queue, and
so what a service waits, grow for ever: most of the events then find no message, because the
subscription's own queue (KEEP_LAST) keeps the newest alone. So the age of that queue is measured,
and while it is too old `TurnsExecutor` does the work, which has no queue. It costs some 25 us more
per message as long as it waits for each of them, and less once several wait.
"""

from __future__ import annotations

from collections.abc import Iterator
from inspect import iscoroutinefunction
from time import monotonic, perf_counter
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.utilities import get_default_context
from rclpy.waitable import Waitable

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # an rclpy without it: SteadyExecutor does without, too
    EventsExecutor = None  # type: ignore[assignment]  # it is compared with None alone

TURN = 0.01  # [s] for the messages of one subscription before everything else has its turn
ASK_EVERY = 0.05  # [s] how old the queue of events is
OLDEST = 0.1  # [s] it may be
AT_LEAST = 20  # callbacks within that time: a process that was not given the processor has fewer
CALM = 1.0  # [s] without a full turn after which events are queued again
LONGEST_CALM = 60.0  # [s] where that has failed again and again


class TurnsExecutor(SingleThreadedExecutor):
    """Takes the messages that wait for a limited time, then lets everything else run.

    Callbacks run in the thread that calls `spin` or `spin_once`.

    Attributes
    ----------
    busy : when more messages waited than it could take in a turn, by `monotonic` [s].
    """

    def __init__(self, *, context: Any = None) -> None:
        super().__init__(context=context)
        self.busy = 0.0
        self._changed = True  # nodes or what they consist of
        self._looks = False
        self._entities: dict[str, list[Any]] = {}
        self._takes: dict[int, Subscription] = {}  # by pointer, as the wait set gives them back
        self._wait_set: Any = None

    def add_node(self, node: Node) -> bool:
        """As of `rclpy.executors.Executor`."""
        self._changed = True
        return super().add_node(node)

    def remove_node(self, node: Node) -> None:
        """As of `rclpy.executors.Executor`."""
        self._changed = True
        super().remove_node(node)

    def wake(self) -> None:
        """Something of a node was made or destroyed."""
        self._changed = True
        super().wake()

    def can_execute(self, entity: Any) -> bool:
        """Whether the executor of rclpy sees to `entity`: not to messages, which are taken here."""
        return (
            not _taken_here(entity)
            and not (self._looks and isinstance(entity, Waitable))
            and super().can_execute(entity)
        )

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait until something is ready; then a turn of messages, and all else that is ready."""
        if not self._context.ok():
            raise ExternalShutdownException
        if self._is_shutdown:
            return
        came, others = self._wait(timeout_sec)
        for subscription in came:
            self._take(subscription)
        if others:
            self._run_others()

    def look_at(self, nodes: list[Node]) -> None:
        """Run once what is ready of nodes that EventsExecutor has.

        Waitables are its own: each keeps its place in a wait set of that executor.
        """
        self._nodes, self._changed, self._looks = set(nodes), True, True
        try:
            self.spin_once(0.0)
        finally:
            self._nodes, self._changed, self._looks = set(), True, False

    def _wait(self, timeout_sec: float | None) -> tuple[list[Subscription], bool]:
        """(the subscriptions with messages, whether anything else may be ready)."""
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
        # Waitables (what the middleware reports of publishers) wait for a timer, or the timeout:
        # watching them costs as much as all the rest.
        return came, not came or bool(self._tasks) or any(
            wait_set.get_ready_entities(kind)
            for kind in ('timer', 'service', 'client', 'guard_condition')
        )

    def _collect(self) -> None:
        """Make the wait set for what the nodes consist of now."""
        self._changed = False  # first: what changes meanwhile is seen next time
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
        """Call back with the messages that wait, for one turn."""
        kind, raw, handle = subscription.msg_type, subscription.raw, subscription.handle
        alone = subscription._callback_type is Subscription.CallbackType.MessageOnly
        end = perf_counter() + TURN
        while perf_counter() < end:
            try:
                with handle:
                    taken = handle.take_message(kind, raw)
            except InvalidHandle:  # the callback before has destroyed it
                return
            if taken is None:
                return
            if alone:
                subscription.callback(taken[0])
            else:
                subscription.callback(*taken)
        self.busy = monotonic()

    def _run_others(self) -> None:
        """Run all that is ready but messages, once."""
        while not self._is_shutdown and self._context.ok():
            try:
                handler, _, _ = self.wait_for_ready_callbacks(0.0)
            except (TimeoutException, ShutdownException):
                return
            handler()
            if handler.exception() is not None:
                raise handler.exception()


class SteadyExecutor:
    """EventsExecutor while it keeps up, `TurnsExecutor` while it does not.

    Callbacks run in the thread that calls `spin` or `spin_once`.
    """

    def __init__(self, *, context: Any = None) -> None:
        self._context = context or get_default_context()
        self._nodes: list[Node] = []
        self._turns = TurnsExecutor(context=context)
        self._events: Any = None
        self._calm = CALM
        self._since = 0.0  # that these events are queued
        self._asked = 0.0  # when an event was queued to see how long it waits; 0: it has run
        self._ask_at = 0.0
        self._ran = 0  # callbacks since then
        self._look = False  # at what came while nodes were taken in, which may go unnoticed
        if EventsExecutor is not None:
            self._queue_events()

    @property
    def context(self) -> Any:
        """As of `rclpy.executors.Executor`."""
        return self._context

    @property
    def in_turns(self) -> bool:
        """Whether more comes than EventsExecutor can do."""
        return self._events is None

    def add_node(self, node: Node) -> bool:
        """As of `rclpy.executors.Executor`."""
        if node in self._nodes:
            return False
        self._nodes.append(node)
        self._look = True
        return (self._events or self._turns).add_node(node)

    def remove_node(self, node: Node) -> None:
        """As of `rclpy.executors.Executor`."""
        if node in self._nodes:
            self._nodes.remove(node)
            (self._events or self._turns).remove_node(node)

    def get_nodes(self) -> list[Node]:
        """As of `rclpy.executors.Executor`."""
        return list(self._nodes)

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Any:
        """As of `rclpy.executors.Executor`."""
        return (self._events or self._turns).create_task(callback, *args, **kwargs)

    def wake(self) -> None:
        """As of `rclpy.executors.Executor`."""
        (self._events or self._turns).wake()

    def spin(self) -> None:
        """Run callbacks until the context ends."""
        while self._context.ok():
            self.spin_once(0.1)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait until something is ready, and run it."""
        if self._events is None:
            self._turns.spin_once(timeout_sec)
            if EventsExecutor is not None and monotonic() - self._turns.busy > self._calm:
                self._queue_events()
            return
        now = monotonic()
        self._ran += 1
        if now >= self._ask_at:
            if not self._asked:
                self._asked, self._ask_at, self._ran = now, now + ASK_EVERY, 0
                self._events.create_task(self._answer)
            elif now - self._asked > OLDEST and self._ran >= AT_LEAST:
                self._take_turns(now)
                return
        if self._look:
            self._look = False
            self._events.spin_once(timeout_sec=0.0)  # takes the nodes in
            self._turns.look_at(self._nodes)
            return
        self._events.spin_once(timeout_sec=timeout_sec)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """As of `rclpy.executors.Executor`."""
        if self._events is not None:
            self._events.shutdown()
        return self._turns.shutdown(timeout_sec)

    def _answer(self) -> None:
        self._asked = 0.0

    def _take_turns(self, now: float) -> None:
        """Forget the queue of events: `TurnsExecutor` sees for itself what is ready."""
        for node in self._nodes:
            self._turns.add_node(node)  # which takes it from the other
        self._events.shutdown()
        self._events = None
        self._turns.busy = now
        again = now - self._since < 10.0 * self._calm
        self._calm = min(2.0 * self._calm, LONGEST_CALM) if again else CALM

    def _queue_events(self) -> None:
        self._events, self._asked, self._since = (
            EventsExecutor(context=self._context),
            0.0,
            monotonic(),
        )
        for node in self._nodes:
            self._events.add_node(node)
        self._look = True


def _taken_here(entity: Any) -> bool:
    return isinstance(entity, Subscription) and not iscoroutinefunction(entity.callback)


def waiting(subscription: Subscription) -> Iterator[tuple[bytes, Any]]:
    """The raw messages that still wait on it, at most its queue's depth: (CDR bytes, info).

    EventsExecutor takes one message for each event. An event that comes while it takes a node or a
    subscription in may go unnoticed, and every message after it would be one message late.
    """
    for _ in range(subscription.qos_profile.depth or 1):
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, True)
        if taken is None:
            return
        yield taken
