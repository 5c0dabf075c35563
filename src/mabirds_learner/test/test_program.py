"""The learner as a program: it starts, keeps its first checkpoint and ends as asked."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from mabirds_learner.learner_node import HELP

EXPERIMENT = """
name: corridor
game: {kind: patrol, map: "...", starts: [[[0, 0]]], goals: [[0, 2]], horizon: 3}
algorithm: {steps: {alpha: 2.0, beta: 1.0}}
learners: [learner_1, learner_2]
schedule: {kind: static}
demonstrations: {bag: bag, per_learner: 4}
iterations: 4
constraint_threshold: 0.1
"""

COMMAND = [sys.executable, "-m", "mabirds_learner"]


def start(directory: Path, *arguments: str) -> "subprocess.Popen[str]":
    domain = {"ROS_DOMAIN_ID": str(1 + os.getpid() % 101), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    environment = {**os.environ, **domain, "ROS_LOG_DIR": str(directory / "log")}
    return subprocess.Popen([*COMMAND, *arguments], env=environment, stderr=subprocess.PIPE, text=True)


def test_the_program_says_what_it_takes() -> None:
    done = subprocess.run([*COMMAND, "--help"], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, HELP.strip())


def test_it_starts_in_its_namespace_and_ends_as_asked(tmp_path: Path) -> None:
    file, checkpoints = tmp_path / "corridor.yaml", tmp_path / "checkpoints"
    file.write_text(EXPERIMENT, encoding="utf-8")
    parameters = ["-p", f"experiment:={file}", "-p", f"checkpoints:={checkpoints}"]
    with start(tmp_path, "--ros-args", "-r", "__ns:=/learner_1", *parameters) as process:
        deadline = time.monotonic() + 60
        while not list(checkpoints.glob("journal")):
            assert process.poll() is None
            assert time.monotonic() < deadline, "no checkpoint within a minute"
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=20) == 0


def test_a_name_that_the_experiment_does_not_have_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "corridor.yaml"
    file.write_text(EXPERIMENT, encoding="utf-8")
    with start(tmp_path, "--ros-args", "-r", "__ns:=/learner_9", "-p", f"experiment:={file}") as process:
        _, words = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "'learner_9' is none of the learners" in words
