"""What the commands of ``mabirds bench`` have in common: cases in processes of their own, and what is said of them."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mabirds_bringup.bench.results import CaseResult
from mabirds_bringup.bench.study import Case
from mabirds_bringup.console import console, progress_bar
from mabirds_bringup.run.processes import ONE_THREAD

if TYPE_CHECKING:
    import polars as pl

FIRST_SEED = 301
"""The reported seeds are 301, 302, ... where nothing else is said; none of them served to choose settings."""

RunCase = Callable[[Case, int], list[CaseResult]]
"""Learns a case with a seed; one result per learner."""


def run_cases(run_case: RunCase, cases: Sequence[Case], seeds: range, jobs: int) -> Iterator[CaseResult]:
    """All cases with all seeds, ``jobs`` at once; results in the order of the cases.

    A process of one thread learns one case with one seed and ends, so that times and memory are those of the case.
    """
    os.environ.update(ONE_THREAD)  # for the processes started from here on
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1)
    with pool, progress_bar() as bar:
        futures = [pool.submit(run_case, case, seed) for case in cases for seed in seeds]
        for future in bar.track(futures, description="learning"):
            yield from future.result()


def results_of(
    run_case: RunCase, cases: Sequence[Case], seeds: range, jobs: int, directory: Path, only: str | None = None
) -> "pl.DataFrame":
    """Learn ``cases``; with ``only`` those of one group, the others' results stay as they are in ``directory``."""
    # The cases' processes import the whole command, and what is imported there counts as memory of the cases.
    from mabirds_bringup.bench.frame import frame_of, read_results

    directory.mkdir(parents=True, exist_ok=True)
    asked = [case for case in cases if only in {None, case.group}]
    kept = read_results(directory).remove(group=only) if only else frame_of([])
    return kept.extend(frame_of(run_cases(run_case, asked, seeds, jobs)))


def tell(content: dict[str, Any], directory: Path) -> None:
    """Which targets are met, and where the report is."""
    for target in content["targets"]:
        verdict = "met   " if target["met"] else "MISSED"
        console.print(f"{verdict} {target['name']}: {target['value']:.4f}", soft_wrap=True)
    console.print(f"report in {directory / 'report.html'}", soft_wrap=True)
