"""``mabirds bench continuous``: drones, Table 3 and Figure 4 of the paper."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from mabirds_bringup.bench.cases import truncate
from mabirds_bringup.bench.command import FIRST_SEED, Request, command_line
from mabirds_bringup.bench.continuous.cases import all_cases
from mabirds_bringup.bench.continuous.outcome import FLIGHTS, run_case
from mabirds_bringup.commands.options import FirstSeed, Jobs, Json, MostIterations, ReportDirectory, Seeds
from mabirds_bringup.console import guarded_output, print_json
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.games.drones.study import drone_game


def continuous(  # noqa: PLR0913, PLR0917 - the options of a command
    main: Annotated[Path, typer.Option(help="Experiment of Table 3.")] = Path("ros_ws/config/drones.yaml"),
    sac: Annotated[
        Path | None,
        typer.Option(help="The same by soft actor-critic. Default: MAIN_sac.yaml beside --main, where there is one."),
    ] = None,
    seeds: Seeds = 5,
    first_seed: FirstSeed = FIRST_SEED,
    iterations: MostIterations = 1_000_000,
    flights: Annotated[
        int, typer.Option(help="That judge the last policies; a tenth as many judge the others.", min=20, max=100_000)
    ] = FLIGHTS,
    only: Annotated[
        Literal["lattice", "soft_actor_critic", "variations"] | None,
        typer.Option(help="Run this group of cases again; the others' results stay as they are in --out."),
    ] = None,
    jobs: Jobs = 1,
    out: ReportDirectory = Path("runs/bench-continuous"),
    as_json: Json = False,
) -> None:
    """Compare MA-BIRDS with BICS, FTL, DLM and ME-gradient, and with variations of itself; write a report.

    Example: mabirds bench continuous --seeds 1 --iterations 10 --only lattice --out runs/quick
    """
    from mabirds_bringup.bench.continuous.report import write_report  # loads matplotlib and polars

    with guarded_output() as stdout:
        first, second = _loaded(main, iterations), _networks(main, sac, iterations)
        if only == "soft_actor_critic" and second is None:
            raise ExperimentError(f"{_beside(main)}: no such file; give the experiment by soft actor-critic with --sac")
        request = Request(out, only, seeds, jobs, first_seed, fresh=True)
        results = request.results(all_cases(first, second), partial(run_case, flights=flights))
        content = write_report(first, second, results, out, command_line(), flights)
        request.tell(content)
        if as_json:
            print_json(content, stdout)


def _networks(main: Path, sac: Path | None, iterations: int) -> Experiment | None:
    """The experiment by soft actor-critic; None where there is none, and none was asked for."""
    file = sac or _beside(main)
    return _loaded(file, iterations) if sac or file.exists() else None


def _loaded(file: Path, iterations: int) -> Experiment:
    experiment = truncate(load_experiment(file), iterations)
    drone_game(experiment)  # refuses other games
    return experiment


def _beside(main: Path) -> Path:
    return main.with_stem(f"{main.stem}_sac")
