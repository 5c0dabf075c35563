"""A loop that hands messages to callbacks with little ado, and leaves all else to rclpy's executor.

rclpy builds anew what it waits for before each callback, makes a task of it and wakes itself up twice: half a
millisecond for a message. Here subscriptions are taken from directly, and what is waited for is kept. Timers, services,
events and guard conditions wake the loop, too, and are then the executor's to call.

To look whether a subscription has a message takes a microsecond, to wait for messages, timers and guard conditions 30,
and to wait for services and events of the middleware as well 80. So all subscriptions are looked at first, and where
messages follow each other closely, the wait for all else begins a little later.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as implementation
from rclpy.node import Node

NANOSECONDS = 1_000_000_000

MOST_IN_A_ROW = 16
"""Messages, or rounds of them, after which it is looked at what else is due: nobody starves."""

SOON = 0.005
"""Seconds after a message in which services and events wait, as the next one is likely to come."""

PROMPT = ("timer", "guard_condition")
"""What is always waited for beside messages."""


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
        """Messages since it was looked at what else is due."""
        self._due = False
        """Is anything but messages known to be due?"""
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
        taken = self._take_all() or self._wait_and_take(0.0 if self._due else timeout_sec)
        self._in_a_row = self._in_a_row + taken if taken else 0
        if self._in_a_row > MOST_IN_A_ROW:
            self._in_a_row = 0
            self._wait(0.0)
        if not self._in_a_row:
            self._leave_to_executor()

    def _take_all(self) -> int:
        """Take what is there, if not more of a topic than its turn; how many messages."""
        return sum(map(self._take_some, self._subscriptions.values()))

    def _take_some(self, subscription: Any, most: int = MOST_IN_A_ROW) -> int:
        taken = 0
        while taken < most and self._take(subscription):
            taken += 1
        return taken

    def _wait_and_take(self, timeout_sec: float) -> int:
        """Wait for something to do; how many messages were taken."""
        ready = self._wait(min(timeout_sec, SOON), prompt=True) if self._in_a_row else []
        if not (ready or self._due):
            ready = self._wait(timeout_sec)
        return sum(self._take_some(self._subscriptions[pointer]) for pointer in ready)

    def _leave_to_executor(self) -> None:
        """Have it call what is due beside messages, if anything is: to look for it takes the executor long."""
        if self._due or self._executor._tasks:  # noqa: SLF001 - whose turn comes at each of its looks
            self._due, self._entities = False, None  # what the executor calls may add something to wait for
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
            for pointer in self._wait(0.0):
                self._take_some(self._subscriptions[pointer], most)
            if not self._due:
                break
            self._leave_to_executor()

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
        self._entities = {kind: [self._hold(each.handle) for each in entities] for kind, entities in others.items()}
        waitables = list(node.waitables)
        for waitable in waitables:
            self._held.enter_context(waitable)
        self._all = self._waiting_for(self._entities, waitables)
        self._prompt = self._waiting_for({kind: self._entities[kind] for kind in PROMPT}, [])

    def _hold(self, handle: Any) -> Any:
        self._held.enter_context(handle)
        return handle

    def _waiting_for(self, entities: Mapping[str, Sequence[Any]], waitables: Sequence[Any]) -> "_WaitingFor":
        """A wait for messages and for these."""
        counts = Counter({kind: len(handles) for kind, handles in entities.items()})
        of_waitables = [waitable.get_num_entities() for waitable in waitables]
        wait_set = implementation.WaitSet(
            len(self._subscriptions) + sum(count.num_subscriptions for count in of_waitables),
            counts["guard_condition"] + sum(count.num_guard_conditions for count in of_waitables),
            counts["timer"] + sum(count.num_timers for count in of_waitables),
            counts["client"] + sum(count.num_clients for count in of_waitables),
            counts["service"] + sum(count.num_services for count in of_waitables),
            sum(count.num_events for count in of_waitables),
            self._hold(self._context.handle),
        )
        adds = [(wait_set.add_subscription, each.handle) for each in self._subscriptions.values()]
        for kind, handles in entities.items():
            adds += [(getattr(wait_set, f"add_{kind}"), handle) for handle in handles]
        return _WaitingFor(wait_set, adds, tuple(entities), waitables)

    def _wait(self, seconds: float, *, prompt: bool = False) -> list[int]:
        """Pointers of the subscriptions that have something; ``prompt``: waits for nothing that can wait."""
        waiting = self._prompt if prompt else self._all
        waiting.wait(int(seconds * NANOSECONDS))
        self._require_context()
        self._remember_guards(waiting.wait_set.get_ready_entities("guard_condition"))
        self._due = self._due or waiting.others_are_due()
        ready = waiting.wait_set.get_ready_entities("subscription")
        return [pointer for pointer in ready if pointer in self._subscriptions]

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


class _WaitingFor(NamedTuple):
    """What is waited for at once: a set, how it is filled before each wait, kinds of what it has beside messages."""

    wait_set: Any
    adds: Sequence[tuple[Callable[[Any], Any], Any]]
    kinds: tuple[str, ...]
    waitables: Sequence[Any]

    def wait(self, nanoseconds: int) -> None:
        self.wait_set.clear_entities()
        for add, handle in self.adds:
            add(handle)
        for waitable in self.waitables:
            waitable.add_to_wait_set(self.wait_set)
        self.wait_set.wait(nanoseconds)

    def others_are_due(self) -> bool:
        """Has anything but messages come of the last wait?"""
        return any(map(self.wait_set.get_ready_entities, self.kinds)) or any(
            waitable.is_ready(self.wait_set) for waitable in self.waitables
        )
