"""Start an experiment on a stock ROS installation: each learner in its namespace, and the expert player.

    ros2 launch mabirds_bringup experiment.launch.py experiment:=/path/to/drones.yaml rate:=10.0

These are the nodes of ``mabirds run``, which also watches them, ends when they are done, and reports. Here learners
stay until Ctrl-C. It takes the packages ``launch`` and ``launch_ros`` of a ROS installation.
"""

from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.security import enclave_arguments

PATROL = Path(__file__).resolve().parents[1] / "config" / "patrol.yaml"

ARGUMENTS = {
    "experiment": (str(PATROL), "experiment file"),
    "run": ("", "name of this run; what belongs to others is refused"),
    "bag": ("", "bag to play; empty: the experiment's"),
    "rate": ("1.0", "speed, as a multiple of the recorded timing"),
    "hz": ("0.0", "demonstrations per second; 0: the recorded timing times rate"),
    "checkpoints": ("", "directory with one below it for each learner's checkpoints; empty: none"),
}
"""Default and description of each."""

RESPAWN_DELAY = 1.0
"""Seconds before a learner that died is started again; it goes on from its checkpoints."""


def generate_launch_description() -> LaunchDescription:
    """What ``ros2 launch`` asks for."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=words)
        for name, (default, words) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    """The nodes of the experiment, once the arguments are known."""
    values = {name: str(LaunchConfiguration(name).perform(context)) for name in ARGUMENTS}
    file = Path(values["experiment"]).absolute()
    common = {"experiment": _text(str(file)), "run": _text(values["run"])}
    played = {"bag": _text(values["bag"]), "rate": float(values["rate"]), "hz": float(values["hz"])}
    names = load_experiment(file).learners
    return [*(_learner(name, common, values["checkpoints"]) for name in names), _player({**common, **played})]


def _text(value: str) -> ParameterValue:
    """A string, even where it looks like a number."""
    return ParameterValue(value, value_type=str)


def _learner(name: str, common: dict[str, Any], checkpoints: str) -> Node:
    own = {"checkpoints": _text(str(Path(checkpoints, name).absolute()))} if checkpoints else {}
    return Node(
        package="mabirds_learner",
        executable="mabirds-learner",
        namespace=f"/{name}",
        parameters=[{**common, **own}],
        ros_arguments=enclave_arguments(f"/{name}"),
        respawn=bool(checkpoints),
        respawn_delay=RESPAWN_DELAY,
        output="screen",
    )


def _player(parameters: dict[str, Any]) -> Node:
    return Node(
        package="mabirds_expert_player",
        executable="mabirds-expert-player",
        parameters=[parameters],
        ros_arguments=enclave_arguments("/expert_player"),
        output="screen",
    )
