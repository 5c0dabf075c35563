"""Supervisors that are suspended or killed: a result is whole or says what is missing, and a run is gone on with."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from identity import assert_same_histories, bits

from mabirds_bringup.commands.demonstrations import digest_at_hand
from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.run.stored_run import load_run
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import load_experiment
from mabirds_expert_player.recorder import record
from mabirds_learner.learner_session import OTHER_BAG
from mabirds_learner.parameters_log import ParametersLog
from mabirds_learner.records import HEADER
from mabirds_msgs_py.errors import BagError

MABIRDS = str(Path(sys.executable).with_name("mabirds"))

OTHER_SHOWN = {"bag": "bag", "experts": "soft", "seed": 7, "period": 1.0}

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """A function that starts ``mabirds run`` with runs in a place of its own; what is left at the end is killed."""
    started: list[subprocess.Popen[str]] = []

    def run(*arguments: object) -> "subprocess.Popen[str]":
        command = [MABIRDS, "run", *map(str, arguments), "--out", str(tmp_path / "runs")]
        started.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True))
        return started[-1]

    yield run
    for process in started:
        process.kill()
        process.wait()
        if process.stderr:
            process.stderr.close()


def latest(tmp_path: Path) -> Path:
    return (tmp_path / "runs" / "latest").resolve()


def reached(directory: Path, name: str = "learner_1") -> int:
    """The newest iteration that a learner has written down."""
    file = directory / "checkpoints" / name / "parameters.log"
    if not file.exists():
        return 0
    run = load_run(directory)
    like = build_learner(run.experiment, name).initial_state().parameters
    log = ParametersLog(file, Parameters(*like), run.digest)
    newest = log.newest
    log.close()
    return newest


def wait_until(condition: Callable[[], Any], timeout: float = 40.0) -> None:
    """Poll files and processes; there is nothing to subscribe to."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "not in time"
        time.sleep(0.05)


def finished(process: "subprocess.Popen[str]", timeout: float = 60.0) -> tuple[int, str]:
    _, errors = process.communicate(timeout=timeout)
    return process.returncode, errors


def assert_whole(directory: Path, last: int) -> None:
    """Certified, and to the bit what the algorithm in one loop gives."""
    run, summary = load_run(directory), json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    assert (summary["complete"], set(summary["last_iterations"].values())) == (True, {last})
    with run.open_history() as kept:
        assert_same_histories(kept.without_gap(), simulate_from_bag(run.experiment))
    assert subprocess.run([MABIRDS, "check", directory], capture_output=True, check=False).returncode == 0


def suspend_early(process: "subprocess.Popen[str]", tmp_path: Path) -> None:
    """Long before learners have as many iterations as they keep in memory."""
    wait_until(lambda: latest(tmp_path).is_dir() and reached(latest(tmp_path)) >= 4)
    process.send_signal(signal.SIGSTOP)


def test_a_suspended_supervisor_misses_nothing(
    make_experiment: Callable[..., Path], tmp_path: Path, start: Start
) -> None:
    """It sleeps while learners learn more than they keep in memory for those who ask."""
    process = start(make_experiment(iterations=280), "--hz", 60)
    suspend_early(process, tmp_path)
    wait_until(lambda: all(reached(latest(tmp_path), name) == 281 for name in ("learner_1", "learner_2")))
    process.send_signal(signal.SIGCONT)
    code, errors = finished(process)
    assert code == 0, errors
    assert_whole(latest(tmp_path), 281)


def test_what_nobody_knows_any_more_makes_a_run_incomplete(
    make_experiment: Callable[..., Path], tmp_path: Path, start: Start
) -> None:
    """As above, and the learner's log is gone, as it is on another host.

    A hundred iterations more than learners keep: sockets of a process that sleeps hold some dozens.
    """
    process = start(make_experiment(iterations=360), "--hz", 60)
    suspend_early(process, tmp_path)
    wait_until(lambda: reached(latest(tmp_path)) == reached(latest(tmp_path), "learner_2") == 361)
    log = latest(tmp_path) / "checkpoints" / "learner_2" / "parameters.log"
    os.truncate(log, HEADER)
    process.send_signal(signal.SIGCONT)
    code, errors = finished(process)
    summary = json.loads((latest(tmp_path) / "summary.json").read_text(encoding="utf-8"))
    assert code == 5, errors
    assert summary["complete"] is False
    assert summary["missing"][0].startswith("learner_2: iterations ")
    assert "incomplete: learner_2: iterations" in errors


def kill_in_the_middle(process: "subprocess.Popen[str]", directory: Callable[[], Path], after: int = 15) -> None:
    wait_until(lambda: directory().exists() and reached(directory()) > after)
    process.kill()
    process.communicate()
    wait_until(lambda: not _locked(directory()))


def _locked(directory: Path) -> bool:
    """Does a learner of the killed run still live?"""
    import fcntl

    for lock in (directory / "checkpoints").glob("*/lock"):
        with lock.open("wb") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
    return False


def test_a_killed_run_is_gone_on_with(make_experiment: Callable[..., Path], tmp_path: Path, start: Start) -> None:
    file = make_experiment(iterations=40)
    kill_in_the_middle(start(file, "--hz", 40), lambda: latest(tmp_path))
    directory = latest(tmp_path)
    code, errors = finished(start("--resume", directory))
    assert code == 0, errors
    assert "going on with" in errors
    assert_whole(directory, 41)
    assert latest(tmp_path) == directory


def test_the_same_command_with_the_same_name_goes_on(
    make_experiment: Callable[..., Path], tmp_path: Path, start: Start
) -> None:
    command = (make_experiment(iterations=40), "--hz", 40, "--run", "monday")
    kill_in_the_middle(start(*command), lambda: latest(tmp_path))
    code, errors = finished(start(*command))
    assert code == 0, errors
    assert_whole(latest(tmp_path), 41)
    code, errors = finished(start(*command))
    assert code == 0
    assert "is complete; there is nothing to go on with" in errors
    assert len(list((tmp_path / "runs").glob("2*"))) == 1


def test_another_bag_is_refused(make_experiment: Callable[..., Path], tmp_path: Path, start: Start) -> None:
    file = make_experiment(iterations=40)
    kill_in_the_middle(start(file, "--hz", 20), lambda: latest(tmp_path), after=5)
    other = load_experiment(file)
    shutil.rmtree(other.demonstrations.bag)
    shown = {"experts": "soft", "seed": 7}
    demonstrations = other.demonstrations.model_copy(update=shown)
    record(other.model_copy(update={"demonstrations": demonstrations}), other.demonstrations.bag)
    code, errors = finished(start("--resume", latest(tmp_path)))
    assert code == 2
    assert "holds other demonstrations" in errors.replace("\n", " ")
    assert "bring the first bag back, or start another run" in errors.replace("\n", " ")


def test_the_player_refuses_another_bag(make_experiment: Callable[..., Path], nodes: Any) -> None:
    file = make_experiment()
    with pytest.raises(BagError, match="other demonstrations .* than those with which this run began .0123"):
        nodes.player(file, bag_digest="0123")


def test_learners_refuse_the_bag_of_a_player_that_was_started_by_hand(
    make_experiment: Callable[..., Path], nodes: Any
) -> None:
    """It has their run and no digest to keep to; they know what they learned last, and go on with the first bag."""
    file = make_experiment(iterations=12)
    experiment = load_experiment(file)
    other = make_experiment(name="other", iterations=12, change={"demonstrations": {**OTHER_SHOWN, "per_learner": 12}})
    learners = [nodes.learner(file, name, status_period=0.2) for name in experiment.learners]
    for bag, reached in ((file.with_name("bag"), 5), (other.with_name("bag"), 5), (file.with_name("bag"), 13)):
        player = nodes.player(file, bag=str(bag), hz=10.0)
        nodes.spin_until(lambda least=reached: all(learner.session.iteration >= least for learner in learners))
        if bag.parent == other.parent:
            nodes.spin_until(lambda: all(learner._drops[OTHER_BAG] for learner in learners))
            nodes.spin_for(1.0)
            assert {learner.session.iteration for learner in learners} <= {5, 6, 7}
        nodes.executor.remove_node(player)
        nodes.all.remove(player)
        player.destroy_node()
    reference = simulate_from_bag(experiment)
    for learner in learners:
        assert bits(learner.session.parameters) == bits(reference[learner.learner_name][-1])


def test_of_two_players_with_different_bags_learners_believe_the_first(
    make_experiment: Callable[..., Path], nodes: Any
) -> None:
    """Demonstrations name the bag of their player; those of the other are refused by name, and no bit changes."""
    file = make_experiment(iterations=12)
    experiment = load_experiment(file)
    other = make_experiment(name="other", iterations=12, change={"demonstrations": {**OTHER_SHOWN, "per_learner": 12}})
    learners = [nodes.learner(file, name, status_period=0.2) for name in experiment.learners]
    players = []
    for bag, done in (
        (file.with_name("bag"), lambda learner: learner.session.iteration >= 4),
        (other.with_name("bag"), lambda learner: learner._drops[OTHER_BAG]),
    ):
        digest = digest_at_hand(experiment, file, (bag,), needed=True)
        players.append(nodes.player(file, bag=str(bag), bag_digest=digest, hz=5.0))
        nodes.spin_until(lambda done=done: all(map(done, learners)))
        players[0].control.set_paused(len(players) == 1)
    nodes.spin_until(lambda: all(learner.session.finished for learner in learners))
    reference = simulate_from_bag(experiment)
    for learner in learners:
        assert bits(learner.session.parameters) == bits(reference[learner.learner_name][-1])


@pytest.mark.parametrize("option", ["--only", "no bag"])
def test_what_cannot_run_is_seen_before_anything_starts(
    make_experiment: Callable[..., Path], tmp_path: Path, start: Start, option: str
) -> None:
    file = make_experiment()
    (tmp_path / "runs").mkdir()
    if option == "no bag":
        shutil.rmtree(load_experiment(file).demonstrations.bag)
        expected, arguments = f"there is no bag; record it: mabirds record {file}", ()
    else:
        expected, arguments = "--only learner_7: expected some of", ("--only", "learner_7")
    code, errors = finished(start(file, *arguments))
    assert (code, expected in errors) == (2, True), errors
    assert not list((tmp_path / "runs").iterdir())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mode": "in process", "network": None}, "ran in process and keeps no checkpoints"),
        ({"network": {"run": "x", "method": "bics"}}, "bics is a central method and keeps no checkpoints"),
    ],
)
def test_what_cannot_be_gone_on_with_is_refused(
    make_experiment: Callable[..., Path], tmp_path: Path, start: Start, change: dict[str, Any], words: str
) -> None:
    from mabirds_bringup.run.stored_run import RunPlan, begin

    file = make_experiment()
    made = begin(
        tmp_path / "runs", load_experiment(file), file, bag_digest=None, plan=RunPlan("x"), method=None
    ).directory
    manifest = {**json.loads((made / "manifest.json").read_text(encoding="utf-8")), **change}
    (made / "manifest.json").write_text(
        json.dumps({name: value for name, value in manifest.items() if value is not None}), encoding="utf-8"
    )
    code, errors = finished(start("--resume", made))
    assert (code, words in errors) == (2, True), errors


def test_a_run_of_which_nothing_is_known_is_incomplete(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    from mabirds_bringup.run.stored_run import RunPlan, begin

    file = make_experiment()
    made = begin(tmp_path, load_experiment(file), file, bag_digest=None, plan=RunPlan("x"), method=None).directory
    (made / "parameters").mkdir()
    assert subprocess.run([MABIRDS, "report", made], capture_output=True, check=False).returncode == 5
    missing = json.loads((made / "summary.json").read_text(encoding="utf-8"))["missing"]
    assert missing[-1] == "nothing is known of iteration 1 of learner_1, learner_2"


def test_without_a_file_nothing_runs(tmp_path: Path, start: Start) -> None:
    code, errors = finished(start())
    assert code == 2
    assert "Missing argument EXPERIMENT" in errors
    assert not (tmp_path / "runs").exists()
