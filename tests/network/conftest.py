"""Nodes in this process, on an executor of the test's choice, and processes that are always stopped."""

import os
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from mabirds_expert_player.player_node import ExpertPlayerNode
from mabirds_learner.learner_node import LearnerNode

SpinUntil = Callable[[Callable[[], Any]], None]


class Nodes:
    """Makes nodes in one context and spins them together."""

    def __init__(self, context: Context, executor: Executor) -> None:
        self.context, self.executor = context, executor
        self.all: list[Node] = []

    def add(self, node: Node) -> Node:
        self.executor.add_node(node)
        self.all.append(node)
        return node

    def learner(self, file: Path, name: str, **parameters: Any) -> LearnerNode:
        overrides = overrides_of(experiment=str(file), **parameters)
        return self.add(LearnerNode(context=self.context, namespace=f"/{name}", parameter_overrides=overrides))

    def player(self, file: Path, **parameters: Any) -> ExpertPlayerNode:
        overrides = overrides_of(experiment=str(file), **parameters)
        return self.add(ExpertPlayerNode(context=self.context, parameter_overrides=overrides))

    def plain(self, name: str = "test") -> Node:
        return self.add(Node(name, context=self.context))

    def spin_until(self, condition: Callable[[], Any], timeout: float = 20.0) -> None:
        """Spin until the condition holds; fails the test after ``timeout`` seconds."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"not within {timeout} s: {condition}"
            self.executor.spin_once(timeout_sec=0.05)

    def spin_for(self, seconds: float) -> None:
        """Spin for a while, to see that something does not happen."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, client: Any, request: Any) -> Any:
        """Call a service and wait for its answer."""
        self.spin_until(client.service_is_ready)
        future = client.call_async(request)
        self.spin_until(future.done)
        return future.result()


def overrides_of(**parameters: Any) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in parameters.items()]


@pytest.fixture
def nodes(context: Context) -> Iterator[Nodes]:
    """Nodes on a SingleThreadedExecutor."""
    executor = SingleThreadedExecutor(context=context)
    made = Nodes(context, executor)
    yield made
    made.executor.shutdown(timeout_sec=5)
    for node in made.all:
        node.destroy_node()


@pytest.fixture
def start_process(tmp_path: Path) -> Iterator[Callable[[Sequence[str]], "subprocess.Popen[str]"]]:
    """A function that starts a process with its output piped; what is left at the end is killed."""
    started: list[subprocess.Popen[str]] = []

    def start(command: Sequence[str]) -> "subprocess.Popen[str]":
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "ROS_LOG_DIR": str(tmp_path / "log"), "PYTHONUNBUFFERED": "1"},
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()
