"""Who is there: what the liveliness of a learner's parameters topic tells about its process."""

import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks

from mabirds_msgs_py.qos import LIVELINESS_LEASE

MAX_STRANGERS, MAX_DIGEST = 64, 80
"""Runs that are told apart, and characters of their digests: what others send is not kept without a limit."""


class LivelinessMonitor:
    """Counts the living publishers of each name.

    Parameters
    ----------
    on_change : Callable[[str], None], optional
        Called with a name whose publishers have all gone, or of which the first has come back.
    """

    def __init__(self, on_change: Callable[[str], None] = lambda _: None) -> None:
        self._on_change = on_change
        self._alive: dict[str, int] = {}
        self._doubled_since: dict[str, float] = {}
        self._strangers: defaultdict[str, set[str]] = defaultdict(set)

    def watch(self, name: str) -> SubscriptionEventCallbacks:
        """Event callbacks for a subscription to a topic of ``name`` with QoS ``announced``."""
        return SubscriptionEventCallbacks(liveliness=partial(self._on_liveliness, name))

    def _on_liveliness(self, name: str, event: Any) -> None:
        before, now = self._alive.get(name), event.alive_count
        self._alive[name] = now
        if before is not None and now < before:
            self._strangers.pop(name, None)  # one has gone: those of other runs are heard again, if it was none of them
        if now > 1:
            self._doubled_since.setdefault(name, time.monotonic())
        else:
            self._doubled_since.pop(name, None)
        if before is not None and (before == 0) != (now == 0):
            self._on_change(name)

    def note_stranger(self, name: str, digest: str) -> None:
        """One of those that publish under a name is of another run.

        Parameters
        ----------
        name : str
            That is watched.
        digest : str
            Of the other run.
        """
        self._strangers[name].add(digest[:MAX_DIGEST])
        if len(self._strangers[name]) > MAX_STRANGERS:
            self._strangers[name].pop()

    def is_lost(self, name: str) -> bool:
        """Was it there, and has nothing been heard of it for LIVELINESS_LEASE seconds?"""
        return self._alive.get(name) == 0

    def duplicates(self) -> list[str]:
        """Names that several living processes of this run publish under; not one that was started again just now."""
        now = time.monotonic()
        lasting = [name for name, since in self._doubled_since.items() if now - since > 2 * LIVELINESS_LEASE]
        return [name for name in lasting if self._alive[name] - len(self._strangers.get(name, ())) > 1]
