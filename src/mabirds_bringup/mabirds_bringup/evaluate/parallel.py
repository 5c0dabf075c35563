"""Judging many policies: one after the other while that is quick, by several processes once it is not."""

import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

from mabirds_bringup.evaluate.policies import LearnerMetrics, PolicyJudge, Task
from mabirds_bringup.evaluate.verdicts import Verdict
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py.supervised import SUPERVISOR, end_with_supervisor

WORTH_WORKERS = 6.0
"""Seconds that must be left for processes to be started, which takes each of them some two seconds."""

AT_ONCE = 16
"""Tasks for each process that are handed out together: however many there are, few wait in memory."""

Judged = LearnerMetrics | Verdict


def judge_all(judge: PolicyJudge, tasks: Sequence[Task]) -> Iterator[Judged]:
    """Judge all tasks; who does it makes no difference to any bit.

    Parameters
    ----------
    judge : PolicyJudge
        Of the experiment.
    tasks : Sequence[Task]
        What there is to be judged.

    Yields
    ------
    LearnerMetrics or Verdict
        In the order of the tasks.
    """
    began = time.monotonic()
    for done, task in enumerate(tasks, start=1):
        yield judge.judged(task)
        left = (time.monotonic() - began) / done * (len(tasks) - done)
        if left > WORTH_WORKERS and processors() > 1:
            yield from judge_in_parallel(judge.experiment, tasks[done:], processors())
            return


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def judge_in_parallel(experiment: Experiment, tasks: Sequence[Task], workers: int) -> Iterator[Judged]:
    """Judge by new processes, which end with this one.

    Parameters
    ----------
    experiment : Experiment
        Of the tasks.
    tasks : Sequence[Task]
        What there is to be judged.
    workers : int
        How many processes.

    Yields
    ------
    LearnerMetrics or Verdict
        In the order of the tasks.
    """
    fresh = multiprocessing.get_context("spawn")  # a fork would copy the locks of libraries' threads
    with ProcessPoolExecutor(workers, fresh, _Worker.begin, (experiment, os.getpid())) as pool:
        try:
            for first in range(0, len(tasks), AT_ONCE * workers):
                yield from pool.map(_Worker.judged, tasks[first : first + AT_ONCE * workers])
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


class _Worker:
    """What a process of the pool keeps between tasks."""

    judge: PolicyJudge

    @classmethod
    def begin(cls, experiment: Experiment, parent: int) -> None:
        os.environ[SUPERVISOR] = str(parent)
        end_with_supervisor()
        cls.judge = PolicyJudge(experiment)

    @classmethod
    def judged(cls, task: Task) -> Judged:
        return cls.judge.judged(task)
