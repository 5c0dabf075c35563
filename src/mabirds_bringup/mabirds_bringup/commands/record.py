"""``mabirds record``: expert demonstrations into a bag."""

from pathlib import Path
from typing import Annotated

import typer

from mabirds_bringup.commands.options import ExperimentFile
from mabirds_bringup.console import console, progress_bar
from mabirds_core.experiment.file import load_experiment
from mabirds_expert_player.recorder import record as record_bag


def record(
    file: ExperimentFile,
    bag: Annotated[Path | None, typer.Option(help="Directory to write; default: the experiment's bag.")] = None,
) -> None:
    """Record the experts of an experiment to a rosbag2 MCAP bag, one topic per learner.

    Example: mabirds record ros_ws/config/patrol.yaml --bag bags/my_patrol
    """
    experiment = load_experiment(file)
    directory = bag or experiment.demonstrations.bag
    total = experiment.demonstrations.per_learner * len(experiment.learners)
    with progress_bar() as bar:
        task = bar.add_task("recording", total=total)
        record_bag(experiment, directory, lambda: bar.advance(task))
    console.print(f"{total} demonstrations in {directory}")
