"""``mabirds bag``: look at bags."""

from pathlib import Path

import typer

from mabirds_bringup.commands.options import ExperimentFile, Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag

bag_app = typer.Typer(help="Check bags of demonstrations.")


@bag_app.callback()
def _bag() -> None:
    """Keep ``check`` a command of its own although it is the only one."""


@bag_app.command()
def check(
    file: ExperimentFile,
    bag: Path | None = typer.Option(None, help="Bag to check; default: the experiment's."),  # noqa: B008 - typer
    as_json: Json = False,
) -> None:
    """Check a bag against an experiment: checksums, types, iteration numbers and every transition.

    Example: mabirds bag check ros_ws/config/patrol.yaml
    """
    with guarded_output() as stdout:
        experiment = load_experiment(file)
        directory = bag or experiment.demonstrations.bag
        with DemonstrationBag(directory, build_game(experiment), experiment.learners) as reader:
            counts = {name: reader.count(name) for name in experiment.learners}
        console.print(f"{directory}: whole; " + ", ".join(f"{name} {count}" for name, count in counts.items()))
        if as_json:
            print_json({"bag": str(directory), "demonstrations": counts}, stdout)
