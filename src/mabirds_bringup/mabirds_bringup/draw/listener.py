"""A node that hears everything that can be drawn."""

import time
from functools import partial
from typing import Any

from nav_msgs.msg import OccupancyGrid, Path
from visualization_msgs.msg import MarkerArray

from mabirds_bringup.watch.inspector import SEARCH_PERIOD
from mabirds_msgs_py.interfaces import type_name
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.qos import STATUS_QOS

KINDS = {type_name(kind): kind for kind in (OccupancyGrid, Path, MarkerArray)}

SETTLING = 2.0
"""Seconds without a new topic after which no more are to be expected."""


class DrawnListener(NetworkNode):
    """Keeps the newest message of each topic of grids, paths and markers, in ``drawn`` by topic."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("picture", **node_options)
        self.drawn: dict[str, Any] = {}
        self._found, self._found_at = set[str](), time.monotonic()
        self.create_timer(SEARCH_PERIOD, self._search)

    def settled(self) -> bool:
        """Has every topic that was found been heard, and has none been found for a while?"""
        quiet = time.monotonic() - self._found_at > SETTLING
        return quiet and bool(self.drawn) and self._found - self.drawn.keys() == set()

    def _search(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            kind = next((KINDS[name] for name in types if name in KINDS), None)
            if kind is not None and topic not in self._found:
                self._found.add(topic)
                self._found_at = time.monotonic()
                self.create_subscription(kind, topic, partial(self.drawn.__setitem__, topic), STATUS_QOS)
