"""The one way in which a node's process starts, spins and ends."""

import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from mabirds_core.errors import MabirdsError

EXIT_FINISHED = 0
EXIT_BAD_INPUT = 2

BAD_INPUT = (MabirdsError, InvalidParameterTypeException, InvalidParameterValueException, RCLError)

IDLE_WAKE_UP = 1.0
"""Seconds after which the loop looks at rclpy.ok() even if nothing happens."""


def run_node(create: Callable[[], Node], help_text: str, arguments: Sequence[str] | None = None) -> int:
    """Create one node and spin it until SIGINT, SIGTERM or its attribute ``done``; returns the exit code.

    ``--help`` prints ``help_text``. Bad input is one line on standard error and exit code 2, never a traceback.
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    if "--help" in given or "-h" in given:
        print(help_text)
        return EXIT_FINISHED
    try:
        rclpy.init(args=given)
        node = create()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while rclpy.ok() and not getattr(node, "done", False):
            executor.spin_once(timeout_sec=IDLE_WAKE_UP)
    except BAD_INPUT as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
    return EXIT_FINISHED
