#!/usr/bin/env python3
"""Tell whether a node speaks: a container's healthcheck, and in the image mabirds-healthy.

usage: mabirds-healthy NAME [SECONDS]     a learner's name, or expert_player; 10 seconds at most, unless given

Exit code 0: NAME was heard on /diagnostics, and what it said is printed. 1: it was not. Where security is on, an
enclave may not hear /diagnostics: then it is enough that the ROS graph has a node of this name, which only a living
process keeps there.
"""

import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from mabirds_msgs_py import diagnostics, topics
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.security import is_requested, make_probe, start_ros

PATIENCE = 10.0
"""Seconds; nodes speak once a second, after they have been found."""


def on_the_graph(node: Node, name: str) -> str | None:
    """Words for a node that has this name, or is alone in a namespace of it; None while none is known."""
    for node_name, namespace in node.get_node_names_and_namespaces():
        if name in (node_name, topics.split_namespace(namespace)[1]):
            return f"{namespace.rstrip('/')}/{node_name} is there"
    return None


def what_it_says(name: str, seconds: float) -> str | None:
    """What ``name`` says of itself within ``seconds``; None where it says nothing."""
    node, heard = make_probe(None), list[str]()  # no more than what every policy allows

    def listen(message: DiagnosticArray) -> None:
        heard.extend(status.message for status in message.status if status.hardware_id == name)

    secured = is_requested([])
    if not secured:
        node.create_subscription(DiagnosticArray, topics.DIAGNOSTICS, listen, diagnostics.DEPTH)
    deadline = time.monotonic() + seconds
    while not heard and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.1)
        if secured and (words := on_the_graph(node, name)):
            heard.append(words)
    return heard[0] if heard else None


def main() -> int:
    """Entry point."""
    if len(sys.argv) not in (2, 3) or sys.argv[1][:1] in ("", "-"):
        print(__doc__)
        return 2
    name, seconds = sys.argv[1], float(sys.argv[2]) if len(sys.argv) == 3 else PATIENCE
    prepare_environment()
    start_ros([])
    try:
        words = what_it_says(name, seconds)
    finally:
        rclpy.try_shutdown()
    print(f"{name}: {words}" if words else f"error: nothing heard of {name} within {seconds:g} s")
    return 0 if words else 1


if __name__ == "__main__":
    sys.exit(main())
