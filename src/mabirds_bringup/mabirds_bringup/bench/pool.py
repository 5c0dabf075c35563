"""Cases run one by one or several at once, each in a process of its own with one thread."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

from mabirds_bringup.bench.results import CaseResult
from mabirds_bringup.bench.study import Case
from mabirds_bringup.console import progress_bar
from mabirds_bringup.run.processes import ONE_THREAD

RunCase = Callable[[Case, int], list[CaseResult]]
"""Learns a case with a seed; one result per learner."""


def run_cases(run_case: RunCase, cases: Sequence[Case], seeds: range, jobs: int) -> Iterator[CaseResult]:
    """All cases with all seeds; results in the order of the cases.

    A process learns one case with one seed and ends, so that its memory is that of the case.
    """
    os.environ.update(ONE_THREAD)  # for the processes started from here on
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1)
    with pool, progress_bar() as bar:
        task = bar.add_task("learning", total=len(cases) * len(seeds))
        futures = [pool.submit(run_case, case, seed) for case in cases for seed in seeds]
        for future in futures:
            yield from future.result()
            bar.advance(task)
