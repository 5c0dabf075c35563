"""A node of ours for as long as a command looks at a network."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from mabirds_msgs_py.clock_watch import SetBack, waking
from mabirds_msgs_py.message_loop import MessageLoop
from mabirds_msgs_py.security import enclave_arguments, start_ros

NICE = 10
"""By how much those who learn go before those who look."""

PAUSE, MOST = 0.1, 5
"""Seconds between two glances, and messages of one topic that are taken in each."""


class Glances:
    """A node that is spun now and then: of what came meanwhile it takes the newest, and costs little beside learners.

    Parameters
    ----------
    node : Node
        Whose subscriptions keep few messages.
    executor : SingleThreadedExecutor
        That has it.
    """

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self._loop = MessageLoop(node, executor)

    def glance(self) -> None:
        """Wait PAUSE seconds, then take what is there."""
        self._loop.glance(PAUSE, MOST)

    def close(self) -> None:
        """Let go of the node."""
        self._loop.close()


@contextmanager
def looking(create: Callable[[], Any], enclave: str) -> Iterator[tuple[Any, SingleThreadedExecutor]]:
    """A node and an executor to spin it with.

    Parameters
    ----------
    create : Callable[[], Any]
        Makes the node, once ROS is started.
    enclave : str
        Of the process.

    Yields
    ------
    tuple
        The node and the executor.
    """
    os.environ.setdefault("ROS_SUPER_CLIENT", "TRUE")  # a discovery server tells others what they ask for only
    clock = SetBack()  # before the participant is made
    start_ros(["--ros-args", *enclave_arguments(enclave)], signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    try:
        node: Node = create()
        executor.add_node(node)
        with waking(executor, node, clock):
            yield node, executor
        node.destroy_node()
    finally:
        executor.shutdown()
        rclpy.try_shutdown()
