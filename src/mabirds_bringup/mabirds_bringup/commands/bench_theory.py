"""``mabirds bench theory``: the paper's rates on a tiny game."""

from pathlib import Path
from typing import Annotated

import typer

from mabirds_bringup.bench.command import FIRST_SEED, tell
from mabirds_bringup.commands.options import FirstSeed, Jobs, Json, ReportDirectory
from mabirds_bringup.console import guarded_output, print_json, progress_bar
from mabirds_bringup.run.run_directory import command_line


def theory(
    seeds: Annotated[int, typer.Option(help="Of the main cases; others have half as many.", min=2, max=1000)] = 6,
    first_seed: FirstSeed = FIRST_SEED,
    iterations: Annotated[
        int, typer.Option(help="N: updates per learner; with hard constraints five times as many.", min=20, max=100_000)
    ] = 1500,
    jobs: Jobs = 1,
    out: ReportDirectory = Path("runs/bench-theory"),
    as_json: Json = False,
) -> None:
    """Measure consensus, violations, reward gap and regret against n, and compare with Theorem 1; write a report.

    Example: mabirds bench theory --seeds 2 --iterations 100 --out runs/quick
    """
    # Loads matplotlib, polars and scipy.
    from joblib import Parallel, delayed

    from mabirds_bringup.bench.frame import frame_of
    from mabirds_bringup.bench.theory.cases import OTHERS, RATES
    from mabirds_bringup.bench.theory.measure import measure
    from mabirds_bringup.bench.theory.report import write_theory

    with guarded_output() as stdout:
        out.mkdir(parents=True, exist_ok=True)
        few = max(2, seeds // 2)
        asked = [(case, seed) for case in RATES for seed in range(seeds)]
        asked += [(case, seed) for case in OTHERS for seed in range(few)]
        tasks = [delayed(measure)(case, iterations, first_seed + seed) for case, seed in asked]
        with progress_bar() as bar:
            learned = Parallel(n_jobs=jobs, return_as="generator")(tasks)
            results = frame_of(bar.track(learned, total=len(tasks), description="learning"))
        content = write_theory(results, out, command_line())
        tell(content, out)
        if as_json:
            print_json(content, stdout)
