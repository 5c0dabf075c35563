"""Asking a learner of another experiment for its settings, to name those that differ: digests say only that some do."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node

from mabirds_core.experiment.differences import differences
from mabirds_msgs_py.ros_parameters import strings_param
from mabirds_msgs_py.security import is_requested

SETTINGS = "settings"
"""Parameter of a learner's node that holds them."""

MOST = 10_000
"""Settings of others that are looked at."""


def declare_settings(node: Node, settings: Sequence[str]) -> None:
    """Let others ask a node for its settings.

    Parameters
    ----------
    node : Node
        That learns.
    settings : Sequence[str]
        As of ``settings_lines``.
    """
    words = "what decides the run, as others may ask for it; follows from the experiment"
    node.declare_parameter(SETTINGS, list(settings), strings_param(words), ignore_override=True)


class SettingsInquiry:
    """Asks each learner once. Where security is on, nobody is asked: policies do not allow it.

    Parameters
    ----------
    node : Node
        That asks.
    ours : Sequence[str]
        Its own settings.
    """

    def __init__(self, node: Node, ours: Sequence[str]) -> None:
        self._node, self._ours = node, ours
        self._asked, self._answers = set[str](), dict[str, str]()

    def words(self, learner: str, kind: str = "learner") -> str:
        """What differs, as far as it is known by now.

        Parameters
        ----------
        learner : str
            Whose settings.
        kind : str, optional
            Name of its node.

        Returns
        -------
        str
            In words; empty where nothing is known yet.
        """
        service = f"{learner}/{kind}/get_parameters"
        if service not in self._asked and not is_requested([]):
            self._asked.add(service)
            client = self._node.create_client(GetParameters, service)
            future = client.call_async(GetParameters.Request(names=[SETTINGS]))
            future.add_done_callback(partial(self._on_settings, learner))
        return self._answers.get(learner, "")

    def _on_settings(self, learner: str, future: Any) -> None:
        response = future.result()
        if response is not None and response.values:
            self._answers[learner] = differences(response.values[0].string_array_value[:MOST], self._ours)
