"""Options and arguments that several verbs share."""

from pathlib import Path
from typing import Annotated

import typer

from mabirds_core.experiment.assembly import method_names


def _installed(method: str | None) -> str | None:
    """The method, if a package brings it."""
    if method is not None and method not in method_names():
        raise typer.BadParameter(f"{method!r} is none of {', '.join(method_names())}")
    return method


ExperimentFile = Annotated[
    Path, typer.Argument(metavar="EXPERIMENT", help="Experiment file, such as ros_ws/config/patrol.yaml.")
]
RunsDirectory = Annotated[Path, typer.Option(help="Where run directories are made.")]
CentralMethodName = Annotated[
    str | None,
    typer.Option(
        callback=_installed,
        help="Run this central method on all demonstrations, in the learners' place (see `mabirds kinds`).",
    ),
]
Seeds = Annotated[int, typer.Option(help="How many seeds.", min=1, max=1000)]
FirstSeed = Annotated[int, typer.Option(help="The first of them.", min=0, max=1_000_000)]
MostIterations = Annotated[int, typer.Option("--iterations", help="At most so many, for a quick look.", min=1)]
Jobs = Annotated[int, typer.Option(help="Cases at once; times are comparable with 1.", min=1, max=256)]
ReportDirectory = Annotated[Path, typer.Option(help="Report directory.")]
Evaluation = Annotated[
    bool,
    typer.Option("--evaluation/--no-evaluation", help="Judge what was learned; `mabirds report` does it later, too."),
]
Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on standard output.")]
