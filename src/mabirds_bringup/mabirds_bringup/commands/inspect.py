"""``mabirds inspect``: what the learners of this domain say."""

import os
import sys
import time
from contextlib import suppress
from typing import Annotated, Any

import rclpy
import typer
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup import exit_codes
from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.watch.inspector import InspectorNode, WatchedLearner, describe, describe_parameters
from mabirds_core.errors import ExperimentError
from mabirds_core.texts import sanitize
from mabirds_learner.learner_session import DEMONSTRATION
from mabirds_msgs_py.clock_watch import SetBack, waking
from mabirds_msgs_py.constraints_conversion import constraints_text
from mabirds_msgs_py.security import enclave_arguments, start_ros

MAX_LINE = 1000
"""Characters of what is shown of a message."""


def inspect(
    once: Annotated[bool, typer.Option("--once", help="Show every learner once, then end.")] = False,
    top: Annotated[int, typer.Option(help="How many costs and constraints to name.", min=0)] = 3,
    timeout: Annotated[float, typer.Option(help="Seconds to look for learners, with --once.", min=0.1)] = 10.0,
    as_json: Json = False,
) -> None:
    """Show the learners of this ROS domain: one line per parameter message and per change of status.

    Example: mabirds inspect --once --json
    """
    if as_json and not once:
        raise ExperimentError("--json prints one object and needs --once")
    os.environ.setdefault("ROS_SUPER_CLIENT", "TRUE")  # a discovery server tells others what they ask for only
    arguments = ["--ros-args", *enclave_arguments("/inspector")]
    start_ros(arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with guarded_output() as stdout:
            code = _inspect_once(top, timeout, stdout if as_json else None) if once else _follow(top)
    finally:
        rclpy.try_shutdown()
    sys.exit(code)


def _follow(top: int) -> int:
    """Print as messages come, until Ctrl-C."""
    shown: dict[str, str] = {}

    def on_parameters(learner: WatchedLearner) -> None:
        _print(f"{learner.namespace} {_parameters_line(describe_parameters(learner, top))}")

    def on_status(learner: WatchedLearner) -> None:
        line = _status_line(describe(learner, top))
        if shown.get(learner.namespace) != line:
            shown[learner.namespace] = line
            _print(f"{learner.namespace} {line}")

    def on_constraints(learner: WatchedLearner) -> None:
        _print(f"{learner.namespace} {_constraints_line(learner, top)}")

    executor, node = SingleThreadedExecutor(), InspectorNode(on_parameters, on_status, on_constraints)
    executor.add_node(node)
    console.print("looking for learners; Ctrl-C ends")
    with suppress(KeyboardInterrupt), waking(executor, node, SetBack()):
        executor.spin()
    return exit_codes.FINISHED


def _inspect_once(top: int, timeout: float, json_stream: Any) -> int:
    """Wait until all learners are heard, at most ``timeout`` seconds, and show them."""
    node, executor = InspectorNode(), SingleThreadedExecutor()
    executor.add_node(node)
    deadline = time.monotonic() + timeout
    while not node.complete and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.1)
    learners = dict(sorted(node.learners.items()))
    if json_stream is not None:
        content = {name: describe(learner, top) for name, learner in learners.items()}
        print_json({"learners": content, "missing": node.missing()}, json_stream)
    else:
        _show(learners, node.missing(), top)
    return exit_codes.FINISHED if learners else exit_codes.NOBODY_THERE


def _show(learners: dict[str, WatchedLearner], missing: list[str], top: int) -> None:
    for namespace, learner in learners.items():
        content = describe(learner, top)
        if "state" in content:
            _print(f"{namespace} {_status_line(content)}")
        if "parameters" in content:
            _print(f"{namespace} {_parameters_line(content['parameters'])}")
        if "constraints" in content:
            _print(f"{namespace} {_constraints_line(learner, top)}")
        if "refused" in content:
            _print(f"{namespace} refused, since it cannot be shown: {content['refused']}")
    if missing:
        _print(f"not found, but in the schedule: {', '.join(missing)}")
    if not learners:
        console.print("no learner found; start some, and compare ROS_DOMAIN_ID here and there")


def _print(line: str) -> None:
    """One line, whatever others have put into their messages."""
    console.print(sanitize(line, MAX_LINE), soft_wrap=True)


def _status_line(content: dict[str, Any]) -> str:
    neighbours = [name for name in content["waiting_for"] if name != DEMONSTRATION]
    waiting = f" ({', '.join(neighbours)})" if neighbours else ""
    dropped = f", dropped {content['dropped']}" if content["dropped"] else ""
    message = f", {content['message']}" if content["message"] else ""
    return (
        f"iteration {content['iteration']}: {content['state']}{waiting}, backlog {content['backlog']}{dropped}{message}"
    )


def _constraints_line(learner: WatchedLearner, top: int) -> str:
    return constraints_text(learner.constraints, top)


def _parameters_line(content: dict[str, Any]) -> str:
    costliest = ", ".join(f"{cost['feature']} {cost['cost']:.3g}" for cost in content["costliest"])
    return (
        f"parameters {content['iteration']}: |theta| {content['theta_norm']:.4g}, |omega| {content['omega_norm']:.4g},"
        f" costliest: {costliest}"
    )
