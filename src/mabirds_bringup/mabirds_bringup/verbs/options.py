"""Options and arguments that several verbs share."""

from pathlib import Path
from typing import Annotated, Literal

import typer

ExperimentFile = Annotated[
    Path, typer.Argument(metavar="EXPERIMENT", help="Experiment file, such as ros_ws/config/patrol.yaml.")
]
RunsDirectory = Annotated[Path, typer.Option(help="Where run directories are made.")]
CentralMethodName = Annotated[
    Literal["bics", "ftl", "dlm", "me_greedy"] | None,
    typer.Option(help="Run this central method on all demonstrations, in the learners' place."),
]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")]
