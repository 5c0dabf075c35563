"""How the parts of a run on several hosts end: nobody leaves while another part still has to hear of its learners."""

import time
from collections.abc import Collection, Iterator, Sequence

import rclpy
from rclpy.node import Node

SHUTDOWN_TIMEOUT = 5.0
"""Seconds in which those who stay hear what was said before somebody leaves."""

PATIENCE = 60.0
"""Seconds for which a part that has everything is there for others that have not said so."""

PERIOD = 0.5
"""Seconds between two looks at who is there."""


class Farewell:
    """Tells other hosts that this one has everything, and whether all of them have.

    It is told by nodes in the ROS graph, one for each name of this part, since who hears of them needs no topic.
    ``part``: names of this host. ``names``: of all. ``digest``: of the run.
    """

    def __init__(self, part: Collection[str], names: Sequence[str], digest: str) -> None:
        self._part, self._others = part, set(names) - set(part) if part else set[str]()
        self._node_name = f"has_all_of_{digest.rpartition('-')[2][:16]}"
        self._nodes: list[Node] = []
        self._began, self._looked_at, self.news = 0.0, 0.0, list[str]()

    def is_over(self) -> bool:
        """May this host leave, which has everything? Looks from time to time."""
        if not self._part:
            return True
        now = time.monotonic()
        if not self._nodes:
            self._begin(now)
        if self._others and now - self._looked_at > PERIOD:
            self._looked_at = now
            self._others -= self._seen()
            self._began = self._began if self._others else now
        return now - self._began > (PATIENCE if self._others else SHUTDOWN_TIMEOUT)

    def _begin(self, now: float) -> None:
        self._nodes, self._began = list(self._telling()), now
        if self._others:
            self.news.append(f"all is here; waiting until {', '.join(sorted(self._others))} have it all on their host")

    def last_words(self) -> list[str]:
        """Whom this host leaves although they have not said that they have everything, and what helps them."""
        if not self._others:
            return []
        names = ", ".join(sorted(self._others))
        return [f"the host of {names} has not said that it has everything; where it waits, run this command once more"]

    def _telling(self) -> Iterator[Node]:
        for name in self._part:
            yield rclpy.create_node(
                self._node_name, namespace=f"/{name}", enable_rosout=False, start_parameter_services=False
            )

    def _seen(self) -> set[str]:
        """Names whose host has everything."""
        nodes = self._nodes[0].get_node_names_and_namespaces()
        return {namespace.strip("/") for name, namespace in nodes if name == self._node_name}

    def close(self) -> None:
        """Take the nodes out of the graph."""
        for node in self._nodes:
            node.destroy_node()
