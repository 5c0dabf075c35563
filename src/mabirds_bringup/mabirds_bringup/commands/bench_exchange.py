"""``mabirds bench exchange``: what messages between learners cost."""

from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import guarded_output, print_json, tell_targets


def exchange(
    small: Annotated[bool, typer.Option("--small", help="Two learners, a short run: half a minute.")] = False,
    large: Annotated[bool, typer.Option("--large", help="Also 1e4 and 1e5 numbers in theta: minutes.")] = False,
    iterations: Annotated[int, typer.Option(help="Of each run.", min=50)] = 600,
    repetitions: Annotated[int, typer.Option(help="Of each kind of run, in turns.", min=1)] = 3,
    as_json: Json = False,
) -> None:
    """Time networks of learners against bare nodes that pass the same messages, with and without checkpoints.

    Example: mabirds bench exchange --small --json
    """
    with guarded_output() as stdout:
        content = measured(iterations, repetitions, small=small, large=large)
        tell_targets(content["targets"])
        if as_json:
            print_json(content, stdout)


def measured(iterations: int, repetitions: int, *, small: bool = False, large: bool = False) -> dict[str, Any]:
    """Run all networks, one after the other.

    Parameters
    ----------
    iterations : int
        Of each run.
    repetitions : int
        Of each kind.
    small : bool, optional
        One network, once.
    large : bool, optional
        Also long parameters.

    Returns
    -------
    dict[str, Any]
        machine, results, targets.
    """
    # Loads ROS.
    import os

    from mabirds_bringup.bench.exchange.cases import CASES, LARGE, SMALL
    from mabirds_bringup.bench.exchange.compare import compare, targets
    from mabirds_bringup.bench.report import machine
    from mabirds_msgs_py.environment import prepare_environment, send_to_this_host

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    prepare_environment()
    send_to_this_host()  # as `mabirds run` does
    cases = SMALL if small else (*CASES, *(LARGE if large else ()))
    results = {case.name: compare(case, iterations, 1 if small else repetitions) for case in cases}
    versions = machine("numpy", "ros-jazzy-rclpy", "ros-rclpy", "ros-jazzy-rmw-fastrtps-cpp")
    return {"machine": versions, "results": results, "targets": targets(cases, results)}
