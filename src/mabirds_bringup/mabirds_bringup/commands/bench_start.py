"""``mabirds bench start``: what it takes until something answers."""

from pathlib import Path
from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import guarded_output, print_json, tell_targets

EXPERIMENTS = ("ros_ws/config/patrol.yaml", "ros_ws/config/discrete.yaml")
"""That the package has in its folder config."""


def start(
    repetitions: Annotated[int, typer.Option(help="Of each, in turns.", min=1)] = 5,
    as_json: Json = False,
) -> None:
    """Time `mabirds --help` and learners until they are heard, against a bare node of rclpy.

    Example: mabirds bench start --repetitions 3 --json
    """
    with guarded_output() as stdout:
        content = measured(repetitions)
        tell_targets(content["targets"])
        if as_json:
            print_json(content, stdout)


def measured(repetitions: int) -> dict[str, Any]:
    """Start all of it.

    Parameters
    ----------
    repetitions : int
        Of each.

    Returns
    -------
    dict[str, Any]
        machine, results, targets.
    """
    # Loads ROS.
    import os
    import tempfile

    import mabirds_bringup
    from mabirds_bringup.bench.report import machine
    from mabirds_bringup.bench.start.measure import compare, targets
    from mabirds_msgs_py.environment import prepare_environment

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    prepare_environment()
    config = Path(mabirds_bringup.__file__).parent / "config"
    files = {Path(name).stem: config / Path(name).name for name in EXPERIMENTS}
    with tempfile.TemporaryDirectory(prefix="mabirds-start-") as logs:
        results = compare(files, repetitions, Path(logs))
    versions = machine("numpy", "ros-jazzy-rclpy", "ros-rclpy", "typer")
    return {"machine": versions, "results": results, "targets": targets(results)}
