"""``mabirds bench pedestrians``: real people, learned from a part of the time and judged by the rest."""

from pathlib import Path
from typing import Annotated

import typer

from mabirds_bringup.bench.command import FIRST_SEED, tell
from mabirds_bringup.commands.options import FirstSeed, Json, ReportDirectory
from mabirds_bringup.console import guarded_output, print_json, progress_bar
from mabirds_bringup.run.run_directory import command_line


def pedestrians(
    data: Annotated[Path, typer.Option(help="Directory of ucy_zara01, with obsmat.txt.")],
    iterations: Annotated[int, typer.Option(help="Updates per learner, at most.", min=20, max=10_000)] = 400,
    folds: Annotated[int, typer.Option(help="Blocks of the training, of which each judges once.", min=2, max=20)] = 3,
    samples: Annotated[int, typer.Option(help="k: ways from each start.", min=1, max=1000)] = 20,
    seed: FirstSeed = FIRST_SEED,
    out: ReportDirectory = Path("runs/bench-pedestrians"),
    as_json: Json = False,
) -> None:
    """Learn from pairs of pedestrians in the first 60 % of the time, and judge by the last 40 %; write a report.

    Example: mabirds bench pedestrians --data ucy_zara01 --iterations 40 --out runs/quick
    """
    # Loads matplotlib, polars and scipy.
    from mabirds_bringup.bench.pedestrians.data import read_pedestrians
    from mabirds_bringup.bench.pedestrians.measure import Sizes, measured
    from mabirds_bringup.bench.pedestrians.report import write_pedestrians

    with guarded_output() as stdout:
        tracks = read_pedestrians(data)
        out.mkdir(parents=True, exist_ok=True)
        sizes = Sizes(iterations, folds, samples, seed)
        with progress_bar() as bar:
            task = bar.add_task("learning and judging", total=sizes.runs)
            findings = measured(tracks, sizes, lambda: bar.advance(task))
        content = write_pedestrians(findings, sizes, out, command_line())
        tell(content, out)
        if as_json:
            print_json(content, stdout)
