"""``mabirds bench behaviour``: random games, the default rule, all measures."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from mabirds_bringup.bench.command import tell
from mabirds_bringup.commands.options import FirstSeed, Jobs, Json, ReportDirectory
from mabirds_bringup.console import guarded_output, print_json, progress_bar
from mabirds_bringup.run.run_directory import command_line
from mabirds_core.extras import require

FIRST_SEED = 7101
"""The reported seeds begin here; none of them served to choose anything."""

CENTRAL = ("bics", "ftl", "dlm", "me_greedy")


def behaviour(  # noqa: PLR0913, PLR0917 - the options of a command
    maps: Annotated[int, typer.Option(help="How many random games.", min=2, max=10_000)] = 20,
    first_seed: FirstSeed = FIRST_SEED,
    central_maps: Annotated[
        int, typer.Option(help="On so many of them others learn, too: the paper's steps and central methods.", min=0)
    ] = 4,
    demonstrations: Annotated[int, typer.Option(help="Of each learner.", min=2, max=10_000)] = 40,
    game: Annotated[str, typer.Option(help="Kind of game; one that can be drawn at random.")] = "",
    jobs: Jobs = 1,
    out: ReportDirectory = Path("runs/bench-behaviour"),
    as_json: Json = False,
) -> None:
    """Learn random games that nobody tuned for, and measure behaviour and constraints; write a report.

    Ctrl-C ends it with a report of the games that are done.

    Example: mabirds bench behaviour --maps 4 --central-maps 1 --out runs/quick
    """
    for library in ("joblib", "networkx", "scipy"):
        require(library, "mabirds bench behaviour", "mabirds_bringup[bench]")
    # Loads matplotlib, polars and scipy.
    from joblib import Parallel, delayed

    from mabirds_bringup.bench.behaviour.draw import random_kind
    from mabirds_bringup.bench.behaviour.report import write_report
    from mabirds_bringup.bench.behaviour.trial import run_trial
    from mabirds_bringup.bench.report import machine

    with guarded_output() as stdout:
        kind = random_kind(game)
        tasks = [
            delayed(run_trial)(first_seed + k, kind, CENTRAL if k < central_maps else (), demonstrations)
            for k in range(maps)
        ]
        rows = list[dict[str, Any]]()
        with progress_bar() as bar, suppress(KeyboardInterrupt):  # then the report is of the games that are done
            results = Parallel(n_jobs=jobs, return_as="generator")(tasks)
            for trial in bar.track(results, total=maps, description="learning"):
                rows += trial
        content = write_report(rows, out, command_line(), machine("numpy", "scipy"), kind)
        tell(content, out)
        if as_json:
            print_json(content, stdout)
