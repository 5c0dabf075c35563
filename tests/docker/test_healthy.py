"""The healthcheck: passes for a node that speaks, and for no other."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.node import Node

from mabirds_bringup.run import processes
from mabirds_bringup.run.processes import NodeProcess, learner_command

HEALTHY = Path(__file__).resolve().parents[2] / "docker" / "healthy.py"


def check(name: str, seconds: float) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, str(HEALTHY), name, str(seconds)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture
def learner(make_experiment: Callable[..., Path], tmp_path: Path) -> Iterator[NodeProcess]:
    """learner_1, waiting for a first demonstration."""
    process = processes.start("learner_1", learner_command("learner_1", make_experiment()), tmp_path)
    yield process
    process.popen.send_signal(signal.SIGCONT)
    processes.stop([process])


def test_a_node_that_speaks_is_healthy_and_no_other(learner: NodeProcess) -> None:
    done = check("learner_1", 20)
    assert done.returncode == 0
    assert done.stdout.startswith("learner_1: iteration 1: waits for demonstration")
    done = check("learner_2", 2)
    assert (done.returncode, done.stdout) == (1, "error: nothing heard of learner_2 within 2 s\n")
    os.kill(learner.popen.pid, signal.SIGSTOP)  # it is still there, and does nothing
    assert check("learner_1", 3).returncode == 1


def test_without_a_name_it_says_how_to_use_it() -> None:
    command = [sys.executable, str(HEALTHY)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "usage: mabirds-healthy NAME" in done.stdout


def test_where_security_hides_diagnostics_the_graph_tells(
    load_program: Callable[[str], ModuleType], context: Context
) -> None:
    healthy = load_program("healthy")
    observer = Node("observer", context=context)
    nodes: list[Any] = [observer, Node("learner", namespace="/depot/learner_1", context=context)]
    nodes.append(Node("expert_player", context=context))
    for name, words in (("learner_1", "/depot/learner_1/learner"), ("expert_player", "/expert_player")):
        assert healthy.on_the_graph(observer, name) == f"{words} is there"
    for name in ("learner_2", "depot", "learner_10"):
        assert healthy.on_the_graph(observer, name) is None
    for node in nodes:
        node.destroy_node()
