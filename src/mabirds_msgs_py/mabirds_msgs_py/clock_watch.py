"""Wakes the middleware up when the system's clock was set back: it waits until times of that clock.

Fast DDS as built for the wheels has two kinds of waits in which a second becomes an hour where the clock is set back by
one: that of a wait set, in which a node's loop waits for messages and timers, and that of a participant's thread of
events, which announces it and asks for what was lost (``pthread_cond_timedwait`` in ``WaitSetImpl::wait`` and in
``ResourceEvent::event_service``). A process that nobody has met yet gets no message that would end the first, and is
not met as long as the second lasts. Once ended, both begin anew with the clock as it is.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rcl_interfaces.msg import ParameterEvent
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import qos_profile_parameter_events

PERIOD = 0.1
"""Seconds between two looks; a clock that is set back and forth in between is not noticed."""

SUSPENDED = 1.0
"""Seconds between two looks from which on this process stood still, and nobody knows what its clock did meanwhile."""

LEAST = 0.05
"""Seconds by which a clock is set back at least; less lengthens waits by as little."""


class SetBack:
    """Notices that the system's clock was set back, or may have been.

    Parameters
    ----------
    system : Callable[[], float], optional
        Seconds of the system's clock.
    steady : Callable[[], float], optional
        Seconds that only grow.
    """

    def __init__(self, system: Callable[[], float] = time.time, steady: Callable[[], float] = time.monotonic) -> None:
        self._system, self._steady = system, steady
        self._looked_at = steady()
        self._ahead = system() - self._looked_at

    def happened(self) -> bool:
        """Has it been since the last look?"""
        looked_at, ahead = self._looked_at, self._ahead
        self._looked_at = self._steady()
        self._ahead = self._system() - self._looked_at
        return self._ahead < ahead - LEAST or self._looked_at > looked_at + SUSPENDED


@contextmanager
def waking(executor: Executor, node: Node, clock: SetBack) -> Iterator[None]:
    """Wake up what waits in this process whenever the system's clock was set back.

    Parameters
    ----------
    executor : Executor
        Which spins in this context.
    node : Node
        One of its nodes.
    clock : SetBack
        Made before the participant.

    Yields
    ------
    None
        Nothing.
    """
    held, over = threading.Lock(), threading.Event()

    def look() -> None:
        again = False
        while not over.is_set():
            set_back = clock.happened()
            with held:
                if (set_back or again) and not over.is_set():
                    executor.create_task(_wake_events, node)  # which wakes the executor
            again = set_back  # a thread that had just read the clock may begin to wait only now
            time.sleep(PERIOD)  # steady, as waits with a timeout are not in every Python

    threading.Thread(target=look, daemon=True, name="clock watch").start()
    try:
        yield
    finally:
        with held:
            over.set()


def _wake_events(node: Node) -> None:
    """Fast DDS looks at its events anew when there is another timer: each publisher has some."""
    node.destroy_publisher(node.create_publisher(ParameterEvent, "/parameter_events", qos_profile_parameter_events))
