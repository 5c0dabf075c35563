"""``mabirds draw`` and ``mabirds picture``: topics that stock tools draw, and what they hold as PNG."""

import time
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from mabirds_bringup import exit_codes
from mabirds_bringup.commands.options import ExperimentFile
from mabirds_bringup.console import console, ending_as_interrupted, guarded_output
from mabirds_bringup.priority import step_back
from mabirds_bringup.watch.spinning import NICE, Glances, looking
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.security import SecurityError, is_requested


def draw(
    file: ExperimentFile,
    frame: Annotated[str, typer.Option(help="Frame of all that is drawn.")] = "map",
    rate: Annotated[float, typer.Option(help="Drawings per second, at most.", min=0.05, max=50)] = 2.0,
    demonstrations: Annotated[
        bool, typer.Option("--demonstrations", help="Hear and draw the learners' demonstrations, too.")
    ] = False,
) -> int:
    """Publish what learners say as grids, markers, paths and numbers for RViz, Foxglove, PlotJuggler and Nav2.

    It runs beside the network, until Ctrl-C.

    Example: mabirds draw ros_ws/config/patrol.yaml
    """
    from mabirds_bringup.draw.node import DrawingNode

    if demonstrations and is_requested([]):
        raise SecurityError(
            "--demonstrations: with security on, learners alone may hear what they are shown; leave it out"
        )
    experiment = load_experiment(file)
    step_back(NICE)
    create = partial(DrawingNode, experiment, frame, rate, demonstrations=demonstrations)
    with (
        guarded_output(),
        ending_as_interrupted(),
        suppress(KeyboardInterrupt),
        looking(create, "/drawing") as (node, executor),
        closing(Glances(node, executor)) as glances,
    ):
        console.print(f"drawing {experiment.name} below */drawn; Ctrl-C ends")
        while True:
            glances.glance()
    return exit_codes.FINISHED


def picture(
    file: Annotated[Path, typer.Argument(metavar="PNG", help="File to write.")],
    timeout: Annotated[float, typer.Option(help="Seconds to listen, at most.", min=0.1)] = 10.0,
) -> int:
    """Draw the grids, markers and paths of this ROS domain, from whomever they are, to a PNG.

    Example: mabirds picture drawn.png
    """
    from mabirds_bringup.draw.listener import DrawnListener
    from mabirds_bringup.draw.pictures import picture as figure_of

    with guarded_output(), looking(DrawnListener, "/picture") as (node, executor):
        deadline = time.monotonic() + timeout
        while not node.settled() and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        drawn = dict(node.drawn)
    if not drawn:
        console.print("nothing drawn is published here; start `mabirds draw`, compare ROS_DOMAIN_ID", soft_wrap=True)
        return exit_codes.NOBODY_THERE
    figure_of(drawn).savefig(file, dpi=110)
    console.print(f"{file}: {len(drawn)} topics", soft_wrap=True)
    return exit_codes.FINISHED
