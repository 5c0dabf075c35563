"""Write the configurations of RViz and Foxglove: ros_ws/rviz/mabirds.rviz and ros_ws/foxglove/mabirds.json.

They name topics as `mabirds draw` publishes them for learner_1 and learner_2 with two experts; a test compares them
with what is published. `python tools/display_files.py` writes them anew.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from mabirds_bringup.draw import names

ROOT = Path(__file__).resolve().parents[1]
RVIZ, FOXGLOVE = ROOT / "ros_ws" / "rviz" / "mabirds.rviz", ROOT / "ros_ws" / "foxglove" / "mabirds.json"
LEARNERS, EXPERTS = ("/learner_1", "/learner_2"), (0, 1)
PLOTTED = ("iteration", "backlog", "omega_norm", "iteration_seconds")
DIAGNOSTICS = "/diagnostics"


def drawn_topics() -> dict[str, str]:
    """Topics that are shown, with their types."""
    topics = {f"/{names.DRAWN}/{last}": "visualization_msgs/msg/MarkerArray" for last in (names.SCENE, names.NETWORK)}
    for learner in LEARNERS:
        topics[names.of_learner(learner, names.MARKERS)] = "visualization_msgs/msg/MarkerArray"
        for expert in map(names.of_expert, EXPERTS):
            for kind in (names.COSTS, names.KEEPOUT):
                topics[names.of_learner(learner, kind, expert)] = "nav_msgs/msg/OccupancyGrid"
            topics[names.of_learner(learner, names.IMAGINED, expert)] = "nav_msgs/msg/Path"
    return topics


DISPLAYS = {
    "visualization_msgs/msg/MarkerArray": "rviz_default_plugins/MarkerArray",
    "nav_msgs/msg/OccupancyGrid": "rviz_default_plugins/Map",
    "nav_msgs/msg/Path": "rviz_default_plugins/Path",
}


def rviz() -> dict[str, Any]:
    """The configuration of RViz: all displays, of which the costs of expert 1 and the markers are on."""
    quality = {"Depth": 1, "Durability Policy": "Transient Local", "Reliability Policy": "Reliable"}
    displays = [
        {
            "Class": DISPLAYS[kind],
            "Name": topic.strip("/").replace("/drawn/", " ").replace("/", " "),
            "Enabled": "keepout" not in topic and "costs/expert_2" not in topic,
            "Topic": {"Value": topic, **quality},
        }
        for topic, kind in drawn_topics().items()
    ]
    manager = {
        "Global Options": {"Fixed Frame": "map", "Background Color": "240; 240; 240"},
        "Displays": displays,
        "Views": {"Current": {"Class": "rviz_default_plugins/TopDownOrtho", "Scale": 60, "X": 6, "Y": 3.5}},
    }
    return {"Panels": [{"Class": "rviz_common/Displays", "Name": "Displays"}], "Visualization Manager": manager}


def foxglove() -> dict[str, Any]:
    """The layout of Foxglove: a 3D panel beside plots of numbers by name, and diagnostics."""
    panels: dict[str, Any] = {
        "3D!scene": {
            "followTf": "map",
            "topics": {topic: {"visible": "keepout" not in topic} for topic in drawn_topics()},
        },
        "DiagnosticSummary!health": {"topicToRender": DIAGNOSTICS},
    }
    for name in PLOTTED:
        scalars = [names.of_learner(learner, names.SCALARS, name) for learner in LEARNERS]
        panels[f"Plot!{name}"] = _plot([f"{topic}.data" for topic in scalars])
    consensus = [f"/{names.DRAWN}/{names.CONSENSUS}/{part}" for part in ("theta", "omega")]
    panels["Plot!consensus"] = _plot([f"{topic}.data" for topic in consensus])
    column = _stacked(["DiagnosticSummary!health", *(name for name in panels if name.startswith("Plot!"))])
    layout = {"first": "3D!scene", "second": column, "direction": "row", "splitPercentage": 60}
    return {"configById": panels, "globalVariables": {}, "userNodes": {}, "layout": layout}


def _plot(values: Sequence[str]) -> dict[str, Any]:
    paths = [{"value": value, "enabled": True, "timestampMethod": "receiveTime"} for value in values]
    return {"paths": paths, "showLegend": True, "legendDisplay": "top", "isSynced": True}


def _stacked(panels: list[str]) -> Any:
    """Panels one below the other, of the same height."""
    if len(panels) == 1:
        return panels[0]
    share = 100 / len(panels)
    return {"first": panels[0], "second": _stacked(panels[1:]), "direction": "column", "splitPercentage": share}


def write() -> None:
    """Write both files."""
    RVIZ.write_text(f"# Written by tools/{Path(__file__).name}\n{yaml.safe_dump(rviz(), sort_keys=False)}")
    FOXGLOVE.write_text(json.dumps(foxglove(), indent=2) + "\n")


if __name__ == "__main__":
    write()
