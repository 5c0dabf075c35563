"""Every number of a status on a topic of its own, by name, so that plotting tools find it."""

import math
from collections.abc import Mapping
from typing import Any

from mabirds_msgs.msg import LearnerStatus
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from mabirds_bringup.draw import names
from mabirds_msgs_py.qos import STATUS_QOS

MOST = 256
"""Topics of a learner: what others send makes no more than these."""


def scalars_of(status: LearnerStatus) -> dict[str, float]:
    """All numbers of a status by name; those that are none are left out."""
    metrics = dict(zip(status.metric_names, status.metric_values, strict=False))
    numbers = {
        "iteration": status.iteration,
        "last_demonstration": status.last_demonstration,
        "backlog": status.backlog,
        "state": status.state,
        "dropped": sum(status.drop_counts),
        **metrics,
    }
    return {names.scalar(name): float(value) for name, value in numbers.items() if math.isfinite(value)}


class ScalarTopics:
    """Publishes numbers by name below one place.

    Parameters
    ----------
    node : Node
        That publishes.
    place : str
        Of the topics.
    """

    def __init__(self, node: Node, place: str) -> None:
        self._node, self._place = node, place
        self._publishers: dict[str, Publisher] = {}

    def publish(self, values: Mapping[str, float]) -> None:
        """Publish each on its own topic, which is made when it is first needed."""
        for name, value in values.items():
            if (publisher := self._publisher(name)) is not None:
                publisher.publish(Float64(data=value))

    def _publisher(self, name: str) -> Any:
        if name not in self._publishers and len(self._publishers) < MOST:
            topic = f"{self._place}/{name}"
            self._publishers[name] = self._node.create_publisher(Float64, topic, STATUS_QOS)
        return self._publishers.get(name)
