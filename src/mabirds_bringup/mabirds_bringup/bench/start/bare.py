"""The least that says on a topic that it is there: rclpy, one message type of this project, one publisher.

usage: python -m mabirds_bringup.bench.start.bare --ros-args -r __ns:=/NAME
"""

import sys

import rclpy
from mabirds_msgs.msg import LearnerStatus
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile


def main() -> int:
    """Publish one message, and spin until SIGTERM."""
    rclpy.init(args=sys.argv)
    node, executor = Node("bare"), SingleThreadedExecutor()
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(LearnerStatus, "status", latched).publish(LearnerStatus())
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=1.0)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
