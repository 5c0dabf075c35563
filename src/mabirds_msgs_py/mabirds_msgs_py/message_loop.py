"""A loop that hands messages to callbacks with little ado, and leaves all else to rclpy's executor.

rclpy builds anew what it waits for before each callback, makes a task of it and wakes itself up twice: half a
millisecond for a message. Here subscriptions are taken from directly, and what is waited for is kept. Timers, services,
events and guard conditions wake the loop, too, and are then the executor's to call.
"""

import time
from collections.abc import Iterable
from contextlib import ExitStack
from typing import Any

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as implementation
from rclpy.node import Node

NANOSECONDS = 1_000_000_000

MOST_IN_A_ROW = 16
"""Wake-ups by messages alone after which the executor is asked for the rest: nobody starves."""


class MessageLoop:
    """The loop of one node, in one thread.

    Parameters
    ----------
    node : Node
        Whose callbacks of messages are plain functions.
    executor : SingleThreadedExecutor
        Has no other node.
    """

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self._node, self._executor, self._context = node, executor, node.context
        self._held = ExitStack()
        self._entities: Any = None
        self._in_a_row = 0
        executor.add_node(node)

    def spin_once(self, timeout_sec: float) -> None:
        """Wait for something to do, and do it.

        Parameters
        ----------
        timeout_sec : float
            To wait at most.

        Raises
        ------
        ExternalShutdownException
            The context was shut down meanwhile.
        """
        self._require_context()
        if self._entities is None:
            self._gather()
        ready = self._wait(int(timeout_sec * NANOSECONDS))
        for pointer in ready:
            self._take(self._subscriptions[pointer])
        self._in_a_row = self._in_a_row + 1 if ready else 0
        if not ready or self._in_a_row > MOST_IN_A_ROW:
            self._in_a_row, self._entities = 0, None  # what the executor calls may add something to wait for
            self._executor.spin_once(timeout_sec=0)

    def glance(self, pause: float, most: int) -> None:
        """Let messages gather for a while and take them all at once: cheaper than each when it comes.

        Parameters
        ----------
        pause : float
            Seconds.
        most : int
            Messages that are taken of a topic; others wait, or are replaced by newer ones, as its QoS says.

        Raises
        ------
        ExternalShutdownException
            The context was shut down meanwhile.
        """
        time.sleep(pause)
        for _ in range(MOST_IN_A_ROW):
            self._require_context()
            self._gather()  # what was called last may have added something
            for pointer in self._wait(0):
                subscription, taken = self._subscriptions[pointer], 0
                while taken < most and self._take(subscription):
                    taken += 1
            if not self._others_are_due():
                break
            self._executor.spin_once(timeout_sec=0)

    def _others_are_due(self) -> bool:
        """Has anything but messages come of the last wait?"""
        wait_set = self._wait_set
        return any(wait_set.get_ready_entities(kind) for kind, _ in self._entities) or any(
            waitable.is_ready(wait_set) for waitable in self._waitables
        )

    def _require_context(self) -> None:
        if not self._context.ok():
            raise ExternalShutdownException

    def _gather(self) -> None:
        """All that can happen, held until it is gathered again: nothing is destroyed while it is waited for."""
        self._held.close()
        node, executor = self._node, self._executor
        others: dict[str, Iterable[Any]]
        self._subscriptions = {self._hold(each.handle).pointer: each for each in node.subscriptions}
        self._guards = [*node.guards, executor._guard, executor._sigint_gc]  # noqa: SLF001 - wake it up
        others = {
            "timer": node.timers,
            "client": node.clients,
            "service": node.services,
            "guard_condition": self._guards,
        }
        self._entities = [(kind, [self._hold(each.handle) for each in entities]) for kind, entities in others.items()]
        self._waitables = list(node.waitables)
        for waitable in self._waitables:
            self._held.enter_context(waitable)
        self._wait_set = self._make_wait_set()

    def _hold(self, handle: Any) -> Any:
        self._held.enter_context(handle)
        return handle

    def _make_wait_set(self) -> Any:
        counts = {kind: len(handles) for kind, handles in self._entities}
        of_waitables = [waitable.get_num_entities() for waitable in self._waitables]
        return implementation.WaitSet(
            len(self._subscriptions) + sum(count.num_subscriptions for count in of_waitables),
            counts["guard_condition"] + sum(count.num_guard_conditions for count in of_waitables),
            counts["timer"] + sum(count.num_timers for count in of_waitables),
            counts["client"] + sum(count.num_clients for count in of_waitables),
            counts["service"] + sum(count.num_services for count in of_waitables),
            sum(count.num_events for count in of_waitables),
            self._hold(self._context.handle),
        )

    def _wait(self, nanoseconds: int) -> list[int]:
        """Pointers of the subscriptions that have something."""
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in self._subscriptions.values():
            wait_set.add_subscription(subscription.handle)
        for kind, handles in self._entities:
            add = getattr(wait_set, f"add_{kind}")
            for handle in handles:
                add(handle)
        for waitable in self._waitables:
            waitable.add_to_wait_set(wait_set)
        wait_set.wait(nanoseconds)
        self._require_context()
        self._remember_guards(wait_set.get_ready_entities("guard_condition"))
        return [pointer for pointer in wait_set.get_ready_entities("subscription") if pointer in self._subscriptions]

    def _remember_guards(self, pointers: list[int]) -> None:
        """Waiting has taken their triggers away; the executor is told of them as it tells itself."""
        for guard in self._guards if pointers else ():
            if guard.handle.pointer in pointers:
                guard._executor_triggered = True  # noqa: SLF001

    @staticmethod
    def _take(subscription: Any) -> bool:
        """Take a message, if there is any."""
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is not None:
            subscription.callback(taken[0])
        return taken is not None

    def close(self) -> None:
        """Let go of everything."""
        self._held.close()
        self._entities = None
