"""A timer that is set to a time, rings then or before, and is left alone where it is set early enough already.

Setting a timer wakes up the loop that waits for it, which took a player longer than what it then did. It is never
cancelled: an executor that has just found it ready would fail to call it.
"""

from collections.abc import Callable

from rclpy.node import Node

from mabirds_msgs_py.conversion import NANOSECONDS

IDLE = 3600.0
"""Seconds after which it rings at the latest."""

ON_TIME = 1e-6
"""Seconds by which it may ring too late."""


class Alarm:
    """Calls back at a time, or before; whoever is called sets it anew.

    Parameters
    ----------
    node : Node
        Whose timer it is.
    on_time : Callable[[], None]
        What is called.
    """

    def __init__(self, node: Node, on_time: Callable[[], None]) -> None:
        self._on_time, self._rings_at = on_time, 0.0
        self._timer = node.create_timer(IDLE, self._ring)

    def _ring(self) -> None:
        self._rings_at = 0.0  # by another clock than ours, it may be early
        self._on_time()

    def set(self, now: float, pause: float) -> None:
        """Ring after a pause, or before.

        Parameters
        ----------
        now : float
            Seconds of a steady clock.
        pause : float
            Seconds; longer than ``IDLE`` is as long.
        """
        pause = min(pause, IDLE)
        if not now < self._rings_at <= now + pause + ON_TIME:
            self._rings_at = now + pause
            self._timer.timer_period_ns = max(1, int(pause * NANOSECONDS))
            self._timer.reset()
