"""Listening to any topic: its type and QoS are those of its publishers."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mabirds_msgs.msg import FeatureNames
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from mabirds_bringup import exit_codes
from mabirds_bringup.topics.plain import InspectionError, message_type
from mabirds_core.experiment.names import ParameterNames
from mabirds_core.texts import truncate
from mabirds_msgs_py import topics
from mabirds_msgs_py.feature_names_conversion import read_feature_names
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.qos import STATUS_QOS

BURST = 0.5
"""Seconds for which messages that a publisher keeps for late joiners may come."""

DEPTH = 1000


class NothingHeardError(InspectionError):
    """There is nobody, or nothing came."""

    exit_code = exit_codes.NOBODY_THERE


@contextmanager
def allowed(what: str) -> Iterator[None]:
    """Say in words that the middleware refuses to listen or to call.

    Raises
    ------
    InspectionError
        It does.
    """
    try:
        yield
    except RCLError as error:
        words = " ".join(str(error).split())
        raise InspectionError(
            f"{what}: the middleware refuses it ({truncate(words)}); with security on, the permissions of /inspector"
            " say what it may hear, and nothing that it may call"
        ) from None


class Listening:
    """Finds topics and listens to one at a time.

    Parameters
    ----------
    node : Node
        That listens.
    executor : SingleThreadedExecutor
        Spins it.
    timeout : float
        Seconds to find a topic.
    """

    def __init__(self, node: Node, executor: SingleThreadedExecutor, timeout: float) -> None:
        self._node, self._executor, self._timeout = node, executor, timeout

    def spin_until(self, condition: Callable[[], Any], timeout: float | None = None) -> bool:
        """Spin until a condition holds; tells whether it came to hold in time."""
        deadline = time.monotonic() + (self._timeout if timeout is None else timeout)
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def type_of(self, topic: str) -> str:
        """The type of a topic that somebody publishes.

        Raises
        ------
        NothingHeardError
            Nobody does.
        """
        known: dict[str, list[str]] = {}

        def found() -> bool:
            known.update(self._node.get_topic_names_and_types())
            return topic in known and self._node.count_publishers(topic) > 0

        if not self.spin_until(found):
            near = ", ".join(sorted(known)[:8])
            raise NothingHeardError(
                f"topic {truncate(topic)}: nobody publishes it; there is {near or 'nothing'}. Start the nodes, or"
                " compare ROS_DOMAIN_ID"
            )
        return known[topic][0]

    def qos_of(self, topic: str) -> QoSProfile:
        """What fits all publishers of a topic: as reliable and as latched as the least of them."""
        offered = [info.qos_profile for info in self._node.get_publishers_info_by_topic(topic)]
        latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in offered)
        reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in offered)
        return QoSProfile(
            depth=DEPTH,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        )

    def subscribe(self, topic: str, receive: Callable[[Any], None], *, raw: bool = False) -> QoSProfile:
        """Listen; ``raw``: to bytes."""
        kind, qos = message_type(self.type_of(topic)), self.qos_of(topic)
        with allowed(f"topic {truncate(topic)}"):
            self._node.create_subscription(kind, topic, receive, qos, raw=raw)
        return qos

    def messages(self, topic: str) -> Iterator[Any]:
        """All messages from now on, and those that a publisher keeps; for ever."""
        waiting: list[Any] = []
        self.subscribe(topic, waiting.append)
        while True:
            self._executor.spin_once(timeout_sec=0.1)
            while waiting:
                yield waiting.pop(0)

    def newest(self, topic: str) -> Any:
        """The newest message: of those that a publisher keeps, the last.

        Raises
        ------
        NothingHeardError
            None came in time.
        """
        came: list[tuple[float, Any]] = []
        qos = self.subscribe(topic, lambda message: came.append((time.monotonic(), message)))
        if not self.spin_until(lambda: came):
            raise NothingHeardError(f"topic {truncate(topic)}: nothing came within {self._timeout:g} s")
        if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self.spin_until(lambda: time.monotonic() - came[-1][0] > BURST, 4 * BURST)
        return came[-1][1]

    def names_for(self, topic: str) -> ParameterNames:
        """What a learner calls its parameters, if ``topic`` is theirs and it says so soon."""
        heard: list[FeatureNames] = []
        if self.type_of(topic) != f"{ParametersMessage.__module__.split('.', maxsplit=1)[0]}/msg/Parameters":
            return ParameterNames((), ())
        place = f"{topic.rpartition('/')[0]}/{topics.FEATURE_NAMES}"
        self._node.create_subscription(FeatureNames, place, heard.append, STATUS_QOS)
        self.spin_until(lambda: heard, 2.0)
        return read_feature_names(heard[0]) if heard else ParameterNames((), ())


def listener_node(**node_options: Any) -> NetworkNode:
    """A node that says nothing of its own; options as of ``rclpy.node.Node``."""
    return NetworkNode("inspector", **node_options)
