"""``mabirds bench``: experiments over many seeds, with tables and pictures."""

import multiprocessing
import os
import shlex
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated, Literal

import typer

from mabirds_bringup.console import console, guarded_output, print_json, progress_bar
from mabirds_bringup.discrete.cases import Case, all_cases, shortened
from mabirds_bringup.discrete.outcome import Outcome, run_case
from mabirds_bringup.processes import ONE_THREAD
from mabirds_bringup.verbs.options import Json
from mabirds_core.experiment import load_experiment

FIRST_SEED = 301
"""The reported seeds are 301, 302, ...; none of them served to choose settings."""

bench_app = typer.Typer(help="Experiments over many seeds, with tables and pictures.")


@bench_app.callback()
def _bench() -> None:
    """Keep ``discrete`` a command of its own although it is the only one."""


@bench_app.command()
def discrete(  # noqa: PLR0913, PLR0917 - the options of a command
    main: Annotated[Path, typer.Option(help="Experiment of Tables 1 and 2.")] = Path("ros_ws/config/discrete.yaml"),
    hard: Annotated[Path, typer.Option(help="Experiment with many starts.")] = Path(
        "ros_ws/config/discrete_many_starts.yaml"
    ),
    seeds: Annotated[int, typer.Option(help="Seeds, from 301 on.", min=1, max=1000)] = 5,
    iterations: Annotated[int, typer.Option(help="At most so many, for a quick look.", min=1)] = 1_000_000,
    only: Annotated[
        Literal["main", "variations", "hard"] | None,
        typer.Option(help="Run this group of cases again; the others' outcomes stay as they are in --out."),
    ] = None,
    jobs: Annotated[int, typer.Option(help="Cases at once; times are comparable with 1.", min=1, max=256)] = 1,
    out: Annotated[Path, typer.Option(help="Report directory.")] = Path("runs/bench-discrete"),
    as_json: Json = False,
) -> None:
    """Compare MA-BIRDS with BICS, FTL, DLM and ME-greedy, and with variations of itself; write a report.

    Example: mabirds bench discrete --seeds 2 --iterations 10 --out runs/quick
    """
    from mabirds_bringup.discrete.report import earlier_outcomes, write_report  # matplotlib takes a second to load

    with guarded_output() as stdout:
        first, second = (shortened(load_experiment(file), iterations) for file in (main, hard))
        out.mkdir(parents=True, exist_ok=True)
        cases = [case for case in all_cases(first, second) if only in (None, case.group)]
        kept = [one for one in earlier_outcomes(out) if one.group != only] if only else []
        outcomes = [*kept, *_run(cases, range(FIRST_SEED, FIRST_SEED + seeds), jobs)]
        command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
        content = write_report(first, second, outcomes, out, command)
        for target in content["targets"]:
            console.print(f"{'met   ' if target['met'] else 'MISSED'} {target['name']}: {target['value']:.4f}")
        console.print(f"report in {out / 'report.html'}", soft_wrap=True)
        if as_json:
            print_json(content, stdout)


def _run(cases: list[Case], seeds: range, jobs: int) -> Iterator[Outcome]:
    """All cases with all seeds, each in a process with one thread; outcomes in the order of the cases."""
    os.environ.update(ONE_THREAD)  # for the processes started from here on
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool, progress_bar() as bar:
        task = bar.add_task("learning", total=len(cases) * len(seeds))
        futures = [pool.submit(run_case, case, seed) for case in cases for seed in seeds]
        for future in futures:
            yield from future.result()
            bar.advance(task)
