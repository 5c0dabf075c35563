"""The ``mabirds`` command as people and scripts use it."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml
from rosbags.rosbag2 import Reader

from mabirds_bringup.report.said import TIMES
from mabirds_bringup.run.processes import learner_command

MABIRDS = [str(Path(sys.executable).with_name("mabirds"))]


def mabirds(*arguments: object, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [*MABIRDS, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=60, check=False)


def wait_until(condition: Callable[[], Any], timeout: float = 20.0) -> Any:
    """Poll a condition on processes or files; there is nothing to subscribe to."""
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        assert time.monotonic() < deadline, "not in time"
        time.sleep(0.02)
    return value


@pytest.fixture
def file(make_experiment: Callable[..., Path]) -> Path:
    return make_experiment(iterations=8)


@pytest.fixture(scope="module")
def shared_file(make_shared_experiment: Callable[..., Path]) -> Path:
    return make_shared_experiment(iterations=8)


def in_place(verb: str, *arguments: object, cwd: Path) -> tuple[Path, dict[str, Any]]:
    """The run directory that a command made, and what it said."""
    result = mabirds(verb, *arguments, "--json", cwd=cwd)
    assert result.returncode == 0, result.stderr
    summary: dict[str, Any] = json.loads(result.stdout)
    return cwd / "runs" / "latest", summary


@pytest.fixture(scope="module")
def finished_run(
    shared_file: Path, shared_ros_domain: int, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    """``mabirds run`` that has ended."""
    return in_place("run", shared_file, "--hz", 20, cwd=tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def simulation(shared_file: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """``mabirds simulate`` of the same experiment."""
    return in_place("simulate", shared_file, cwd=tmp_path_factory.mktemp("simulation"))


def test_run_fills_the_run_directory(finished_run: tuple[Path, dict[str, Any]]) -> None:
    latest, summary = finished_run
    assert summary == json.loads((latest / "summary.json").read_text(encoding="utf-8"))
    for row in summary["learners"].values():
        assert row["iterations"] == 8
        rates = ("violation_rate", "success_rate", "false_positive_rate", "false_negative_rate")
        assert all(0 <= row[rate] <= 1 for rate in rates)
    assert {"theta", "omega", "policy"} == set(summary["consensus_distance"])
    assert (latest / "report.html").read_text(encoding="utf-8").count("<img") == 4
    assert {file.name for file in (latest / "logs").glob("*.log")} == {
        "learner_1.log",
        "learner_2.log",
        "expert_player.log",
    }
    assert all(column in (latest / "report.html").read_text(encoding="utf-8") for column in TIMES)
    for picture in ("map.png", "curves.png", "schedule.png", "delivered.png"):
        assert (latest / picture).read_bytes().startswith(b"\x89PNG")


def test_run_metrics_hold_every_learner_and_iteration(finished_run: tuple[Path, dict[str, Any]]) -> None:
    with (finished_run[0] / "metrics.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["learner"], int(row["iteration"])) for row in rows] == [
        (name, n) for name in ("learner_1", "learner_2") for n in range(1, 10)
    ]


def test_the_recording_holds_all_parameters_and_no_demonstration(finished_run: tuple[Path, dict[str, Any]]) -> None:
    with Reader(finished_run[0] / "bag") as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert counts["/learner_1/parameters"] == counts["/learner_2/parameters"] == 9
    assert counts["/learner_1/status"] > 0
    assert not [topic for topic in counts if "demonstration" in topic]


def test_simulate_gives_the_same_summary_as_run(
    finished_run: tuple[Path, dict[str, Any]], simulation: tuple[Path, dict[str, Any]]
) -> None:
    run, simulated = (dict(summary) for _, summary in (finished_run, simulation))
    assert run.pop("wall_seconds") > 0
    assert simulated.pop("wall_seconds") > 0
    assert run.pop("delivered_graph") == {"iterations": 8, "edge_mismatches": [], "connectivity_window": 1}
    assert run == simulated


def test_manifest_names_versions_seeds_and_digests(simulation: tuple[Path, dict[str, Any]]) -> None:
    manifest = json.loads((simulation[0] / "manifest.json").read_text(encoding="utf-8"))
    assert set(manifest["digests"]) == {"game", "experiment", "schedule", "bag"}
    assert manifest["seeds"] == {"learners": 3, "demonstrations": 0}
    assert all(manifest["versions"].values())


def children_of(process: "subprocess.Popen[str]") -> list[psutil.Process]:
    """What a run has started, once all three nodes and the judge are there."""
    found = psutil.Process(process.pid).children()
    return found if len(found) == 4 else []


@pytest.fixture
def slow_run(file: Path, tmp_path: Path) -> Any:
    """``mabirds run`` at a rate that will not end by itself, with all that it has started; it restarts none."""
    command = [*MABIRDS, "run", str(file), "--rate", "0.05", "--restarts", "0"]
    # Under nohup and some test runners SIGINT is ignored, which children inherit.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, before)
    children = wait_until(lambda: children_of(process))
    # A node opens its log when ROS is up in it; the player says when it is ready.
    logs = tmp_path / "runs" / "latest" / "logs" / "ros"
    wait_until(lambda: len(list(logs.glob("*.log"))) == 3)
    wait_until(lambda: any("waiting for learner_1" in log.read_text(encoding="utf-8") for log in logs.glob("*.log")))
    yield process, children
    process.kill()
    process.communicate()


def gone(children: list[psutil.Process]) -> bool:
    return not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_run_leaves_its_recording_and_nothing_else_behind(
    slow_run: Any, tmp_path: Path, number: int
) -> None:
    process, children = slow_run
    process.send_signal(number)
    _, errors = process.communicate(timeout=15)
    assert process.returncode == 130
    assert "interrupted; everything was stopped" in errors
    assert "Traceback" not in errors
    assert gone(children)
    summary = json.loads((tmp_path / "runs" / "latest" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["complete"], summary["missing"][-1]) == (False, "interrupted")
    bag = tmp_path / "runs" / "latest" / "bag"
    assert (bag / "metadata.yaml").is_file()
    with Reader(bag) as reader:  # whole: index, footer and all
        assert {connection.topic.split("/")[1] for connection in reader.connections} <= {"learner_1", "learner_2"}


def test_a_run_whose_learner_dies_stops_the_rest_and_names_it(slow_run: Any) -> None:
    process, children = slow_run
    victim = next(child for child in children if "/learner_2" in " ".join(child.cmdline()))
    victim.kill()
    _, errors = process.communicate(timeout=15)
    assert process.returncode == 3
    assert re.search(r"error: learner_2 ended with exit code -9 \(SIGKILL\); the end of .*learner_2\.log", errors)
    assert gone(children)


def test_a_run_whose_player_leaves_early_stops_the_rest(slow_run: Any) -> None:
    process, children = slow_run
    next(child for child in children if "mabirds_expert_player" in " ".join(child.cmdline())).terminate()
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 3
    assert "expert_player ended with exit code 0" in errors
    assert gone(children)


def test_nodes_do_not_outlive_a_killed_run(slow_run: Any) -> None:
    """Not even one that was stopped before."""
    process, children = slow_run
    children[0].send_signal(signal.SIGSTOP)
    process.kill()
    wait_until(lambda: gone(children))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("run", "missing.yaml"), "error: missing.yaml: cannot be read"),
        (("run",), "Missing argument"),
        (("run", "x", "--rate", "-1"), "--rate"),
        (("simulate", "odd.yaml"), "odd.yaml: expected the settings of an experiment, found list"),
        (("record", "experiment/experiment.yaml"), "bag: exists already"),
        (("bag", "check", "nowhere"), "nowhere: is not there; give the directory of a rosbag2 bag"),
        (("inspect", "--json"), "--json prints one object and needs --once"),
    ],
)
def test_bad_input_is_one_message_and_exit_code_2(
    file: Path, tmp_path: Path, arguments: tuple[str, ...], text: str
) -> None:
    (tmp_path / "odd.yaml").write_text("- 1\n", encoding="utf-8")
    result = mabirds(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert text in result.stderr.replace("\n", " ")
    assert "Traceback" not in result.stderr
    assert result.stdout == ""


def test_record_makes_the_bag_of_the_experiment(file: Path, tmp_path: Path) -> None:
    assert mabirds("record", file, "--bag", "again", cwd=tmp_path).returncode == 0
    result = mabirds("bag", "check", "again", "--experiment", file, "--json", cwd=tmp_path)
    assert json.loads(result.stdout)["demonstrations"] == {"learner_1": 8, "learner_2": 8}


def test_experts_without_a_way_are_refused_and_leave_no_bag(file: Path, tmp_path: Path) -> None:
    settings = yaml.safe_load(file.read_text(encoding="utf-8"))
    settings["game"]["horizon"] = 2
    file.write_text(yaml.safe_dump(settings), encoding="utf-8")
    result = mabirds("record", file, "--bag", "again", cwd=tmp_path)
    assert result.returncode == 2
    assert "1 of 1 starts have no way to the goal within 2 steps" in result.stderr.replace("\n", " ")
    assert not (tmp_path / "again").exists()


def test_a_place_that_cannot_be_written_is_refused(file: Path, tmp_path: Path) -> None:
    (tmp_path / "occupied").write_text("a file, not a directory", encoding="utf-8")
    result = mabirds("run", file, "--out", "occupied", cwd=tmp_path)
    assert result.returncode == 2
    assert "occupied: File exists; choose a place that can be read and written" in result.stderr.replace("\n", " ")


@pytest.mark.parametrize("verb", [(), ("run",), ("simulate",), ("record",), ("inspect",), ("bag", "check")])
def test_every_command_has_help(tmp_path: Path, verb: tuple[str, ...]) -> None:
    result = mabirds(*verb, "--help", cwd=tmp_path)
    assert result.returncode == 0
    assert ("Example:" if verb else "Exit codes") in result.stdout


def test_inspect_once_shows_every_learner(file: Path, tmp_path: Path) -> None:
    logs = {"env": {**os.environ, "ROS_LOG_DIR": str(tmp_path)}, "stdout": subprocess.DEVNULL}
    learners = [subprocess.Popen(learner_command(name, file), **logs) for name in ("learner_1", "learner_2")]
    try:
        result = mabirds("inspect", "--once", "--json", "--top", 2, cwd=tmp_path)
    finally:
        for learner in learners:
            learner.terminate()
            learner.wait(timeout=10)
    assert result.returncode == 0, result.stderr
    content = json.loads(result.stdout)
    assert content["missing"] == []
    assert set(content["learners"]) == {"/learner_1", "/learner_2"}
    for learner in content["learners"].values():
        assert learner["state"] == "waits for a demonstration"
        assert learner["parameters"]["iteration"] == 1
        assert learner["iterations_per_second"] in {None, 0.0}
        assert [one["feature"] for one in learner["parameters"]["costliest"]] == [
            "expert_1 in (0, 0)",
            "expert_1 in (0, 1)",
        ]


def test_inspect_finds_nobody(tmp_path: Path) -> None:
    result = mabirds("inspect", "--once", "--timeout", 1, cwd=tmp_path)
    assert result.returncode == 4
    assert "no learner found" in result.stderr
