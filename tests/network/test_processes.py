"""Nodes as processes: they end when asked, name bad input in one line, and stay small."""

import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import psutil
import pytest
from mabirds_msgs.msg import LearnerStatus

from mabirds_bringup.run.processes import learner_command, player_command
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.qos import STATUS_QOS

Start = Callable[[Sequence[str]], "subprocess.Popen[str]"]
PATROL = Path(__file__).resolve().parents[2] / "ros_ws" / "config" / "patrol.yaml"

MEBIBYTE = 2**20


@pytest.fixture
def statuses(nodes: Any) -> dict[str, LearnerStatus]:
    """The newest status of learner_1."""
    newest: dict[str, LearnerStatus] = {}
    nodes.plain("listener").create_subscription(
        LearnerStatus, "/learner_1/status", lambda status: newest.update(learner_1=status), STATUS_QOS
    )
    return newest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_learner_ends_cleanly_when_asked(
    make_experiment: Callable[..., Path], nodes: Any, statuses: Any, start_process: Start, number: int
) -> None:
    process = start_process(learner_command("learner_1", make_experiment()))
    nodes.spin_until(lambda: statuses)
    process.send_signal(number)
    output, _ = process.communicate(timeout=5)
    assert process.returncode == 0
    assert "Traceback" not in output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_player_ends_cleanly_when_asked(
    make_experiment: Callable[..., Path], nodes: Any, start_process: Start, number: int
) -> None:
    process = start_process(player_command(make_experiment(), {}))
    observer = nodes.plain("observer")
    nodes.spin_until(lambda: observer.get_publishers_info_by_topic("/learner_2/demonstration"))
    process.send_signal(number)
    output, _ = process.communicate(timeout=5)
    assert process.returncode == 0
    assert "Traceback" not in output


@pytest.mark.parametrize("command", [learner_command, player_command])
def test_one_alone_says_so_within_five_seconds(
    make_experiment: Callable[..., Path], start_process: Start, ros_domain: int, command: Callable[..., list[str]]
) -> None:
    """A learner or a player in the wrong ROS domain."""
    file = make_experiment()
    process = start_process(player_command(file, {}) if command is player_command else command("learner_1", file))
    assert process.stdout
    begin = time.monotonic()
    said = next(line for line in process.stdout if f"nobody heard in ROS domain {ros_domain}" in line)
    assert "compare ROS_DOMAIN_ID" in said
    assert time.monotonic() - begin < 5 + 3  # and what a process takes to start


def bad_learner(file: Path, **_: Any) -> list[str]:
    return learner_command("learner_9", file)


def missing_file(file: Path, **_: Any) -> list[str]:
    return learner_command("learner_1", file.with_name("missing.yaml"))


def wrong_parameter(file: Path, **_: Any) -> list[str]:
    return [*learner_command("learner_1", file), "-p", "status_period:=-1.0"]


def wrong_type(file: Path, **_: Any) -> list[str]:
    return [*player_command(file, {}), "-p", "rate:=fast"]


def wrong_arguments(file: Path, **_: Any) -> list[str]:
    return [*player_command(file, {}), "-r", "nonsense"]


def damaged_bag(file: Path, **_: Any) -> list[str]:
    mcap = next((file.parent / "bag").glob("*.mcap"))
    content = bytearray(mcap.read_bytes())
    content[300] ^= 1  # in the first chunk
    mcap.write_bytes(content)
    return player_command(file, {})


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (bad_learner, "'learner_9' is none of the learners ['learner_1', 'learner_2']"),
        (missing_file, "missing.yaml: cannot be read"),
        (wrong_parameter, "status_period"),
        (wrong_type, "rate"),
        (wrong_arguments, "nonsense"),
        (damaged_bag, "bag_0.mcap: crc validation failed"),
    ],
)
def test_bad_input_is_one_message_and_exit_code_2(
    make_experiment: Callable[..., Path], start_process: Start, command: Callable[..., list[str]], text: str
) -> None:
    process = start_process(command(file=make_experiment()))
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 2
    assert "error: " in output
    assert text.lower() in output.lower()
    assert "Traceback" not in output


@pytest.mark.parametrize("node", ["mabirds_learner", "mabirds_expert_player"])
def test_help_shows_an_example_and_exit_codes(start_process: Start, node: str) -> None:
    import sys

    process = start_process([sys.executable, "-m", node, "--help"])
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "example:" in output
    assert "Exit codes:" in output


def test_a_waiting_learner_is_small_and_idle(nodes: Any, statuses: Any, start_process: Start) -> None:
    """The shipped patrol experiment: under 150 MB resident, under 5 % of a core while nothing arrives."""
    process = start_process(learner_command("learner_1", PATROL))
    nodes.spin_until(lambda: statuses)
    learner = psutil.Process(process.pid)
    before, start = cpu_seconds(learner), time.monotonic()
    nodes.spin_for(4.0)
    share = (cpu_seconds(learner) - before) / (time.monotonic() - start)
    assert share < 0.05
    assert learner.memory_info().rss < 150 * MEBIBYTE


def test_a_busy_learner_is_small(nodes: Any, statuses: Any, start_process: Start) -> None:
    """The same while it learns: the whole patrol run."""
    names = load_experiment(PATROL).learners
    learners = [start_process(learner_command(name, PATROL)) for name in names]
    start_process(player_command(PATROL, {"hz": 1000.0}))
    nodes.spin_until(lambda: statuses and statuses["learner_1"].state == LearnerStatus.FINISHED)
    for process in learners:
        assert psutil.Process(process.pid).memory_info().rss < 150 * MEBIBYTE


def cpu_seconds(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
