"""A node of ours for as long as a command looks at a network."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from mabirds_msgs_py.security import enclave_arguments, start_ros


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
    start_ros(["--ros-args", *enclave_arguments(enclave)], signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    try:
        node: Node = create()
        executor.add_node(node)
        yield node, executor
        node.destroy_node()
    finally:
        executor.shutdown()
        rclpy.try_shutdown()
