"""The one way in which a node's process starts, spins and ends."""

import os
import sys
import time
from collections.abc import Callable, Sequence

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from mabirds_core.errors import MabirdsError
from mabirds_msgs_py.addresses import AddressWatch
from mabirds_msgs_py.clock_watch import SetBack, waking
from mabirds_msgs_py.early import without_collection
from mabirds_msgs_py.environment import load_type_support_alone
from mabirds_msgs_py.message_loop import MessageLoop
from mabirds_msgs_py.network_node import require_known_parameters
from mabirds_msgs_py.security import start_ros
from mabirds_msgs_py.supervised import SUPERVISOR, end_with_supervisor

EXIT_FINISHED = 0
EXIT_BAD_INPUT = 2

EXIT_MOVED = 75
"""The host has other addresses than when the node began; its supervisor starts it again, with a new participant."""

BAD_INPUT = (MabirdsError, InvalidParameterTypeException, InvalidParameterValueException)

IDLE_WAKE_UP = 1.0
"""Seconds after which the loop looks at rclpy.ok() even if nothing happens."""


def run_node(create: Callable[[], Node], help_text: str, arguments: Sequence[str] | None = None) -> int:
    """Create one node and spin it until SIGINT, SIGTERM or its attribute ``done``.

    For the seconds of its attribute ``gather``, if it has any, it lets messages gather before it takes them.

    Bad input, and security that was asked for and is not enforced, is one line on standard error, never a traceback.

    Parameters
    ----------
    create : Callable[[], Node]
        The node, once ROS is started.
    help_text : str
        What ``--help`` prints.
    arguments : Sequence[str], optional
        Of the command line; default: those of the process.

    Returns
    -------
    int
        The exit code: 2 for bad input.
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    if "--help" in given or "-h" in given:
        print(help_text)  # noqa: T201 - what --help is for
        return EXIT_FINISHED
    end_with_supervisor()
    load_type_support_alone()
    addresses, clock = AddressWatch(), SetBack()  # before the participant is made, which keeps to both
    try:
        start_ros(given)
    except MabirdsError as error:
        return _refuse(error)
    try:
        executor = SingleThreadedExecutor()  # before the node is seen: whoever sees it may end this process
        with addresses.while_made(), without_collection():
            node = create()
        require_known_parameters(node)
        loop = MessageLoop(node, executor)
        with waking(executor, node, clock):
            if not _spin(node, loop, addresses):
                return EXIT_MOVED
        loop.close()
        node.destroy_node()
    except BAD_INPUT as error:
        return _refuse(error)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RCLError as error:
        if rclpy.ok():  # else a signal took the context away in the middle of a call: ended as asked
            return _refuse(error)
    finally:
        rclpy.try_shutdown()
    return EXIT_FINISHED


def _spin(node: Node, loop: MessageLoop, addresses: AddressWatch) -> bool:
    """Until it is done, True; or until it must be started again since the host has other addresses, False."""
    told = False
    while rclpy.ok() and not getattr(node, "done", False):
        if pause := getattr(node, "gather", 0.0):  # what it lets messages gather for
            time.sleep(pause)
        loop.spin_once(timeout_sec=IDLE_WAKE_UP)
        if not told and (words := addresses.changed()):
            if SUPERVISOR in os.environ:
                print(f"{words}; to be started again", file=sys.stderr)  # noqa: T201 - into the log
                return False
            node.get_logger().warning(f"{words}: others may not hear this process; start it again")
            told = True
    return True


def _refuse(error: Exception) -> int:
    print(f"error: {error}", file=sys.stderr)  # noqa: T201 - there may be no logger yet
    return EXIT_BAD_INPUT
