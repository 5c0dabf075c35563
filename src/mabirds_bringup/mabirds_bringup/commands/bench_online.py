"""``mabirds bench online``: how many demonstrations a second are learned."""

from pathlib import Path
from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import guarded_output, print_json, tell_targets

EXPERIMENTS = ("ros_ws/config/patrol.yaml", "ros_ws/config/discrete.yaml")
"""That the package has in its folder config."""


def online(
    iterations: Annotated[int, typer.Option(help="Of each run.", min=20)] = 150,
    repetitions: Annotated[int, typer.Option(help="Of each method, in turns.", min=1)] = 3,
    share: Annotated[
        float, typer.Option(help="Of a processor for each process, as if each had one of its own.", min=0.05, max=1.0)
    ] = 1.0,
    as_json: Json = False,
) -> None:
    """Find the highest rate of demonstrations at which no backlog grows: of learners, BICS, FTL and DLM.

    Example: mabirds bench online --iterations 60 --repetitions 1 --json
    """
    with guarded_output() as stdout:
        content = measured(iterations, repetitions, share)
        tell_targets(content["targets"])
        if as_json:
            print_json(content, stdout)


def measured(iterations: int, repetitions: int, share: float = 1.0) -> dict[str, Any]:
    """Run all methods, one after the other.

    Parameters
    ----------
    iterations : int
        Of each run.
    repetitions : int
        Of each method.
    share : float, optional
        Of a processor that each process gets; 1: what is there.

    Returns
    -------
    dict[str, Any]
        machine, results, targets.
    """
    # Loads ROS.
    import os

    import mabirds_bringup
    from mabirds_bringup.bench.online.compare import compare, targets
    from mabirds_bringup.bench.report import machine
    from mabirds_msgs_py.environment import prepare_environment, send_to_this_host

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    prepare_environment()
    send_to_this_host()  # as `mabirds run` does
    config = Path(mabirds_bringup.__file__).parent / "config"
    files = {Path(name).stem: config / Path(name).name for name in EXPERIMENTS}
    results = {name: compare(file, iterations, repetitions, share) for name, file in files.items()}
    return {"machine": machine("numpy", "ros-rclpy"), "share": share, "results": results, "targets": targets(results)}
