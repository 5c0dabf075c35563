"""Cases run one by one or several at once, in processes with one thread."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.results import CaseResult
from mabirds_bringup.console import progress_bar
from mabirds_bringup.run.processes import ONE_THREAD

RunCase = Callable[[Case, int], list[CaseResult]]
"""Learns a case with a seed; one result per learner."""


def run_cases(
    run_case: RunCase, cases: Sequence[Case], seeds: range, jobs: int, *, fresh: bool = False
) -> Iterator[CaseResult]:
    """All cases with all seeds; results in the order of the cases.

    ``fresh``: each in a process of its own, so that its memory is its own.
    """
    os.environ.update(ONE_THREAD)  # for the processes started from here on
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1 if fresh else None)
    with pool, progress_bar() as bar:
        task = bar.add_task("learning", total=len(cases) * len(seeds))
        futures = [pool.submit(run_case, case, seed) for case in cases for seed in seeds]
        for future in futures:
            yield from future.result()
            bar.advance(task)
