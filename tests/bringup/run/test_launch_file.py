"""The launch file for stock installations starts what ``mabirds run`` starts.

``launch`` is in no pip wheel, so the parts of it that the file uses have stand-ins here.
"""

import importlib.util
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from mabirds_bringup.run.processes import learner_command, player_command
from mabirds_core.experiment.file import load_experiment

LAUNCH_FILE = Path(__file__).resolve().parents[3] / "ros_ws" / "launch" / "experiment.launch.py"


@dataclass
class LaunchDescription:
    entities: list[Any]


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: str
    description: str


@dataclass
class OpaqueFunction:
    function: Callable[[Any], list[Any]]


@dataclass
class LaunchContext:
    launch_configurations: dict[str, str]


@dataclass
class LaunchConfiguration:
    name: str

    def perform(self, context: LaunchContext) -> str:
        return context.launch_configurations[self.name]


@dataclass
class ParameterValue:
    """Text; without this, launch takes what looks like a number for one."""

    value: str
    value_type: type


@dataclass
class Node:
    package: str
    executable: str
    parameters: Sequence[dict[str, Any]]
    ros_arguments: Sequence[str]
    output: str
    namespace: str | None = None
    respawn: bool = False
    respawn_delay: float | None = field(default=None)

    @property
    def values(self) -> dict[str, Any]:
        """Parameters by name, as the node gets them."""
        (given,) = self.parameters
        assert all(isinstance(value, ParameterValue | float) for value in given.values())
        return {name: getattr(value, "value", value) for name, value in given.items()}


STAND_INS = {
    "launch": [LaunchContext, LaunchDescription],
    "launch.actions": [DeclareLaunchArgument, OpaqueFunction],
    "launch.substitutions": [LaunchConfiguration],
    "launch_ros": [],
    "launch_ros.actions": [Node],
    "launch_ros.parameter_descriptions": [ParameterValue],
}

Launch = Callable[..., list[Node]]


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch) -> Launch:
    """A function that launches the file as ``ros2 launch FILE NAME:=VALUE`` would, and returns the nodes."""
    for name, members in STAND_INS.items():
        module = ModuleType(name)
        vars(module).update({member.__name__: member for member in members})
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("experiment_launch", LAUNCH_FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def run(**given: str) -> list[Node]:
        *declared, action = module.generate_launch_description().entities
        defaults = {argument.name: argument.default_value for argument in declared}
        assert set(given) <= set(defaults)
        return list(action.function(LaunchContext({**defaults, **given})))

    return run


def parameters(command: Sequence[str]) -> dict[str, Any]:
    """ROS parameters of a command line."""
    given = [word.partition(":=") for before, word in pairwise(command) if before == "-p"]
    return {name: json.loads(value) for name, _, value in given}


def namespace(command: Sequence[str]) -> str:
    (found,) = [word.removeprefix("__ns:=") for word in command if word.startswith("__ns:=")]
    return found


def module_of(node: Node) -> str:
    """The module that a node's executable runs."""
    (script,) = [one for one in entry_points(group="console_scripts") if one.name == node.executable]
    assert script.dist is not None
    assert script.dist.name.replace("-", "_") == node.package
    return script.module


def test_the_nodes_are_those_of_mabirds_run(
    make_experiment: Callable[..., Path], tmp_path: Path, launch: Launch
) -> None:
    file, checkpoints = make_experiment(learners=3), tmp_path / "checkpoints"
    nodes = launch(experiment=str(file), run="12", checkpoints=str(checkpoints), rate="10", bag="other bag")
    *learners, player = nodes
    names = load_experiment(file).learners
    for node, name in zip(learners, names, strict=True):
        command = learner_command(name, file, run="12", checkpoints=str(checkpoints / name))
        assert (node.namespace, node.values) == (namespace(command), parameters(command))
        assert module_of(node) == "mabirds_learner.__main__"
        assert node.respawn
    command = player_command(file, {"run": "12", "bag": "other bag", "rate": 10.0, "hz": 0.0})
    assert (player.namespace, player.values) == (None, parameters(command))
    assert module_of(player) == "mabirds_expert_player.__main__"
    assert not player.respawn
    assert not any(node.ros_arguments for node in nodes)


def test_without_arguments_it_is_the_patrol_beside_it(launch: Launch) -> None:
    *learners, player = launch()
    patrol = LAUNCH_FILE.parents[1] / "config" / "patrol.yaml"
    assert [node.namespace for node in learners] == ["/learner_1", "/learner_2"]
    assert {node.values["experiment"] for node in (*learners, player)} == {str(patrol)}
    assert not any(node.respawn or "checkpoints" in node.values for node in learners)


def test_with_security_every_node_has_its_enclave(launch: Launch, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    enclaves = [["--enclave", f"/{name}"] for name in ("learner_1", "learner_2", "expert_player")]
    assert [node.ros_arguments for node in launch()] == enclaves
