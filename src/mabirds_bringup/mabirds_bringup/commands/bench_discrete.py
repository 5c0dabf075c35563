"""``mabirds bench discrete``: patrollers, Tables 1 and 2 and Figures 2 and 3 of the paper."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from mabirds_bringup.bench.cases import truncate
from mabirds_bringup.bench.command import Request, command_line
from mabirds_bringup.bench.discrete.cases import all_cases
from mabirds_bringup.bench.discrete.outcome import run_case
from mabirds_bringup.commands.options import Jobs, Json, MostIterations, ReportDirectory, Seeds
from mabirds_bringup.console import guarded_output, print_json
from mabirds_core.experiment.file import load_experiment


def discrete(  # noqa: PLR0913, PLR0917 - the options of a command
    main: Annotated[Path, typer.Option(help="Experiment of Tables 1 and 2.")] = Path("ros_ws/config/discrete.yaml"),
    hard: Annotated[Path, typer.Option(help="Experiment with many starts.")] = Path(
        "ros_ws/config/discrete_many_starts.yaml"
    ),
    seeds: Seeds = 5,
    iterations: MostIterations = 1_000_000,
    only: Annotated[
        Literal["main", "variations", "hard"] | None,
        typer.Option(help="Run this group of cases again; the others' results stay as they are in --out."),
    ] = None,
    jobs: Jobs = 1,
    out: ReportDirectory = Path("runs/bench-discrete"),
    as_json: Json = False,
) -> None:
    """Compare MA-BIRDS with BICS, FTL, DLM and ME-greedy, and with variations of itself; write a report.

    Example: mabirds bench discrete --seeds 2 --iterations 10 --out runs/quick
    """
    from mabirds_bringup.bench.discrete.report import write_report  # loads matplotlib and polars

    with guarded_output() as stdout:
        first, second = (truncate(load_experiment(file), iterations) for file in (main, hard))
        request = Request(out, only, seeds, jobs)
        results = request.results(all_cases(first, second), run_case)
        content = write_report(first, second, results, out, command_line())
        request.tell(content)
        if as_json:
            print_json(content, stdout)
