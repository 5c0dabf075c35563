"""Options and arguments that several verbs share."""

from pathlib import Path
from typing import Annotated

import typer

ExperimentFile = Annotated[
    Path, typer.Argument(metavar="EXPERIMENT", help="Experiment file, such as ros_ws/config/patrol.yaml.")
]
RunsDirectory = Annotated[Path, typer.Option(help="Where run directories are made.")]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")]
