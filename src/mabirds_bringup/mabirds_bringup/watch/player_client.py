"""Asking a running player: its services, and the reasons that its status tells."""

import time
from collections.abc import Callable
from typing import Any

from mabirds_msgs.msg import PlayerStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from mabirds_bringup import exit_codes
from mabirds_core.errors import MabirdsError
from mabirds_core.texts import sanitize
from mabirds_msgs_py.player_services import STATUS, service_package, service_type
from mabirds_msgs_py.qos import STATUS_QOS

REASON_PATIENCE = 2.0
"""Seconds to wait for the reason of an answer."""


class NoPlayerError(MabirdsError):
    """There is no player of this name."""

    exit_code = exit_codes.NOBODY_THERE


class PlayerClient(Node):
    """One who asks a player.

    Parameters
    ----------
    player : str
        Its name, such as "/expert_player".
    timeout : float
        Seconds to find it, and for its answers.
    **node_options : Any
        Of ``rclpy.node.Node``.
    """

    def __init__(self, player: str, timeout: float, **node_options: Any) -> None:
        super().__init__("player_client", **node_options)
        self._player, self._timeout = player, timeout
        self.status: PlayerStatus | None = None
        self.create_subscription(PlayerStatus, f"{player}/{STATUS}", self._on_status, STATUS_QOS)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self)

    def _on_status(self, status: PlayerStatus) -> None:
        self.status = status

    def find(self) -> PlayerStatus:
        """The status of the player.

        Raises
        ------
        NoPlayerError
            It is not heard.
        """
        self._spin_until(lambda: self.status is not None, self._timeout)
        if self.status is None:
            raise NoPlayerError(
                f"no player {self._player} is heard within {self._timeout:g} s; start one by `mabirds play` or"
                " `mabirds run`, or compare --player and ROS_DOMAIN_ID here and there"
            )
        return self.status

    def ask(self, name: str, **fields: Any) -> tuple[Any, str]:
        """Call a service.

        Parameters
        ----------
        name : str
            One of PLAYER_SERVICES.
        **fields : Any
            Of the request.

        Returns
        -------
        tuple[Any, str]
            The response, and the reason that the player gives.

        Raises
        ------
        NoPlayerError
            It does not answer.
        """
        before = self.find().answers
        kind = service_type(name, self._package(name))
        client = self.create_client(kind, f"{self._player}/{name}")
        self._spin_until(client.service_is_ready, self._timeout)
        future = client.call_async(kind.Request(**fields))
        self._spin_until(future.done, self._timeout)
        if not future.done():
            raise NoPlayerError(f"{self._player} does not answer {name} within {self._timeout:g} s; look at its log")
        self._spin_until(lambda: self.status is not None and self.status.answers > before, REASON_PATIENCE)
        status = self.find()
        return future.result(), sanitize(status.answer) if status.answers > before else ""

    def _package(self, name: str) -> str:
        """Where the type is from that this player serves: it may run where rosbag2 is installed, or where it is not."""
        known = dict(self.get_service_names_and_types())
        types = known.get(f"{self._player}/{name}", [])
        return types[0].partition("/")[0] if types else service_package()

    def _spin_until(self, condition: Callable[[], bool], timeout: float) -> None:
        deadline = time.monotonic() + timeout
        while not condition() and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)
