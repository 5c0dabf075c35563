"""A node that keeps what everybody says, and the cost grids that somebody draws of it."""

from collections.abc import Callable
from functools import partial
from typing import Any

from nav_msgs.msg import OccupancyGrid

from mabirds_bringup.draw import names
from mabirds_bringup.watch.inspector import SEARCH_PERIOD, InspectorNode, WatchedLearner
from mabirds_msgs_py.interfaces import type_name
from mabirds_msgs_py.qos import STATUS_QOS


class CostsInspectorNode(InspectorNode):
    """Keeps the newest of everybody, and in ``maps`` by topic the newest grid of costs; None before one has come."""

    def __init__(self, on_message: Callable[[WatchedLearner, str], None], **node_options: Any) -> None:
        super().__init__(on_message, **node_options)
        self.maps: dict[str, OccupancyGrid | None] = {}
        self.create_timer(SEARCH_PERIOD, self._search_maps)

    def _search_maps(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            drawn = f"/{names.DRAWN}/{names.COSTS}/" in topic and type_name(OccupancyGrid) in types
            if drawn and topic not in self.maps:
                self.maps[topic] = None
                self.create_subscription(OccupancyGrid, topic, partial(self.maps.__setitem__, topic), STATUS_QOS)
