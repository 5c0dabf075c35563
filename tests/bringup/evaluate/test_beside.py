"""Judging while learners go on: the same bits as afterwards, kept whatever happens, and nothing left behind."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import psutil
import pytest

from mabirds_bringup.commands.report import report
from mabirds_bringup.commands.simulate import simulate, simulate_from_bag
from mabirds_bringup.evaluate.beside import LOW, Beside, told_confidences
from mabirds_bringup.evaluate.constraints import Constraints
from mabirds_bringup.evaluate.evaluation import judge_finals, tasks_of
from mabirds_bringup.evaluate.parallel import judge_all, judge_in_parallel
from mabirds_bringup.evaluate.policies import LearnerMetrics, PolicyJudge, Task
from mabirds_bringup.run.judging import Judging
from mabirds_bringup.run.run_directory import METRICS, JudgedRows, read_judged
from mabirds_bringup.run.stored_run import load_run
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.file import load_experiment
from mabirds_learner.checkpoint import CONFIDENCES, CheckpointMetadata, CheckpointStore

PATIENCE = 60.0

ITERATIONS = 6


@pytest.fixture(scope="module")
def finished(make_shared_experiment: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nobody has judged."""
    out = tmp_path_factory.mktemp("runs")
    simulate(make_shared_experiment(iterations=ITERATIONS), out=out, evaluation=False)
    return (out / "latest").resolve()


@pytest.fixture
def afterwards(finished: Path, tmp_path: Path) -> Path:
    """The run, to be judged once all is learned."""
    return Path(shutil.copytree(finished, tmp_path / "afterwards"))


@pytest.fixture
def beginning(finished: Path, tmp_path: Path) -> Path:
    """The run before anything was learned."""
    return Path(shutil.copytree(finished, tmp_path / "beside", ignore=shutil.ignore_patterns("parameters", "*.json")))


def learn(directory: Path, finished: Path, first: int, last: int) -> None:
    """Write down iterations as the monitor of a network does."""
    shutil.copy(finished / "manifest.json", directory)
    with load_run(finished).open_history() as whole, load_run(directory).open_history() as kept:
        for name, log in kept.parameters.items():
            for n in range(first, last + 1):
                log[n] = whole.parameters[name][n]


def wait_until(condition: Callable[[], bool], words: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, words
        time.sleep(0.02)


def rows_of(directory: Path) -> int:
    return len(read_judged(directory))


def test_what_is_judged_while_it_is_learned_is_what_is_judged_afterwards(
    beginning: Path, afterwards: Path, finished: Path
) -> None:
    assert report([afterwards]) == 0
    learn(beginning, finished, 1, 1)
    with Judging(beginning) as judging:
        for n in range(1, ITERATIONS + 2):
            learn(beginning, finished, n, n)
            wait_until(lambda n=n: rows_of(beginning) == 2 * n, f"iteration {n} is not judged")  # type: ignore[misc]
        summary = judging.results(load_run(afterwards).summary()["wall_seconds"], [], None)
    assert summary == load_run(afterwards).summary()
    for file in ("summary.json", METRICS, "map.png", "curves.png"):
        assert (beginning / file).read_bytes() == (afterwards / file).read_bytes(), file


def test_results_come_at_once_where_nothing_was_judged(beginning: Path, afterwards: Path, finished: Path) -> None:
    """A run that is over before the judging has begun."""
    assert report([afterwards]) == 0
    learn(beginning, finished, 1, ITERATIONS + 1)
    with Judging(beginning) as judging:
        assert judging.results(1.0, [], None) is not None
    assert (beginning / METRICS).read_bytes() == (afterwards / METRICS).read_bytes()


def test_what_learners_found_of_their_constraints_is_not_looked_for_again(finished: Path, tmp_path: Path) -> None:
    directory = Path(shutil.copytree(finished, tmp_path / "told"))
    stored = load_run(directory)
    judge, last = PolicyJudge(stored.experiment), stored.last
    with stored.open_history() as kept:
        final = {name: log[last] for name, log in kept.parameters.items()}
    tested = judge_finals(judge, final, {}).constraints
    told = np.linspace(0.0, 1.0, len(tested["learner_1"].learned))
    for name, iteration in (("learner_1", last), ("learner_2", last - 1)):
        whose = CheckpointMetadata(name, stored.digest, "schedule")
        with closing(CheckpointStore(stored.checkpoints / name, whose, final[name], 1)) as checkpoints:
            checkpoints.keep_confidences(iteration, told)
    judge.told = told_confidences(stored, judge)
    found = judge_finals(judge, final, {}).constraints
    assert np.array_equal(found["learner_1"].confidences, told)
    assert same(found["learner_2"], tested["learner_2"]), "of an earlier iteration"
    others = {name: Parameters(theta + 1, omega) for name, (theta, omega) in final.items()}
    assert not np.array_equal(judge_finals(judge, others, {}).constraints["learner_1"].confidences, told)
    assert same(judge_finals(judge, final, {}, updates=1).constraints["learner_2"], tested["learner_2"]) is False
    (stored.checkpoints / "learner_1" / CONFIDENCES).write_bytes(b"of another run")
    assert told_confidences(stored, judge) == {}


def same(left: Constraints, right: Constraints) -> bool:
    return np.array_equal(left.confidences, right.confidences)


def test_a_killed_judge_leaves_what_it_judged_and_the_next_goes_on(
    beginning: Path, finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learn(beginning, finished, 1, 3)
    with Judging(beginning) as judging:
        wait_until(lambda: rows_of(beginning) == 6, "nothing is judged")
        os.kill(judging.process_id, signal.SIGKILL)
        assert judging.results(1.0, [], None) is None
    learn(beginning, finished, 4, ITERATIONS + 1)
    judged, row = list[tuple[str, int]](), PolicyJudge.row

    def noted(judge: PolicyJudge, task: Task) -> LearnerMetrics:
        judged.append(task.row)
        return row(judge, task)

    monkeypatch.setattr(PolicyJudge, "row", noted)
    beside = Beside(load_run(beginning))
    beside.start()
    wait_until(lambda: rows_of(beginning) == 2 * (ITERATIONS + 1), "the rest is not judged")
    beside.end()
    assert judged == [(name, n) for n in range(4, ITERATIONS + 2) for name in ("learner_1", "learner_2")]


def test_a_gap_keeps_nobody_waiting(beginning: Path, finished: Path) -> None:
    """What was missed is asked for later, and judged later."""
    learn(beginning, finished, 1, 2)
    learn(beginning, finished, 4, 5)
    beside = Beside(load_run(beginning))
    beside.start()
    wait_until(lambda: rows_of(beginning) == 8, "iterations after the gap are not judged")
    learn(beginning, finished, 3, 3)
    wait_until(lambda: rows_of(beginning) == 10, "the gap is not judged")
    beside.end()


def test_a_stopped_judge_answers(beginning: Path, finished: Path) -> None:
    learn(beginning, finished, 1, ITERATIONS + 1)
    with Judging(beginning) as judging:
        os.kill(judging.process_id, signal.SIGSTOP)
        assert judging.results(1.0, [], None) is not None


def test_a_run_that_is_none_is_nobodys_result(tmp_path: Path) -> None:
    with Judging(tmp_path) as judging:
        assert judging.results(1.0, [], None) is None


SUPERVISOR = """
import sys, time
from pathlib import Path
from mabirds_bringup.run.judging import Judging
with Judging(Path(sys.argv[1])) as judging:
    print(judging.process_id, flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_judge_ends_with_its_supervisor(beginning: Path, finished: Path, number: signal.Signals) -> None:
    learn(beginning, finished, 1, 1)
    command = [sys.executable, "-c", SUPERVISOR, str(beginning)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as supervisor:
        assert supervisor.stdout
        judge = psutil.Process(int(supervisor.stdout.readline()))
        wait_until(lambda: rows_of(beginning) == 2, "nothing is judged")
        supervisor.send_signal(number)
        judge.wait(PATIENCE)


def test_the_judging_thread_lets_others_go_first(beginning: Path, finished: Path) -> None:
    learn(beginning, finished, 1, 1)
    beside = Beside(load_run(beginning))
    beside.start()
    wait_until(lambda: rows_of(beginning) == 2, "nothing is judged")
    assert os.getpriority(os.PRIO_PROCESS, beside.native_id or 0) == LOW
    assert os.getpriority(os.PRIO_PROCESS, 0) < LOW
    beside.end()


def test_many_processes_judge_as_one(make_drone_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_drone_experiment(iterations=2))
    judge = PolicyJudge(experiment)
    history = simulate_from_bag(experiment)
    rows = [task for task in tasks_of(judge, history) if not task.planner]
    tasks = [next(task for task in tasks_of(judge, history) if task.planner), *rows]
    alone = [judge.judged(task) for task in tasks]
    assert list(judge_in_parallel(experiment, tasks, 2)) == alone
    assert len(alone) == 1 + 2 * 3


def test_processes_are_started_where_they_are_worth_it(
    make_shared_experiment: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All tasks are judged once and in order, wherever the line is drawn."""
    experiment = load_experiment(make_shared_experiment(name="few", iterations=2))
    judge, started = PolicyJudge(experiment), list[int]()
    tasks = tasks_of(judge, simulate_from_bag(experiment))

    def counted(_: object, left: list[Task], __: int) -> list[LearnerMetrics]:
        started.append(len(left))
        return [judge.row(task) for task in left]

    monkeypatch.setattr("mabirds_bringup.evaluate.parallel.judge_in_parallel", counted)
    alone = list(judge_all(judge, tasks))
    assert started == []
    monkeypatch.setattr("mabirds_bringup.evaluate.parallel.WORTH_WORKERS", 0.0)
    monkeypatch.setattr("mabirds_bringup.evaluate.parallel.processors", lambda: 2)
    assert list(judge_all(judge, tasks)) == alone
    assert started == [len(tasks) - 1]


def test_rows_are_known_up_to_where_a_file_was_cut(tmp_path: Path) -> None:
    row = LearnerMetrics("learner_1", 1, 0.125, None, -3.5, 0.25)
    with JudgedRows(tmp_path) as rows:
        for n in (1, 2, 3):
            rows.add(LearnerMetrics(row.learner, n, row.violation_rate, None, -3.5, 0.25))
    content = (tmp_path / METRICS).read_bytes()
    assert read_judged(tmp_path)[0] == row
    for cut in range(1, len(content) - content[:-2].rfind(b"\n")):
        (tmp_path / METRICS).write_bytes(content[:-cut])
        assert [known.iteration for known in read_judged(tmp_path)] == [1, 2]
    with JudgedRows(tmp_path) as rows:
        rows.add(row)  # known: nothing to write
        rows.add(LearnerMetrics(row.learner, 3, row.violation_rate, None, -3.5, 0.25))
    assert (tmp_path / METRICS).read_bytes() == content
