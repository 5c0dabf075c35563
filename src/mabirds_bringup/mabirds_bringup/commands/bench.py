"""``mabirds bench``: experiments over many seeds, with tables and pictures."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from mabirds_bringup.bench.command import FIRST_SEED, results_of, tell
from mabirds_bringup.bench.outcome import run_case
from mabirds_bringup.bench.study import load_study, packaged_studies
from mabirds_bringup.commands.bench_behaviour import behaviour
from mabirds_bringup.commands.bench_exchange import exchange
from mabirds_bringup.commands.bench_online import online
from mabirds_bringup.commands.bench_pedestrians import pedestrians
from mabirds_bringup.commands.bench_scale import scale
from mabirds_bringup.commands.bench_solve import solve
from mabirds_bringup.commands.bench_start import start
from mabirds_bringup.commands.bench_theory import theory
from mabirds_bringup.commands.options import FirstSeed, Jobs, Json, MostIterations, Seeds
from mabirds_bringup.console import guarded_output, print_json
from mabirds_bringup.run.run_directory import command_line
from mabirds_core.errors import ExperimentError

STUDY = "STUDY"
"""The command that stands for a study's file."""


class Studies(TyperGroup):
    """Any other name is the path of a study's file."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of that name, or the one that reads a file."""
        return super().get_command(ctx, cmd_name) or super().get_command(ctx, STUDY)


bench_app = typer.Typer(cls=Studies, help="Experiments over many seeds, with tables and pictures.")


def study(  # noqa: PLR0913, PLR0917 - the options of a command
    context: typer.Context,
    experiment: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=FILE", help="An experiment in place of the study's; may be given several times."),
    ] = None,
    seeds: Seeds = 5,
    first_seed: FirstSeed = FIRST_SEED,
    iterations: MostIterations = 1_000_000,
    rollouts: Annotated[
        int | None,
        typer.Option(help="That judge the last policies where a game needs some, a tenth the others.", min=20),
    ] = None,
    only: Annotated[
        str | None, typer.Option(metavar="GROUP", help="Run this group again; the others stay as they are in --out.")
    ] = None,
    jobs: Jobs = 1,
    out: Annotated[Path | None, typer.Option(help="Report directory.", show_default="runs/bench-STUDY")] = None,
    as_json: Json = False,
) -> None:
    """Learn the cases of a study, of the package or a file of your own, and write a report.

    Example: mabirds bench discrete --seeds 1 --iterations 10 --only main --out runs/quick
    """
    name = str(context.info_name)
    with guarded_output() as stdout:
        files = dict(_named_file(given) for given in experiment or ())
        loaded = load_study(name, files, iterations, rollouts)
        if only not in {None, *loaded.settings.groups}:
            raise ExperimentError(f"--only {only}: the study has the groups {list(loaded.settings.groups)}")
        from mabirds_bringup.bench.study_report import write_study  # loads matplotlib and polars

        directory = out or Path("runs") / f"bench-{Path(name).stem}"
        results = results_of(run_case, loaded.cases, range(first_seed, first_seed + seeds), jobs, directory, only)
        content = write_study(loaded, results, directory, command_line())
        tell(content, directory)
        if as_json:
            print_json(content, stdout)


def _named_file(given: str) -> tuple[str, Path]:
    name, sign, file = given.partition("=")
    if not sign:
        raise typer.BadParameter(f"--experiment {given}: expected NAME=FILE, such as main=my.yaml")
    return name, Path(file)


for command in (*packaged_studies(), STUDY):
    bench_app.command(command)(study)
bench_app.command()(behaviour)
bench_app.command()(solve)
bench_app.command()(exchange)
bench_app.command()(start)
bench_app.command()(online)
bench_app.command()(scale)
bench_app.command()(theory)
bench_app.command()(pedestrians)
