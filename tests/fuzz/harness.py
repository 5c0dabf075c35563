"""Nodes in this process, and messages handed to them."""

from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from mabirds_msgs.msg import Demonstration
from rclpy.node import Node
from rclpy.serialization import serialize_message

NODES = pytest.mark.parametrize("count", [8, pytest.param(150, marks=pytest.mark.slow)])


def few(count: int) -> settings:
    return settings(max_examples=count, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def sent_to(node: Node, topic: str, message: Any) -> None:
    """What the middleware does when a message arrives."""
    (subscription,) = [one for one in node.subscriptions if one.topic_name == topic]
    subscription.callback(serialize_message(message) if subscription.raw else message)


def topic_of(sender: str, message: Any) -> str:
    return f"/{sender}/{'demonstration' if isinstance(message, Demonstration) else 'parameters'}"
